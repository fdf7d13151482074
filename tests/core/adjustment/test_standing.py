"""Stands of a vehicle on wheels: found where it neither shakes nor moves, and nowhere else."""

from __future__ import annotations

import numpy as np
import pytest

from furrowmap.core.adjustment.vehicle import Standing
from furrowmap.core.trajectory.inertial_start import Hints
from furrowmap.core.values.gnss import Positions
from furrowmap.core.values.inertial import InertialTrack

T_S = 1_779_529_272.0 + np.arange(0.0, 60.0, 0.01)


def recording(*, shakes: bool, moves: bool) -> tuple[InertialTrack, Positions]:
    """A minute with less shaking, and no way, from 20 to 30 s."""
    random = np.random.default_rng(3)
    since = T_S - T_S[0]
    quiet = (since >= 20.0) & (since < 30.0)
    size = np.where(quiet & (not shakes), 0.05, 1.0)[:, None]
    track = InertialTrack(
        T_S, 0.05 * size * random.normal(size=(len(T_S), 3)), size * random.normal(size=(len(T_S), 3)) + (0, 0, 9.8)
    )
    way = np.cumsum(np.where(quiet & (not moves), 0.0, 0.01))
    at = np.arange(0, len(T_S), 10)
    n = len(at)
    xyz = np.column_stack([way[at], 0 * way[at], 0 * way[at]]) + random.normal(0.0, 0.01, (n, 3))
    sigma = np.full((n, 3), 0.01)
    none = np.full(n, np.nan)
    return track, Positions(T_S[at], xyz, sigma, sigma, np.zeros(n, np.intp), np.zeros(n, np.int8), none)


@pytest.mark.parametrize(("shakes", "moves", "stands"), [(False, False, 1), (True, False, 0), (False, True, 0)])
def test_stands__neither_shake_nor_move(shakes: bool, moves: bool, stands: int) -> None:
    found = Standing.find(*recording(shakes=shakes, moves=moves))
    assert len(found.begin_s) == stands
    if stands:
        assert found.begin_s[0] - T_S[0] == pytest.approx(20.0, abs=1.0)
        assert found.end_s[0] - T_S[0] == pytest.approx(30.0, abs=1.0)


def test_what_hovers__is_not_at_rest() -> None:
    track, positions = recording(shakes=False, moves=False)
    assert Hints().observations(track, positions) == ()
    assert any(isinstance(one, Standing) for one in Hints(on_wheels=True).observations(track, positions))


@pytest.mark.parametrize("windows", [3, 4, 5, 6])
def test_stands__end_where_the_shaking_begins_again(windows: int) -> None:
    t_s = T_S[:2000] - T_S[0]
    quiet = (t_s >= 5.0) & (t_s < 5.0 + windows)
    size = np.where(quiet, 0.01, 1.0)[:, None]
    shaken = size * np.random.default_rng(5).normal(size=(len(t_s), 3))
    still = np.zeros((len(t_s), 3))
    sigma = np.full((len(t_s), 3), 0.01)
    positions = Positions(t_s, still, sigma, sigma, np.zeros(len(t_s), np.intp), np.zeros(len(t_s), np.int8), t_s)
    found = Standing.find(InertialTrack(t_s, shaken, shaken), positions)
    assert found.begin_s.tolist() == [5.0]
    assert found.end_s.tolist() == [5.0 + windows]
