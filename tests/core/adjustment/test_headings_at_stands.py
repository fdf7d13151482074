"""Headings of chains of scans at a stand: those of the first guess, for no other chain."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from furrowmap.core.adjustment.knots import knots_over
from furrowmap.core.adjustment.position_observations import headings_at_stands
from furrowmap.core.values.gnss import Fix, Positions
from furrowmap.core.values.trajectory import Trajectory, trajectory_from_attitude

T_S = np.arange(0.0, 60.0, 0.1)


def drive(way_m: float) -> tuple[Trajectory, Positions]:
    """At a stand until 10 s, then east-north-east by `way_m` until 20 s, and on along a curve."""
    along = np.interp(T_S, [0.0, 10.0, 20.0, 60.0], [0.0, 0.0, way_m, way_m + 60.0])
    heading = np.interp(T_S, [0.0, 20.0, 60.0], [70.0, 70.0, 200.0])
    xyz = np.column_stack([along * np.sin(np.radians(70.0)), along * np.cos(np.radians(70.0)), 0.0 * along])
    start = trajectory_from_attitude(T_S, xyz, 1.0, 2.0, heading, max_gap_s=1.0)
    sigma = np.ones((len(T_S), 6))
    sigma[:, 5] = np.interp(T_S, [0.0, 60.0], [3.0, 0.6])
    small = np.full((len(T_S), 3), 0.01)
    nothing = np.zeros(len(T_S), np.intp)
    fixed = np.full(len(T_S), Fix.FIXED, np.int8)
    positions = Positions(T_S, xyz, small, small, nothing, fixed, np.full(len(T_S), np.nan))
    return replace(start, sigma=sigma), positions


@pytest.mark.parametrize(("way_m", "middles_s"), [(0.9, [5.0, 16.0]), (1.5, [5.0])])
def test_chains_in_which_the_antenna_moves_less_than_a_metre__get_one_heading(
    way_m: float, middles_s: list[float]
) -> None:
    scans = np.concatenate([np.arange(2.0, 8.0, 0.05), np.arange(14.0, 18.0, 0.05), np.arange(24.0, 50.0, 0.05)])
    start, positions = drive(way_m=2.5 * way_m)
    found = headings_at_stands(start, knots_over(scans), positions)
    assert [float(one.t_s[0]) for one in found] == pytest.approx(middles_s, abs=0.05)
    for one, t_s in zip(found, middles_s, strict=True):
        assert len(one.t_s) == 1
        assert np.degrees(one.yaw_rad) == pytest.approx([20.0], abs=0.1)
        assert np.degrees(one.sigma_rad) == pytest.approx(3.0 - 0.04 * t_s, abs=0.01)


def test_one_chain__or_headings_that_are_not_known_add_nothing() -> None:
    start, positions = drive(1.0)
    assert headings_at_stands(start, knots_over(np.arange(2.0, 18.0, 0.05)), positions) == ()
    two = knots_over(np.concatenate([np.arange(2.0, 8.0, 0.05), np.arange(24.0, 50.0, 0.05)]))
    assert len(headings_at_stands(start, two, positions)) == 1
    unknown = replace(start, sigma=np.full_like(start.sigma, np.nan))
    assert headings_at_stands(unknown, two, positions) == ()
    elsewhere = positions.t_s > 20.0
    late = Positions(*(getattr(positions, name)[elsewhere] for name in positions.__dataclass_fields__))
    assert headings_at_stands(start, two, late) == ()
