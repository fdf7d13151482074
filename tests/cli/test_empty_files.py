"""An empty file, or a folder where a file is expected, in every command."""

from __future__ import annotations

from pathlib import Path

import pytest

from furrowmap.cli.main import command_line

SURVEY = "name,e_m,n_m,h_m\nP1,1,1,1\n"


COMMANDS = (
    "inspect {it}",
    "init {it} -o {out}",
    "run {it} -o {out}",
    "run {it} --preview -o {out}",
    "surface {it} -o {out}",
    "cloud {it} -o {out}.copc.laz",
    "fields {it} -o {out}.gpkg",
    "export {it} -o {out}.gpkg",
    "farm add {it} {out}.gpkg",
    "farm list {it}",
    "farm mosaic {it} -o {out}.tif",
    "calibrate {it}",
    "crs {it}",
    "gnss evaluate {it} --reference 35,139,10 -o {out}",
    "gnss evaluate {it} --reference {it} -o {out}",
    "check {it} {survey}",
    "simulate {it} -o {out}",
)
NOTHING_BUT_DEFAULTS = ("simulate {it} -o {out}", "empty file")


@pytest.mark.parametrize(
    ("command", "kind"),
    sorted({(command, kind) for command in COMMANDS for kind in ("empty file", "folder")} - {NOTHING_BUT_DEFAULTS}),
)
def test_promise_01__an_empty_file_or_a_folder_is_an_error_that_names_it(
    command: str, kind: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    it, survey = tmp_path / "given", tmp_path / "survey.csv"
    survey.write_text(SURVEY)
    if kind == "folder":
        it.mkdir()
    else:
        it.touch()
    names = {"it": it, "out": tmp_path / "out", "survey": survey}
    before = sorted(tmp_path.rglob("*"))
    status = command_line([word.format(**names) for word in command.split()])
    lines = capsys.readouterr().err.splitlines()
    assert status == 3
    assert len(lines) == 3
    assert str(it) in lines[0]
    assert sorted(tmp_path.rglob("*")) == before
    assert it.is_dir() or it.read_bytes() == b""
