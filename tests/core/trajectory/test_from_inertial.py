"""Trajectories from GNSS and an IMU: against flights worked out in earth-centred coordinates, and a sample's truth."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import lfilter
from scipy.spatial.transform import Rotation

from furrowmap.core.adjustment.knots import KNOT_STEP_S
from furrowmap.core.adjustment.position_observations import RecordedHeadings
from furrowmap.core.runtime import arrays
from furrowmap.core.runtime.errors import InputError, RefusedError
from furrowmap.core.session.opened import open_session
from furrowmap.core.trajectory.from_inertial import InertialTrajectory, trajectory_from_inertial
from furrowmap.core.trajectory.inertial_checks import densities
from furrowmap.core.trajectory.inertial_start import NO_HINTS, Hints, MountedImu
from furrowmap.core.trajectory.located import Companions, locate
from furrowmap.core.values.gnss import GnssTrack
from furrowmap.core.values.inertial import InertialTrack, inertial_noise
from furrowmap.core.values.rotation import attitude_to_quaternion, wrap_deg
from furrowmap.core.values.trajectory import Trajectory
from tests.core.trajectory.flights import BEGIN_S, LEVER_M, MOUNTING, Flight, Forward, frame

FloatArray = NDArray[np.float64]

INDUSTRIAL = inertial_noise("industrial")


def found(track: GnssTrack, imu: InertialTrack, hints: Hints = NO_HINTS) -> InertialTrajectory:
    return trajectory_from_inertial(track, MountedImu(imu, MOUNTING, INDUSTRIAL), frame(), LEVER_M, None, hints)


@cache
def usual(seed: int) -> InertialTrajectory:
    """Of a flight of 40 s with noise as stated, which several tests look at."""
    flight = Flight(40.0, seed)
    return found(flight.noisy_track(), flight.noisy_imu())


def errors(trajectory: Trajectory, flight: Flight) -> FloatArray:
    """(n, 6) metres and degrees, as :attr:`Trajectory.sigma`."""
    t_s = trajectory.t_s - BEGIN_S
    attitude = np.column_stack(trajectory.attitude_deg()) - np.column_stack(flight.attitude_deg(t_s))
    return np.column_stack([trajectory.xyz_m - flight.xyz_m(t_s), wrap_deg(attitude)])


def test_exact_measurements__give_the_flight() -> None:
    flight = Flight(60.0, seed=1)
    trajectory = found(flight.track(), flight.imu()).trajectory
    off = np.abs(errors(trajectory, flight)[200:-200])
    assert off[:, :3].max() < 0.003
    assert off[:, 3:].max() < 0.004


@pytest.mark.filterwarnings("error")
def test_a_second_beyond_a_minute__in_which_no_second_differences_fit_is_as_the_rest() -> None:
    """Alignment goes by minutes."""
    flight = Flight(61.0, seed=8)
    off = errors(found(flight.track(), flight.imu()).trajectory, flight)
    assert np.abs(off[-50:]).max() < 0.02


def test_fast_and_far__earth_rate_curvature_and_scale_are_in() -> None:
    flight = Flight(60.0, seed=2, speed_mps=60.0)
    off = np.abs(errors(found(flight.track(), flight.imu()).trajectory, flight)[200:-200])
    assert off[:, :3].max() < 0.004
    assert off[:, 3:].max() < 0.008


def test_sigmas__hold_over_ten_flights() -> None:
    ratio = []
    for seed in range(10):
        trajectory = usual(seed).trajectory
        ratio.append((errors(trajectory, Flight(40.0, seed)) / trajectory.sigma)[::40])
    rms = np.sqrt((np.concatenate(ratio) ** 2).mean(axis=0))
    assert 0.7 < np.sqrt((rms[:3] ** 2).mean()) < 1.5
    assert 0.7 < np.sqrt((rms[3:] ** 2).mean()) < 1.5
    assert (rms < 2.0).all()


@pytest.mark.parametrize(("seed", "kind"), [(25, "consumer"), (26, "tactical")])
def test_right_flights__are_not_doubted(seed: int, kind: str) -> None:
    """Gyroscopes whose bias turns gravity by 20° in the flight; a nose against a course that turns without it."""
    flight, noise = Flight(50.0, seed), inertial_noise(kind)
    imu = MountedImu(flight.noisy_imu(noise, rate_hz=100.0), MOUNTING, noise)
    result = trajectory_from_inertial(flight.noisy_track(), imu, frame(), LEVER_M, None)
    assert result.notices == ()
    assert (np.sqrt(((errors(result.trajectory, flight) / result.trajectory.sigma) ** 2).mean(axis=0)) < 3.0).all()


@pytest.mark.parametrize("off_s", [0.0, 0.03, -0.4, 18.0])
def test_clock_of_the_imu__is_found_and_used(off_s: float) -> None:
    flight = Flight(40.0, seed=3)
    imu = flight.noisy_imu(rate_hz=100.0)
    by_imu = found(flight.noisy_track(), replace(imu, t_s=imu.t_s + off_s))
    assert by_imu.figures.clock_estimate_s is not None
    estimate_s, sigma_s = by_imu.figures.clock_estimate_s
    assert abs(estimate_s - off_s) < 3.0 * sigma_s
    assert sigma_s < 0.002
    assert abs(by_imu.figures.minus_gnss_s - off_s) < 0.004
    assert [notice.code for notice in by_imu.notices] == (["imu-clock-off"] if off_s else [])
    assert errors(by_imu.trajectory, flight)[:, :3].std(axis=0).max() < 0.02


def test_a_clock_that_is_off_by_less_than_is_corrected__is_in_the_sigmas_of_attitudes_alone() -> None:
    """Poses of another time have another attitude; but the antenna is where the positions are."""
    flight, off_s = Flight(40.0, seed=3), 0.0018
    imu = flight.noisy_imu(rate_hz=100.0)
    right, late = (found(flight.noisy_track(), replace(imu, t_s=imu.t_s + by_s)) for by_s in (0.0, off_s))
    assert (late.notices, late.figures.minus_gnss_s) == ((), 0.0)
    assert late.adjusted.clock_sigma_s == pytest.approx(off_s, rel=0.3)
    now, before = (np.median(one.trajectory.sigma, axis=0) for one in (late, right))
    np.testing.assert_allclose(now[:3], before[:3], rtol=0.05)
    assert (now[3:5] > 1.5 * before[3:5]).all()
    ratio = errors(late.trajectory, flight) / late.trajectory.sigma
    assert (np.sqrt((ratio**2).mean(axis=0)) < 2.0).all()


@pytest.mark.parametrize(
    ("gains", "times", "key"), [(1.5e-3, 1.0, "imu-clock-off.rate-off"), (0.0, 1.03, "imu-scale-off")]
)
def test_clock_that_runs_or_gyroscopes_of_a_wrong_scale__are_told_apart_and_corrected(
    gains: float, times: float, key: str
) -> None:
    flight = Flight(40.0, seed=3)
    imu = flight.noisy_imu(rate_hz=100.0)
    t_s = imu.t_s + gains * (imu.t_s - imu.t_s[0] - 20.0)
    by_imu = found(flight.noisy_track(), replace(imu, t_s=t_s, rate_radps=times * imu.rate_radps))
    assert [notice.key for notice in by_imu.notices] == [key]
    shown = dict(by_imu.notices[0].values)
    assert float(str(shown.get("by_ms", 1e3 * gains))) == pytest.approx(1e3 * gains, abs=0.3)
    assert float(str(shown.get("times", times))) == pytest.approx(times, abs=0.003)
    ratio = errors(by_imu.trajectory, flight) / by_imu.trajectory.sigma
    assert (np.sqrt((ratio**2).mean(axis=0)) < 3.0).all()


def test_lever_arm_that_is_off__is_named_and_not_taken_for_a_clock() -> None:
    flight = Flight(40.0, seed=3)
    imu = MountedImu(flight.noisy_imu(rate_hz=100.0), MOUNTING, INDUSTRIAL)
    lever_m = (LEVER_M[0] + 0.3, LEVER_M[1], LEVER_M[2])
    by_imu = trajectory_from_inertial(flight.noisy_track(), imu, frame(), lever_m, None)
    assert by_imu.figures.minus_gnss_s == 0.0
    assert by_imu.figures.lever_arm_m == pytest.approx(LEVER_M, abs=0.05)
    assert [notice.key for notice in by_imu.notices] == ["contradiction.lever-arm"]
    # That of the IMU may be off instead.
    assert np.hypot(*by_imu.trajectory.sigma[:, :2].T).min() > 0.25


@pytest.mark.parametrize(("jump", "key"), [(False, "contradiction.positions-err"), (True, "gnss-steps.either")])
def test_positions_that_err_slowly_or_jump__are_named(jump: bool, key: str) -> None:
    flight = Flight(60.0, seed=3)
    track = flight.noisy_track()
    since_s = track.t_s - track.t_s[0]
    wandering = lfilter(
        [0.3 * np.sqrt(1.0 - 0.997**2)], [1.0, -0.997], np.random.default_rng(1).normal(size=len(track))
    )
    off_m = 0.4 * (since_s > 30.0) if jump else wandering
    by_imu = found(replace(track, lat_deg=track.lat_deg + off_m / 111_000.0), flight.noisy_imu(rate_hz=100.0))
    assert key in {notice.key for notice in by_imu.notices}
    assert np.sqrt(np.mean((errors(by_imu.trajectory, flight) / by_imu.trajectory.sigma) ** 2)) < 2.0


@pytest.mark.parametrize("slow_m", [0.0, 0.2])
def test_drive_on_wheels__has_the_slow_error_that_its_imu_shows(slow_m: float) -> None:
    drive, noise = Forward(60.0, 4, speed_mps=6.0), inertial_noise("consumer")
    track, kept = drive.noisy_track(), np.exp(-0.1 / 150.0)
    white = np.random.default_rng(5).normal(scale=np.sqrt(1.0 - kept**2), size=(len(track), 2))
    east_m, north_m = slow_m * lfilter([1.0], [1.0, -kept], white, axis=0).T
    track = replace(track, lat_deg=track.lat_deg + north_m / 111_000.0, lon_deg=track.lon_deg + east_m / 63_000.0)
    imu = MountedImu(drive.noisy_imu(noise, 100.0), MOUNTING, noise)
    by_imu = trajectory_from_inertial(track, imu, frame(), LEVER_M, None, Hints(on_wheels=True))
    assert [notice.key for notice in by_imu.notices] == ["contradiction.positions-err"] * (slow_m > 0.0)
    ratio = errors(by_imu.trajectory, drive) / by_imu.trajectory.sigma
    assert np.sqrt((ratio**2).mean()) < 2.0


def test_slow_error__has_the_density_that_was_drawn_on_the_axis_that_has_it() -> None:
    flight, sigma_m, lasting_s = Flight(60.0, seed=3), 0.1, 150.0
    track = flight.noisy_track()
    kept = np.exp(-0.1 / lasting_s)
    white = np.random.default_rng(4).normal(scale=sigma_m * np.sqrt(1.0 - kept**2), size=len(track))
    by_imu = found(replace(track, height_m=track.height_m + lfilter([1.0], [1.0, -kept], white)), flight.noisy_imu())
    problem, stated = by_imu.adjusted.problem, by_imu.positions.drift_m
    shown = np.median(problem.positions.drift_m / np.sqrt(problem.drift_s), axis=0)
    assert shown[2] == pytest.approx(sigma_m / np.sqrt(lasting_s), rel=0.2)
    assert shown[:2] == pytest.approx(np.median(stated[:, :2], axis=0) / np.sqrt(60.0), rel=1e-6)
    assert [notice.key for notice in by_imu.notices] == ["contradiction.positions-err"]


@pytest.mark.parametrize("period_s", [15.0, 25.0])
def test_heights_that_wave__are_blamed_on_positions(period_s: float) -> None:
    """To the IMU they look like noise of the vertical force, which its measurements do not have."""
    flight = Flight(60.0, seed=3)
    track = flight.noisy_track()
    wave_m = 0.05 * np.sin(2.0 * np.pi * (track.t_s - BEGIN_S) / period_s)
    by_imu = found(replace(track, height_m=track.height_m + wave_m), flight.noisy_imu())
    assert [notice.key for notice in by_imu.notices] == ["contradiction.positions-err"]
    assert np.sqrt(np.mean((errors(by_imu.trajectory, flight) / by_imu.trajectory.sigma) ** 2)) < 1.5


def test_rates_in_another_unit__are_refused_by_name() -> None:
    flight = Flight(60.0, seed=3)
    imu = flight.noisy_imu(rate_hz=100.0)
    with pytest.raises(InputError, match="in radians per second instead of degrees"):
        found(flight.noisy_track(), replace(imu, rate_radps=np.radians(imu.rate_radps)))


def test_flight_worked_on_in_parts__is_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    flight = Flight(40.0, seed=6)
    track, imu = flight.noisy_track(), flight.noisy_imu()
    whole = usual(6).trajectory
    monkeypatch.setattr(arrays, "ROWS_AT_ONCE", 210)
    monkeypatch.setattr(arrays, "LARGE", 1)
    parts = found(track, imu).trajectory
    for name in ("t_s", "xyz_m", "quaternion", "speed_mps", "sigma"):
        assert np.allclose(getattr(whole, name), getattr(parts, name), rtol=1e-6, atol=1e-8), name


def test_outage__is_bridged_within_its_sigma() -> None:
    flight = Flight(60.0, seed=3)
    whole = flight.noisy_track()
    track = whole[(whole.t_s < BEGIN_S + 25.0) | (whole.t_s > BEGIN_S + 33.0)]
    trajectory = found(track, flight.noisy_imu()).trajectory
    inside = (trajectory.t_s > BEGIN_S + 25.5) & (trajectory.t_s < BEGIN_S + 32.5)
    off = errors(trajectory, flight)[inside]
    assert (np.abs(off[:, :3]) < 4.0 * trajectory.sigma[inside, :3]).all()
    assert np.abs(off[:, :3]).max() < 0.05
    assert set(trajectory.position_from[inside]) == {"imu"}
    before = (trajectory.t_s > BEGIN_S + 1.0) & (trajectory.t_s < BEGIN_S + 24.0)
    assert set(trajectory.position_from[before]) == {"gnss"}


def test_outliers__lose_their_weight_and_are_told() -> None:
    """Ten positions, a twelfth of the second differences that show the first attitude."""
    flight = Flight(40.0, seed=4)
    track = flight.noisy_track()
    lat_deg = track.lat_deg.copy()
    lat_deg[200:210] += 2e-5  # two metres
    result = found(replace(track, lat_deg=lat_deg), flight.noisy_imu())
    assert result.figures.doubted >= 10
    assert np.abs(errors(result.trajectory, flight)[:, :3]).max() < 0.06
    (notice,) = result.notices
    assert notice.key == "gnss-jumps.by-imu"
    assert "(10): " in notice.text
    assert "(10 positions)" in notice.text


def below(limit: int, noisy: InertialTrack, exact: InertialTrack) -> InertialTrack:
    """The measurements with noise that a filter over some of them has passed."""
    smooth = np.ones(limit) / limit
    force, rate = (
        np.column_stack([np.convolve(one[:, k] - other[:, k], smooth, "same") for k in range(3)]) + other
        for one, other in ((noisy.force_mps2, exact.force_mps2), (noisy.rate_radps, exact.rate_radps))
    )
    return InertialTrack(exact.t_s, rate, force)


@pytest.mark.parametrize(("filtered", "code"), [(1, "imu-shaken"), (10, "contradiction")])
def test_force_noisier_than_stated__is_told_and_sigmas_follow(filtered: int, code: str) -> None:
    """White noise shows itself in the measurements, filtered noise by the positions alone."""
    real, squares = replace(INDUSTRIAL, force=12.0 * INDUSTRIAL.force), []
    for seed in (7, 8):
        flight = Flight(30.0, seed)
        result = found(flight.noisy_track(), below(filtered, flight.noisy_imu(real), flight.imu()))
        assert code in {notice.code for notice in result.notices}
        squares.append((errors(result.trajectory, flight) / result.trajectory.sigma) ** 2)
    assert np.sqrt(np.concatenate(squares).mean()) < 2.0
    assert not {"imu-noisier", "imu-shaken", "contradiction"} & {notice.code for notice in usual(8).notices}
    assert max(usual(8).figures.residual_correlation) < 0.2


def test_biases__are_found_in_the_axes_of_the_imu() -> None:
    flight = Flight(60.0, seed=5)
    exact = flight.imu()
    bias = np.array([0.002, -0.001, 0.0015]), np.array([0.05, -0.03, 0.02])
    figures = found(
        flight.track(), InertialTrack(exact.t_s, exact.rate_radps + bias[0], exact.force_mps2 + bias[1])
    ).figures
    assert figures.rate_bias_dps == pytest.approx(np.degrees(bias[0]), abs=0.003)
    assert figures.force_bias_mps2 == pytest.approx(bias[1], abs=0.005)


def test_figures__have_the_digits_that_mean_something_and_the_noise_of_the_positions() -> None:
    """Tenths of a millimetre; hundredths of a millidegree per second; hundredths of a millimetre per second squared."""
    flight = Flight(40.0, seed=5)
    figures = found(flight.noisy_track(white_m=0.02), flight.noisy_imu()).figures
    assert figures.position_rms_m == pytest.approx((0.02, 0.02, 0.03), rel=0.15)
    for values, digits in (
        (figures.rate_bias_dps, 5),
        (figures.rate_bias_sigma_dps, 5),
        (figures.force_bias_mps2, 5),
        (figures.force_bias_sigma_mps2, 5),
        (figures.position_rms_m, 4),
        ((figures.variance_factor,), 3),
    ):
        assert list(values) == [float(f"{value:.{digits}f}") for value in values]
        assert list(values) != [float(f"{value:.{digits - 1}f}") for value in values]


def test_densities__are_those_of_the_noise() -> None:
    shown = densities(Flight(40.0, 7).noisy_imu())
    assert shown == pytest.approx((INDUSTRIAL.rate, INDUSTRIAL.force), rel=0.1)
    exact = Flight(40.0, 7).imu()
    line = 2.0 * np.sin(2 * np.pi * 87.0 * exact.t_s)[:, None]
    assert densities(replace(exact, force_mps2=exact.force_mps2 + line))[1] < INDUSTRIAL.force


def test_hover__shows_no_heading_and_is_refused() -> None:
    flight = Flight(40.0, seed=6, speed_mps=0.0)
    exact, still = flight.imu(), flight.track()
    middle = [np.full(len(still), np.median(values)) for values in (still.lon_deg, still.lat_deg, still.height_m)]
    track = GnssTrack.build(still.t_s, lon_deg=middle[0], lat_deg=middle[1], height_m=middle[2], fix=still.fix)
    rest = InertialTrack(exact.t_s, 0.0 * exact.rate_radps, np.tile([0.0, 0.0, -9.8], (len(exact), 1)))
    with pytest.raises(RefusedError) as caught:
        found(track, rest)
    assert caught.value.code == "heading-unknown"


def baseline(flight: Flight, across_rad: float, sigma_deg: float, lasting_s: float = 10.0) -> RecordedHeadings:
    """Headings of two antennas at 10 Hz, with errors that last."""
    t, random = np.arange(0.1, flight.length_s, 0.1), np.random.default_rng([flight.seed, 97])
    axis = (np.cos(across_rad), np.sin(across_rad), 0.0)
    along = Rotation.from_quat(attitude_to_quaternion(*flight.attitude_deg(t)), scalar_first=True).apply(axis)
    off, kept = [random.normal()], np.exp(-0.1 / lasting_s)
    while len(off) < len(t):
        off.append(kept * off[-1] + np.sqrt(1.0 - kept**2) * random.normal())
    sigma = float(np.radians(sigma_deg))
    yaw = np.arctan2(along[:, 1], along[:, 0]) + sigma * np.array(off)
    return RecordedHeadings(BEGIN_S + t, yaw, sigma, lasting_s, across_rad)


@pytest.mark.parametrize("across_deg", [90.0, -160.0])
def test_baseline_of_two_antennas__is_that_of_a_tilted_vehicle(across_deg: float) -> None:
    flight = Flight(30.0, seed=3)
    log = baseline(flight, np.radians(across_deg), 1e-6)
    exact = found(flight.track(), flight.imu(), Hints(heading=replace(log, sigma_rad=1e-5))).trajectory
    assert np.abs(errors(exact, flight)[200:-200, 5]).max() < 0.002


def test_two_antennas_at_a_hover__show_the_heading_within_its_sigma() -> None:
    ratio = []
    for seed in range(4):
        flight = Flight(30.0, seed, speed_mps=0.0)
        place = flight.track()
        middle = [np.full(len(place), np.median(v)) for v in (place.lon_deg, place.lat_deg, place.height_m)]
        track = GnssTrack.build(place.t_s, lon_deg=middle[0], lat_deg=middle[1], height_m=middle[2], fix=place.fix)
        t_s = BEGIN_S + np.arange(0.0, 30.0, 0.01)
        rest = InertialTrack(t_s, np.zeros((len(t_s), 3)), np.tile([0.0, 0.0, -9.815], (len(t_s), 1)))
        yaw, sigma = 0.3 * seed, float(np.radians(0.5))
        noise = baseline(flight, 0.0, 0.5)
        exact = baseline(flight, 0.0, 0.0)
        log = RecordedHeadings(noise.t_s, yaw + (noise.yaw_rad - exact.yaw_rad), sigma, 10.0)
        hovered = found(track, rest, Hints(heading=log)).trajectory
        off = wrap_deg(hovered.attitude_deg()[2] - (90.0 - np.degrees(yaw)))
        ratio.append(np.median(off) / np.median(hovered.sigma[:, 5]))
        assert np.abs(off).max() < 1.0
        assert 0.1 < np.median(hovered.sigma[:, 5]) < 0.4
    assert 0.3 < np.sqrt(np.mean(np.square(ratio))) < 1.6


@pytest.mark.parametrize(
    ("rate", "force", "words"),
    [
        (180.0 / np.pi, 1.0, "angular rates were in degrees per second instead of radians"),
        (0.001, 1.0, "angular rates were in degrees or radians per second instead of thousandths"),
        (1000.0, 1.0, "angular rates were in thousandths of degrees or radians per second"),
        (1.0, 1.0 / 9.80665, "specific force were in g instead"),
        (1.0, -1.0, "specific force had the other sign"),
        (np.array([1.0, 1.0, -1.0]), 1.0, "about the vehicle's z axis had the other sign"),
    ],
)
def test_units_and_signs__that_are_wrong_are_named(rate: float, force: float, words: str) -> None:
    exact = Flight(40.0, seed=8).imu()
    wrong = InertialTrack(exact.t_s, exact.rate_radps * rate, exact.force_mps2 * force)
    with pytest.raises(InputError) as caught:
        found(Flight(40.0, seed=8).track(), wrong)
    assert caught.value.code == "imu-contradicts"
    assert words in caught.value.what


def test_stretches_without_heading__are_left_out() -> None:
    flight = Flight(60.0, seed=9)
    exact, track = flight.imu(), flight.track()
    pause = (exact.t_s > BEGIN_S + 40.0) & (exact.t_s < BEGIN_S + 41.0)
    imu = InertialTrack(exact.t_s[~pause], exact.rate_radps[~pause], exact.force_mps2[~pause])
    result = found(track[track.t_s < BEGIN_S + 38.0], imu)
    assert result.notices == ()
    assert result.trajectory.span_s[1] < BEGIN_S + 43.1


def test_other_times__are_an_error_with_both_spans() -> None:
    flight = Flight(30.0, seed=7)
    exact = flight.imu()
    with pytest.raises(InputError) as caught:
        found(flight.track(), InertialTrack(exact.t_s + 3600.0, exact.rate_radps, exact.force_mps2))
    assert caught.value.code == "imu-no-overlap"


@pytest.mark.parametrize(("name", "most_m"), [("session.toml", 0.008), ("session_outage.toml", 0.008)])
def test_sample__is_as_good_as_is_promised(shared_data: Path, name: str, most_m: float) -> None:
    folder = shared_data / "uav_wheat"
    opened = open_session(folder / name)
    located = locate(opened.positions(), opened.session, opened.frame, Companions(opened.inertial))
    truth = np.genfromtxt(folder / "truth" / "trajectory.csv", delimiter=",", names=True)
    t_s, trajectory = truth["time_unix_s"], located.trajectory
    at = np.flatnonzero((trajectory.t_s > t_s[0] + 6.0) & (trajectory.t_s < t_s[-1] - 5.0))[::20]
    poses = trajectory.at(trajectory.t_s[at])
    true = [np.interp(trajectory.t_s[at], t_s, truth[key]) for key in ("e_m", "n_m", "h_m", "roll_deg", "pitch_deg")]
    heading = np.interp(trajectory.t_s[at], t_s, np.degrees(np.unwrap(np.radians(truth["heading_deg"]))))
    off = np.column_stack([poses.xyz_m, *poses.attitude_deg()]) - np.column_stack([*true, heading])
    off[:, 5] = wrap_deg(off[:, 5])
    rms = np.sqrt((off**2).mean(axis=0))
    assert (rms[:3] < most_m).all()
    assert (rms[3:5] < 0.010).all()
    assert rms[5] < 0.05
    ratio = off / trajectory.sigma[at]
    assert (np.sqrt((ratio**2).mean(axis=0)) < 2.0).all()


def test_a_stretch__whose_motion_shows_no_heading_has_no_poses() -> None:
    """A flight, and after a pause of both recordings half a minute on the ground."""
    flight = Flight(40.0, seed=1)
    track, imu = flight.track(), flight.imu()
    still_s = imu.t_s[-1] + 20.0 + np.arange(0.0, 30.0, 0.005)
    level = MOUNTING.rotation.T @ np.array([0.0, 0.0, 9.815])
    both = InertialTrack(
        np.concatenate([imu.t_s, still_s]),
        np.concatenate([imu.rate_radps, np.zeros((len(still_s), 3))]),
        np.concatenate([imu.force_mps2, np.tile(level, (len(still_s), 1))]),
        "flight",
    )
    at_s = still_s[::20]
    t_s = np.concatenate([track.t_s, at_s])
    place = [np.concatenate([v, np.full(len(at_s), v[-1])]) for v in (track.lon_deg, track.lat_deg, track.height_m)]
    stays = GnssTrack.build(
        t_s, lon_deg=place[0], lat_deg=place[1], height_m=place[2], fix=np.full(len(t_s), track.fix[0])
    )
    result = found(stays, both)
    assert "imu-not-aligned" in {notice.code for notice in result.notices}
    assert result.trajectory.t_s[-1] < still_s[0]


def test_pose_errors__have_the_sigmas_of_the_poses_and_nodes_at_the_ends_of_chains() -> None:
    flight = Flight(40.0, seed=6)
    exact = flight.noisy_imu()
    t_s = exact.t_s - BEGIN_S
    heard = (t_s < 18.0) | (t_s > 21.0)
    paused = InertialTrack(exact.t_s[heard], exact.rate_radps[heard], exact.force_mps2[heard])
    result = found(flight.noisy_track(), paused)
    errors_of = result.pose_errors()
    gap = np.diff(errors_of.t_s).argmax()
    assert BEGIN_S + 17.5 < errors_of.t_s[gap] < BEGIN_S + 18.0
    assert BEGIN_S + 21.0 < errors_of.t_s[gap + 1] < BEGIN_S + 21.5
    assert (errors_of.value == 0.0).all()
    own = np.sqrt(np.diag(errors_of.covariance)).reshape(-1, 6)[1:-1]
    poses = result.trajectory
    near = np.abs(poses.t_s - errors_of.t_s[1:-1, None]).argmin(axis=1)
    np.testing.assert_allclose(own[:, :3], poses.sigma[near, :3], rtol=0.05)
    np.testing.assert_allclose(np.degrees(own[:, 5]), poses.sigma[near, 5], rtol=0.05)


def test_pose_errors__have_nodes_at_the_times_that_are_wanted() -> None:
    result = usual(6)
    wanted_s = BEGIN_S + np.array([10.33, 11.33, 12.9])
    nodes_s = result.pose_errors(wanted_s).t_s
    assert np.abs(nodes_s - wanted_s[:, None]).min(axis=1).max() <= 0.5 * KNOT_STEP_S + 1e-6
    assert len(nodes_s) < len(result.pose_errors().t_s) + 3
