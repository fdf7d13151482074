"""Ends of a tool's working width by the soil that it changed, where these are known."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from furrowmap.core.coverage.tool_edges import ACROSS_BIN_M, SEARCHED_BESIDE_M, ToolEdges, ToolEnds, Transition
from furrowmap.core.surfaces.grid import Grid
from furrowmap.core.surfaces.passage import LineTrack, Passages
from furrowmap.core.surfaces.spool import SPOOL_TILE, TilePoints
from furrowmap.core.values.session import Implement

FloatArray = NDArray[np.float64]
GRID = Grid(0.05, 0, SPOOL_TILE, (SPOOL_TILE, SPOOL_TILE))
EASTING_M, NORTHING_M = (axis.ravel() for axis in np.meshgrid(*GRID.centres_m()))
MIDDLE_M = 6.0
HALF_M = 0.85
PASSED_S = 100.0


def edges(aside_m: float, half_m: float) -> ToolEdges:
    """A pass eastward along the middle whose tool is stated so far to the left of where it is."""
    t = np.linspace(0.0, 1.0, 50)
    middle = np.column_stack([-1.0 + 15.0 * t, np.full(50, MIDDLE_M + aside_m)])
    track = LineTrack(1, PASSED_S + 0.5 * t, middle, np.tile([0.0, half_m], (50, 1)))
    return ToolEdges([Passages([track])], half_m)


def changed(change_m: FloatArray, seed: int = 0) -> TilePoints:
    """Three returns in every cell before and after the pass, with 8 mm of noise."""
    rng = np.random.default_rng(seed)
    cell = np.tile(np.repeat(np.arange(len(EASTING_M)), 3), 2).astype(np.uint16)
    after = np.repeat([False, True], len(cell) // 2)
    height = 1.0 + np.where(after, change_m[cell], 0.0) + rng.normal(0.0, 0.008, len(cell))
    t_s = np.where(after, PASSED_S + 50.0, PASSED_S - 50.0).astype(np.float32)
    return TilePoints(GRID, cell, height.astype(np.float32), t_s, 0.0, 0.0)


def tilled(seed: int = 0) -> FloatArray:
    """2.5 cm of swell and new relief where the tool truly works."""
    across_m = np.abs(NORTHING_M - MIDDLE_M)
    relief_m = 0.025 + np.random.default_rng(seed).normal(0.0, 0.02, len(across_m))
    return np.where(across_m < HALF_M, relief_m, 0.0)


def ends(change_m: FloatArray, aside_m: float = 0.0, half_m: float = HALF_M) -> ToolEnds:
    summed = edges(aside_m, half_m)
    points = changed(change_m)
    return summed.ends(summed.changes(points, np.ones(len(points.cell), np.bool_)))


@pytest.mark.parametrize("aside_m", [0.0, 0.1, -0.1, 0.3, -0.3, 0.6])
def test_tool__beside_where_it_is_stated_ends_where_the_soil_does(aside_m: float) -> None:
    found = ends(tilled(), aside_m)
    # The left end is the more to the right, the more to the left the tool is stated.
    for end_m, true_m in ((found.left_m, HALF_M - aside_m), (found.right_m, HALF_M + aside_m)):
        if true_m < HALF_M + SEARCHED_BESIDE_M - 0.25:
            assert end_m == pytest.approx(true_m, abs=1.1 * ACROSS_BIN_M)
    notices = found.notices(Implement(name="", kind="rotary tiller", xy_m=(-1.6, aside_m), width_m=2.0 * HALF_M))
    assert bool(notices) == (abs(aside_m) > 0.2)
    for notice in notices:
        assert f"{found.left_m:.2f} m to the left" in notice.text


@pytest.mark.parametrize("aside_m", [0.95, -0.95, 1.2, -1.2, 1.9, -1.9])
def test_tool__that_worked_beside_the_middle_of_its_line_is_told(aside_m: float) -> None:
    """Its far end is told where soil changed close to the middle, its near end else."""
    found = ends(tilled(), aside_m)
    tool = Implement(name="", kind="rotary tiller", xy_m=(-1.6, aside_m), width_m=2.0 * HALF_M)
    (notice,) = found.notices(tool)
    if notice.key == "tool-apart":
        far_m = found.right_m if aside_m > 0.0 else found.left_m
        assert far_m == pytest.approx(abs(aside_m) + HALF_M, abs=1.6 * ACROSS_BIN_M)
    else:
        assert found.aside_m == pytest.approx(np.sign(aside_m) * HALF_M - aside_m, abs=1.1 * ACROSS_BIN_M)


def test_windrow__beside_ground_that_a_mower_leaves_as_it_is_shows_no_tool_elsewhere() -> None:
    laid = np.where(np.abs(NORTHING_M - MIDDLE_M - 1.0) < 0.35, 0.05, 0.0)
    tool = Implement(name="", kind="mower", xy_m=(-1.6, 0.0), width_m=2.0 * HALF_M)
    assert ends(laid).notices(tool) == ()


@pytest.mark.parametrize(("half_m", "told"), [(0.85, False), (0.9, False), (1.275, True), (0.68, True), (0.45, True)])
def test_width__that_is_stated_too_large_or_small_is_told(half_m: float, *, told: bool) -> None:
    found = ends(tilled(), half_m=half_m)
    assert found.left_m == pytest.approx(HALF_M, abs=1.1 * ACROSS_BIN_M)
    assert found.right_m == pytest.approx(HALF_M, abs=1.1 * ACROSS_BIN_M)
    tool = Implement(name="", kind="rotary tiller", xy_m=(-1.6, 0.0), width_m=2.0 * half_m)
    assert bool(found.notices(tool)) is told


@pytest.mark.parametrize("half_m", [0.6, 0.85, 2.0])
def test_wheels__and_a_tool_without_a_trace_show_no_ends_elsewhere(half_m: float) -> None:
    """A mower, and the ruts of a tractor, 3 cm deep."""
    tool = Implement(name="", kind="mower", xy_m=(-1.6, 0.0), width_m=2.0 * half_m)
    across_m = np.abs(NORTHING_M - MIDDLE_M)
    rutted = np.where(np.abs(across_m - 0.75) < 0.15, -0.03, 0.0)
    assert ends(np.zeros(len(across_m)), half_m=half_m).notices(tool) == ()
    assert ends(rutted, half_m=half_m).notices(tool) == ()


def test_ruts_beside_a_narrow_tool__are_not_its_work() -> None:
    across_m = np.abs(NORTHING_M - MIDDLE_M)
    worked = np.where(across_m < 0.6, tilled() + 0.01, 0.0)
    rutted = np.where((across_m > 0.6) & (across_m < 0.9), -0.03, worked)
    tool = Implement(name="", kind="plough", xy_m=(-1.6, 0.0), width_m=1.2)
    assert ends(rutted, half_m=0.6).notices(tool) == ()


def way(begin_m: float, end_m: float) -> LineTrack:
    """The tool's line eastward at 1 m/s, which is at 6 m at the time of the pass."""
    east = np.linspace(begin_m, end_m, 1 + round((end_m - begin_m) / 0.1))
    middle = np.column_stack([east, np.full(len(east), MIDDLE_M)])
    return LineTrack(1, PASSED_S + east - 6.0, middle, np.tile([0.0, HALF_M], (len(east), 1)))


def transition(at_m: float, *, lowered: bool) -> Transition:
    track = way(at_m - 1.5, at_m + 1.5)
    since_m = track.middle_m[:, 0] - at_m
    return Transition(1, lowered, track, since_m if lowered else -since_m)


@pytest.mark.parametrize("stated_ahead_m", [0.0, 0.2, 0.5, -0.5, -0.9])
def test_tool__ahead_or_behind_where_it_is_stated_is_told_by_begins_and_ends(stated_ahead_m: float) -> None:
    begin_m = 3.0 + stated_ahead_m
    end_m = 9.0 + stated_ahead_m
    transitions = [transition(begin_m, lowered=True), transition(end_m, lowered=False)]
    summed = ToolEdges([Passages([way(begin_m, end_m)])], HALF_M, transitions)
    points = changed(np.where((EASTING_M > 3.0) & (EASTING_M < 9.0), tilled(), 0.0))
    found = summed.ends(summed.changes(points, np.ones(len(points.cell), np.bool_)))
    assert found.ahead_m == pytest.approx(-stated_ahead_m, abs=1.5 * ACROSS_BIN_M)
    tool = Implement(name="", kind="rotary tiller", xy_m=(-1.6, 0.0), width_m=2.0 * HALF_M)
    keys = [notice.key for notice in found.notices(tool)]
    assert keys == (["tool-apart.along-track"] if abs(stated_ahead_m) > 0.4 else [])


def test_pass__that_begins_before_its_time_and_ends_after_it_is_no_tool_elsewhere() -> None:
    """The soil is reached before the threshold of the state is."""
    summed = ToolEdges(
        [Passages([way(3.0, 9.0)])], HALF_M, [transition(3.0, lowered=True), transition(9.0, lowered=False)]
    )
    points = changed(np.where((EASTING_M > 2.6) & (EASTING_M < 9.4), tilled(), 0.0))
    found = summed.ends(summed.changes(points, np.ones(len(points.cell), np.bool_)))
    assert found.ahead_m == pytest.approx(0.0, abs=ACROSS_BIN_M)
