"""From the samples' recordings to the ground worked, judged by the tool that lies beside them."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from html.parser import HTMLParser
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import geopandas as gpd
import laspy
import numpy as np
import pyogrio
import pytest
import rasterio
from playwright.sync_api import Browser

from furrowmap.core.values.clock import las_time_to_utc
from furrowmap.exporters.reports.drawings import ACTIVITIES
from furrowmap.exporters.reports.html_pages import duration_words
from tests.test_end_to_end import TRACTORS, RunOnce, loop_by_the_truth, rover_session, session_folder, tool_module

AREA_LAYERS = ("zones", "passes", "coverage", "overlaps", "misses")


@dataclass(frozen=True)
class Result:
    """A run's folder, and what the samples' tool says of it."""

    folder: Path
    implement: dict[str, Any]
    work: dict[str, Any]
    report: dict[str, Any]


@pytest.fixture(scope="module")
def result(shared_data: Path, run_once: RunOnce) -> Callable[[str], Result]:
    """A sample's run as its session says, one for all tests."""

    @cache
    def run_of(name: str) -> Result:
        run = run_once(name, lambda folder: session_folder(shared_data, name, folder, truth=False))
        tool = tool_module(shared_data, "evaluate")
        truth = tool.Truth(shared_data / name)
        track = tool.read_layer(run.path, "trajectory", truth.session["crs"]["map"])
        implement = tool.judge_implement(run.path, truth, track)
        return Result(run.path, implement, tool.judge_work(run.path, truth), dict(run.report))

    return run_of


@pytest.mark.parametrize("name", TRACTORS)
def test_states__are_true_and_every_transition_is_found(result: Callable[[str], Result], name: str) -> None:
    found = result(name).implement
    assert found["f1_down"] >= 0.99
    assert found["up_scans_not_said_up"] == 0
    assert found["transitions_found"] == found["transitions_true"] == 6
    assert found["transitions_invented"] == 0
    assert found["timing_abs_median_s"] <= 0.1
    assert found["timing_abs_p95_s"] <= 0.25
    assert found["tool_height"]["rmse_m"] <= 0.01


@pytest.mark.parametrize("name", TRACTORS)
def test_ground__is_the_true_one_within_its_sigma(result: Callable[[str], Result], name: str) -> None:
    work = result(name).work
    coverage = work["coverage"]
    assert abs(coverage["area_error_percent"]) <= 1.5
    assert coverage["iou"] >= 0.96
    assert abs(coverage["error_over_sigma"]) <= 3.0
    assert work["passes"]["passes"] == work["passes"]["passes_true"]
    assert abs(work["overlaps"]["error_percent_of_field"]) <= 0.3
    assert work["misses"]["of_it_truly_worked_m2"] <= 0.1


@pytest.mark.parametrize("name", TRACTORS)
def test_report__tells_the_layers_areas(result: Callable[[str], Result], name: str) -> None:
    found = result(name)
    figures = found.report["figures"]
    for layer, key in (
        ("coverage", "worked"),
        ("overlaps", "overlap"),
        ("misses", "missed"),
        ("unworked", "unworked"),
        ("boundary", "field"),
    ):
        table = gpd.read_file(found.folder / "field.gpkg", layer=layer)
        assert table.geometry.is_valid.all()
        assert figures[f"{key}_area_m2"] == pytest.approx(table.geometry.area.sum(), abs=0.001)
        assert figures[f"{key}_area_m2"] == pytest.approx(figures[f"{key}_area_ellipsoid_m2"], rel=0.001)
    parts = gpd.read_file(found.folder / "field.gpkg", layer="coverage").clip(table).geometry.area.sum()
    assert figures["worked_share"] == pytest.approx(parts / figures["field_area_m2"], abs=1e-4)
    assert parts + figures["missed_area_m2"] + figures["unworked_area_m2"] == pytest.approx(
        figures["field_area_m2"], rel=0.002
    )
    page = (found.folder / "report.html").read_text(encoding="utf-8")
    assert f"{figures['worked_share']:.1%} of the field (" in page
    hours = figures["hours"]
    assert sum(value for name, value in hours.items() if name != "field_s") == pytest.approx(hours["field_s"], abs=0.3)
    assert figures["passes"] == len(gpd.read_file(found.folder / "field.gpkg", layer="passes"))


@pytest.mark.parametrize("name", TRACTORS)
def test_report__shows_the_hours_of_its_tiles_as_bars(result: Callable[[str], Result], name: str) -> None:
    """The time of an activity is that of its bars, as a reader measures them along the axis."""
    found = result(name)
    page = (found.folder / "report.html").read_text(encoding="utf-8").replace("\u00a0", " ")
    graph = re.search(r'<svg [^>]*aria-label="Activity over time">.*?</svg>', page)
    assert graph is not None
    root = ET.fromstring(graph[0])
    ticks = [(text.text or "", float(text.attrib["x"])) for text in root.iter("text")]
    known = [(60.0 * int(t.split(":")[0]) + int(t.split(":")[1]), x) for t, x in ticks if re.match(r"\d+:\d\d$", t)]
    s_per_unit = (known[-1][0] - known[0][0]) / (known[-1][1] - known[0][1])
    hours = found.report["figures"]["hours"]
    colours = {str(name): colour for name, colour in ACTIVITIES.items()}
    for activity, key, tile in (
        ("working", "working_s", None),
        ("turning or reversing", "turning_s", "turning and reversing"),
        ("standing", "idle_s", "standing"),
    ):
        bars = [bar for bar in root.iter("rect") if bar.attrib["fill"] == colours[activity]]
        drawn_s = s_per_unit * sum(float(bar.attrib["width"]) for bar in bars)
        assert drawn_s == pytest.approx(hours[key], abs=0.5)
        assert tile is None or f"<b>{duration_words(hours[key])}</b><span>{tile}</span>" in page


@pytest.mark.parametrize("name", TRACTORS)
def test_cloud__tells_the_pass_of_each_point(result: Callable[[str], Result], name: str) -> None:
    found = result(name)
    passes = pyogrio.read_dataframe(found.folder / "field.gpkg", layer="passes", read_geometry=False)
    wanted = laspy.DecompressionSelection.base().decompress_gps_time().decompress_point_source_id()
    las = laspy.read(found.folder / "cloud.copc.laz", decompression_selection=wanted)
    t_s = las_time_to_utc(np.asarray(las.gps_time))
    expected = np.zeros(len(t_s), int)
    clear = np.ones(len(t_s), bool)
    for number, *ends in zip(passes["pass"], passes["start"], passes["end"], strict=True):
        begin_s, end_s = (end.timestamp() for end in ends)
        expected[(t_s >= begin_s) & (t_s <= end_s)] = number
        clear &= (np.abs(t_s - begin_s) > 0.001) & (np.abs(t_s - end_s) > 0.001)  # layers tell milliseconds
    assert clear.mean() > 0.999
    np.testing.assert_array_equal(np.asarray(las.point_source_id)[clear], expected[clear])


@pytest.mark.parametrize("name", TRACTORS)
def test_swaths_raster__is_the_map_of_what_the_report_tells(result: Callable[[str], Result], name: str) -> None:
    """Mean, RMS and area come out of the raster again; its values are rounded to eighths of a millimetre."""
    found = result(name)
    told = found.report["accuracy"]["swaths"]
    with rasterio.open(found.folder / "swaths.tif") as raster, rasterio.open(found.folder / "dsm.tif") as surface:
        difference = raster.read(1, masked=True).compressed().astype(np.float64)
        area_m2 = len(difference) * abs(raster.transform.determinant)
        assert raster.bounds.left <= surface.bounds.left < raster.bounds.left + 0.4
        assert raster.bounds.top - 0.4 < surface.bounds.top <= raster.bounds.top
    assert area_m2 == pytest.approx(told["area_m2"], abs=0.06)
    assert difference.mean() == pytest.approx(told["mean_m"], abs=1e-4)
    assert np.sqrt(np.mean(difference**2)) == pytest.approx(told["rms_m"], abs=1e-4)
    page = (found.folder / "report.html").read_text(encoding="utf-8")
    assert f"{1000 * told['rms_m']:.0f}." in page
    assert "The same ground seen again" in page


class _Addresses(HTMLParser):
    """Collects what a page refers to, and its text."""

    def __init__(self) -> None:
        super().__init__()
        self.addresses: list[str] = []
        self.tags: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.addresses += [value or "" for name, value in attrs if name in ("src", "href", "srcset", "data")]


@pytest.mark.parametrize("name", TRACTORS)
def test_page__is_whole_in_itself_and_tells_the_figures(result: Callable[[str], Result], name: str) -> None:
    found = result(name)
    text = (found.folder / "report.html").read_text(encoding="utf-8").replace("\u00a0", " ")
    page = _Addresses()
    page.feed(text)
    assert page.addresses
    assert all(address.startswith("data:image/png;base64,") for address in page.addresses)
    assert not {"script", "link", "iframe"} & set(page.tags)
    assert "url(" not in text
    assert text.count('<svg viewBox="0 0') == 9
    assert text.count('<image class="depth"') == 3
    assert f"{found.report['figures']['worked_area_m2']:.1f} m²" in text
    assert len(text) < 400_000


@pytest.mark.parametrize(("width", "height"), [(1280, 900), (360, 740)], ids=["desktop", "phone"])
def test_page__in_a_browser_asks_for_nothing_fits_its_width_and_prints(
    result: Callable[[str], Result], browser: Browser, width: int, height: int
) -> None:
    address = (result("tractor_fishtail").folder / "report.html").as_uri()
    page = browser.new_page(viewport={"width": width, "height": height})
    asked: list[str] = []
    faults: list[str] = []
    page.on("request", lambda request: asked.append(request.url))
    page.on("console", lambda message: faults.append(message.text))
    page.on("pageerror", lambda error: faults.append(str(error)))
    page.goto(address)
    assert [url for url in asked if not url.startswith("data:")] == [address]
    assert faults == []
    assert page.evaluate("document.documentElement.scrollWidth") == width
    pdf = page.pdf(format="A4")
    assert pdf.startswith(b"%PDF")
    assert 2 <= len(re.findall(rb"/Type\s*/Page\b", pdf)) <= 5
    page.close()


def test_a_session_without_implement_has_states_but_no_ground(shared_data: Path, run_once: RunOnce) -> None:
    result = loop_by_the_truth(shared_data, run_once)
    report, out = result.report, result.path
    assert report["session"]["implement"] is None
    assert "implement-not-stated" in {warning["code"] for warning in report["warnings"]}
    assert report["figures"]["implement"]["transitions"] == 6
    assert "worked_area_m2" not in report["figures"]
    assert pyogrio.list_layers(out / "field.gpkg")[:, 0].tolist() == ["trajectory", "layer_styles"]
    track = pyogrio.read_dataframe(out / "field.gpkg", layer="trajectory", read_geometry=False)
    assert set(track["implement"]) == {"down", "up"}
    assert "how wide it is" in (out / "report.html").read_text(encoding="utf-8")


def test_a_rover_has_no_implement_and_a_page_all_the_same(shared_data: Path, run_once: RunOnce) -> None:
    result = run_once("rover", lambda folder: rover_session(shared_data, folder, poses=True))
    report, out = result.report, result.path
    assert report["figures"]["implement"] is None
    assert "implement-never-moves" in {warning["code"] for warning in report["warnings"]}
    track = pyogrio.read_dataframe(out / "field.gpkg", layer="trajectory", read_geometry=False)
    assert set(track["implement"]) == {"unknown"}
    assert "<svg" in (out / "report.html").read_text(encoding="utf-8")
    assert json.loads((out / "report.json").read_text())["products"] == report["products"]
