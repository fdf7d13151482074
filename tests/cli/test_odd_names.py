"""Names of files that a shell, a format or a parser of options could take for something else."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

import furrowmap
from furrowmap.cli.main import command_line

NAMES = [
    "two words .nmea", "it's \"quoted\".nmea", "100%s %(a)s {0}.nmea", "圃場 東.nmea", "🚜.nmea", "-o", "--json",
    "line\nbreak.nmea", "$(touch x);`touch x`|&.nmea", "a" * 250 + ".nmea", "~", "*", "[bold]x[red].nmea",
    "\x1b[31m.nmea",
]  # fmt: skip


@pytest.mark.parametrize("name", NAMES)
def test_promise_22__a_file_of_any_name_is_inspected(
    name: str, shared_data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """On the command line and from Python; no file but it is there afterwards."""
    monkeypatch.chdir(tmp_path)
    lines = (shared_data / "tractor_loop" / "gnss.nmea").read_bytes().splitlines(keepends=True)
    Path(name).write_bytes(b"".join(lines[:60]))
    assert command_line(["inspect", "--json", "--", name]) == 0
    (answer,) = json.loads(capsys.readouterr().out)["files"]
    assert (answer["path"], answer["format"]) == (name, "nmea")
    assert furrowmap.inspect(name).inspection.facts == furrowmap.inspect(tmp_path / name).inspection.facts
    assert [path.name for path in tmp_path.iterdir()] == [name]
