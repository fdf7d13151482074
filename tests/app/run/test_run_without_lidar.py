"""A session without a scanner: positions and states make a field's layers and its report, and no cloud."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import pyogrio
import pytest

import furrowmap
from furrowmap.core.geodesy.projection import MapFrame
from furrowmap.core.pipeline.run import run
from furrowmap.core.pipeline.run_result import RunResult
from furrowmap.core.pointclouds.placed_scans import PlacedScan
from furrowmap.core.runtime.errors import InputError
from furrowmap.core.session.opened import open_session
from furrowmap.core.session.session_file import parse_session
from tests.core.coverage.section_tasks import CRS, drawn_drill, straight_boom

SESSION = """furrowmap = 1
name = "Harvest"
[recording]
gnss = ["TASKDATA"]
task = "TSK20"
[crs]
map = "EPSG:32632"
[implement]
width_m = 9.0
xy_m = [0.0, 0.0]
states = ["{states}"]
"""


class NoSink:
    """Takes no points, because there are none."""

    def __call__(
        self, frame: MapFrame, origin_m: tuple[float, float, float], frames: object
    ) -> Callable[[PlacedScan], None]:
        pytest.fail("a session without scans has no points")

    def add(self, placed: PlacedScan) -> None:
        pytest.fail("a session without scans has no points")


def run_alone(session_file: Path) -> RunResult:
    return run(open_session(session_file), NoSink())


@pytest.fixture(scope="module")
def folder(shared_data: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the harvest's smallest field, and the products of a run on it."""
    folder = tmp_path_factory.mktemp("harvest")
    data = folder / "TASKDATA"
    data.mkdir()
    for name in ("TASKDATA.XML", "TLG00026.xml", "TLG00026.bin"):
        shutil.copyfile(shared_data / "isoxml/field_days/harvest_21_fields" / name, data / name)
    (folder / "session.toml").write_text(SESSION.format(states="TASKDATA"))
    furrowmap.run(folder / "session.toml", folder / "result")
    return folder


def test_products__are_those_of_a_run_but_the_cloud(folder: Path) -> None:
    names = {path.name for path in (folder / "result").iterdir()}
    assert names == {"field.gpkg", "states.csv", "report.json", "report.html", "session.toml", "item.json"}
    report = json.loads((folder / "result" / "report.json").read_text(encoding="utf-8"))
    assert list(report) == [
        "furrowmap", "schema", "session_file", "verdict", "session", "inputs", "figures", "coordinates", "accuracy",
        "observability", "inertial", "calibration", "strips", "strip_differences", "image_adjustment",
        "strip_adjustment", "live", "clocks", "warnings", "timings", "products", "colours",
    ]  # fmt: skip
    layers = dict(pyogrio.list_layers(folder / "result" / "field.gpkg"))
    assert {"trajectory", "passes", "coverage", "overlaps", "misses", "tool_path", "events"} <= layers.keys()
    page = (folder / "result" / "report.html").read_text(encoding="utf-8")
    assert "as the scanner saw it" not in page
    assert "million" not in page


def test_figures__are_those_of_the_field(folder: Path) -> None:
    found = run_alone(folder / "session.toml")
    assert found.work.ground is not None
    assert found.work.ground.figures.worked.ellipsoid_m2 == pytest.approx(6178, rel=0.02)
    assert found.placement.points == 0
    assert len(found.inputs) == 1
    assert {notice.code for notice in found.notices} >= {"local-time", "direction-forward"}


def test_states_table__of_a_run_gives_the_same_polygons(folder: Path) -> None:
    first = run_alone(folder / "session.toml").work.ground
    shutil.copyfile(folder / "result" / "states.csv", folder / "states.csv")
    (folder / "again.toml").write_text(SESSION.format(states="states.csv"))
    again = run_alone(folder / "again.toml").work.ground
    assert first is not None
    assert again is not None
    assert again.coverage.wkb == first.coverage.wkb
    assert [p.ground.wkb for p in again.passes] == [p.ground.wkb for p in first.passes]
    assert [o.ground.wkb for o in again.overlaps] == [o.ground.wkb for o in first.overlaps]


def test_a_session_with_neither_scanner_nor_states__is_refused(folder: Path) -> None:
    path = folder / "neither.toml"
    path.write_text(SESSION.format(states="TASKDATA").replace('states = ["TASKDATA"]', ""))
    with pytest.raises(InputError) as error:
        run_alone(path)
    assert "recording.lidar names no file" in error.value.what


def test_tasks_of_two_machines__are_not_read_as_one(shared_data: Path, tmp_path: Path) -> None:
    shutil.copyfile(shared_data / "isoxml/other/no_status_position_jumps.zip", tmp_path / "two.zip")
    text = SESSION.format(states="two.zip").replace("TASKDATA", "two.zip").replace('task = "TSK20"', "")
    (tmp_path / "session.toml").write_text(text)
    with pytest.raises(InputError) as error:
        run_alone(tmp_path / "session.toml")
    assert error.value.code == "tasks-overlap"
    assert "[recording] task" in error.value.remedy


def test_part_of_a_recording__is_as_in_the_whole_of_it(folder: Path) -> None:
    whole = furrowmap.open_result(folder / "result").trajectory
    first, last = whole["time"].iloc[[len(whole) // 3, 2 * len(whole) // 3]]
    text = SESSION.format(states="TASKDATA").replace(
        "[crs]", f'from = "{first.isoformat()}"\nto = {last.isoformat()}\n[crs]'
    )
    (folder / "part.toml").write_text(text)
    found = furrowmap.run(folder / "part.toml", folder / "part")
    part = found.trajectory
    assert first <= part["time"].iloc[0] <= part["time"].iloc[-1] <= last
    assert len(part) == pytest.approx(len(whole) / 3, rel=0.02)
    inside = whole[(whole["time"] >= part["time"].iloc[0]) & (whole["time"] <= part["time"].iloc[-1])]
    assert part.geometry.distance(inside.geometry.reset_index(drop=True)).median() < 0.01
    again = parse_session((folder / "part/session.toml").read_text()).recording
    assert again.span_s == (first.timestamp(), last.timestamp())


def test_sections__of_task_data_in_a_session(tmp_path: Path) -> None:
    """The line of the sections lies on the tool's line of the session; the report lists them."""
    task = straight_boom(tmp_path / "TASKDATA")
    text = SESSION.format(states="TASKDATA").replace("EPSG:32632", CRS).replace('task = "TSK20"', "")
    session = tmp_path / "session.toml"
    session.write_text(text.replace("width_m = 9.0", "width_m = 24.0").replace("xy_m = [0.0", "xy_m = [-2.0"))
    found = furrowmap.run(session, tmp_path / "result")
    (worked,) = task.worked
    report = found.report["figures"]
    assert report["worked_area_m2"] == pytest.approx(worked.area_m2, rel=0.005)
    assert abs(report["overlap_area_m2"] - worked.overlap_m2) < 0.002 * task.field_m.area
    sections = report["implement"]["sections"]
    assert [(one["left_m"], one["width_m"]) for one in sections] == [(10.5 - 3.0 * k, 3.0) for k in range(8)]
    assert "Sections" in (tmp_path / "result/report.html").read_text(encoding="utf-8")
    assert not {"sections-width", "sections-drawn"} & {one["code"] for one in found.report["warnings"]}
    session.write_text(text.replace("width_m = 9.0", "width_m = 20.0"))
    assert "sections-width" in {notice.code for notice in run_alone(session).notices}


def test_sections__of_a_drawn_implement_are_rigid_in_a_session(tmp_path: Path) -> None:
    drawn_drill(tmp_path / "TASKDATA")
    text = SESSION.format(states="TASKDATA").replace("EPSG:32632", CRS).replace('task = "TSK20"', "")
    (tmp_path / "session.toml").write_text(text.replace("width_m = 9.0", "width_m = 6.0"))
    found = run_alone(tmp_path / "session.toml")
    assert "sections-drawn" in {notice.code for notice in found.notices}
    assert found.work.ground is not None
    assert found.work.ground.figures.passes > 0
