"""Observations of a wheeled vehicle: the equations against numerical derivatives of the residuals."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from furrowmap.core.adjustment.banded import HUBER_SIGMAS, NormalEquations, huber_weight
from furrowmap.core.adjustment.knots import GNSS_DRIFT, KNOT_STEP_S, VEHICLE, Knots, State, knots_over, normal_equations
from furrowmap.core.adjustment.position_observations import (
    ANTENNA_HEADING_CORRELATION_S,
    ANTENNA_HEADING_SIGMA_RAD,
    AntennaPositions,
    RecordedHeadings,
)
from furrowmap.core.adjustment.registered_returns import Registration, SliceSums
from furrowmap.core.adjustment.vehicle import (
    ACCELERATION,
    HEAVE,
    LEVEL_CORRELATION_S,
    LEVEL_SIGMA,
    MIN_SLIP_SIGMA_M,
    SLIP,
    SLIP_EVERY_S,
    SWAY,
    TURNING,
    wheeled_vehicle,
)
from furrowmap.core.values.gnss import DRIFT_CORRELATION_S, Positions

FloatArray = NDArray[np.float64]

SIZE = VEHICLE.size
LEVER = np.array([1.8, -0.1, 1.6])
ORIGIN = np.array([10.0, 20.0, 5.0])


def turning_state(knots: Knots) -> State:
    """A slow turn on rough ground, none of whose residuals is zero."""
    random = np.random.default_rng(3)
    s = knots.t_s - knots.t_s[0]
    yaw = 0.4 + np.radians(20) * s + 0.002 * random.normal(size=len(s))
    xyz = np.column_stack([1.1 * s, 0.3 * s, 0.02 * s]) + 0.002 * random.normal(size=(len(s), 3))
    tilt = np.radians([2.0, -1.0]) + 0.002 * random.normal(size=(len(s), 2))
    rotation = Rotation.from_euler("ZYX", np.column_stack([yaw, tilt])).as_matrix()
    return State(xyz, rotation, 0.01 * random.normal(size=(len(s), 3)))


def positions_at(t_s: FloatArray, run: list[int], yaw_rad: FloatArray) -> Positions:
    random = np.random.default_rng(4)
    m = len(t_s)
    return Positions(
        t_s=t_s,
        xyz_m=ORIGIN + LEVER + 0.3 * random.normal(size=(m, 3)),
        white_m=random.uniform(0.004, 0.02, (m, 3)),
        drift_m=np.full((m, 3), 0.02),
        run=np.array(run),
        fix=np.full(m, 4, np.int8),
        yaw_rad=yaw_rad,
    )


def equations_at(knots: Knots, state: State, positions: Positions, trust: FloatArray) -> NormalEquations:
    """Of a wheeled vehicle, whose positions have these robust weights."""
    antenna, *others = wheeled_vehicle(positions, ORIGIN, LEVER)
    assert isinstance(antenna, AntennaPositions)
    return normal_equations([replace(antenna, weight=trust), *others], knots, state)


def residuals(knots: Knots, state: State, at: State, positions: Positions, trust: FloatArray) -> FloatArray:
    """All residuals over their standard deviations; standard deviations that depend on the way are those of `at`."""
    out: list[FloatArray] = []
    n = len(knots)

    def between(values: FloatArray, t_s: float) -> FloatArray:
        place = (t_s - knots.t_s[0]) / KNOT_STEP_S
        k = int(place)
        return np.asarray(values[k] + (place - k) * (values[k + 1] - values[k]))

    arm = state.rotation @ LEVER
    for m, t in enumerate(positions.t_s):
        computed = ORIGIN + between(state.xyz_m, t) + between(arm, t) + between(state[GNSS_DRIFT], t)
        out.append((computed - positions.xyz_m[m]) / positions.white_m[m] * np.sqrt(trust[m]))
    shown = np.flatnonzero(np.isfinite(positions.yaw_rad))
    for m in shown.tolist():
        k = int((positions.t_s[m] - knots.t_s[0]) / KNOT_STEP_S)
        yaw = np.arctan2(state.rotation[k, 1, 0], state.rotation[k, 0, 0])
        step_s = np.median(np.diff(positions.t_s[shown]))
        out.append(
            np.array([yaw - positions.yaw_rad[m]])
            / ANTENNA_HEADING_SIGMA_RAD
            / np.sqrt(ANTENNA_HEADING_CORRELATION_S / step_s)
        )
    kept = np.exp(-KNOT_STEP_S / DRIFT_CORRELATION_S)
    nearest = np.searchsorted(positions.t_s, knots.t_s).clip(0, len(positions.t_s) - 1)
    run, spread = positions.run[nearest], positions.drift_m[nearest]
    for k in range(n):
        if k == 0 or run[k] != run[k - 1]:
            out.append(state[GNSS_DRIFT][k] / spread[k])
        else:
            change = state[GNSS_DRIFT][k] - kept * state[GNSS_DRIFT][k - 1]
            out.append(change / (spread[k] * np.sqrt(1 - kept**2)))
    for k in range(1, n - 1):
        jerked = state.xyz_m[k + 1] - 2 * state.xyz_m[k] + state.xyz_m[k - 1]
        out.append(jerked / (np.array([ACCELERATION, ACCELERATION, HEAVE]) * KNOT_STEP_S**1.5))
        rotation = Rotation.from_matrix(state.rotation[k - 1 : k + 2])
        later = rotation[1].apply((rotation[1].inv() * rotation[2]).as_rotvec())
        earlier = rotation[0].apply((rotation[0].inv() * rotation[1]).as_rotvec())
        out.append((later - earlier) / (np.array([SWAY, SWAY, TURNING]) * KNOT_STEP_S**1.5))
    for k in range(n - 1):
        left = 0.5 * (state.rotation[k, :, 1] + state.rotation[k + 1, :, 1])
        way = np.linalg.norm(at.xyz_m[k + 1] - at.xyz_m[k])
        sigma = np.hypot(SLIP * way * np.sqrt(SLIP_EVERY_S / KNOT_STEP_S), MIN_SLIP_SIGMA_M)
        out.append(np.array([left @ (state.xyz_m[k + 1] - state.xyz_m[k])]) / sigma)
    out.append(state.rotation[:, 2, :2].reshape(-1) / (LEVEL_SIGMA * np.sqrt(LEVEL_CORRELATION_S / KNOT_STEP_S)))
    return np.concatenate(out)


def dense_band(band: FloatArray) -> FloatArray:
    size = band.shape[1]
    out = np.zeros((size, size))
    for offset, diagonal in enumerate(band):
        index = np.arange(size - offset)
        out[index + offset, index] = out[index, index + offset] = diagonal[: size - offset]
    return out


@pytest.mark.parametrize("two_antennas", [False, True])
def test_the_equations_are_those_of_their_residuals(two_antennas: bool) -> None:
    knots = knots_over(np.array([0.0, 0.31]))
    state = turning_state(knots)
    t = np.array([0.01, 0.1, 0.112, 0.2, 0.29])
    yaw = np.full(5, np.nan)
    if two_antennas:
        yaw[[0, 1, 3]] = [0.42, 0.41, 0.5]
    positions = positions_at(t, [0, 0, 0, 1, 1], yaw)
    trust = np.array([1.0, 0.5, 1.0, 0.2, 1.0])
    equations = equations_at(knots, state, positions, trust)

    n = len(knots) * SIZE
    step = 1e-6
    columns = []
    for one in np.eye(n):
        plus, minus = (state.moved(sign * step * one.reshape(-1, SIZE)) for sign in (1, -1))
        difference = residuals(knots, plus, state, positions, trust) - residuals(knots, minus, state, positions, trust)
        columns.append(difference / (2 * step))
    design = np.column_stack(columns)
    expected, right = design.T @ design, -design.T @ residuals(knots, state, state, positions, trust)
    scale = 1 / np.sqrt(np.diag(expected))
    # Turns from knot to knot are small: their derivatives are taken as those of plain vectors.
    assert np.abs((dense_band(equations.band) - expected) * scale[:, None] * scale).max() < 0.01
    assert np.abs((equations.right - right) * scale).max() < 0.01 * np.abs(right * scale).max()


def test_a_smooth_drive_with_exact_positions_stays_as_it_is() -> None:
    knots = knots_over(np.array([0.0, 4.0]))
    heading = Rotation.from_euler("z", 0.7)
    xyz = heading.apply(np.column_stack([1.2 * knots.t_s, 0 * knots.t_s, 0 * knots.t_s]))
    rotation = np.broadcast_to(heading.as_matrix(), (len(knots), 3, 3))
    state = State(xyz, rotation, np.zeros_like(xyz))
    t = np.arange(0.05, 3.9, 0.1)
    exact = ORIGIN + heading.apply(LEVER) + heading.apply(np.column_stack([1.2 * t, 0 * t, 0 * t]))
    positions = replace(positions_at(t, [0] * len(t), np.full(len(t), np.nan)), xyz_m=exact)
    whole = np.ones(len(t))
    equations = equations_at(knots, state, positions, whole)
    step = equations.solve().values.reshape(-1, SIZE)
    assert np.abs(step).max() < 1e-9
    assert AntennaPositions.unweighted(positions, ORIGIN, LEVER).normalised(knots, state).max() < 1e-6

    # Off by a centimetre aside and a degree of heading it comes back, to first order.
    turned = Rotation.from_euler("z", np.radians(1.0)) * Rotation.from_matrix(rotation)
    off = State(xyz + np.array([0.01, -0.01, 0.005]), turned.as_matrix(), np.zeros_like(xyz))
    for _ in range(4):
        equations = equations_at(knots, off, positions, whole)
        off = off.moved(equations.solve().values.reshape(-1, SIZE))
    assert np.abs(off.rotation - rotation).max() < 1e-4
    assert np.abs(off.xyz_m - xyz).max() < 1e-4


def test_positions_outside_the_scans_time_take_no_part() -> None:
    knots = knots_over(np.concatenate([np.arange(0, 1, 0.05), np.arange(9, 10, 0.05)]))
    state = turning_state(knots)
    t = np.array([-3.0, 0.5, 5.0, 9.5, 12.0])
    antenna = AntennaPositions.unweighted(positions_at(t, [0] * 5, np.full(5, np.nan)), ORIGIN, LEVER)
    assert np.isfinite(antenna.normalised(knots, state)).tolist() == [False, True, False, True, False]


def test_a_slice_of_returns_pulls_at_the_mean_of_its_two_knots() -> None:
    knots = knots_over(np.array([0.0, 0.2]))
    state = turning_state(knots)
    positions = positions_at(np.array([0.05, 0.15]), [0, 0], np.full(2, np.nan))
    random = np.random.default_rng(5)
    sums = SliceSums.empty(len(knots))
    n = len(knots) * SIZE
    expected, right = np.zeros((n, n)), np.zeros(n)
    for k in knots.linked:
        root = random.normal(size=(7, 6))
        matrix, pull = root.T @ root, random.normal(size=6)
        sums.normal[k], sums.right[k] = matrix[np.triu_indices(6)], pull
        mean = np.zeros((6, n))
        mean[:, k * SIZE : k * SIZE + 6] = mean[:, (k + 1) * SIZE : (k + 1) * SIZE + 6] = 0.5 * np.eye(6)
        expected += mean.T @ matrix @ mean
        right += mean.T @ pull
    without = equations_at(knots, state, positions, np.ones(2))
    others = wheeled_vehicle(positions, ORIGIN, LEVER)
    whole = normal_equations([*others, Registration(sums, free=False)], knots, state)
    scale = np.abs(dense_band(without.band)).max()
    np.testing.assert_allclose(dense_band(whole.band) - dense_band(without.band), expected, atol=1e-12 * scale)
    np.testing.assert_allclose(whole.right - without.right, right, atol=1e-12 * np.abs(without.right).max())


def test_huber_weight__is_huber_s() -> None:
    normalised = np.array([0.0, HUBER_SIGMAS, 2 * HUBER_SIGMAS, 100.0, np.nan])
    np.testing.assert_allclose(huber_weight(normalised), [1, 1, 0.5, HUBER_SIGMAS / 100, 1])


@pytest.mark.parametrize(("lasting_s", "alike"), [(0.0, 1.0), (0.2, 1.0), (1.0, 2.5), (5.0, 10.0), (np.inf, 10.0)])
def test_recorded_headings__weigh_as_many_as_are_independent(lasting_s: float, alike: float) -> None:
    """Ten headings, each 0.4 s, of a level vehicle: their weights of the yaw add up."""
    knots = knots_over(np.linspace(100.0, 104.0, 400))
    n, sigma_rad = len(knots), 0.02
    level = State(np.zeros((n, 3)), np.tile(np.eye(3), (n, 1, 1)), np.zeros((n, 3)))
    headings = RecordedHeadings(100.1 + 0.4 * np.arange(10), np.zeros(10), sigma_rad, lasting_s)
    found = normal_equations([headings], knots, level)
    assert found.band[0].sum() == pytest.approx(10.0 / (alike * sigma_rad**2))
