"""Long recordings are worked on in parts, which changes nothing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from furrowmap.core.adjustment.coarse import CoarseKnots, coarse_right, fine_step
from furrowmap.core.adjustment.knots import KNOT_STEP_S, Knots, State, knots_over, normal_equations, start_from
from furrowmap.core.adjustment.vehicle import wheeled_vehicle
from furrowmap.core.matching.gauss_newton import crab_equations
from furrowmap.core.matching.matched import information_of
from furrowmap.core.runtime import arrays
from furrowmap.core.values.gnss import Positions
from furrowmap.core.values.trajectory import trajectory_from_attitude


def _drive() -> tuple[Knots, State, Positions]:
    """Two chains of a drive in a curve, with a gap of the positions."""
    rng = np.random.default_rng(5)
    t = np.concatenate([np.arange(0.0, 9.0, 0.1), np.arange(20.0, 31.0, 0.1)])
    n, yaw = len(t), 0.1 * t
    xyz = np.column_stack([10.0 * np.sin(yaw), -10.0 * np.cos(yaw), np.zeros(n)])
    start = trajectory_from_attitude(
        t, xyz, 0.5, -0.3, 90.0 - np.degrees(yaw), max_gap_s=0.3, speed_mps=np.ones(n), motion=np.ones(n, np.int8)
    )
    knots = knots_over(t)
    positions = Positions(
        t_s=t,
        xyz_m=xyz + rng.normal(0.0, 0.01, (n, 3)),
        white_m=np.full((n, 3), 0.005),
        drift_m=np.full((n, 3), 0.01),
        run=np.repeat([0, 1], [60, n - 60]),
        fix=np.full(n, 4, np.int8),
        yaw_rad=np.where(t < 5.0, yaw, np.nan),
    )
    return knots, start_from(start, knots, np.zeros(3)), positions


def _everything() -> list[np.ndarray]:
    """What is worked on in parts."""
    knots, state, positions = _drive()
    rng = np.random.default_rng(6)
    equations = normal_equations(wheeled_vehicle(positions, np.zeros(3), np.array([1.0, 0.2, 2.0])), knots, state)
    coarse = CoarseKnots.over(knots, round(1.0 / KNOT_STEP_S), 1.0)
    centre, size = coarse.centres(knots, state), state.layout.size
    step = fine_step(coarse, centre, state, rng.normal(size=coarse.count * size))
    moved = state.moved(step)
    half = rng.normal(size=(len(knots), 6, 6))
    normal = (half @ half.transpose(0, 2, 1))[:, *np.triu_indices(6)]
    normal[100:200] = 0.0
    information = information_of(normal, 0.5 * normal)
    link, own, right = crab_equations(knots, moved)
    return [
        state.xyz_m, state.rotation, equations.band, equations.right, step, moved.xyz_m, moved.rotation, moved.added,
        coarse_right(coarse, centre, state, step), information.heading, information.place, information.level,
        link, np.array([own, right]),
    ]  # fmt: skip


def test_parts_give_the_same_as_the_whole(monkeypatch: pytest.MonkeyPatch) -> None:
    whole = _everything()
    monkeypatch.setattr(arrays, "ROWS_AT_ONCE", 37)
    monkeypatch.setattr(arrays, "LARGE", 1)
    for one, other in zip(whole, _everything(), strict=True):
        assert np.allclose(one, other, rtol=1e-9, atol=1e-12 * max(1.0, float(np.abs(one).max())))


def test_turns_between_poses_are_the_same_in_parts(monkeypatch: pytest.MonkeyPatch) -> None:
    t = np.arange(100.0)
    rng = np.random.default_rng(7)
    track = trajectory_from_attitude(
        t, np.zeros((100, 3)), rng.normal(size=100), rng.normal(size=100), 40.0 * t, max_gap_s=2.0
    )
    monkeypatch.setattr(arrays, "ROWS_AT_ONCE", 7)
    turn = replace(track).turn_rad
    pose = Rotation.from_quat(track.quaternion, scalar_first=True)
    assert np.allclose((pose[:-1] * Rotation.from_rotvec(turn)).as_matrix(), pose[1:].as_matrix())
