"""Scans in gaps between positions: which of them positions hold."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from furrowmap.core.matching.bridging import held_by_positions
from furrowmap.core.matching.matched import unheld_notices
from furrowmap.core.matching.returns import GroundReturns
from furrowmap.core.matching.walls import UprightReturns
from furrowmap.core.values.trajectory import Trajectory, trajectory_from_attitude

FloatArray = NDArray[np.float64]
T0_S = 1_779_529_272.0


def scanned(*spans_s: tuple[float, float], step_s: float = 0.05) -> GroundReturns:
    """Returns every `step_s` in some spans of time, numbered; upright ones every second one."""
    t_s = T0_S + np.concatenate([np.arange(begin, end, step_s) for begin, end in spans_s])
    n = len(t_s)
    xyz = np.repeat(np.arange(n, dtype=np.float32)[:, None], 3, axis=1)
    half, laser = (np.arange(n) % 2).astype(np.uint8), (np.arange(n) % 16).astype(np.uint8)
    upright = UprightReturns(t_s[::2], xyz[::2], half[::2], laser[::2])
    return GroundReturns(t_s, xyz, half, np.zeros((80, 80), np.bool_), upright, laser)


def positions(*spans_s: tuple[float, float], step_s: float = 0.1) -> FloatArray:
    return T0_S + np.concatenate([np.arange(begin, end + 1e-6, step_s) for begin, end in spans_s])


def start_of(*sigma_deg: float) -> Trajectory:
    """A first guess of a minute, whose headings have standard deviations that follow each other evenly in time."""
    t_s = T0_S + np.linspace(0.0, 60.0, 601)
    start = trajectory_from_attitude(t_s, np.zeros((601, 3)), 0.0, 0.0, np.zeros(601), max_gap_s=1.0)
    sigma = np.ones((601, 6))
    sigma[:, 5] = np.interp(t_s, T0_S + np.linspace(0.0, 60.0, len(sigma_deg)), sigma_deg) if sigma_deg else np.nan
    return replace(start, sigma=sigma)


@pytest.mark.parametrize(
    ("scans", "known", "lost"),
    [
        ([(0, 30)], [(0, 30)], []),
        ([(0, 30)], [(0, 10), (20, 30)], []),
        ([(0, 14), (15.9, 30)], [(0, 10), (20, 30)], []),
        ([(0, 14), (16.1, 30)], [(0, 10), (20, 30)], [(10.5, 14), (16.1, 19.5)]),
        ([(0, 5), (12, 17), (25, 30)], [(0, 10), (20, 30)], [(12, 17)]),
        ([(0, 14)], [(0, 10), (20, 30)], [(10.5, 14)]),
        ([(12, 30)], [(0, 10), (20, 30)], [(12, 19.5)]),
        ([(9.5, 30)], [(0, 10), (20, 30)], [(9.5, 19.5)]),
        ([(8.5, 30)], [(0, 10), (20, 30)], []),
        ([(12, 30)], [(0, 10), (12.9, 30)], []),
        ([(12, 30)], [(0, 10), (13.1, 30)], [(12, 12.6)]),
        ([(0, 30)], [(2, 2), (11, 30)], []),
        ([(1.5, 30)], [(2, 2), (11, 30)], [(1.5, 10.5)]),
        ([(0, 5), (8, 30)], [(0, 3), (14, 14.8), (21, 30)], [(3.5, 5), (8, 20.5)]),
    ],
    ids=[
        "no gap",
        "through the gap",
        "short pause in the gap",
        "pause in the gap",
        "island in the gap",
        "end in the gap",
        "begin in the gap",
        "begin too shortly before the gap",
        "begin a second before the gap",
        "short gap",
        "gap of three seconds",
        "one position before a gap gone through",
        "one position at the begin",
        "few positions after a pause",
    ],
)
def test_scans__that_do_not_go_through_a_gap_are_lost_in_it(
    scans: list[tuple[float, float]], known: list[tuple[float, float]], lost: list[tuple[float, float]]
) -> None:
    returns = scanned(*scans)
    kept, unheld = held_by_positions(returns, positions(*known), start_of(1.0))
    assert np.asarray(unheld).reshape(-1, 2) - T0_S == pytest.approx(np.asarray(lost).reshape(-1, 2), abs=0.06)
    inside = np.zeros(len(returns), np.bool_)
    for begin_s, end_s in unheld:
        inside |= (returns.t_s >= begin_s) & (returns.t_s < end_s)
    np.testing.assert_array_equal(kept.t_s, returns.t_s[~inside])
    np.testing.assert_array_equal(kept.xyz_m, returns.xyz_m[~inside])
    np.testing.assert_array_equal(kept.half, returns.half[~inside])
    np.testing.assert_array_equal(kept.laser, returns.laser[~inside])
    np.testing.assert_array_equal(kept.upright.t_s, returns.t_s[::2][~inside[::2]])
    np.testing.assert_array_equal(kept.upright.xyz_m, returns.xyz_m[::2][~inside[::2]])
    (said,) = unheld_notices(unheld) or ("",)
    if lost:
        total_s = sum(end - begin for begin, end in lost)
        assert said.code == "scans-not-held"
        assert float(said.text.split(" s, the first")[0].removeprefix("Scans of ")) == pytest.approx(total_s, abs=0.2)


SPANS = st.lists(st.floats(0.2, 9.0), min_size=2, max_size=9)


@given(SPANS, SPANS)
def test_held_scans__have_a_position_near_or_go_through_their_gap(scans: list[float], known: list[float]) -> None:
    """Times on and off by turns, of scanner and receiver."""
    on = [np.cumsum([0.0, *lengths]) for lengths in (scans, known)]
    spans = [[(float(a), float(b)) for a, b in zip(t[::2], t[1::2], strict=False)] for t in on]
    returns, position_s = scanned(*spans[0]), positions(*spans[1])
    kept, unheld = held_by_positions(returns, position_s, start_of(1.0))
    assert len(kept) + sum(int(((returns.t_s >= a) & (returns.t_s < b)).sum()) for a, b in unheld) == len(returns)
    begin, end = np.searchsorted(position_s, kept.t_s) - 1, np.searchsorted(position_s, kept.t_s)
    within = (begin >= 0) & (end < len(position_s))
    before, after = position_s[np.maximum(begin, 0)], position_s[np.minimum(end, len(position_s) - 1)]
    lonely = within & (after - before > 3.0) & (kept.t_s - before > 0.6) & (after - kept.t_s > 0.6)
    for t_s in np.unique(before[lonely]):
        gap = float(t_s), float(position_s[np.searchsorted(position_s, t_s) + 1])
        first, last = np.searchsorted(returns.t_s, gap[0] - 0.9) - 1, np.searchsorted(returns.t_s, gap[1] + 0.9)
        assert first >= 0, "there are scans before a gap that is gone through"
        assert last < len(returns), "and after it"
        assert np.diff(returns.t_s[first : last + 1]).max() < 2.1, (
            "the scanner does not pause for long from one to the other"
        )


@given(st.floats(0.1, 2.9), st.floats(1.0, 20.0))
def test_short_gaps__lose_nothing(gap_s: float, pause_at_s: float) -> None:
    returns = scanned((0.0, pause_at_s), (pause_at_s + 1.5, 30.0))
    assert held_by_positions(returns, positions((0.0, 10.0), (10.0 + gap_s, 30.0)), start_of(1.0)) == (returns, ())


@pytest.mark.parametrize(
    ("scans", "known", "sigma_deg", "lost"),
    [
        ([(0, 3), (10, 60)], [(0, 60)], (20.0, 9.0, 2.0, 1.0), [(0, 3)]),
        ([(0, 3), (10, 60)], [(0, 60)], (7.9, 7.5, 2.0, 1.0), []),
        ([(0, 3), (10, 60)], [(0, 60)], (), []),
        ([(0, 60)], [(0, 60)], (20.0, 9.0, 2.0, 1.0), []),
        ([(0, 60)], [(0, 6), (12, 60)], (30.0, 9.0, 2.0, 1.0), [(0, 11.5)]),
        ([(0, 54)], [(0, 50), (51.5, 60)], (1.0, 1.0, 1.0, 60.0), [(50.5, 54)]),
        ([(0, 54)], [(0, 50), (51.5, 60)], (1.0, 1.0, 1.0, 5.0), []),
    ],
    ids=[
        "stand before a pause",
        "heading known enough",
        "nothing known of headings",
        "no pause",
        "heading not known before a gap",
        "heading lost in a short gap",
        "short gap",
    ],
)
def test_scans__between_pauses_are_lost_where_the_heading_is_not_known(
    scans: list[tuple[float, float]],
    known: list[tuple[float, float]],
    sigma_deg: tuple[float, ...],
    lost: list[tuple[float, float]],
) -> None:
    _, unheld = held_by_positions(scanned(*scans), positions(*known), start_of(*sigma_deg))
    assert np.asarray(unheld).reshape(-1, 2) - T0_S == pytest.approx(np.asarray(lost).reshape(-1, 2), abs=0.06)
