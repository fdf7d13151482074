"""The adjustment of a tractor with an IMU."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy.sparse
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from furrowmap.core.adjustment.banded import BandedSolution
from furrowmap.core.adjustment.imu_aiding import AIDED, GYRO_SCALE, InertialAttitudes
from furrowmap.core.adjustment.imu_aiding import MISALIGNMENT as IMU_ASKEW
from furrowmap.core.adjustment.knots import (
    VEHICLE,
    Knots,
    Observation,
    State,
    StateLayout,
    knots_over,
    normal_equations,
    start_from,
)
from furrowmap.core.adjustment.preintegration import RATE_BIAS
from furrowmap.core.adjustment.vehicle import wheeled_vehicle
from furrowmap.core.matching.problem import Iterate, Problem
from furrowmap.core.matching.returns import ground_returns
from furrowmap.core.matching.schedule import solve
from furrowmap.core.simulator.drive import drive_path, plan_path
from furrowmap.core.simulator.machine_motion import stand_on
from furrowmap.core.simulator.noise import random_for
from furrowmap.core.simulator.scenario import Scenario, ScenarioDrive, ScenarioField
from furrowmap.core.simulator.site import lay_out
from furrowmap.core.simulator.soil_over_time import find_sweeps, make_ground
from furrowmap.core.values.gnss import Positions
from furrowmap.core.values.inertial import inertial_noise
from furrowmap.core.values.trajectory import Motion, Trajectory, same_hemisphere, trajectory_from_attitude
from tests.core.adjustment.gyro import MISALIGNMENT, NOISE, SCALE, gyro_on
from tests.core.conftest import Recording

FloatArray = NDArray[np.float64]

LEVER = np.array([1.2, 0.1, 2.0])
BIAS = np.radians([0.11, -0.07, 0.19])
LOOP = Scenario(
    name="loop",
    title="Two passes and a turn",
    seed=21,
    field=ScenarioField(margin_m=10.0),
    drive=ScenarioDrive(passes=2),
)


def driven() -> Trajectory:
    """The true drive of a tractor over rough ground, at 100 Hz."""
    path = plan_path(LOOP.drive, random_for(LOOP.seed, "driver"))
    scenario = lay_out(LOOP, path)
    track = drive_path(path, scenario.drive, scenario.implement, random_for(LOOP.seed, "tool"))
    ground = make_ground(scenario, find_sweeps(track, scenario.implement.xy_m))
    motion = stand_on(ground, track, scenario.tractor, scenario.sway, random_for(LOOP.seed, "sway"))
    i = slice(None, None, round(0.01 / float(np.median(np.diff(motion.t_s)))))
    angles = (np.degrees(a[i]) for a in (motion.roll_rad, motion.pitch_rad, np.pi / 2 - motion.yaw_rad))
    return trajectory_from_attitude(motion.t_s[i], motion.xyz_m[i], *angles, max_gap_s=1.0)


def yaws_rad(truth: Trajectory) -> FloatArray:
    """(n,) without jumps."""
    forward = Rotation.from_quat(truth.quaternion, scalar_first=True).apply([1.0, 0.0, 0.0])
    return np.unwrap(np.arctan2(forward[:, 1], forward[:, 0]))


def positions_on(truth: Trajectory, outage_s: tuple[float, float]) -> Positions:
    """Ten positions a second of an antenna, a centimetre of drift and 4 mm of noise, but for an outage."""
    random = np.random.default_rng(5)
    t = np.arange(truth.span_s[0] + 0.05, truth.span_s[1], 0.1)
    t = t[(t < outage_s[0]) | (t > outage_s[1])]
    poses = truth.at(t)
    antenna = poses.xyz_m + Rotation.from_quat(poses.quaternion, scalar_first=True).apply(LEVER)
    drift = 0.01 * np.column_stack([np.sin(t / 17.0), np.cos(t / 23.0), np.sin(t / 29.0 + 1.0)])
    m = len(t)
    return Positions(
        t_s=t,
        xyz_m=antenna + drift + 0.004 * random.standard_normal((m, 3)),
        white_m=np.full((m, 3), 0.004),
        drift_m=np.full((m, 3), 0.01),
        run=np.zeros(m, np.intp),
        fix=np.full(m, 4, np.int8),
        yaw_rad=np.full(m, np.nan),
    )


def adjusted(
    truth: Trajectory,
    knots: Knots,
    layout: StateLayout,
    observations: tuple[Observation, ...],
    outage_s: tuple[float, float],
) -> tuple[State, BandedSolution]:
    """Gauss-Newton from a level first guess that is straight in the outage."""
    kept = (truth.t_s < outage_s[0]) | (truth.t_s > outage_s[1])
    heading = 90.0 - np.degrees(yaws_rad(truth)[kept])
    guess = trajectory_from_attitude(truth.t_s[kept], truth.xyz_m[kept], 0.0, 0.0, heading + 0.5, max_gap_s=1.0)
    state = start_from(guess, knots, np.zeros(3), layout)
    for _ in range(10):
        solution = normal_equations(observations, knots, state).solve()
        observations = tuple(one.reweighted(knots, state) for one in observations)
        state = state.moved(solution.values.reshape(len(knots), -1))
    return state, solution


def heading_errors(truth: Trajectory, knots: Knots, state: State) -> FloatArray:
    """(n,) in radians."""
    true = Rotation.from_quat(truth.at(knots.t_s).quaternion, scalar_first=True).as_matrix()
    turn = Rotation.from_matrix(state.rotation @ true.transpose(0, 2, 1)).as_rotvec()
    return np.asarray(turn[:, 2])


def test_a_gyro_holds_the_heading_through_an_outage_in_a_turn_and_its_bias_is_found() -> None:
    truth = driven()
    yaw_rate = np.gradient(yaws_rad(truth), truth.t_s)
    middle = float(truth.t_s[np.argmax(np.convolve(np.abs(yaw_rate), np.ones(600), mode="same"))])
    outage = (middle - 4.0, middle + 4.0)
    knots = knots_over(np.arange(truth.span_s[0] + 0.1, truth.span_s[1] - 0.1, 0.1))
    usual = wheeled_vehicle(positions_on(truth, outage), np.zeros(3), LEVER)
    within = (knots.t_s > outage[0]) & (knots.t_s < outage[1])

    without, _ = adjusted(truth, knots, VEHICLE, usual, outage)
    gyro = gyro_on(truth, knots, BIAS, seed=8)
    aided = wheeled_vehicle(positions_on(truth, outage), np.zeros(3), LEVER, (gyro,))
    state, solution = adjusted(truth, knots, AIDED, aided, outage)
    before, after = (heading_errors(truth, knots, one)[within] for one in (without, state))
    rms_before, rms_after = (np.sqrt(np.mean(one**2)) for one in (before, after))
    assert rms_after < 0.25 * rms_before
    assert rms_after < np.radians(0.25)

    sigma = solution.sigma().reshape(len(knots), -1)
    assert np.sqrt(np.mean((after / sigma[within, 5]) ** 2)) < 2.0
    bias, scale = AIDED.column(RATE_BIAS), AIDED.column(GYRO_SCALE)
    off = np.abs(state[RATE_BIAS] - BIAS)
    assert (off < 3.5 * sigma[:, bias : bias + 3]).all()
    assert sigma[:, bias + 2].max() < 0.3 * NOISE.rate_bias
    assert off[:, 2].max() < 0.2 * BIAS[2]
    assert abs(state[GYRO_SCALE][0, 0]) < 3.5 * sigma[0, scale] < 0.01


def test_gyroscopes_and_attitudes_of_an_imu_mounted_askew_fit_the_truth_and_lead_back_to_it() -> None:
    truth, askew = driven(), Rotation.from_rotvec(MISALIGNMENT)
    knots = knots_over(np.arange(truth.span_s[0] + 0.1, truth.span_s[1] - 0.1, 0.1))
    stated = Rotation.from_quat(truth.quaternion, scalar_first=True) * askew
    sigma = np.column_stack([np.zeros((len(truth), 3)), np.full((len(truth), 3), (0.03, 0.03, 0.2))])
    by_imu = replace(truth, quaternion=same_hemisphere(stated.as_quat(scalar_first=True)), sigma=sigma)
    attitudes = InertialAttitudes.from_trajectory(by_imu, inertial_noise("consumer"), knots)
    level, headings = np.isfinite(attitudes.sigma_rad[:, [0, 2]]).sum(axis=0)
    assert 1 <= headings < level < 20

    start = start_from(truth, knots, np.zeros(3), AIDED)
    added = np.zeros((len(knots), AIDED.size))
    for block, value in ((RATE_BIAS, BIAS), (IMU_ASKEW, MISALIGNMENT), (GYRO_SCALE, SCALE)):
        added[:, AIDED.column(block) : AIDED.column(block) + block.size] = value
    true = start.moved(added)
    axes = Rotation.from_quat(truth.at(knots.t_s).quaternion, scalar_first=True)
    true = replace(true, rotation=axes.as_matrix())
    gyro = gyro_on(truth, knots, BIAS, seed=8, share=1.0, noisy=False)
    tiny = 1e-5 * np.random.default_rng(3).standard_normal((len(knots), AIDED.size))
    tiny[:, AIDED.column(RATE_BIAS) :] = tiny[0, AIDED.column(RATE_BIAS) :]
    for observation in (gyro, attitudes):
        at_truth, beside = (normal_equations((observation,), knots, one) for one in (true, true.moved(tiny)))
        back = scipy.sparse.dia_array((at_truth.band, -np.arange(len(at_truth.band))), shape=(tiny.size, tiny.size))
        expected = -(back + scipy.sparse.tril(back, -1).T) @ tiny.ravel()
        off = beside.right - at_truth.right - expected
        assert np.abs(off).max() < 0.01 * np.abs(expected).max()  # half of the misalignment is not in the derivative


def test_the_whole_schedule_takes_an_imu(straight: Recording) -> None:
    located, session = straight.located, straight.session
    assert located.antenna is not None
    assert session.antenna is not None
    returns = ground_returns(straight.scans(), session.lidar.mounting, located.trajectory)
    usual = Problem.from_session(
        returns, located.trajectory, located.antenna, session.antenna.xyz_m, session.lidar.mounting, None
    )
    gyro = gyro_on(straight.truth, usual.knots, BIAS, seed=9)
    start = start_from(located.trajectory, usual.knots, usual.origin_m, AIDED)
    aided = wheeled_vehicle(usual.positions, usual.origin_m, usual.lever_m, (gyro,))
    more = replace(usual, start=start, observations=aided)
    without, found = (solve(one, Iterate.first(one), lambda share: None) for one in (usual, more))

    inside = (usual.knots.t_s > straight.truth.span_s[0]) & (usual.knots.t_s < straight.truth.span_s[1])
    moves = located.trajectory.motion[located.trajectory.interval(usual.knots.t_s)[0]] != Motion.STANDING
    inside &= moves
    before, after = (heading_errors(straight.truth, usual.knots, one.state)[inside] for one in (without, found))
    assert np.std(after) < 0.7 * np.std(before)
    column = AIDED.column(RATE_BIAS)
    sigma = found.last.held.solve().sigma().reshape(len(usual.knots), -1)[:, column : column + 3]
    assert (np.abs(found.state[RATE_BIAS] - BIAS) < 3.5 * sigma).all()
    assert np.abs(found.state[RATE_BIAS][:, 2] - BIAS[2]).max() < 0.2 * BIAS[2]
