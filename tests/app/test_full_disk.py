"""Every command on a full disk: of its output, of temporary files, over existing products.

It ends in the way of the contract, says in three lines which file it was and how much space was free, leaves what was
there unchanged and nothing half-written.
"""

from __future__ import annotations

import hashlib
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

import click
import pytest

import furrowmap
from furrowmap.cli.main import furrowmap as program_of_commands
from tests.app.command_cases import CASES, WITHOUT_FILES, Case, materials
from tests.app.killing import KILLS, Mortal

DISK_BYTES = 256 << 20
ALWAYS = ("run", "batch", "surface", "parcels", "export gpkg", "share", "farm add", "check --table")
"""Run with a full folder of temporary files in every test, one of each kind of output; `make kills` takes all."""
pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="there are no file systems of a fixed size")


def commands() -> Iterator[str]:
    """All commands that do something, of the command line itself."""

    def below(group: click.Group, name: str) -> Iterator[str]:
        context = click.Context(group)
        for word in group.list_commands(context):
            command = group.get_command(context, word)
            assert command is not None
            whole = f"{name} {word}".strip()
            if isinstance(command, click.Group) and not command.invoke_without_command:
                yield from below(command, whole)
            else:
                yield whole

    return below(program_of_commands, "")


def test_every_command_is_a_case_or_writes_no_files() -> None:
    known = [*CASES, *WITHOUT_FILES]
    missing = {name for name in commands() if not any(f"{one} ".startswith(f"{name} ") for one in known)}
    assert not missing, "add them to tests/app/command_cases.py"
    assert not {one for one in known if not any(f"{one} ".startswith(f"{name} ") for name in commands())}


@pytest.fixture(scope="module")
def made(
    tmp_path_factory: pytest.TempPathFactory, simulated: furrowmap.Simulated, result: furrowmap.Result
) -> dict[str, Path]:
    return materials(tmp_path_factory.mktemp("materials"), simulated, result)


@pytest.fixture(scope="module")
def disk(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A file system of its own, which root may make."""
    folder = tmp_path_factory.mktemp("disk")
    command = [shutil.which("mount") or "false", "-t", "tmpfs", "-o", f"size={DISK_BYTES}", "tmpfs", str(folder)]
    made = subprocess.run(command, capture_output=True, text=True, check=False)
    if made.returncode:
        pytest.skip(f"no file system of a fixed size can be made here: {made.stderr.strip()}")
    yield folder
    subprocess.run(["umount", str(folder)], check=True)


@dataclass(frozen=True)
class Runs:
    """Runs of a command into a folder."""

    case: Case
    made: dict[str, Path]
    out: Path
    program: Mortal

    def begin(self) -> None:
        """The folder as it is before the command."""
        shutil.rmtree(self.out, ignore_errors=True)
        self.out.mkdir()
        self.case.before(self.made, self.out)

    def run(self, more: str = "", **end: Any) -> dict[str, Any]:
        names = {name: str(path) for name, path in self.made.items()} | {"out": str(self.out)}
        arguments = [word.format(**names) for word in f"{self.case.words} {more}".split()]
        return self.program.runs(arguments, self.out.parent, **end)

    def files(self) -> dict[str, str]:
        """Everything in the folder, hidden files and folders too."""
        there = {path.relative_to(self.out).as_posix(): path for path in sorted(self.out.rglob("*"))}
        return {name: _digest(path) for name, path in there.items()}


def fill(disk: Path, free: int) -> None:
    """Leave so many bytes free."""
    (disk / "ballast").unlink(missing_ok=True)
    if (taken := shutil.disk_usage(disk).free - free) > 0:
        with (disk / "ballast").open("wb") as ballast:
            os.posix_fallocate(ballast.fileno(), 0, taken)


def _digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest() if path.is_file() else ""


def refused(said: dict[str, Any], places: list[Path]) -> None:
    """A failed write is told as it is to be, or refused before the work."""
    lines = said["said"].splitlines()[-3:]
    assert said.get("exit") in (1, 4), said
    assert re.search(r"\(\d\S* \w+ free[,)]" if said["exit"] == 1 else r"has \S+ GB of free space", lines[0]), said
    assert any(str(place) in lines[0] for place in places), said
    assert "bug" not in said["said"], said
    assert "Traceback" not in said["said"], said


@pytest.mark.parametrize("name", CASES)
def test_promise_19__full_disk_of_the_output(name: str, made: dict[str, Path], disk: Path, program: Mortal) -> None:
    runs = Runs(CASES[name], made, disk / "out", program)
    (disk / "ballast").unlink(missing_ok=True)
    runs.begin()
    before = runs.files()
    whole = runs.run()
    assert whole.get("exit") == 0, whole
    written = sum(path.stat().st_blocks * 512 for path in runs.out.rglob("*") if path.is_file())
    complete = sorted(runs.files())
    for over, share in product((True, False), (0.0, 0.5)) if KILLS else ((True, 0.5), (False, 0.0)):
        (disk / "ballast").unlink(missing_ok=True)
        if not (over and runs.case.repeats):
            runs.begin()
        earlier = runs.files()
        fill(disk, int(share * written))
        said = runs.run(runs.case.again if over else "")
        if said.get("exit") == 0 and share:  # it writes less than half of it
            assert sorted(runs.files()) == complete
        elif said.get("exit") == 0 and over:  # the earlier products are as they would be again
            assert runs.files() == earlier
        else:
            refused(said, [runs.out])
            assert runs.files() == earlier
            assert over or runs.files() == before
    (disk / "ballast").unlink(missing_ok=True)


@pytest.mark.parametrize("kind", ["full", "nearly full", "missing", "a file"] if KILLS else ["nearly full"])
@pytest.mark.parametrize("name", CASES if KILLS else ALWAYS)
def test_promise_19__folder_of_temporary_files_that_is_full_or_none(
    name: str, kind: str, made: dict[str, Path], disk: Path, tmp_path: Path, program: Mortal
) -> None:
    """It is not needed, another is found, or it is named."""
    runs = Runs(CASES[name], made, tmp_path / "out", program)
    temporary = disk / "temporary"
    shutil.rmtree(temporary, ignore_errors=True)
    temporary.unlink(missing_ok=True)
    if kind == "a file":
        temporary.write_text("")
    elif kind != "missing":
        temporary.mkdir()
        fill(disk, 0 if kind == "full" else 16 << 10)
    runs.begin()
    before = runs.files()
    said = runs.run(environment={"TMPDIR": str(temporary)})
    assert not temporary.is_dir() or not list(temporary.iterdir())
    if said.get("exit") != 0:
        assert kind == "nearly full", said
        refused(said, [temporary])
        assert runs.files() == before
