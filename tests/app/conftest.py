"""A small simulated recording and its result, made once for all processes, and the program of killed writers."""

from __future__ import annotations

import pickle
import shutil
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import pytest

import furrowmap
from tests.app.killing import Mortal
from tests.one_pass import make_one_pass


@pytest.fixture(scope="session")
def one_pass(
    made_once: Callable[[str, Callable[[Path], object]], Path], tmp_path_factory: pytest.TempPathFactory
) -> Path:
    """The process's own copy, as tests write beside the recording."""
    folder: Path = tmp_path_factory.mktemp("simulated")
    return shutil.copytree(made_once("one_pass", make_one_pass), folder, dirs_exist_ok=True)


@pytest.fixture(scope="session")
def simulated(one_pass: Path) -> furrowmap.Simulated:
    """One pass of five seconds."""
    made: furrowmap.Simulated = pickle.loads((one_pass / "simulated.pickle").read_bytes())
    drive = one_pass / "drive"
    return replace(made, folder=drive, session=drive / made.session.name, recording=drive / made.recording.name)


@pytest.fixture(scope="session")
def result(one_pass: Path) -> furrowmap.Result:
    """Its result."""
    return furrowmap.open_result(one_pass / "result")


@pytest.fixture(scope="session")
def program() -> Iterator[Mortal]:
    """One for all tests of the process: its start imports everything and loads the kernels."""
    program = Mortal()
    yield program
    program.close()
