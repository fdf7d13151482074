"""A tractor with a roller in front and a tiller behind: states and worked ground of each, against the drive's truth."""

from __future__ import annotations

import json
import re
import sqlite3
import tomllib
from contextlib import closing
from pathlib import Path
from typing import Any
from zoneinfo import ZoneInfo

import geopandas as gpd
import numpy as np
import pandas as pd
import pyogrio
import pytest

import furrowmap
from furrowmap.core.session.session_file import load_session
from furrowmap.core.simulator.scenario import FrontImplement, Scenario, ScenarioDrive, ScenarioField, ScenarioLidar
from furrowmap.core.simulator.simulate import simulate
from furrowmap.exporters.farm.farm_results import read_result
from furrowmap.exporters.files.result_folder import open_result
from furrowmap.exporters.share.page_features import shared_layer

DEPTH_M = 0.12
TOOLS = (
    ("rear tool", "implement.csv", "worked.gpkg", "tool_height_m"),
    ("front roller", "implement_front.csv", "worked_front.gpkg", "tool_2_height_m"),
)
SCENARIO = Scenario(
    name="two",
    title="Roller and tiller",
    seed=4,
    field=ScenarioField(size_e_m=20.0, size_n_m=10.0),
    drive=ScenarioDrive(
        passes=1,
        pass_m=(5.0,),
        speed_work_mps=1.4,
        accel_mps2=1.5,
        stand_start_s=0.4,
        stand_end_s=0.4,
        lead_in_m=2.5,
    ),
    # beside the cab, its fan of beams along the vehicle: it sees both tools
    lidar=ScenarioLidar(xyz_m=(0.5, 1.1, 2.5), rpy_deg=(80.0, 0.0, 0.0), max_range_m=20.0),
    front=FrontImplement(ahead_m=1.0, width_m=2.2),
)


@pytest.fixture(scope="module")
def drive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The recording; its report is to be in Japanese."""
    folder = tmp_path_factory.mktemp("two") / "drive"
    session = simulate(SCENARIO, folder).session
    session.write_text(session.read_text("utf-8") + '\n[report]\nlanguage = "ja"\n', "utf-8")
    return folder


@pytest.fixture(scope="module")
def result(drive: Path) -> furrowmap.Result:
    return furrowmap.run(drive / "session.toml", drive.parent / "result")


def true_transitions(file: Path) -> tuple[pd.DataFrame, list[float]]:
    """The tool over time, and when it crossed the working depth."""
    truth = pd.read_csv(file)
    t_s, height = truth.time_unix_s.to_numpy(), truth.tool_height_m.to_numpy() - DEPTH_M
    before = np.flatnonzero(np.diff(height < 0.0))
    share = height[before] / (height[before] - height[before + 1])
    return truth, (t_s[before] + share * (t_s[before + 1] - t_s[before])).tolist()


@pytest.mark.parametrize(("name", "states", "worked", "height"), TOOLS)
def test_each_tool__has_its_own_states_and_ground(
    drive: Path, result: furrowmap.Result, name: str, states: str, worked: str, height: str
) -> None:
    truth, times = true_transitions(drive / "truth" / states)
    field = result.path / "field.gpkg"
    events = pyogrio.read_dataframe(field, layer="events", read_geometry=False)
    mine = events[(events.tool == name) & events.kind.isin(["down", "up"])]
    assert mine.kind.tolist() == ["down", "up"]
    assert mine.t_s.to_numpy() == pytest.approx(np.array(times), abs=0.025)
    scans = pyogrio.read_dataframe(field, layer="trajectory", read_geometry=False)
    error = scans[height] - np.interp(scans.t_s, truth.time_unix_s, truth.tool_height_m)
    assert error.notna().mean() > 0.98
    assert np.sqrt(np.mean(error**2)) < 0.01
    covered, true = (gpd.read_file(file, layer="coverage") for file in (field, drive / "truth" / worked))
    ground = covered[covered.tool == name].geometry.union_all()
    # The few positions of eight seconds are off by centimetres together, along and across the pass.
    assert ground.area == pytest.approx(true.geometry.area.sum(), rel=0.02)
    assert ground.intersection(true.geometry.union_all()).area / true.geometry.area.sum() > 0.96
    told = next(tool for tool in result.report["figures"]["tools"] if tool["name"] == name)
    assert told["worked_area_m2"] == pytest.approx(ground.area, abs=0.001)
    assert told["implement"]["transitions"] == 2
    assert told["passes"] == 1


def test_layers__name_the_tool_and_only_the_one_in_the_soil_has_a_depth(result: furrowmap.Result) -> None:
    for layer in ("passes", "coverage", "tool_path", "events", "zones", "boundary"):
        table = pyogrio.read_dataframe(result.path / "field.gpkg", layer=layer, read_geometry=False)
        assert set(table.tool) == {"rear tool", "front roller"}, layer
    passes = pyogrio.read_dataframe(result.path / "field.gpkg", layer="passes", read_geometry=False).set_index("tool")
    assert np.isfinite(passes.depth_m["rear tool"])
    assert np.isnan(passes.depth_m["front roller"])
    assert passes.width_m.to_dict() == {"rear tool": 1.7, "front roller": 2.2}


def test_pass__is_named_with_its_tool_wherever_passes_are_shown(result: furrowmap.Result, tmp_path: Path) -> None:
    """Each tool has a pass 1."""
    both = {"rear tool", "front roller"}
    with closing(sqlite3.connect(result.path / "field.gpkg")) as database:
        styles = dict(database.execute("SELECT f_table_name, styleQML FROM layer_styles WHERE useAsDefault"))
    assert """"&quot;tool&quot; || ' ' || &quot;pass&quot;\"""" in styles["passes"]
    assert all(re.search(r'<mapTip[^>]*>\[% "tool" %\]: ', styles[name]) for name in ("passes", "tool_path", "events"))
    shown = shared_layer("passes", open_result(result.path).layer("passes"), ZoneInfo("Asia/Tokyo"), shown=True)
    assert shown is not None
    assert {feature["label"] for feature in shown["features"]} == {f"{tool} 1" for tool in both}
    furrowmap.export([result.path], "kml", tmp_path / "out.kml", layers=["passes"])
    names = re.findall("<name>(.*?, pass .*?)</name>", (tmp_path / "out.kml").read_text("utf-8"))
    assert set(names) == {f"{tool}, pass 1" for tool in both}


def test_report__shows_each_tool_in_the_language_of_the_page(result: furrowmap.Result) -> None:
    page = (result.path / "report.html").read_text("utf-8")
    for title in ("作業機の一覧", "地図：front roller", "作業機：rear tool", "行程：front roller"):
        assert f"<h2>{title}</h2>" in page
    assert ">スキャンから<" in page
    assert ">from the scans<" not in page


def test_session_of_the_result__has_both_and_a_farm_map_the_one_in_the_soil(result: furrowmap.Result) -> None:
    text = (result.path / "session.toml").read_text("utf-8")
    assert [tool["name"] for tool in tomllib.loads(text)["implement"]] == ["rear tool", "front roller"]
    known = load_session(result.path / "session.toml")
    assert [tool.name for tool in known.implements] == ["rear tool", "front roller"]
    layers = {layer.name: layer for layer in read_result(result.path).layers}
    assert layers["passes"].columns["width_m"].tolist() == [1.7]
    assert "tool" not in layers["passes"].columns


def test_states_in_files__give_the_same_grounds_without_the_scanner(
    drive: Path, result: furrowmap.Result, tmp_path: Path
) -> None:
    content: dict[str, Any] = tomllib.loads((drive / "session.toml").read_text("utf-8"))
    for name, number in (("rear", ""), ("front", "_2")):
        (tmp_path / f"{name}.csv").write_bytes((result.path / f"states{number}.csv").read_bytes())
    for name in ("gnss.nmea", "boundary.geojson"):
        (tmp_path / name).write_bytes((drive / name).read_bytes())
    lines = ['furrowmap = 1\n[recording]\ngnss = ["gnss.nmea"]\n[crs]\nmap = "EPSG:6677"\nheights = "ellipsoidal"']
    lines += [f"[antenna]\nxyz_m = {content['antenna']['xyz_m']}"]
    for tool, file in zip(content["implement"], ("rear.csv", "front.csv"), strict=True):
        lines += [f"[[implement]]\nname = {json.dumps(tool['name'])}\nwidth_m = {tool['width_m']}"]
        lines += [f"xy_m = {tool['xy_m']}\nstates = [{json.dumps(file)}]"]
    (tmp_path / "session.toml").write_text("\n".join(lines) + "\n", "utf-8")
    alone = furrowmap.run(tmp_path / "session.toml", tmp_path / "result")
    for seen, told in zip(result.report["figures"]["tools"], alone.report["figures"]["tools"], strict=True):
        assert told["name"] == seen["name"]
        assert told["implement"]["states_from"] == "elsewhere"
        # Positions alone have another heading than scans.
        assert told["worked_area_m2"] == pytest.approx(seen["worked_area_m2"], rel=0.05)
