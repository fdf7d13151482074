"""`furrowmap fields` as it is typed."""

from __future__ import annotations

import json
from pathlib import Path

import pyogrio
import pytest

from furrowmap.cli.main import command_line
from tests.core.readers.isoxml.time_logs import Record, header, task_data


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two fields, a minute of work in each, the second without a boundary and never at work."""
    corners = "".join(
        f'<PNT A="2" C="{lat}" D="{lon}"/>' for lat, lon in [(50, 10), (50, 10.001), (50.003, 10.001), (50.003, 10)]
    )
    body = (
        f'<PFD A="PFD1" C="&lt;North&gt;"><PLN A="1"><LSG A="1">{corners}</LSG></PLN></PFD><PFD A="PFD2" C="South"/>'
        '<TSK A="TSK1" B="one" E="PFD1" G="4"><TLG A="TLG00001" C="1"/></TSK>'
        '<TSK A="TSK2" B="two" E="PFD2" G="4"><TLG A="TLG00002" C="1"/></TSK>'
    )
    logs = {}
    for number, (name, works) in enumerate((("TLG00001", 1), ("TLG00002", 0))):
        records = [
            Record(
                1000 * (36_000 + 100 * number + k),
                15_000,
                {"A": 500_003_000 + 180 * k, "B": 100_005_000, "D": 4},
                {0: works * int(5 <= k < 55), 1: 6000} if k in (0, 5, 55) else {},
            )
            for k in range(61)
        ]
        log = header([(141, "DET-1"), (67, "DET-1")]), b"".join(record.pack() for record in records)
        logs[name] = log
    return task_data(tmp_path_factory.mktemp("fields") / "TASKDATA", body, logs)


def test_table__has_a_line_for_each_task(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert command_line(["fields", str(folder)]) == 0
    said = capsys.readouterr()
    head, one, two = said.out.splitlines()
    assert head.split()[:3] == ["task", "field", "passes"]
    assert one.split()[:4] == ["TSK1", "<North>", "1", "0.060"]  # 50 s of 2 m/s, 6 m wide
    assert two.split()[:4] == ["TSK2", "South", "0", "0.000"]
    assert two.split()[-1] == "unknown"
    assert "assumed to be UTC" in said.err


def test_layers__of_all_fields_in_one_file(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    target = tmp_path / "fields.gpkg"
    assert command_line(["fields", str(folder), "-o", str(target), "--json", "-q"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert [row["task"] for row in answer["fields"]] == ["TSK1", "TSK2"]
    fields = pyogrio.read_dataframe(target, layer="fields")
    assert fields["worked_area_m2"].tolist() == pytest.approx([600.0, 0.0], rel=0.02)
    assert fields.geometry.isna().tolist() == [False, True]
    passes = pyogrio.read_dataframe(target, layer="passes")
    assert passes[["task", "field", "pass"]].values.tolist() == [["TSK1", "<North>", 1]]
    styled = pyogrio.read_dataframe(target, layer="layer_styles")["f_table_name"]
    assert set(styled) == {name for name, _ in pyogrio.list_layers(target)} - {"layer_styles"}
    assert command_line(["fields", str(folder), "-o", str(target)]) == 4


def test_width_and_task__as_asked(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert command_line(["fields", str(folder), "--width", "3", "--task", "one", "--json"]) == 0
    (row,) = json.loads(capsys.readouterr().out)["fields"]
    assert row["worked_area_m2"] == pytest.approx(300.0, rel=0.02)
    assert command_line(["fields", str(folder), "--task", "three"]) == 3
    assert "TSK1 (one)" in capsys.readouterr().err
