"""The layers of the ground worked: fields, geometries and times as they were computed, and QGIS's view of them."""

from __future__ import annotations

import datetime as dt
import sqlite3
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING
from zoneinfo import ZoneInfo

import geopandas as gpd
import numpy as np
import pyogrio
import pytest

from furrowmap.core.coverage.field_work import FieldWork
from furrowmap.core.runtime.settings import using
from furrowmap.exporters.vectors.geopackage import write_field
from tests.core.implement.drives_with_tool import FRAME
from tests.exporters.vectors.worked_field import DOWN_S, worked_field

if TYPE_CHECKING:
    from conftest import QgisRoot

AREAS = ["area_m2", "area_ellipsoid_m2", "area_sigma_m2"]
FIELDS = {
    "events": ("Point Z", ["kind", "time", "t_s", "pass", "sigma_s"]),
    "tool_path": ("LineString Z", ["implement", "pass", "start", "end", "length_m"]),
    "misses": ("Polygon", ["kind", *AREAS]),
    "unworked": ("Polygon", AREAS),
    "boundary": ("MultiPolygon", ["worked_share", *AREAS]),
    "overlaps": ("Polygon", ["pass_a", "pass_b", "start", "end", *AREAS]),
    "coverage": ("MultiPolygon", AREAS),
    "passes": (
        "MultiPolygon",
        [
            "pass",
            "start",
            "end",
            "length_m",
            "width_m",
            *AREAS,
            "speed_mps",
            "depth_m",
            "depth_sigma_m",
            "depth_spread_m",
        ],
    ),
    "zones": ("Polygon", ["zone", *AREAS]),
}


@pytest.fixture(scope="module")
def field(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("layers") / "field.gpkg"
    poses, work = worked_field()
    write_field(path, poses, FRAME.crs, work)
    return path


def test_layers__have_their_fields_and_kinds_topmost_first(field: Path) -> None:
    names = [name for name in pyogrio.list_layers(field)[:, 0] if name != "layer_styles"]
    assert names == ["events", "trajectory", *list(FIELDS)[1:]]
    for name, (kind, fields) in FIELDS.items():
        info = pyogrio.read_info(field, layer=name)
        assert (info["geometry_type"], list(info["fields"])) == (kind, fields)


def test_layers__hold_valid_shapes_whose_areas_are_told(field: Path) -> None:
    for name, (kind, _) in FIELDS.items():
        table = gpd.read_file(field, layer=name)
        assert len(table) > 0, name
        assert table.geometry.is_valid.all(), name
        if "Polygon" in kind:
            np.testing.assert_allclose(table["area_m2"], table.geometry.area, rtol=1e-9)
            assert (table["area_sigma_m2"] >= 0).all()


def test_passes__are_those_of_the_tool(field: Path) -> None:
    passes = gpd.read_file(field, layer="passes")
    assert passes["pass"].tolist() == [1, 2, 3]
    lengths_s = (passes["end"] - passes["start"]).dt.total_seconds()
    np.testing.assert_allclose(lengths_s, [end - begin for begin, end in DOWN_S], atol=0.0015)
    np.testing.assert_allclose(passes["depth_m"], 0.12, atol=1e-9)
    coverage, overlaps = gpd.read_file(field, layer="coverage"), gpd.read_file(field, layer="overlaps")
    assert passes.geometry.union_all().symmetric_difference(coverage.geometry[0]).area < 1e-6
    assert coverage["area_m2"][0] == pytest.approx(passes["area_m2"].sum() - overlaps["area_m2"].sum(), rel=1e-3)


def test_trajectory__tells_the_tools_state_at_each_scan(field: Path) -> None:
    _, work = worked_field()
    track = gpd.read_file(field, layer="trajectory")
    t_s = track["t_s"].to_numpy() - work.history.states.begin_s[0]
    number = np.zeros(len(t_s), int)
    for k, (begin, end) in enumerate(DOWN_S, start=1):
        number[(t_s >= begin) & (t_s <= end)] = k
    sure = np.abs(t_s[:, None] - np.ravel(DOWN_S)).min(axis=1) > 1e-3
    np.testing.assert_array_equal(track["pass"].fillna(0)[sure], number[sure])
    np.testing.assert_array_equal((track["implement"] == "down")[sure], number[sure] > 0)
    assert track["tool_height_m"].isna().sum() == 20


def test_without_work__there_is_only_the_trajectory_and_its_states_are_unknown(tmp_path: Path) -> None:
    poses, _ = worked_field()
    write_field(tmp_path / "field.gpkg", poses, FRAME.crs, FieldWork())
    assert pyogrio.list_layers(tmp_path / "field.gpkg")[:, 0].tolist() == ["trajectory", "layer_styles"]
    track = gpd.read_file(tmp_path / "field.gpkg", layer="trajectory")
    assert set(track["implement"]) == {"unknown"}
    assert track["pass"].isna().all()


def test_map_tips__show_the_local_time_of_the_zone_that_they_name(tmp_path: Path) -> None:
    poses, work = worked_field()
    styles = {}
    for zone in (None, ZoneInfo("America/St_Johns")):
        write_field(tmp_path / "field.gpkg", poses, FRAME.crs, work, zone=zone)
        with closing(sqlite3.connect(tmp_path / "field.gpkg")) as base:
            styles[zone] = dict(base.execute("SELECT f_table_name, styleQML FROM layer_styles WHERE useAsDefault"))
    local = dt.datetime.fromtimestamp(poses.t_s[0], ZoneInfo("America/St_Johns")).utcoffset()
    assert local is not None
    for name in ("events", "passes", "tool_path", "trajectory"):
        utc, there = (style[name].partition("<mapTip")[2].partition("</mapTip>")[0] for style in styles.values())
        shift = f" + to_interval('{local.total_seconds():.0f} seconds'), 'HH:mm:ss"
        assert utc.count("UTC") == there.count("(America/St_Johns)") == 1
        assert there.replace(shift, ", 'HH:mm:ss").replace("(America/St_Johns)", "UTC") == utc
        assert there.count(shift) == utc.count("format_date(") > 0


def test_qgis__opens_every_layer_in_its_style_and_plays_the_day(field: Path, qgis: QgisRoot) -> None:
    layers = {layer["name"]: layer for layer in qgis.open_layers(field)}
    assert {"trajectory", *FIELDS} <= set(layers)
    assert all(layers[name]["valid"] and layers[name]["crs"] == "EPSG:6677" for name in FIELDS)
    renderers = {name: layers[name]["renderer"] for name in FIELDS}
    assert renderers == {
        **dict.fromkeys(("events", "tool_path", "misses", "passes", "zones"), "categorizedSymbol"),
        **dict.fromkeys(("unworked", "boundary", "overlaps", "coverage"), "singleSymbol"),
    }
    told = qgis.run("python3", Path(__file__).with_name("temporal_in_qgis.py"), field, *FIELDS)
    times = dict(zip(FIELDS, (line.split()[:2] for line in told.splitlines()[-len(FIELDS) :]), strict=True))
    assert times["passes"] == times["overlaps"] == times["tool_path"] == ["True", "end"], (
        "they appear when they were made"
    )
    assert times["events"] == ["True", "time"]


def test_qgis__shows_names_rounded_figures_words_and_actions_without_the_plugin(tmp_path: Path, qgis: QgisRoot) -> None:
    poses, work = worked_field()
    with using(language="ja"):
        write_field(tmp_path / "field.gpkg", poses, FRAME.crs, work)
    told = qgis.run("python3", Path(__file__).with_name("words_in_qgis.py"), tmp_path / "field.gpkg").splitlines()[-4:]
    assert {"行程", "長さ（m）", "面積・地図平面（m²）", "深さ・目安（m）"} <= set(told[0].split("; "))
    assert told[1] == "27.2; 前進"
    assert told[2] == f"レポートを開く; file://{tmp_path}/report.html"
    assert told[3] == f"フォルダを開く; file://{tmp_path}/"
