"""The process that a file belongs to, as another process sees it."""

from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from furrowmap.exporters.files import owner as module
from furrowmap.exporters.files.atomic import relative_path
from furrowmap.exporters.files.owner import Owner, machine

linux = pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")


@given(st.text("0123456789abcdef", min_size=8, max_size=8), st.integers(0, 10**10 - 1), st.integers(0, 10**20 - 1))
def test_words__say_who_it_is(host: str, process: int, started: int) -> None:
    owner = Owner(host, process, started)
    assert Owner.parse(owner.words()) == owner
    for other in (f"{owner.words()}x", f"x{owner.words()}", owner.words().replace("-", "_"), ""):
        assert Owner.parse(other) is None


@linux
def test_owner__runs_until_it_ends() -> None:
    here = Owner.here()
    assert here == Owner(machine(), os.getpid(), here.started)
    assert here.started > 0
    assert here.is_running() is True
    with subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE) as process:
        stat = Path(f"/proc/{process.pid}/stat").read_text()
        other = Owner(machine(), process.pid, int(stat.rpartition(")")[2].split()[19]))
        assert other.is_running() is True
        assert replace(other, started=other.started + 1).is_running() is False  # a later process of that number
        assert replace(other, started=0).is_running() is None
        assert replace(other, machine="0" * 8).is_running() is None
        process.communicate(b"\n")
    assert other.is_running() is False
    assert replace(here, process=10**10 - 1).is_running() is False  # no such number


@linux
def test_owner__of_another_user_is_judged_by_its_start(monkeypatch: pytest.MonkeyPatch) -> None:
    here = Owner.here()

    def refused(process: int, signal: int) -> None:
        raise PermissionError

    monkeypatch.setattr(os, "kill", refused)
    assert here.is_running() is True
    assert replace(here, started=1).is_running() is False


@linux
def test_start__is_unknown_where_the_system_does_not_say(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "getpid", lambda: 10**9)  # a container that sees the processes of its host
    assert module._started(1) == 0
    monkeypatch.undo()
    assert module._started(10**9) == 0
    assert module._started(1) > 0 or not os.access("/proc/1/stat", os.R_OK)


def test_path__on_another_drive_is_not_relative(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    assert relative_path(tmp_path / "a" / "b.tif", tmp_path / "c") == "../a/b.tif"

    def other_drive(path: Path, start: Path) -> str:
        raise ValueError("path is on mount 'C:', start on mount 'D:'")

    monkeypatch.setattr(os.path, "relpath", other_drive)
    assert relative_path(tmp_path / "a.tif", tmp_path) is None
