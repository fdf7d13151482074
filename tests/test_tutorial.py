"""The tutorial works as it is typed."""

from __future__ import annotations

import json
import re
import runpy
import shlex
import subprocess
import sys
import tomllib
from pathlib import Path

import laspy
import pytest
import tomli_w
from matplotlib.image import imread

CHECKOUT = Path(__file__).resolve().parents[1]
PAGE = (CHECKOUT / "docs" / "tutorial" / "first-map.md").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def typed(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, str]]:
    """The folder in which the tutorial was followed, and the output of each command."""
    folder = tmp_path_factory.mktemp("tutorial")
    (edit,) = re.findall(r"^```toml\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)
    answers = {}
    for line in re.findall(r"^furrowmap .+$", PAGE, re.MULTILINE):
        _, command, *arguments = shlex.split(line)
        program = Path(sys.executable).with_name("furrowmap")
        done = subprocess.run([program, command, *arguments], cwd=folder, capture_output=True, text=True, check=False)
        assert done.returncode == 0, f"{line}\n{done.stderr}"
        answers[command] = done.stdout
        if command == "init":
            session = tomllib.loads((folder / "first/mine.toml").read_text(encoding="utf-8"))
            (folder / "first/mine.toml").write_text(tomli_w.dumps(session | tomllib.loads(edit)), encoding="utf-8")
    return folder, answers


def test_tutorial__inspect_shows_what_the_page_says(typed: tuple[Path, dict[str, str]]) -> None:
    inspected = typed[1]["inspect"]
    assert "sensor-gps" in inspected
    assert "overlap" in inspected.splitlines()[-1]
    assert re.search(r"fix +fixed \d+$", inspected, re.MULTILINE)


def test_tutorial__mounting_is_the_simulated_one(typed: tuple[Path, dict[str, str]]) -> None:
    mine, simulated = (tomllib.loads((typed[0] / "first" / name).read_text()) for name in ("mine.toml", "session.toml"))
    assert (mine["antenna"], mine["lidar"]) == (simulated["antenna"], simulated["lidar"])


def test_demo__draws_and_summarises_such_a_result(typed: tuple[Path, dict[str, str]], tmp_path: Path) -> None:
    demo = runpy.run_path(str(CHECKOUT / "scripts" / "demo.py"))
    demo["draw_map"](typed[0] / "first" / "result", tmp_path / "map.png", "The tutorial's map")
    assert imread(tmp_path / "map.png").shape[1] == 1500
    report = json.loads((typed[0] / "first" / "result" / "report.json").read_text(encoding="utf-8"))
    table = demo["summary"](typed[0] / "first" / "result", 1.0)
    cells = [str(cell) for column in table.columns for cell in column.cells]
    assert f"{report['figures']['points']:,} in {report['figures']['scans']} scans" in cells


def test_tutorial__ends_with_files_that_open_in_qgis(typed: tuple[Path, dict[str, str]], qgis) -> None:
    result = typed[0] / "first" / "result"
    layers = qgis.open_layers(result / "cloud.copc.laz", result / "field.gpkg")
    assert [(layer["provider"], layer["crs"], layer["valid"]) for layer in layers] == [
        ("copc", "EPSG:6677", True),
        ("ogr", "EPSG:6677", True),
    ]
    with laspy.open(result / "cloud.copc.laz") as cloud:
        assert layers[0]["count"] == cloud.header.point_count > 1_000_000
    assert layers[1]["count"] > 100
