"""A file is there whole or not at all, whatever interrupts its writing."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from furrowmap.core.runtime.write_errors import WriteError
from furrowmap.exporters.files.atomic import atomic_output

WRITE_AND_HANG = """
import sys, time
from pathlib import Path
from furrowmap.core.runtime.write_errors import WriteError
from furrowmap.exporters.files.atomic import atomic_output
with atomic_output(Path(sys.argv[1])) as unfinished:
    unfinished.write_text("half")
    print("written", flush=True)
    time.sleep(60)
"""


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_atomic_output__takes_the_place_of_the_older_file(tmp_path: Path) -> None:
    path = tmp_path / "report.json"
    path.write_text("old")
    with atomic_output(path) as unfinished:
        unfinished.write_text("new")
        assert path.read_text() == "old"
        assert (unfinished.parent, unfinished.suffix) == (tmp_path, ".json")
    assert path.read_text() == "new"
    assert names(tmp_path) == ["report.json"]


def write_half_and_raise(unfinished: Path, interruption: type[BaseException]) -> None:
    unfinished.write_text("half")
    unfinished.with_name(f"{unfinished.name}-journal").write_text("a database's own file")
    raise interruption


@pytest.mark.parametrize("interruption", [ValueError, KeyboardInterrupt, SystemExit, EOFError])
def test_atomic_output__interrupted_leaves_all_as_it_was(tmp_path: Path, interruption: type[BaseException]) -> None:
    path = tmp_path / "field.gpkg"
    path.write_text("old")
    with pytest.raises(interruption), atomic_output(path) as unfinished:
        write_half_and_raise(unfinished, interruption)
    assert path.read_text() == "old"
    assert names(tmp_path) == ["field.gpkg"]


def test_atomic_output__nothing_written_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError), atomic_output(tmp_path / "cloud.copc.laz"):
        pass
    assert names(tmp_path) == []


def test_atomic_output__error_names_the_file(tmp_path: Path) -> None:
    with pytest.raises(WriteError) as raised, atomic_output(tmp_path / "cloud.copc.laz"):
        raise OSError(28, "No space left on device")
    assert f"{tmp_path / 'cloud.copc.laz'} cannot be written: the disk is full" in raised.value.what


def test_atomic_output__folder_missing_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError), atomic_output(tmp_path / "none" / "cloud.copc.laz"):
        pass


@pytest.mark.parametrize("name", ["圃場 '1' %20.tif", "-rf", "n" * 250 + ".tif", "no suffix", "a." + "s" * 200])
def test_atomic_output__any_name(tmp_path: Path, name: str) -> None:
    with atomic_output(tmp_path / name) as unfinished:
        unfinished.write_bytes(b"\x00")
    assert names(tmp_path) == [name]


@pytest.mark.skipif(sys.platform == "win32", reason="a killed process's file is recognised there by not being open")
def test_atomic_output__removes_what_killed_processes_left_and_nothing_else(tmp_path: Path) -> None:
    command = [sys.executable, "-c", WRITE_AND_HANG, str(tmp_path / "cloud.copc.laz")]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as writer:
        assert writer.stdout is not None
        assert writer.stdout.readline() == "written\n"
        (half,) = names(tmp_path)
        with atomic_output(tmp_path / "other.txt") as unfinished:
            unfinished.write_text("whole")
        assert names(tmp_path) == [half, "other.txt"], "the file of a running process is not touched"
        writer.send_signal(signal.SIGKILL)
        writer.wait()
    foreign = tmp_path / half.replace(half.split("-")[1], "0" * 8)
    foreign.touch()
    with atomic_output(tmp_path / "other.txt") as unfinished:
        unfinished.write_text("whole again")
    assert names(tmp_path) == sorted([foreign.name, "other.txt"]), "another machine's file is not ours to judge"


@pytest.mark.skipif(not hasattr(os, "geteuid"), reason="links to folders need rights on Windows")
def test_atomic_output__into_a_linked_folder(tmp_path: Path) -> None:
    (tmp_path / "real").mkdir()
    (tmp_path / "link").symlink_to(tmp_path / "real")
    with atomic_output(tmp_path / "link" / "a.txt") as unfinished:
        unfinished.write_text("x")
    assert names(tmp_path / "real") == ["a.txt"]
