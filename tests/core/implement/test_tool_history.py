"""States of a tool from heights in closed form."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from furrowmap.core.implement.heights import ToolHeights
from furrowmap.core.implement.seen_implement import (
    DepthImages,
    Levels,
    Region,
    SeenImplement,
    SideTemplate,
    SideViewGrid,
)
from furrowmap.core.implement.states import ToolHistory, tool_history
from furrowmap.core.values.tool_states import ToolState

TURN_S = 0.1
LIFT_M = 0.5
_NONE = np.zeros((0, 0), np.float32)
TILLER = SeenImplement(
    region=Region(
        (0.0, 0.0, 0.0), (-3.0, -1.0, -1.0, 1.0), np.ones(4, bool), _NONE, 0, 0, clockwise=True, turn_s=TURN_S
    ),
    template=SideTemplate(SideViewGrid(-3.0, 0.0, 0, 0), _NONE),
    levels=Levels(0.0, LIFT_M, ToolState.UNKNOWN, 0.005, 0.01),
    working_m=0.0,
    points=100.0,
    gain=1.0,
    images=DepthImages(_NONE, _NONE, np.zeros((0, 0), bool), np.zeros(0)),
)


FloatArray = NDArray[np.float64]
BEGIN_S = 1000.0


def tool(height_m: Callable[[FloatArray], FloatArray], length_s: float = 60.0) -> ToolHeights:
    """A tool with these heights at the times since the begin; out of view where nan."""
    begin_s = BEGIN_S + np.arange(0.0, length_s, TURN_S)
    t_s = begin_s + 0.5 * TURN_S
    n = len(t_s)
    height = height_m(t_s - BEGIN_S)
    return ToolHeights(
        t_s,
        height,
        np.where(np.isnan(height), 0.0, 1.0),
        np.full(n, 1000.0),
        np.ones(n, bool),
        np.zeros(n),
        begin_s,
        begin_s + TURN_S,
    )


def heights(every_s: float, length_s: float = 60.0) -> ToolHeights:
    """A tool that is lowered and lifted every so many seconds."""
    return tool(lambda t: np.where(t // every_s % 2 == 1, LIFT_M, 0.0), length_s)


def hiding(hidden: ToolState) -> SeenImplement:
    return replace(TILLER, levels=replace(TILLER.levels, hidden=hidden))


def rows(history: ToolHistory) -> list[tuple[float, float, ToolState]]:
    """Begin and end since the begin, and state."""
    states = history.states
    ends = zip((states.begin_s - BEGIN_S).round(3), (states.end_s - BEGIN_S).round(3), states.state, strict=True)
    return [(float(begin), float(end), ToolState(state)) for begin, end, state in ends]


@pytest.mark.parametrize(("every_s", "clear"), [(10.0, True), (2.0, True), (0.5, False)])
def test_tool__that_moves_faster_than_any_lift_has_no_state(every_s: float, *, clear: bool) -> None:
    history = tool_history(heights(every_s), TILLER, None)
    if clear:
        assert history.notices == ()
        assert len(history.states) == 60.0 / every_s
        np.testing.assert_allclose(np.diff(history.states.begin_s), every_s, atol=TURN_S)
        return
    assert [notice.code for notice in history.notices] == ["implement-unclear"]
    assert len(history.states) == 0
    assert set(history.state) == {ToolState.UNKNOWN}


@given(st.floats(20.0, 20.1), st.floats(0.3, 1.5), st.booleans())
def test_transition__is_when_the_height_crosses_half_the_lift(at_s: float, speed_mps: float, up: bool) -> None:
    """Of a smooth motion, which is a cubic in time near the threshold, exactly."""

    def height(t: FloatArray) -> FloatArray:
        since = np.clip((t - at_s) * speed_mps / LIFT_M, -0.5, 0.5)  # half a lift on both sides
        lifted: FloatArray = LIFT_M * (0.5 + 1.5 * since - 2.0 * since**3)
        return lifted if up else LIFT_M - lifted

    history = tool_history(tool(height, 40.0), TILLER, None)
    before, after = (ToolState.DOWN, ToolState.UP) if up else (ToolState.UP, ToolState.DOWN)
    (begin, crossed, first), (again, end, second) = rows(history)
    assert (begin, first, second) == (0.0, before, after)
    assert end == pytest.approx(40.0)
    assert again == crossed
    if speed_mps < 1.0:  # four heights within the motion
        assert crossed == pytest.approx(at_s, abs=0.002)
    assert crossed == pytest.approx(at_s, abs=0.02)
    assert history.threshold_m == 0.5 * history.lifted_m == 0.5 * LIFT_M
    sigma = history.states.end_sigma_s
    assert sigma[1] == history.states.begin_sigma_s[0] == 0.0
    assert sigma[0] == history.states.begin_sigma_s[1]
    assert sigma[0] < 0.03
    assert (history.states.confidence > 0.99).all()


@pytest.mark.parametrize("working_depth_m", [None, 0.05, 0.2, 0.374, 0.376, 0.6])
def test_threshold__is_the_working_depth_but_where_the_tool_is_not_lifted_so_far(working_depth_m: float | None) -> None:
    """A ramp of 0.1 m/s: the time of the crossing tells the height."""
    ramp = tool(lambda t: np.clip(0.1 * (t - 20.0), 0.0, LIFT_M), 40.0)
    history = tool_history(ramp, TILLER, working_depth_m)
    counts = working_depth_m is not None and working_depth_m < 0.75 * LIFT_M
    threshold = working_depth_m if counts else 0.5 * LIFT_M
    assert history.threshold_m == threshold
    (_, at, _), _ = rows(history)
    assert at == pytest.approx(20.0 + threshold / 0.1, abs=0.03)


@pytest.mark.parametrize("up", [True, False])
@pytest.mark.parametrize("late_s", [0.0, 0.03, 0.05, 0.08])
def test_transition__at_a_working_depth_is_found_where_the_lift_speeds_up(late_s: float, *, up: bool) -> None:
    """A line between two heights would be up to 3 ms off."""
    depth_m, speed_mps, middle_s = 0.1, 0.6, 20.0 + late_s

    def height(t: FloatArray) -> FloatArray:
        since = np.clip((t - middle_s) * speed_mps / LIFT_M * (1.0 if up else -1.0), -0.5, 0.5)
        return np.asarray(LIFT_M * (0.5 + 1.5 * since - 2.0 * since**3), np.float64)

    roots = np.roots([-2.0, 0.0, 1.5, 0.5 - depth_m / LIFT_M])
    share = float(next(root for root in roots.real if -0.5 < root < 0.5))
    (_, crossed, _), _ = rows(tool_history(tool(height, 40.0), TILLER, depth_m))
    assert crossed == pytest.approx(middle_s + share * LIFT_M / speed_mps * (1.0 if up else -1.0), abs=5e-4)


@given(st.floats(0.4, 0.7), st.floats(0.02, 0.1), st.floats(0.0, 0.09))
def test_transition__of_a_tool_that_leaves_the_view_goes_on_at_its_speed(
    speed_mps: float, edge_m: float, begin_s: float
) -> None:
    """The edge of the view is above the threshold, and below it the tool is not seen."""

    def height(t: FloatArray) -> FloatArray:
        lowered = LIFT_M - np.clip((t - 20.0 - begin_s) * speed_mps, 0.0, LIFT_M)
        lifted = np.clip((t - 30.0 - begin_s) * speed_mps, 0.0, LIFT_M)
        both = np.where(t < 25.0, lowered, lifted)
        return np.where(both > 0.5 * LIFT_M + edge_m, both, np.nan)

    history = tool_history(tool(height), hiding(ToolState.DOWN), None)
    (_, lowered_s, first), (_, lifted_s, second), (_, _, third) = rows(history)
    assert (first, second, third) == (ToolState.UP, ToolState.DOWN, ToolState.UP)
    # two heights at least show the speed; the crossing is not before the middle of the turns around the edge
    within = 0.02
    assert lowered_s == pytest.approx(20.0 + begin_s + 0.5 * LIFT_M / speed_mps, abs=within)
    assert lifted_s == pytest.approx(30.0 + begin_s + 0.5 * LIFT_M / speed_mps, abs=within)
    assert history.states.confidence[1] == pytest.approx(0.9)
    assert history.lifted_m == LIFT_M  # nothing shows another working position
    assert np.isnan(history.tool_height_m[250])


def test_state__of_a_tool_out_of_view_is_the_one_in_which_it_is_not_seen() -> None:
    gone = tool(lambda t: np.where((t > 20.0) & (t < 40.0), np.nan, 0.0))
    for hidden in (ToolState.UP, ToolState.UNKNOWN):
        states = [state for *_, state in rows(tool_history(gone, hiding(hidden), None))]
        between = [ToolState.UP] if hidden == ToolState.UP else []
        assert states == [ToolState.DOWN, *between, ToolState.DOWN]


def unseen(begin_s: float, end_s: float) -> ToolHeights:
    """A tool at work that is out of view for some time."""
    return tool(lambda t: np.where((t > begin_s) & (t < end_s), np.nan, 0.0))


@pytest.mark.parametrize(("gone_s", "states"), [(1.2, 1), (1.8, 2)])
def test_state__of_a_tool_lost_for_longer_than_a_second_and_a_half_is_unknown(gone_s: float, states: int) -> None:
    history = tool_history(unseen(20.0, 20.0 + gone_s), TILLER, None)
    assert len(history.states) == states
    if states == 2:
        assert np.isnan([history.states.end_sigma_s[0], history.states.begin_sigma_s[1]]).all()
        assert history.states.at(BEGIN_S + 20.9) == (ToolState.UNKNOWN, 0.0)


@given(st.floats(0.0, 58.0), st.floats(0.1, 4.0))
def test_state__changes_only_where_a_tool_is_out_of_view_for_as_long_as_its_way_takes(
    at_s: float, gone_s: float
) -> None:
    """It is lifted by 0.25 m at 0.4 m/s at least before it counts as lifted."""
    history = tool_history(unseen(at_s, at_s + gone_s), hiding(ToolState.UP), None)
    states = rows(history)
    assert min(begin for begin, *_ in states) == 0.0
    assert max(end for _, end, _ in states) == pytest.approx(60.0)
    assert all(end == begin for (_, end, _), (begin, *_) in pairwise(states))
    lifted_s = sum(end - begin for begin, end, state in states if state == ToolState.UP)
    way_s = 0.5 * LIFT_M / 0.4
    if 0.5 * TURN_S < at_s < 60.0 - gone_s - 0.5 * TURN_S:  # seen before and after
        ways = 2
        if gone_s < 0.3:
            assert lifted_s == 0.0
        if gone_s > 0.6:
            assert lifted_s == pytest.approx(max(gone_s - ways * way_s, 0.0), abs=2.0 * TURN_S)


@pytest.mark.parametrize(("lost_s", "known"), [(1.0, True), (2.0, False)])
def test_state__at_the_begin_and_the_end_is_unknown_after_a_second_and_a_half(lost_s: float, *, known: bool) -> None:
    late = tool(lambda t: np.where((t > lost_s) & (t < 60.0 - lost_s), 0.0, np.nan))
    states = tool_history(late, TILLER, None).states
    assert len(states) == 1
    ends = (states.begin_sigma_s[0], states.end_sigma_s[0])
    if known:
        assert ends == (0.0, 0.0)
        assert states.begin_s[0] == BEGIN_S
        assert states.end_s[0] == pytest.approx(BEGIN_S + 60.0)
    else:
        assert np.isnan(ends).all()
        assert states.begin_s[0] == pytest.approx(BEGIN_S + lost_s + 0.5 * TURN_S)
        assert states.end_s[0] == pytest.approx(BEGIN_S + 60.0 - lost_s - 0.5 * TURN_S)


def test_tool__never_seen_has_no_state() -> None:
    history = tool_history(tool(lambda t: np.full(len(t), np.nan)), TILLER, None)
    assert len(history.states) == 0
    assert set(history.state) == {ToolState.UNKNOWN}
    assert not history.confidence.any()
    assert np.isnan(history.tool_height_m).all()
    assert history.soil_height_m.tolist() == [0.0] * len(history.t_s)
    assert history.notices == ()


def test_height__of_one_revolution_that_differs_from_both_neighbours_is_no_lift() -> None:
    stray = tool(lambda t: np.where(np.abs(t - 20.05) < 0.01, LIFT_M, 0.0))
    assert np.count_nonzero(stray.height_m) == 1
    history = tool_history(stray, TILLER, None)
    assert [state for *_, state in rows(history)] == [ToolState.DOWN]
    assert np.abs(history.tool_height_m).max() == 0.0
    two = tool(lambda t: np.where(np.abs(t - 20.1) < 0.1, LIFT_M, 0.0))
    assert np.count_nonzero(two.height_m) == 2
    assert np.abs(tool_history(two, TILLER, None).tool_height_m).max() == LIFT_M


def test_height__at_the_cut_end_of_a_revolution_counts_only_with_its_neighbour() -> None:
    """A part of the tool can be taken for the tool at another height."""
    last = tool(lambda t: np.where(t > 59.9, LIFT_M, 0.0))
    for whole, lifted in ((True, LIFT_M), (False, 0.0)):
        cut = replace(last, whole=np.append(last.whole[:-1], whole))
        assert np.nanmax(tool_history(cut, TILLER, None).tool_height_m) == lifted


@settings(max_examples=20)
@given(st.floats(-0.05, 0.05))
def test_working_position__is_that_of_the_recording(level_m: float) -> None:
    """It is the median of the lowered tool, without the heights on the way; unknown where the tool works unseen."""
    shifted = tool(lambda t: level_m + np.clip(t - 30.0, 0.0, LIFT_M))
    history = tool_history(shifted, TILLER, None)
    np.testing.assert_allclose(history.tool_height_m[:290], 0.0, atol=1e-9)
    assert history.lifted_m == pytest.approx(LIFT_M - level_m, abs=1e-9)
    assert tool_history(shifted, hiding(ToolState.DOWN), None).lifted_m == LIFT_M


def test_confidence__falls_with_contrast_and_near_the_threshold() -> None:
    sure = tool(lambda t: np.zeros(len(t)))
    unsure = replace(sure, contrast=np.full(len(sure.t_s), 20.0))  # worth 1: 1 / (1 + exp(-1))
    assert tool_history(sure, TILLER, None).states.confidence[0] == pytest.approx(1.0)
    assert tool_history(unsure, TILLER, None).states.confidence[0] == pytest.approx(1.0 / (1.0 + np.exp(-1.0)))
    near = replace(sure, height_m=np.full(len(sure.t_s), LIFT_M))
    history = tool_history(near, TILLER, working_depth_m=LIFT_M / 2 - 0.01)
    assert history.states.state.tolist() == [ToolState.UP]
