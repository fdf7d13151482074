"""What a scanner's bow does to poses: against the equations themselves, and against lasers whose errors are drawn."""

from __future__ import annotations

import numpy as np

from furrowmap.core.adjustment.banded import NormalEquations
from furrowmap.core.adjustment.knots import VEHICLE
from furrowmap.core.matching.laser_ranges import ELEVATION_SIGMA, range_bow, range_bow_sigma
from furrowmap.core.matching.returns import GroundReturns

SIZE = VEHICLE.size
HEIGHT_M = 0.4
UP = np.array([0.0, 0.0, 1.0])


def rings(elevation: np.ndarray, per_ring: int) -> tuple[np.ndarray, np.ndarray]:
    """Places (n, 3) where level lasers HEIGHT_M above flat ground see it, and their numbers."""
    laser, azimuth = (v.ravel() for v in np.meshgrid(range(len(elevation)), np.arange(per_ring), indexing="ij"))
    azimuth = 2.0 * np.pi * azimuth / per_ring
    radius = HEIGHT_M / np.tan(-elevation[laser])
    xyz = np.column_stack([radius * np.cos(azimuth), radius * np.sin(azimuth), np.full(len(laser), -HEIGHT_M)])
    return xyz, laser.astype(np.uint8)


def test_range_bow_sigma__is_that_of_bowls_fitted_to_lasers_with_random_elevations() -> None:
    elevation = np.radians(np.arange(-15.0, -2.0, 2.0))
    xyz, laser = rings(elevation, 180)
    returns = GroundReturns(
        np.arange(len(xyz)) * 1e-3, xyz.astype(np.float32), laser % 2, np.zeros((80, 80), np.bool_), laser=laser
    )
    said = range_bow_sigma(returns, np.zeros(3), UP)

    random = np.random.default_rng(1)
    distance = np.linalg.norm(xyz, axis=1)
    flat = np.hypot(xyz[:, 0], xyz[:, 1])
    fit = np.linalg.pinv(np.column_stack([np.ones(len(xyz)), xyz[:, :2], flat**2]))[3]
    drawn = []
    for _ in range(4000):
        off = ELEVATION_SIGMA * random.normal(size=len(elevation))
        height = distance * np.sin(elevation[laser] + off[laser])
        drawn.append(fit @ height)
    np.testing.assert_allclose(said, np.std(drawn), rtol=0.05)


def test_range_bow_sigma__is_none_where_lasers_are_not_known() -> None:
    xyz, _ = rings(np.radians(np.array([-10.0, -5.0])), 10)
    half = np.zeros(len(xyz), np.uint8)
    returns = GroundReturns(np.arange(len(xyz)) * 1e-3, xyz.astype(np.float32), half, np.zeros((80, 80), np.bool_))
    assert range_bow_sigma(returns, np.zeros(3), UP) == 0.0


def test_range_bow__bends_poses_into_a_paraboloid_whose_slope_they_follow() -> None:
    random = np.random.default_rng(2)
    centre = np.column_stack([random.uniform(-20.0, 20.0, (12, 2)), np.zeros(12)])
    prior = NormalEquations(12 * SIZE, 2 * SIZE)
    for _ in range(30):
        design = random.normal(size=(11, 2 * SIZE))
        prior.add(np.arange(0, 11 * SIZE, SIZE), design, random.normal(size=11), np.ones(11))
    bow = range_bow(1e-4, prior, centre)
    plan = centre[:, :2] - centre[:, :2].mean(axis=0)
    mode = bow.mode.reshape(-1, SIZE)
    for k, (x, y) in enumerate(plan):
        np.testing.assert_allclose(mode[k, 2], 1e-4 * (x * x + y * y))
        # A turn by a rotation vector lifts what lies by d beside the vehicle by the cross product's upright part.
        for ahead in (np.array([1e-3, 0.0, 0.0]), np.array([0.0, 1e-3, 0.0])):
            lifted = np.cross(mode[k, 3:6], ahead)[2]
            exact = 1e-4 * (((plan[k] + ahead[:2]) ** 2).sum() - ((plan[k] - ahead[:2]) ** 2).sum()) / 2.0
            np.testing.assert_allclose(lifted, exact, rtol=1e-9)
    np.testing.assert_allclose(bow.right, prior.dense() @ bow.mode, rtol=1e-10)
