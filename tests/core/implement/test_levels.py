"""The two positions of a tool from heights whose positions are known."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import ArrayLike

from furrowmap.core.implement.levels import find_positions
from furrowmap.core.implement.near_scans import NearScan
from furrowmap.core.implement.seen_implement import Levels, SideViewGrid
from furrowmap.core.implement.views import SEARCH_M, Heights, Views
from furrowmap.core.values.tool_states import ToolState

GRID = SideViewGrid(-3.0, 0.15, 20, 150)
EVERY_S = 0.5
POINTS = 200.0
NOISE_M = 0.002


def views(index: Sequence[int], every_s: float = EVERY_S) -> Views:
    xyz, whole = np.zeros((0, 3), np.float32), np.zeros(0, np.int32)
    nothing = (xyz, xyz[:, 0], whole.astype(np.uint8), whole)
    begin_s = [100.0 + every_s * k for k in index]
    scans = [NearScan(k, t, t + 0.1, True, 0, *nothing) for k, t in zip(index, begin_s, strict=True)]
    return Views(scans, [], [], (0.0, 0.0, 0.0), (-3.0, -1.0, -1.0, 1.0), GRID)


def heights(height_m: ArrayLike) -> Heights:
    """Of scans that show the tool with all its points, and of such (nan) that show nothing of it."""
    height = np.array(height_m, np.float64)
    height += NOISE_M * np.where(np.arange(len(height)) % 2, 1.0, -1.0)
    seen = np.where(np.isnan(height), 0.0, POINTS)
    return Heights(height, seen, seen, seen)


def found(height_m: Sequence[float], every_s: float = EVERY_S) -> Levels | None:
    """Where every second scan follows on the one before, as in what is kept of a long recording."""
    index = [k + k // 2 for k in range(len(height_m))]
    return find_positions(views(index, every_s), heights(height_m))


def phases(*parts: tuple[int, float]) -> list[float]:
    return [height for count, height in parts for _ in range(count)]


LOST = float("nan")


@given(st.floats(-0.4, 0.4), st.floats(0.12, 0.8), st.integers(4, 20), st.integers(4, 20))
def test_positions__of_a_tool_seen_in_both_are_its_heights(low: float, lift: float, down: int, up: int) -> None:
    levels = found(phases((2 * down, low), (2 * up, low + lift), (2 * down, low)))
    assert levels is not None
    assert levels.hidden == ToolState.UNKNOWN
    assert levels.low_m == pytest.approx(low, abs=1.01 * NOISE_M)
    assert levels.high_m == pytest.approx(low + lift, abs=1.01 * NOISE_M)
    assert levels.sigma_m <= levels.jitter_m < 0.01


@pytest.mark.parametrize("hidden", [ToolState.DOWN, ToolState.UP])
def test_positions__of_a_tool_that_works_out_of_view_and_is_seen_on_its_way(hidden: ToolState) -> None:
    way = [0.1, 0.2, 0.25, 0.3]
    seen = phases((12, 0.5), (30, LOST), *((1, h) for h in way), (12, 0.5), (30, LOST))
    levels = found(seen if hidden == ToolState.DOWN else [-h for h in seen])
    assert levels is not None
    assert levels.hidden == hidden
    near, far = (levels.high_m, levels.low_m) if hidden == ToolState.DOWN else (-levels.low_m, -levels.high_m)
    assert near == pytest.approx(0.5, abs=1.01 * NOISE_M)
    assert far == pytest.approx(np.quantile(way, 0.1), abs=1.01 * NOISE_M)
    assert levels.sigma_m == levels.jitter_m < 0.01


@pytest.mark.parametrize("hidden", [ToolState.DOWN, ToolState.UP])
def test_positions__of_a_tool_of_one_height_that_leaves_the_view(hidden: ToolState) -> None:
    left = phases((20, 0.3), (2, 0.15), (20, LOST), (20, 0.3), (20, LOST), (20, 0.3))
    levels = found(left if hidden == ToolState.DOWN else [-h for h in left])
    assert levels is not None
    assert levels.hidden == hidden
    there, edge = (levels.high_m, levels.low_m) if hidden == ToolState.DOWN else (-levels.low_m, -levels.high_m)
    assert there == pytest.approx(0.3, abs=1.01 * NOISE_M)
    assert edge == pytest.approx(0.15, abs=1.01 * NOISE_M)


def test_positions__none_are_found_where_nothing_shows_which_way_a_tool_left() -> None:
    assert found(phases((20, 0.3), (20, LOST), (20, 0.3), (20, LOST), (20, 0.3))) is None
    both_ways = phases((20, 0.3), (2, 0.15), (20, LOST), (20, 0.3), (2, 0.45), (20, LOST), (20, 0.3))
    assert found(both_ways) is None


@pytest.mark.parametrize(
    ("height_m", "why"),
    [
        (phases((60, LOST)), "never seen"),
        (phases((5, 0.0), (60, LOST)), "seen in too few scans"),
        (phases((40, 0.0)), "one height"),
        (phases((20, 0.0), (20, 0.09)), "a swinging frame"),
        (phases((40, 0.0), (2, 0.5)), "lifted in too few scans"),
        (phases((2, 0.0), (2, LOST), (40, 0.0)), "lost in too few scans"),
        ([0.5 * (k % 2) for k in range(60)], "at another height in each scan"),
        ([0.0 if k % 2 else LOST for k in range(60)], "lost in each second scan"),
    ],
)
def test_positions__none_are_found_of(height_m: Sequence[float], why: str) -> None:
    assert found(height_m) is None, why


def test_positions__a_lift_needs_a_second_and_a_half_in_each_state() -> None:
    """Changes between every third pair of scans: a mean time of four or so pairs in each state."""
    height_m = phases(*[(7, 0.5 * (k % 2)) for k in range(12)])
    assert found(height_m, every_s=1.0) is not None
    assert found(height_m, every_s=0.1) is None


def test_positions__scans_far_apart_show_no_noise_and_no_positions() -> None:
    alternate = views([2 * k for k in range(40)])
    assert len(alternate.pairs) == 0
    assert find_positions(alternate, heights(phases((20, 0.0), (20, 0.5)))) is None
    assert find_positions(alternate, heights(phases((20, 0.0), (2, -0.2), (18, LOST)))) is None


def test_positions__a_noisy_tool_has_none() -> None:
    noise = np.random.default_rng(1).normal(0.0, 0.08, 80)
    assert found((np.array(phases((40, 0.0), (40, 0.5))) + noise).tolist()) is None


def test_sure__heights_at_the_limits_of_the_search_are_not() -> None:
    assert heights([0.0, 0.9 * SEARCH_M, SEARCH_M, -SEARCH_M, LOST]).sure.tolist() == [True, True, False, False, False]
    nowhere = Heights(np.full(3, LOST), np.zeros(3), np.zeros(3), np.zeros(3))
    assert nowhere.usual == (0.0, 0.0)
    assert not nowhere.sure.any()
