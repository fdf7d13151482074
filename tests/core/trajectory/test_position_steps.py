"""Fixes to wrong ambiguities: positions that step, and say that they do not."""

import numpy as np
import pytest

from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.trajectory.from_inertial import InertialTrajectory, trajectory_from_inertial
from furrowmap.core.trajectory.inertial_start import MountedImu
from furrowmap.core.trajectory.position_steps import with_steps
from furrowmap.core.values.gnss import Fix, GnssTrack, Positions
from tests.core.trajectory.flights import BEGIN_S, INDUSTRIAL, LEVER_M, MOUNTING, Flight, frame

LENGTH_S = 120.0
WHITE_M = np.array([0.003, 0.003, 0.005])
SLOW_M = np.array([0.005, 0.005, 0.01])
SLOW_S = 60.0


def errors_m(seed: int, rate_hz: int) -> FloatArray:
    """(n, 3) of a receiver: white noise, and a first-order Gauss-Markov process."""
    chance = np.random.default_rng(seed)
    n = int(LENGTH_S * rate_hz)
    kept = np.exp(-1.0 / rate_hz / SLOW_S)
    slow = np.empty((n, 3))
    slow[0] = SLOW_M * chance.normal(size=3)
    for k in range(1, n):
        slow[k] = kept * slow[k - 1] + SLOW_M * np.sqrt(1.0 - kept**2) * chance.normal(size=3)
    return slow + WHITE_M * chance.normal(size=(n, 3))


def positions(rate_hz: int) -> Positions:
    n = int(LENGTH_S * rate_hz)
    return Positions(
        t_s=BEGIN_S + np.arange(n) / rate_hz,
        xyz_m=np.zeros((n, 3)),
        white_m=np.tile(WHITE_M, (n, 1)),
        drift_m=np.tile(SLOW_M, (n, 1)),
        run=np.zeros(n, np.intp),
        fix=np.full(n, Fix.FIXED, np.int8),
        yaw_rad=np.full(n, np.nan),
    )


def within(rate_hz: int, begin_s: float, end_s: float) -> FloatArray:
    """(n, 1) 1 between two times, 0 elsewhere."""
    s = np.arange(int(LENGTH_S * rate_hz)) / rate_hz
    return np.asarray(((s >= begin_s) & (s < end_s)).astype(np.float64)[:, None])


@pytest.mark.parametrize("rate_hz", [1, 5, 10, 20])
def test_right_positions__do_not_step(rate_hz: int) -> None:
    for seed in range(20):
        found, notices = with_steps(positions(rate_hz), errors_m(seed, rate_hz))
        assert notices == ()
        assert not found.run.any()


@pytest.mark.parametrize("rate_hz", [1, 5, 10, 20])
@pytest.mark.parametrize("off_m", [(0.05, 0.0, 0.0), (0.0, -0.1, 0.1), (0.0, 0.0, 0.2)])
def test_positions_that_step_and_return__are_off_while_they_are_fewer(
    rate_hz: int, off_m: tuple[float, float, float]
) -> None:
    stated = positions(rate_hz)
    found, notices = with_steps(stated, errors_m(5, rate_hz) + off_m * within(rate_hz, 40.0, 60.0))
    assert [notice.key for notice in notices] == ["gnss-steps.shown"]
    begin = 40 * rate_hz
    end = 60 * rate_hz
    assert np.flatnonzero(np.diff(found.run)).tolist() == [begin - 1, end - 1]
    np.testing.assert_allclose(found.drift_m[begin], np.hypot(SLOW_M, 2.0 * np.array(off_m)), atol=0.04)
    others = np.delete(np.arange(len(found.t_s)), begin)
    np.testing.assert_array_equal(found.drift_m[others], stated.drift_m[others])


def test_positions_of_two_halves__may_be_off_on_either_side() -> None:
    found, notices = with_steps(positions(10), errors_m(6, 10) + 0.2 * within(10, 62.0, 120.0))
    assert [notice.key for notice in notices] == ["gnss-steps.either"]
    assert (found.drift_m[[0, 620]] > 0.15).all()


def test_start_of_a_log__is_off_where_the_rest_is_longer() -> None:
    found, notices = with_steps(positions(10), errors_m(7, 10) + [0.0, 0.2, 0.0] * within(10, 0.0, 10.0))
    assert [notice.key for notice in notices] == ["gnss-steps.shown"]
    assert found.drift_m[0, 1] > 0.15
    assert found.drift_m[100, 1] == SLOW_M[1]


@pytest.mark.parametrize("rate_hz", [1, 5, 10])
def test_errors_of_a_wrong_lever_arm__turn_with_the_vehicle_and_are_no_steps(rate_hz: int) -> None:
    """Half a turn in six seconds, twice, with an antenna that is 0.2 m aside of where the session says."""
    s = np.arange(int(LENGTH_S * rate_hz)) / rate_hz
    course = np.pi * (np.clip((s - 40.0) / 6.0, 0.0, 1.0) + np.clip((s - 80.0) / 6.0, 0.0, 1.0))
    arm = 0.2 * np.column_stack([np.cos(course), np.sin(course), 0.0 * s])
    assert with_steps(positions(rate_hz), errors_m(8, rate_hz) + arm)[1] == ()


def test_single_outliers__are_no_steps() -> None:
    outliers = np.zeros((1200, 3))
    outliers[[200, 500, 501, 900]] = 0.3
    assert with_steps(positions(10), errors_m(9, 10) + outliers)[1] == ()


FLIGHT = Flight(50.0, 1)


def flown(begin_s: float, end_s: float, north_m: float, up_m: float) -> InertialTrajectory:
    """A flight whose positions are off between two times."""
    exact = FLIGHT.noisy_track(0.006, 0.004)
    now = (exact.t_s - BEGIN_S >= begin_s) & (exact.t_s - BEGIN_S < end_s)
    track = GnssTrack.build(
        exact.t_s,
        lon_deg=exact.lon_deg,
        lat_deg=exact.lat_deg + now * np.degrees(north_m / 6.38e6),
        height_m=exact.height_m + now * up_m,
        fix=exact.fix,
        sigma_e_m=exact.sigma_e_m,
        sigma_n_m=exact.sigma_n_m,
        sigma_h_m=exact.sigma_h_m,
    )
    mounted = MountedImu(FLIGHT.noisy_imu(INDUSTRIAL, 100.0), MOUNTING, INDUSTRIAL)
    return trajectory_from_inertial(track, mounted, frame(), LEVER_M, None)


@pytest.mark.parametrize(
    ("span_s", "north_m", "up_m"), [((20.0, 30.0), 0.1, 0.0), ((0.0, 8.0), 0.2, 0.0), ((20.0, 25.0), 0.1, 0.2)]
)
def test_flight_with_a_wrong_fix__is_where_it_was(span_s: tuple[float, float], north_m: float, up_m: float) -> None:
    found = flown(*span_s, north_m, up_m)
    assert {notice.key for notice in found.notices} == {"gnss-steps.shown"}
    off_m = found.trajectory.xyz_m - FLIGHT.xyz_m(found.trajectory.t_s - BEGIN_S)
    assert np.abs(off_m).max() < 0.03
    assert (np.sqrt((off_m**2).mean(axis=0)) < 3.0 * np.median(found.trajectory.sigma[:, :3], axis=0)).all()


def test_flight_whose_halves_differ__lies_between_and_says_so() -> None:
    found = flown(25.0, 60.0, 0.2, 0.0)
    assert {notice.key for notice in found.notices} == {"gnss-steps.either"}
    off_m = found.trajectory.xyz_m - FLIGHT.xyz_m(found.trajectory.t_s - BEGIN_S)
    assert (np.sqrt((off_m**2).mean(axis=0)) < 3.0 * np.median(found.trajectory.sigma[:, :3], axis=0)).all()
