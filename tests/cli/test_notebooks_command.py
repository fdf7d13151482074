"""`furrowmap notebooks`: the notebooks of this version, and none of the user's replaced."""

from __future__ import annotations

import json
from pathlib import Path

import nbformat
import pytest

from furrowmap.cli.main import command_line

NAMES = ("any-cloud.ipynb", "christiansen-et-al.ipynb", "nakagawa-et-al.ipynb")


def test_notebooks__are_written_once(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "examples"
    assert command_line(["notebooks", str(folder), "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == {"notebooks": [str(folder / name) for name in NAMES]}
    for path in folder.iterdir():
        nbformat.validate(nbformat.read(path, as_version=4))
    (folder / NAMES[1]).write_text("mine")
    for name in (NAMES[0], *NAMES[2:]):
        (folder / name).unlink()
    assert command_line(["notebooks", str(folder)]) == 4
    assert f"{NAMES[1]} exists already" in capsys.readouterr().err
    assert [path.read_text() for path in folder.iterdir()] == ["mine"]
