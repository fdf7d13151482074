"""A drive across midnight in Japan: all products show the same local times, and name their zone."""

from __future__ import annotations

import datetime as dt
import re
import sqlite3
from contextlib import closing
from pathlib import Path
from xml.etree import ElementTree as ET
from zoneinfo import ZoneInfo

import geopandas as gpd
import pandas as pd
import pytest

import furrowmap
from furrowmap.exporters.files.result_folder import open_result
from furrowmap.exporters.share.page_features import shared_layer
from furrowmap.exporters.vectors.qgis_styles import StyleClock, in_local_times, offset_changes
from furrowmap.workflows.farm.farm import add_to_farm_map, farm_map_sessions
from furrowmap.workflows.share.export import export

TOKYO = ZoneInfo("Asia/Tokyo")
HOURS = "to_interval('32400 seconds')"


@pytest.fixture(scope="module")
def passes(result: furrowmap.Result) -> pd.DataFrame:
    """With times in UTC, as they are stored."""
    return gpd.read_file(result.path / "field.gpkg", layer="passes")


def tips(path: Path) -> dict[str, str]:
    """Map tips of the layers in a GeoPackage that show times."""
    with closing(sqlite3.connect(path)) as base:
        styles = dict(base.execute("SELECT f_table_name, styleQML FROM layer_styles WHERE useAsDefault"))
    found = {name: style.partition("<mapTip")[2].partition("</mapTip>")[0] for name, style in styles.items()}
    return {name: tip for name, tip in found.items() if re.search(r'format_date\("(start|end|time)"', tip)}


def test_drive__crosses_midnight_in_japan_only(result: furrowmap.Result, passes: pd.DataFrame) -> None:
    figures = result.report["figures"]
    assert figures["time_zone"] == "Asia/Tokyo"
    assert (figures["start_local"][:10], figures["end_local"][:10]) == ("2026-06-11", "2026-06-12")
    assert (figures["start"][:10], figures["end"][:10]) == ("2026-06-11", "2026-06-11")
    for key in ("start", "end"):
        assert dt.datetime.fromisoformat(figures[f"{key}_local"]) == dt.datetime.fromisoformat(figures[key])
    assert {str(moment.tzinfo) for moment in passes["start"]} == {"UTC"}


def test_report_page__has_them_with_the_zone(result: furrowmap.Result, passes: pd.DataFrame) -> None:
    page = (result.path / "report.html").read_text(encoding="utf-8")
    begin, end = (dt.datetime.fromisoformat(result.report["figures"][f"{key}_local"]) for key in ("start", "end"))
    assert f"{begin:%Y-%m-%d}, {begin:%H:%M:%S} to {end:%Y-%m-%d}, {end:%H:%M:%S} (Asia/Tokyo, UTC+09:00)" in page
    for one in passes.itertuples():
        assert f"<td>{one.start.tz_convert(TOKYO):%H:%M:%S}</td><td>{one.end.tz_convert(TOKYO):%H:%M:%S}</td>" in page


def test_map_tips__of_result_export_and_farm_map(result: furrowmap.Result, tmp_path: Path) -> None:
    add_to_farm_map(tmp_path / "farm.gpkg", [result.path])
    export([result.path], "gpkg", tmp_path / "copy.gpkg")
    for path in (result.path / "field.gpkg", tmp_path / "copy.gpkg", tmp_path / "farm.gpkg"):
        found = tips(path)
        assert {"passes", "events", "tool_path"} <= set(found)
        for tip in found.values():
            assert "(Asia/Tokyo)" in tip
            assert "UTC" not in tip
            assert tip.count(HOURS) == len(re.findall(r'format_date\("(?:start|end|time)"', tip))
    (session,) = farm_map_sessions(tmp_path / "farm.gpkg")[2]
    assert (session.time_zone, session.date) == ("Asia/Tokyo", dt.date(2026, 6, 11))


def test_kml_and_page__show_each_pass_at_the_same_time(
    result: furrowmap.Result, passes: pd.DataFrame, tmp_path: Path
) -> None:
    export([result.path], "kml", tmp_path / "field.kml")
    folders = ET.parse(tmp_path / "field.kml").findall(".//{*}Folder")
    (folder,) = (one for one in folders if one.findtext("{*}name") == "passes")
    page = shared_layer("passes", open_result(result.path).layer("passes"), TOKYO, shown=True)
    assert page is not None
    for one, mark, shown in zip(passes.itertuples(), folder.findall("{*}Placemark"), page["features"], strict=True):
        local = one.start.tz_convert(TOKYO)
        data = {field.get("name"): field for field in mark.findall(".//{*}Data")}
        assert data["start"].findtext("{*}value") == local.isoformat(timespec="milliseconds")
        assert data["start"].findtext("{*}displayName") == "start (Asia/Tokyo)"
        assert dict(shown["rows"])["Time"].startswith(f"{local:%Y-%m-%d %H:%M:%S} – ")
        assert dict(shown["rows"])["Time"].endswith("(Asia/Tokyo)")


def test_clocks_that_change_within_a_season__are_followed_in_map_tips() -> None:
    """Against the calendar: in 2026 summer time in Berlin ends on 25 October at 01:00 UTC."""
    berlin = ZoneInfo("Europe/Berlin")
    first, last = (dt.datetime(2026, month, 1, tzinfo=dt.UTC).timestamp() for month in (9, 12))
    change = dt.datetime(2026, 10, 25, 1, tzinfo=dt.UTC)
    assert offset_changes(berlin, first, last) == [(int(change.timestamp()), 3600)]
    tip = in_local_times("""[% format_date("start", 'HH:mm') %] UTC""", [StyleClock(berlin, first, last)])
    assert f'WHEN epoch("start") &gt;= {1000 * int(change.timestamp())} THEN' in tip
    assert "ELSE to_interval('7200 seconds') END" in tip
    assert "(Europe/Berlin)" in tip


def test_map_tips__of_sessions_in_different_zones_show_the_clock_of_each() -> None:
    june_s = dt.datetime(2026, 6, 11, tzinfo=dt.UTC).timestamp()
    clocks = [
        StyleClock(TOKYO, june_s, june_s + 1.0, ("a", "c")),
        StyleClock(ZoneInfo("Europe/Berlin"), june_s, june_s + 1.0, ("b",)),
    ]
    tip = in_local_times("""[% format_date("start", 'HH:mm') %] UTC""", clocks)
    of_b = """(CASE WHEN "session" IN ('b') THEN {} ELSE {} END)"""
    hours = of_b.format("to_interval('7200 seconds')", HOURS)
    zone = of_b.format("'Europe/Berlin'", "'Asia/Tokyo'")
    assert tip == f"""[% format_date("start" + {hours}, 'HH:mm') %] ([% {zone} %])"""
