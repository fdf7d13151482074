"""Graphs and maps of a run: whoever reads them by their axes finds the values and times of the run."""

from __future__ import annotations

import re
from dataclasses import replace
from itertools import pairwise
from xml.etree import ElementTree as ET

import numpy as np
import pytest

from furrowmap.core.coverage.field_work import FieldWork
from furrowmap.core.values.tool_states import ToolState, ToolStates
from furrowmap.core.values.trajectory import Motion, ScanPoses
from furrowmap.exporters.reports.drawings import (
    ACTIVITIES,
    activities,
    activity_graph,
    fix_colour,
    pass_colour,
    quality_graph,
    quality_map,
    tool_graph,
)
from furrowmap.exporters.reports.report_page import range_limits_m
from tests.exporters.reports.drawn import FloatArray, corners, number, reading, span
from tests.exporters.vectors.worked_field import LIFTED_M, worked_field

POSES, WORK = worked_field()
NOT_KNOWN = replace(POSES, sigma=np.full_like(POSES.sigma, np.nan))


def times(root: ET.Element, x: FloatArray | float | tuple[float, float]) -> FloatArray:
    """Seconds since the beginning of places along the axis of times."""
    texts = [(text.text or "", float(text.attrib["x"])) for text in root.iter("text")]
    labels = [(60.0 * int(t.split(":")[0]) + int(t.split(":")[1]), at) for t, at in texts if re.match(r"\d+:\d\d$", t)]
    return reading(labels)(np.asarray(x))


def centimetres(root: ET.Element, y: FloatArray | float | tuple[float, float]) -> FloatArray:
    """Values of places along the axis of lengths."""
    labels = [text for text in root.iter("text") if (text.text or "").endswith(" cm")]
    return reading([(number(t.text or ""), float(t.attrib["y"]) - 4.0) for t in labels])(np.asarray(y))


def in_time(count: int, step_s: float = 1.0, pause_after: int | None = None) -> ScanPoses:
    """The first poses at even times, with a pause of a minute after one of them."""
    few = {name: values[:count] for name, values in vars(POSES).items()}
    t_s = 1.7e9 + step_s * np.arange(count)
    if pause_after is not None:
        t_s[pause_after + 1 :] += 60.0
    return replace(POSES, **few | {"t_s": t_s})


def test_tool_graph__shows_heights_states_and_passes_at_their_times() -> None:
    history = WORK.history
    assert history is not None
    root = ET.fromstring(tool_graph(WORK))
    since_s = history.t_s - history.t_s[0]
    lines = [corners(line) for line in root.iter("polyline")]
    assert len(lines) == 2, "it is not known for two seconds"
    gap_s = since_s[99], since_s[120]
    for line in lines:
        at_s, height_m = times(root, line[:, 0]), centimetres(root, line[:, 1]) / 100.0
        assert not ((at_s > gap_s[0] + 0.1) & (at_s < gap_s[1] - 0.1)).any()
        for when, height in zip(at_s.tolist(), height_m.tolist(), strict=True):
            near = history.tool_height_m[np.abs(since_s - when) < 0.2]
            assert np.nanmin(np.abs(near - height)) < 1e-3
    both = centimetres(root, np.concatenate(lines)[:, 1])
    assert (both.min(), both.max()) == pytest.approx((0.0, 100.0 * LIFTED_M), abs=0.1)
    (limit,) = (line for line in root.iter("line") if line.attrib["class"] == "threshold")
    assert centimetres(root, span(limit, "y")) == pytest.approx([12.0, 12.0], abs=0.1)
    states = history.states
    blocks = [*root.iter("rect")]
    assert [block.attrib["class"] for block in blocks] == [ToolState(int(state)).label for state in states.state]
    for block, begin_s, end_s in zip(blocks, states.begin_s, states.end_s, strict=True):
        wanted = np.clip([begin_s, end_s], history.t_s[0], history.t_s[-1]) - history.t_s[0]
        assert times(root, span(block, "x")) == pytest.approx(wanted, abs=0.05)
    numbers = [text for text in root.iter("text") if text.attrib["class"] == "number"]
    assert [text.text for text in numbers] == ["1", "2", "3"]
    middles = [0.5 * (when.begin_s + when.end_s) - history.t_s[0] for when in WORK.passes]
    assert times(root, np.array([float(text.attrib["x"]) for text in numbers])) == pytest.approx(middles, abs=0.05)


def test_quality_graph__shows_fixes_and_sigmas_at_their_times() -> None:
    """The standard deviation in place is that of east and north together; a wild one is cut at the edge."""
    poses = in_time(400)
    sigma = np.tile([0.03, 0.04, 9.0, 9.0, 9.0, 9.0], (400, 1))
    sigma[200:, :2] *= 2.0
    sigma[50] = 40.0
    root = ET.fromstring(quality_graph(replace(poses, sigma=sigma)))
    bars = [*root.iter("rect")]
    assert [bar.attrib["fill"] for bar in bars] == [fix_colour(4), fix_colour(5)]
    assert times(root, span(bars[0], "x")) == pytest.approx([0.0, 300.0], abs=0.2)
    assert times(root, span(bars[1], "x")) == pytest.approx([300.0, 399.0], abs=0.2)
    line = np.concatenate([corners(each) for each in root.iter("polyline")])
    at_s, sigma_cm = times(root, line[:, 0]), centimetres(root, line[:, 1])
    usual = np.abs(at_s - 50.0) > 1.5
    assert sigma_cm[usual & (at_s < 199.0)] == pytest.approx(5.0, abs=0.1)
    assert sigma_cm[usual & (at_s > 201.0)] == pytest.approx(10.0, abs=0.1)
    assert line[:, 1].min() == 20.0
    assert sigma_cm.max() == pytest.approx(13.0, abs=0.1)  # 1.3 times what 99 % are below


@pytest.mark.parametrize(
    ("motion", "state", "kind"),
    [
        (Motion.FORWARD, ToolState.DOWN, 0), (Motion.FORWARD, ToolState.UP, 1), (Motion.FORWARD, ToolState.UNKNOWN, 3),
        (Motion.REVERSE, ToolState.DOWN, 1), (Motion.REVERSE, ToolState.UP, 1), (Motion.REVERSE, ToolState.UNKNOWN, 1),
        (Motion.STANDING, ToolState.DOWN, 2), (Motion.STANDING, ToolState.UP, 2),
        (Motion.STANDING, ToolState.UNKNOWN, 2),
    ],
)  # fmt: skip
def test_activity__follows_from_motion_and_tool(motion: Motion, state: ToolState, kind: int) -> None:
    poses = replace(in_time(3), motion=np.full(3, motion, np.int8))
    one, t_s = np.ones(1), poses.t_s
    states = ToolStates(t_s[:1] - 9.0, t_s[-1:] + 9.0, np.array([state], np.int8), one, 0.0 * one, 0.0 * one)
    assert WORK.history is not None
    work = FieldWork(history=replace(WORK.history, states=states))
    assert activities(poses, work).tolist() == [kind] * 3
    if state is ToolState.UNKNOWN:
        assert activities(poses, FieldWork()).tolist() == [kind] * 3


@pytest.mark.parametrize("pause_after", [None, 2, 9, 14])
def test_activity_graph__shows_what_was_done_when_but_for_pauses(pause_after: int | None) -> None:
    poses = in_time(20, 1.0, pause_after)
    motion = np.full(20, Motion.FORWARD, np.int8)
    motion[5:10], motion[10:12] = Motion.STANDING, Motion.REVERSE
    root = ET.fromstring(activity_graph(replace(poses, motion=motion), FieldWork()))
    since_s = poses.t_s - poses.t_s[0]
    colours = list(ACTIVITIES.values())
    runs = [(0, 5, 3), (5, 10, 2), (10, 12, 1), (12, 20, 3)]
    wanted = []
    for first, behind, kind in runs:
        cuts = [
            first,
            *([pause_after + 1] if pause_after is not None and first <= pause_after < behind - 1 else []),
            behind,
        ]
        for a, b in pairwise(cuts):
            paused = b == 20 or (pause_after is not None and b == pause_after + 1)
            wanted.append((colours[kind], since_s[b - 1] if paused else since_s[b], since_s[a]))
    bars = [*root.iter("rect")]
    assert [bar.attrib["fill"] for bar in bars] == [colour for colour, _, _ in wanted]
    for bar, (_, end_s, begin_s) in zip(bars, wanted, strict=True):
        assert times(root, span(bar, "x")) == pytest.approx([begin_s, end_s], abs=0.06)
    rows = {bar.attrib["fill"]: float(bar.attrib["y"]) for bar in bars}
    assert sorted(rows.values()) == [4.0, 22.0, 40.0]
    assert rows[colours[1]] < rows[colours[2]] < rows[colours[3]]


@pytest.mark.parametrize(("pause_s", "lines"), [(2.9, 1), (3.1, 2)])
def test_path__is_interrupted_by_pauses_of_three_steps(pause_s: float, lines: int) -> None:
    poses = in_time(40)
    t_s = poses.t_s.copy()
    t_s[20:] += pause_s - 1.0
    assert quality_map(replace(poses, t_s=t_s)).count('class="fix"') == lines
    fast = replace(poses, t_s=poses.t_s[0] + 0.1 * np.arange(40) + np.where(np.arange(40) < 20, 0.0, 0.8))
    assert quality_map(fast).count('class="fix"') == 1, "shorter than a second"


def test_path__is_unbroken_where_the_fix_changes() -> None:
    poses = in_time(400)
    root = ET.fromstring(quality_map(poses))
    first, second = (path.attrib for path in root.iter("path") if path.attrib["class"] == "fix")
    assert (first["stroke"], second["stroke"]) == (fix_colour(4), fix_colour(5))
    assert first["d"].split("L")[-1] == second["d"].removeprefix("M").split("L")[0]


@pytest.mark.parametrize(
    "drawn",
    [tool_graph(WORK), quality_graph(POSES), quality_graph(NOT_KNOWN), activity_graph(POSES, WORK), quality_map(POSES)],
    ids=["tool", "quality", "fixes alone", "activity", "map"],
)
def test_drawing__is_as_large_as_what_is_on_it(drawn: str) -> None:
    root = ET.fromstring(drawn)
    width, height = (float(value) for value in root.attrib["viewBox"].split()[2:])
    places = [(float(part.attrib[f"x{k}"]), float(part.attrib[f"y{k}"])) for part in root.iter("line") for k in "12"]
    places += [(float(part.attrib["x"]), float(part.attrib["y"])) for part in root.iter("text")]
    places += [(x, y) for part in root.iter("rect") for x, y in zip(span(part, "x"), span(part, "y"), strict=True)]
    places += [(x, y) for part in root.iter("polyline") for x, y in corners(part).tolist()]
    places += [(float(x), float(y)) for x, y in re.findall(r"([\d.]+) ([\d.]+)(?=L|\")", drawn)]
    x, y = np.array(places).T
    assert width == 640.0
    assert -0.5 <= x.min() <= x.max() <= width + 0.5
    assert y.min() >= -0.5
    assert height - 12.5 <= y.max() <= height


def test_colours_of_passes__go_from_pale_to_dark_green() -> None:
    assert [pass_colour(number, 3) for number in (1, 2, 3)] == ["#b5dcc4", "#2e8b57", "#123f29"]
    assert pass_colour(1, 1) == "#2e8b57"
    assert pass_colour(2, 5) == "#72b48e", "half-way"


def test_colours_of_ranges__begin_and_end_at_the_2nd_and_98th_percentile() -> None:
    range_m = np.arange(1.0, 1001.0, dtype=np.float32).reshape(10, 100)
    assert range_limits_m(range_m, None) == pytest.approx((20.98, 980.02), abs=1e-3)
    assert range_limits_m(range_m, range_m <= 101.0) == pytest.approx((3.0, 99.0), abs=1e-3)
    assert range_limits_m(range_m, range_m < 0.0) == pytest.approx((20.98, 980.02), abs=1e-3)
    assert np.isnan(range_limits_m(np.full((2, 3), np.nan, np.float32), None)).all()
