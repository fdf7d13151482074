"""Which returns of a simulated drive are matched, against the machine's true shape and the true ground."""

from __future__ import annotations

import warnings
from dataclasses import replace
from itertools import islice

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from furrowmap.core.matching.returns import (
    EXTRAPOLATION_S,
    GROUND_RATE_HZ,
    MAX_GROUND_RANGE_M,
    PIXEL_M,
    PIXELS,
    GroundReturns,
    ground_height_m,
    ground_returns,
    on_body,
)
from furrowmap.core.matching.walls import UprightReturns, no_upright
from furrowmap.core.values.scan import ARRAYS
from furrowmap.core.values.trajectory import SOURCE_NAMES, Motion
from tests.core.conftest import Recording


@pytest.fixture(scope="module")
def found(straight: Recording) -> GroundReturns:
    return ground_returns(straight.scans(), straight.session.lidar.mounting, straight.located.trajectory)


def test_returns_are_thinned_to_an_even_rate(found: GroundReturns) -> None:
    t = np.asarray(found.t_s)
    assert (np.diff(t) >= 0).all()
    rate = np.histogram(t, np.arange(t[0] + 0.2, t[-1] - 0.1, 0.5))[0] / 0.5
    assert np.median(rate) == pytest.approx(GROUND_RATE_HZ, rel=0.25)
    assert rate.max() < 1.6 * GROUND_RATE_HZ


def test_returns_of_many_lasers__are_taken_from_more_directions(straight: Recording) -> None:
    mounting, trajectory = straight.session.lidar.mounting, straight.located.trajectory
    some = [scan for scan in islice(straight.scans(), 30) if scan.whole]
    few, many = (
        ground_returns([replace(scan, lasers=lasers) for scan in some], mounting, trajectory) for lasers in (16, 128)
    )
    assert len(many) == pytest.approx(len(few), rel=0.1)
    firings = [len(np.unique(np.floor(np.asarray(returns.t_s) / 60e-6))) for returns in (few, many)]
    assert firings[1] > 2 * firings[0]


def test_scans_alternate_between_the_halves(found: GroundReturns) -> None:
    half = np.asarray(found.half)
    assert set(half.tolist()) == {0, 1}
    assert 0.45 < half.mean() < 0.55
    changes = np.asarray(found.t_s)[1:][np.diff(half.astype(int)) != 0]
    assert np.median(np.diff(changes)) == pytest.approx(0.1, abs=0.001)


def test_the_body_is_the_machine_s(straight: Recording, found: GroundReturns) -> None:
    scenario = straight.scenario
    x, y = scenario.implement.xy_m
    boxes = [*scenario.tractor.body_boxes_m]
    boxes += [(a + x, b + x, c + y, d + y, e, f) for a, b, c, d, e, f in scenario.implement.boxes_m]
    row, column = np.nonzero(found.body)
    at = (np.column_stack([column, row]) + 0.5 - PIXELS // 2) * PIXEL_M
    low = np.array([min(b[0] for b in boxes), min(b[2] for b in boxes)])
    high = np.array([max(b[1] for b in boxes), max(b[3] for b in boxes)])
    # Dust hangs about the tool, and two pixels round the footprint are left out with it.
    assert (at > low - 1.8).all()
    assert (at < high + 1.8).all()
    tool = int(np.floor(x / PIXEL_M)) + PIXELS // 2
    assert found.body[PIXELS // 2, tool]
    assert 2.0 < found.body.sum() * PIXEL_M**2 < 20.0


def test_on_body__is_the_footprint_from_its_first_pixel_to_its_last() -> None:
    body = np.random.default_rng(5).random((PIXELS, PIXELS)) < 0.5
    row, column = np.mgrid[-2 : PIXELS + 2, -2 : PIXELS + 2].reshape(2, -1)
    places = (np.column_stack([column, row]) + 0.5 - PIXELS // 2) * PIXEL_M
    there = on_body(np.column_stack([places, np.zeros(len(row))]).astype(np.float32), body)
    np.testing.assert_array_equal(there.reshape(PIXELS + 4, PIXELS + 4), np.pad(body, 2))


def test_what_is_left_is_ground(straight: Recording, found: GroundReturns) -> None:
    part = slice(None, None, 5)
    t, xyz = np.asarray(found.t_s[part]), np.asarray(found.xyz_m[part], float)
    assert np.hypot(xyz[:, 0], xyz[:, 1]).max() <= MAX_GROUND_RANGE_M
    pixel = np.floor(xyz[:, :2] / PIXEL_M).astype(int) + PIXELS // 2
    near = ((pixel >= 0) & (pixel < PIXELS)).all(axis=1)
    assert not found.body[pixel[near, 1], pixel[near, 0]].any()

    poses = straight.truth.at(t)
    placed = poses.xyz_m + Rotation.from_quat(poses.quaternion, scalar_first=True).apply(xyz)
    s = straight.surface
    column = np.floor((placed[:, 0] - s["e0"]) / s["cell_m"]).astype(int)
    row = np.floor((placed[:, 1] - s["n0"]) / s["cell_m"]).astype(int)
    inside = (row >= 0) & (column >= 0) & (row < s["before"].shape[0]) & (column < s["before"].shape[1])
    row, column, z, since = row[inside], column[inside], placed[inside, 2] - s["h0_m"], t[inside] - s["t0_unix_s"]
    worked = since > s["worked_time"][row, column]
    off = z - np.where(worked, s["after"][row, column], s["before"][row, column])
    assert inside.mean() > 0.95
    assert (np.abs(off) < 0.1).mean() > 0.98
    assert np.median(np.abs(off)) < 0.012


def test_a_stand_teaches_nothing_about_the_body(straight: Recording) -> None:
    start = straight.located.trajectory
    standing = replace(start, motion=np.full(len(start), Motion.STANDING, np.int8))
    found = ground_returns(straight.scans(), straight.session.lidar.mounting, standing)
    assert not found.body.any()


def test_scans_outside_the_trajectory_are_left_out(straight: Recording) -> None:
    start = straight.located.trajectory
    begin = float(start.t_s[0]) + 4.0
    half = len(start.t_s) // 2
    names = ("t_s", "xyz_m", "quaternion", "speed_mps", "motion", "fix", "sigma", *SOURCE_NAMES)
    late = replace(start, **{name: getattr(start, name)[half:] for name in names})
    found = ground_returns(straight.scans(), straight.session.lidar.mounting, late)
    assert begin < late.t_s[0] + 4.0
    assert found.t_s[0] >= late.t_s[0] - EXTRAPOLATION_S
    assert len(found) > 10_000
    nothing = ground_returns([], straight.session.lidar.mounting, start)
    assert len(nothing) == 0


@pytest.mark.parametrize(("shift_m", "expected_m"), [(0.0, 0.0), (-1.5, -1.5), (9.0, 0.0)])
def test_the_ground_s_height_is_learned_where_it_can_be(straight: Recording, shift_m: float, expected_m: float) -> None:
    mounting, scans = straight.session.lidar.mounting, list(islice(straight.scans(), 3))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = ground_height_m(scans, mounting.rotation, np.add(mounting.xyz_m, [0.0, 0.0, shift_m]))
    assert found == pytest.approx(expected_m, abs=0.1)
    assert ground_height_m([], mounting.rotation, np.zeros(3)) == 0.0


def test_a_part_has_the_upright_returns_of_its_time() -> None:
    t_s, upright_s = np.arange(0.0, 10.0), np.arange(0.0, 10.0, 0.5)
    n, m = len(t_s), len(upright_s)
    upright = UprightReturns(
        upright_s, np.full((m, 3), 2.0, np.float32), np.ones(m, np.uint8), np.arange(m, dtype=np.uint8)
    )
    whole = GroundReturns(
        t_s, np.zeros((n, 3), np.float32), np.zeros(n, np.uint8), np.zeros((80, 80), np.bool_), upright
    )
    part = whole.part(slice(3, 7))
    assert part.t_s.tolist() == [3.0, 4.0, 5.0, 6.0]
    assert part.upright.t_s.tolist() == [3.0, 3.5, 4.0, 4.5, 5.0, 5.5]
    assert part.upright.laser.tolist() == [6, 7, 8, 9, 10, 11]
    assert len(part.upright.xyz_m) == len(part.upright.half) == 6
    nothing = whole.part(slice(4, 4))
    assert len(nothing) == 0
    assert len(nothing.upright.t_s) == 0
    assert len(replace(whole, upright=no_upright()).part(slice(3, 7)).upright.t_s) == 0


def test_scans_of_one_return_are_taken_by_its_time(straight: Recording) -> None:
    scan = next(one for one in islice(straight.scans(), 20, None) if len(one) > 1000)
    mounting, trajectory = straight.session.lidar.mounting, straight.located.trajectory
    ground = ground_returns([scan], mounting, trajectory)
    assert len(ground) > 0
    lying = int(np.flatnonzero(np.asarray(scan.t_s) == ground.t_s[0])[0])
    one = replace(scan, **{name: getattr(scan, name)[[lying]] for name in ARRAYS})
    assert len(one) == 1
    assert len(ground_returns([one], mounting, trajectory)) <= 1
    early = trajectory.span_s[0] - EXTRAPOLATION_S
    for first_s, last_s in (
        (early - 0.01, early + 0.05),
        (trajectory.span_s[1], trajectory.span_s[1] + EXTRAPOLATION_S + 0.01),
    ):
        beyond = replace(scan, t_s=np.linspace(first_s, last_s, len(scan)))
        assert len(ground_returns([beyond], mounting, trajectory)) == 0
