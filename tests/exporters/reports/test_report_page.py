"""`report.html`: whole in itself, safe with any name, and its pictures what they are said to be."""

from __future__ import annotations

import base64
import io
import re
import xml.etree.ElementTree as ET
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from matplotlib import image as pictures

from furrowmap.core.coverage.field_work import FieldWork
from furrowmap.core.surfaces.visits import SwathSums
from furrowmap.core.values.tool_states import ToolState, ToolStates
from furrowmap.exporters.rasters.web_images import data_uri, encode_image
from furrowmap.exporters.reports.drawings import (
    map_box,
    pass_colour,
    quality_graph,
    quality_map,
    swath_histogram,
    tool_graph,
    work_map,
)
from furrowmap.exporters.reports.page_language import chosen
from furrowmap.exporters.reports.svg import WIDTH, Sheet, curve
from tests.exporters.vectors.worked_field import worked_field


@given(hnp.arrays(np.uint8, st.tuples(st.integers(1, 9), st.integers(1, 9), st.sampled_from([3, 4]))))
def test_png__is_read_back_by_another_library(picture: np.ndarray) -> None:
    read = pictures.imread(io.BytesIO(encode_image(picture, "PNG")), format="png")
    np.testing.assert_array_equal(np.round(read * 255), picture)


def test_data_uri__holds_the_picture() -> None:
    picture = np.arange(24, dtype=np.uint8).reshape(3, 4, 2)
    head, _, body = data_uri(picture).partition(",")
    assert head == "data:image/png;base64"
    read = pictures.imread(io.BytesIO(base64.b64decode(body)), format="png")
    np.testing.assert_array_equal(np.round(read * 255), np.dstack([picture[:, :, :1]] * 3 + [picture[:, :, 1:]]))


def test_drawings__are_well_formed_and_stay_on_their_sheet() -> None:
    poses, work = worked_field()
    drawings = [
        work_map(map_box(poses, work), poses, work, None),
        work_map(map_box(poses, FieldWork()), poses, FieldWork(), None),
        quality_map(poses),
        tool_graph(work),
        quality_graph(poses),
    ]
    for text in drawings:
        root = ET.fromstring(text)
        width, height = (float(v) for v in root.attrib["viewBox"].split()[2:])
        found = 0
        for shape in root:
            numbers = re.findall(r"[-\d.]+", shape.attrib.get("points", ""))
            x, y = np.array(numbers[::2], float), np.array(numbers[1::2], float)
            assert ((x >= -1) & (x <= width + 1)).all()
            assert ((y >= -1) & (y <= height + 1)).all()
            found += len(shape.attrib)
        assert found > 5


@given(
    west=st.floats(-1e6, 1e6), south=st.floats(-1e6, 1e7), width=st.floats(10.0, 5e4), shape=st.floats(0.2, 5.0)
)  # fmt: skip
def test_scale_bar__is_as_long_as_a_line_of_its_length(west: float, south: float, width: float, shape: float) -> None:
    sheet = Sheet((west, south, west + width, south + shape * width))
    root = ET.fromstring(sheet.svg([], "map"))
    (bar,) = (shape for shape in root.iter() if shape.attrib.get("class") == "bar")
    label = next(shape.text or "" for shape in root.iter() if (shape.text or "").endswith(" m"))
    left, right = (float(part) for part in re.findall(r"^M([\d.]+) [\d.]+H([\d.]+)$", bar.attrib["d"])[0])
    length_m = float(label.removesuffix(" m"))
    drawn = ET.fromstring(sheet.line(np.array([[west, south], [west + length_m, south]]), "line"))
    begin, end = (float(word.split()[0]) for word in drawn.attrib["d"].removeprefix("M").split("L"))
    assert right - left == pytest.approx(end - begin, abs=0.2)
    assert 0.08 * sheet.size[0] < right - left < 0.3 * sheet.size[0]


@given(width=st.floats(10.0, 5e3), shape=st.floats(0.05, 20.0))
def test_scale_bar__and_north_arrow_cover_nothing_of_the_map(width: float, shape: float) -> None:
    sheet = Sheet((0.0, 0.0, width, shape * width))
    root = ET.fromstring(sheet.svg([], "map"))
    tops = []
    for mark in root:
        size = 13.0 if mark.tag == "text" else 1.5  # of letters, and half the width of the bar
        tops.append(float(mark.attrib.get("y") or re.findall(r"^M[\d.]+ ([\d.]+)", mark.attrib["d"])[0]) - size)
    assert len(tops) == 4
    assert min(tops) > sheet.size[1]
    assert max(tops) < float(root.attrib["viewBox"].split()[3])


@pytest.mark.parametrize(
    ("spread_m", "edge"), [(0.002, "10 mm"), (0.02, "50 mm and more"), (0.2, "100 mm and more")], ids=str
)
def test_swath_histogram__bars_are_the_shares_of_the_ground(spread_m: float, edge: str) -> None:
    """The bars' heights sum to all of the ground, and half of that lies right of zero."""
    sums = SwathSums()
    sums.add(np.random.default_rng(3).normal(0.0, spread_m, 4000).astype(np.float32), 0.16)
    differences = sums.differences()
    assert differences is not None
    text = chosen(swath_histogram(differences), "en")
    root = ET.fromstring(text)
    bars = [shape.attrib for shape in root if shape.attrib.get("class") == "bars"]
    middle = next(float(shape.attrib["x1"]) for shape in root if shape.attrib.get("class") == "threshold")
    heights = np.array([float(bar["height"]) for bar in bars])
    right = np.array([float(bar["x"]) > middle for bar in bars])
    assert heights[right].sum() / heights.sum() == pytest.approx(differences.histogram[50:].sum() / 4000, abs=0.005)
    ends = {shape.text for shape in root if shape.tag == "text"}
    assert {f"−{edge}", f"+{edge}"} <= ends


def test_work_map__shows_each_pass_overlap_and_miss() -> None:
    poses, work = worked_field()
    assert work.ground is not None
    text = work_map(map_box(poses, work), poses, work, None)
    for kind, count in (("pass", 3), ("overlap", len(work.ground.overlaps)), ("miss", len(work.ground.misses))):
        assert text.count(f'class="{kind}"') == count > 0
    assert text.count('class="boundary"') == 1
    first = re.search(r'class="pass" fill="(#\w+)"', text)
    assert first is not None
    assert first[1] == pass_colour(1, 3) != pass_colour(3, 3)


@pytest.mark.parametrize("seconds", [5.0, 60.0, 28_800.0])
def test_tool_graph__of_a_day_is_as_small_as_that_of_a_minute(seconds: float) -> None:
    _, work = worked_field()
    history = work.history
    assert history is not None
    n = round(seconds * 10)
    rng = np.random.default_rng(2)
    values = {name: getattr(history, name) for name in history.__dataclass_fields__} | {
        "t_s": history.t_s[0] + 0.1 * np.arange(n),
        "tool_height_m": rng.uniform(0.0, 0.45, n),
    }
    text = tool_graph(FieldWork(history=type(history)(**values)))
    assert 1 < text.count('class="label') < 14
    assert len(text) < 60_000


def test_drawings__of_many_passes_have_no_numbers() -> None:
    poses, work = worked_field()
    assert work.ground is not None
    one = work.ground.passes[0]
    for count, numbered in ((60, 60), (61, 0)):
        many = tuple(replace(one, number=k) for k in range(1, count + 1))
        text = work_map(map_box(poses, work), poses, replace(work, ground=replace(work.ground, passes=many)), None)
        assert text.count('class="pass"') == count
        assert text.count('class="number"') == numbered + 1  # that of the north arrow


def test_tool_graph__of_many_passes_has_no_numbers() -> None:
    _, work = worked_field()
    assert work.history is not None
    for count, numbered in ((40, 40), (41, 0)):
        begin_s = work.history.t_s[0] + np.arange(count)
        down, sure = np.full(count, ToolState.DOWN, np.int8), np.ones(count)
        states = ToolStates(begin_s, begin_s + 0.5, down, sure, 0.0 * sure, 0.0 * sure)
        text = tool_graph(FieldWork(history=replace(work.history, states=states)))
        assert text.count('class="down"') == count
        assert text.count('class="number"') == numbered


def test_quality_graph__without_sigmas_has_only_the_bar_of_fixes() -> None:
    poses, _ = worked_field()
    known, unknown = (
        ET.fromstring(quality_graph(replace(poses, sigma=sigma)))
        for sigma in (np.full_like(poses.sigma, 0.02), np.full_like(poses.sigma, np.nan))
    )
    for root, curves in ((known, 1), (unknown, 0)):
        assert sum(shape.attrib.get("class") == "curve" for shape in root) == curves
        bars = [float(shape.attrib["width"]) for shape in root if shape.tag.endswith("rect")]
        assert sum(bars) == pytest.approx(WIDTH - 86.0, abs=0.5)
        height = float(root.attrib["viewBox"].split()[3])
        assert all(0.0 < float(shape.attrib["y"]) < height for shape in root if shape.tag.endswith("text"))
    assert float(unknown.attrib["viewBox"].split()[3]) < float(known.attrib["viewBox"].split()[3])


def test_path__of_one_pose_is_no_line() -> None:
    poses, _ = worked_field()
    one = replace(
        poses, **{name: value[:1] for name, value in vars(poses).items() if isinstance(value, np.ndarray)}
    )  # fmt: skip
    assert 'class="fix"' in quality_map(poses)
    assert 'class="fix"' not in quality_map(one)


def test_curve__is_interrupted_at_nan_and_keeps_the_extremes() -> None:
    x = np.array([0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0])
    y = np.array([1.0, 2.0, np.nan, 3.0, np.nan, 5.0, 6.0])
    lines = [ET.fromstring(part).attrib["points"] for part in curve(x, y)]
    assert lines == ["0.0,1.0 1.0,2.0", "5.0,5.0 6.0,6.0"]  # one value alone is no line
    fine = np.linspace(0.0, 0.99, 100)
    wave = np.where(np.arange(100) == 37, 9.0, np.where(np.arange(100) == 61, -9.0, 0.0))
    (line,) = (ET.fromstring(part).attrib["points"].split() for part in curve(fine, wave))
    assert [float(point.split(",")[1]) for point in line] == [0.0, 9.0, -9.0, 0.0]
    assert curve(x, np.full(7, np.nan)) == []
