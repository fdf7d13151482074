"""Preintegration and the adjustment against gtsam: increments, covariance, Jacobians, a whole trajectory."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from furrowmap.core.adjustment.banded import NormalEquations
from furrowmap.core.adjustment.knots import KNOT_STEP_S, POSE, Chain, Knots, State, normal_equations
from furrowmap.core.adjustment.position_observations import AntennaPositions, GnssDrift
from furrowmap.core.adjustment.preintegration import (
    FORCE_BIAS,
    INERTIAL,
    MIN_WAY_SIGMA_M,
    RATE_BIAS,
    VELOCITY,
    InertialLinks,
    Site,
    increments,
)
from furrowmap.core.values.gnss import Fix, Positions
from furrowmap.core.values.inertial import InertialTrack, inertial_noise

gtsam = pytest.importorskip("gtsam")

FloatArray = NDArray[np.float64]
RATE_HZ = 200
A_KNOT = round(KNOT_STEP_S * RATE_HZ)
LENGTH_S = 8.0
NOISE = inertial_noise("industrial")
FLAT = Site(9.81, np.zeros(3), 1e15, 1.0)
"""gtsam's earth: flat, and it does not turn."""
ARM_M = np.array([0.4, -0.2, 0.5])
GNSS_M = 0.01


@dataclass(frozen=True)
class Flown:
    """A flight of sines over a flat earth.

    Attributes:
        t_s: (n,) times of the samples.
        rate, force: (n, 3) exact measurements.
        xyz_m, velocity: (n, 3).
        rotation: (n, 3, 3) vehicle to map.
    """

    t_s: FloatArray
    rate: FloatArray
    force: FloatArray
    xyz_m: FloatArray
    velocity: FloatArray
    rotation: FloatArray


@pytest.fixture(scope="module")
def flown() -> Flown:
    t = np.arange(-A_KNOT, round(LENGTH_S * RATE_HZ) + 2 * A_KNOT + 1) / RATE_HZ
    w = 2.0 * np.pi * np.array([0.21, 0.17, 0.11])
    phase, size = np.array([0.3, 1.1, 2.0]), np.array([4.0, 3.0, 0.5])
    turns = np.outer(t, w) + phase
    angles = np.radians([60.0, 6.0, 8.0]) * np.sin(np.outer(t, 2.0 * np.pi * np.array([0.09, 0.4, 0.5])) + phase)
    rotation = Rotation.from_euler("ZYX", angles)

    def at(shift_s: float) -> Rotation:
        shifted = np.outer(t + shift_s, 2.0 * np.pi * np.array([0.09, 0.4, 0.5])) + phase
        return Rotation.from_euler("ZYX", np.radians([60.0, 6.0, 8.0]) * np.sin(shifted))

    near, wide = ((at(-h).inv() * at(h)).as_rotvec() / (2.0 * h) for h in (1e-3, 2e-3))
    acceleration = -size * w**2 * np.sin(turns) + [0.0, 0.0, FLAT.gravity_mps2]
    force = rotation.inv().apply(acceleration)
    rate = (4.0 * near - wide) / 3.0
    return Flown(t, rate, force, size * np.sin(turns), size * w * np.cos(turns), rotation.as_matrix())


def integrated(flown: Flown, rate: FloatArray, force: FloatArray, first: int, count: int, bias: FloatArray):  # type: ignore[no-untyped-def]
    """gtsam's measurement over `count` samples, each step with the mean of the samples at its ends.

    gtsam takes the force in the axes at the begin of a step; half the step's turn takes it there from the middle.
    """
    params = gtsam.PreintegrationParams.MakeSharedU(FLAT.gravity_mps2)
    params.setGyroscopeCovariance(NOISE.rate**2 * np.eye(3))
    params.setAccelerometerCovariance(NOISE.force**2 * np.eye(3))
    params.setIntegrationCovariance(MIN_WAY_SIGMA_M**2 / KNOT_STEP_S * np.eye(3))
    out = gtsam.PreintegratedImuMeasurements(params, gtsam.imuBias.ConstantBias(bias[3:], bias[:3]))
    for k in range(first, first + count):
        middle = 0.5 * (rate[k] + rate[k + 1])
        half = Rotation.from_rotvec(0.5 * (middle - bias[:3]) / RATE_HZ)
        out.integrateMeasurement(half.apply(0.5 * (force[k] + force[k + 1])), middle, 1.0 / RATE_HZ)
    return out


def test_increments__are_those_of_gtsam(flown: Flown) -> None:
    for first, count in ((0, A_KNOT), (200, 200)):
        begin, end = flown.t_s[[first]], flown.t_s[[first + count]]
        ours = increments(flown.t_s, flown.rate, flown.force, begin, end)
        theirs = integrated(flown, flown.rate, flown.force, first, count, np.zeros(6))
        off = Rotation.from_matrix(ours.turn[0].T @ theirs.deltaRij().matrix()).magnitude()
        assert off < 1e-5
        assert ours.velocity_mps[0] == pytest.approx(theirs.deltaVij(), abs=1e-6 * count)
        assert ours.way_m[0] == pytest.approx(theirs.deltaPij(), abs=1e-6 * count)


def links_of(flown: Flown, rate: FloatArray, force: FloatArray) -> tuple[InertialLinks, Knots]:
    count = round(LENGTH_S / KNOT_STEP_S) + 1
    links = InertialLinks(InertialTrack(flown.t_s, rate, force), np.zeros(3), NOISE, FLAT)
    return links, Knots((Chain(0, count, 0.0),), KNOT_STEP_S * np.arange(count))


def true_state(flown: Flown, knots: Knots) -> State:
    sample = np.round((knots.t_s - flown.t_s[0]) * RATE_HZ).astype(int)
    added = np.column_stack([np.zeros((len(sample), 3)), flown.velocity[sample], np.zeros((len(sample), 6))])
    return State(flown.xyz_m[sample], flown.rotation[sample], added, INERTIAL)


def test_link__has_the_covariance_and_the_jacobians_of_gtsam(flown: Flown) -> None:
    """The information of one link in all states of both knots, as gtsam's factor has it."""
    links, knots = links_of(flown, flown.rate, flown.force)
    state = true_state(flown, knots)
    at = 100
    pair = Knots((Chain(0, 2, float(knots.t_s[at])),), knots.t_s[at : at + 2])
    equations = NormalEquations(2 * INERTIAL.size, 2 * INERTIAL.size)
    links.add(equations, pair, state.part(slice(at, at + 2)))
    size = INERTIAL.size
    ours = equations.dense()
    first = round((knots.t_s[at] - flown.t_s[0]) * RATE_HZ)
    measured = integrated(flown, flown.rate, flown.force, first, A_KNOT, np.zeros(6))
    values = gtsam.Values()
    for key, k in ((0, at), (2, at + 1)):
        values.insert(key, gtsam.Pose3(gtsam.Rot3(state.rotation[k]), state.xyz_m[k]))
        values.insert(key + 1, state[VELOCITY][k])
    values.insert(4, gtsam.imuBias.ConstantBias())
    factor = gtsam.ImuFactor(0, 1, 2, 3, 4, measured)
    # the factor's own weights leave out how way and velocity go together, which the measurement's covariance holds
    whitened, _ = factor.linearize(values).jacobian()
    jacobian = np.linalg.solve(factor.noiseModel().R(), whitened)
    information = jacobian.T @ np.linalg.solve(measured.preintMeasCov(), jacobian)
    # gtsam's states: rotation and place in the vehicle's axes, velocity; bias of force and of rate of the earlier knot
    to_ours = np.zeros((2 * size, 24))
    for number, k in enumerate((at, at + 1)):
        turn, first_row = state.rotation[k], number * size
        velocity = INERTIAL.column(VELOCITY)
        to_ours[first_row + 3 : first_row + POSE, 9 * number : 9 * number + 3] = turn
        to_ours[first_row : first_row + 3, 9 * number + 3 : 9 * number + 6] = turn
        to_ours[first_row + velocity : first_row + velocity + 3, 9 * number + 6 : 9 * number + 9] = np.eye(3)
    to_ours[INERTIAL.column(FORCE_BIAS) : INERTIAL.column(FORCE_BIAS) + 3, 18:21] = np.eye(3)
    to_ours[INERTIAL.column(RATE_BIAS) : INERTIAL.column(RATE_BIAS) + 3, 21:24] = np.eye(3)
    without_walk = to_ours.T @ ours @ to_ours
    for block, walk, spread in ((18, NOISE.force_walk, NOISE.force_bias), (21, NOISE.rate_walk, NOISE.rate_bias)):
        for k in range(block, block + 3):
            without_walk[k, k] -= 1.0 / (walk**2 * KNOT_STEP_S) + 1.0 / spread**2
    scale = np.sqrt(np.outer(np.diag(information), np.diag(information)))
    assert (np.abs(without_walk - information) / scale).max() < 0.01


def test_adjustment__is_that_of_gtsam(flown: Flown) -> None:
    random = np.random.default_rng(4)
    n = len(flown.t_s)
    bias = np.array([2e-3, -1e-3, 3e-3, 0.05, -0.04, 0.06])
    rate = flown.rate + bias[:3] + random.normal(0.0, NOISE.rate * np.sqrt(RATE_HZ), (n, 3))
    force = flown.force + bias[3:] + random.normal(0.0, NOISE.force * np.sqrt(RATE_HZ), (n, 3))
    links, knots = links_of(flown, rate, force)
    start = true_state(flown, knots)
    seen = np.arange(0, len(knots) - 1, 4)
    places = start.xyz_m[seen] + start.rotation[seen] @ ARM_M + random.normal(0.0, GNSS_M, (len(seen), 3))
    m = len(seen)
    positions = Positions(
        knots.t_s[seen] + 1e-9, places, np.full((m, 3), GNSS_M), np.full((m, 3), 1e-7), np.zeros(m, np.intp),
        np.full(m, Fix.FIXED), np.full(m, np.nan),
    )  # fmt: skip
    antenna, state = AntennaPositions.unweighted(positions, np.zeros(3), ARM_M), start
    for _ in range(5):
        solution = normal_equations((antenna, GnssDrift(positions), links), knots, state).solve()
        state = state.moved(solution.values.reshape(len(knots), -1))
    sigma = solution.sigma().reshape(len(knots), -1)
    theirs, marginals = _by_gtsam(flown, rate, force, start, knots, seen, places)
    for k in range(0, len(knots), 16):
        pose = theirs.atPose3(3 * k)
        assert pose.translation() == pytest.approx(state.xyz_m[k], abs=2e-4)
        turn = Rotation.from_matrix(pose.rotation().matrix() @ state.rotation[k].T).as_rotvec()
        assert (np.abs(turn) < 0.02 * sigma[k, 3:6]).all()
        assert theirs.atVector(3 * k + 1) == pytest.approx(state[VELOCITY][k], abs=1e-3)
    found = theirs.atConstantBias(3 * 160 + 2)
    assert found.accelerometer() == pytest.approx(state[FORCE_BIAS][160], abs=2e-4)
    assert found.gyroscope() == pytest.approx(state[RATE_BIAS][160], abs=2e-5)
    for k in (0, 100, 200, len(knots) - 1):
        covariance = marginals.marginalCovariance(3 * k)
        own, place = (start.rotation[k] @ covariance[a : a + 3, a : a + 3] @ start.rotation[k].T for a in (0, 3))
        assert sigma[k, :3] == pytest.approx(np.sqrt(np.diag(place)), rel=0.03)
        assert sigma[k, 3:6] == pytest.approx(np.sqrt(np.diag(own)), rel=0.03)


def _by_gtsam(  # type: ignore[no-untyped-def]
    flown: Flown,
    rate: FloatArray,
    force: FloatArray,
    start: State,
    knots: Knots,
    seen: NDArray[np.int64],
    places: FloatArray,
):
    """The optimum of the same measurements and its covariances; keys are 3 k (pose), 3 k + 1, 3 k + 2."""
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    walk = np.repeat([NOISE.force_walk, NOISE.rate_walk], 3) * np.sqrt(KNOT_STEP_S)
    spread = np.repeat([NOISE.force_bias, NOISE.rate_bias], 3)
    none = gtsam.imuBias.ConstantBias()
    for k in range(len(knots)):
        values.insert(3 * k, gtsam.Pose3(gtsam.Rot3(start.rotation[k]), start.xyz_m[k]))
        values.insert(3 * k + 1, start[VELOCITY][k])
        values.insert(3 * k + 2, none)
        if k == len(knots) - 1:
            break
        first = round((knots.t_s[k] - flown.t_s[0]) * RATE_HZ)
        measured = integrated(flown, rate, force, first, A_KNOT, np.zeros(6))
        graph.add(gtsam.ImuFactor(3 * k, 3 * k + 1, 3 * k + 3, 3 * k + 4, 3 * k + 2, measured))
        model = gtsam.noiseModel.Diagonal.Sigmas(walk)
        graph.add(gtsam.BetweenFactorConstantBias(3 * k + 2, 3 * k + 5, none, model))
    graph.add(gtsam.PriorFactorConstantBias(2, none, gtsam.noiseModel.Diagonal.Sigmas(spread)))
    for k, place in zip(seen, places, strict=True):
        graph.add(gtsam.GPSFactorArm(3 * int(k), place, ARM_M, gtsam.noiseModel.Isotropic.Sigma(3, GNSS_M)))
    found = gtsam.LevenbergMarquardtOptimizer(graph, values).optimize()
    return found, gtsam.Marginals(graph, found)
