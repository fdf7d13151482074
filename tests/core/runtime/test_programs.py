"""Programs are looked for in the folders of PATH, and never in the current one."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from furrowmap.core.runtime import programs
from furrowmap.plugin import platforms

LOOKS: list[Callable[[str], str | None]] = [programs.program_on_path, platforms.program_on_path]


def make_program(folder: Path) -> Path:
    program = folder / ("probe.exe" if sys.platform == "win32" else "probe")
    program.write_text("#!/bin/sh\n")
    program.chmod(0o755)
    return program


@pytest.mark.parametrize("look", LOOKS, ids=["package", "plugin"])
@pytest.mark.parametrize("entry", ["", ".", "here/.."])
def test_promise_23__a_program_in_the_current_folder_is_not_started(
    look: Callable[[str], str | None], entry: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    here = tmp_path / "here"
    installed = tmp_path / "installed"
    for folder in (here, here / "here", installed):
        folder.mkdir()
    make_program(here)
    monkeypatch.chdir(here)
    monkeypatch.setenv("PATH", entry)
    assert look("probe") is None
    program = make_program(installed)
    monkeypatch.setenv("PATH", os.pathsep.join((entry, str(installed))))
    if sys.platform != "win32":  # there, Python before 3.12 takes the current folder into any search
        assert look("probe") == str(program)
