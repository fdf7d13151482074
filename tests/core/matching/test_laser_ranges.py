"""The lasers' constants, against those that were put in."""

from __future__ import annotations

import dataclasses

import numpy as np

from furrowmap.core.matching.laser_ranges import MIN_LASER_RETURNS, ranges_of
from furrowmap.core.matching.matched import matched_by, prepare
from furrowmap.core.matching.placing import Tool
from furrowmap.core.matching.returns import ground_returns
from furrowmap.core.matching.schedule import solve
from furrowmap.core.values.scan import MAX_LASERS, LaserRanges, Scan, shortened
from tests.core.conftest import Recording

LASERS = 16


def sums_of(offset_m: np.ndarray, count: float) -> np.ndarray:
    """What `count` returns of each of sixteen lasers say whose ranges are off by so much."""
    sums = np.zeros((4, MAX_LASERS))
    normal = count * 0.25 / 0.012**2
    for k, value in enumerate(offset_m):
        sums[:, k] = normal, normal * value, count * np.sin(np.radians(2.0 * k - 15.0)), count
    return sums


def test_what_looks_like_height_and_pitch_is_left_out() -> None:
    rise = 0.002 + 0.01 * np.sin(np.radians(2.0 * np.arange(LASERS) - 15.0))
    own = 0.003 * np.cos(2.6 * np.arange(LASERS))
    flat, both, alone = (ranges_of(sums_of(values, 20_000)) for values in (rise, rise + own, own))
    assert flat is not None
    assert both is not None
    assert alone is not None
    np.testing.assert_allclose(flat.offset_m, 0.0, atol=1e-9)
    np.testing.assert_allclose(both.offset_m, alone.offset_m, atol=1e-9)
    assert np.abs(alone.offset_m[:LASERS] - own).max() < 0.001


def test_lasers_that_see_little_keep_their_ranges() -> None:
    few = sums_of(np.full(LASERS, 0.003), MIN_LASER_RETURNS - 1.0)
    assert ranges_of(few) is None
    assert ranges_of(np.zeros((4, MAX_LASERS))) is None


def test_points_come_nearer_along_their_rays() -> None:
    random = np.random.default_rng(5)
    points = random.uniform(-20, 20, (100, 3)).astype(np.float32)
    laser = random.integers(0, LASERS, 100).astype(np.uint8)
    offset = np.zeros(256)
    offset[:LASERS] = random.normal(0.0, 0.05, LASERS)
    sensor = np.array([0.5, -0.2, 2.0])
    moved = shortened(points, laser, sensor, offset)
    before, after = points - sensor, moved - sensor
    np.testing.assert_allclose(
        np.linalg.norm(before, axis=1) - np.linalg.norm(after, axis=1), offset[laser], rtol=0, atol=1e-5
    )
    np.testing.assert_allclose(np.cross(before, after), 0.0, atol=1e-4)


def test_a_scan_is_corrected_about_its_sensor() -> None:
    n = 5
    offset = np.zeros(256)
    offset[3] = 0.004
    xyz = np.tile(np.array([3.0, 0.0, -4.0], np.float32), (n, 1))
    counts = np.zeros(n, np.uint8)
    laser = np.array([3, 0, 3, 1, 2], np.uint8)
    scan = Scan(0, np.zeros(n), xyz, counts, laser, counts.astype(np.uint16), counts, counts)
    found = LaserRanges(offset, np.full(256, np.nan)).corrected(scan)
    np.testing.assert_allclose(np.linalg.norm(found.xyz_m, axis=1), [4.996, 5.0, 4.996, 5.0, 5.0], atol=1e-6)


def test_a_drive_of_ten_seconds_shows_more_than_half_of_what_each_laser_has_of_its_own(straight: Recording) -> None:
    session, located = straight.session, straight.located
    assert located.antenna is not None
    assert session.antenna is not None
    assert session.implement is not None
    mounting = session.lidar.mounting
    returns = ground_returns(straight.scans(), mounting, located.trajectory)
    added = 0.006 * np.cos(2.6 * np.arange(LASERS))
    longer = np.zeros(256)
    longer[:LASERS] = -added
    xyz = shortened(returns.xyz_m, returns.laser, np.asarray(mounting.xyz_m), longer)
    tool = Tool(session.implement.xy_m, 0.5 * session.implement.width_m)
    found = []
    for one in (returns, dataclasses.replace(returns, xyz_m=xyz)):
        lever_m = session.antenna.xyz_m
        prepared = prepare(one, located.trajectory, located.antenna, lever_m, mounting, tool)
        assert prepared is not None
        matched = matched_by(prepared, solve(prepared.problem, prepared.first, lambda _: None))
        assert matched.ranges is not None
        found.append(matched.ranges)
    without, with_them = found
    difference = with_them.offset_m[:LASERS] - without.offset_m[:LASERS]
    elevation = np.sin(np.radians(2.0 * np.arange(LASERS) - 15.0))
    own = added - np.polyval(np.polyfit(elevation, added, 1), elevation)
    assert np.std(difference - own) < 0.5 * np.std(own)
    assert np.corrcoef(difference, own)[0, 1] > 0.97
    assert 0.0002 < with_them.sigma_m[:LASERS].min() < with_them.sigma_m[:LASERS].max() < 0.002
    assert np.isnan(with_them.sigma_m[LASERS:]).all()
