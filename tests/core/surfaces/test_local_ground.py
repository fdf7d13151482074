"""The ground of a run: points of a scene with known truth, taken scan by scan and classified at the end."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from furrowmap.core.surfaces.local_ground import GroundSampler
from furrowmap.core.values.scan import PointClass

STEP_M = 0.001
OTHER, GROUND, NOISE = PointClass.OTHER, PointClass.GROUND, PointClass.NOISE


def relief(e: NDArray[np.float64], n: NDArray[np.float64]) -> NDArray[np.float64]:
    return 0.05 * e + 0.3 * np.sin(n / 8.0)


def land(seed: int, count: int = 120_000) -> NDArray[np.float64]:
    """Rough ground on both sides of the origin, across several tiles."""
    rng = np.random.default_rng(seed)
    e, n = rng.uniform(-40.0, 40.0, (count, 2)).T
    return np.column_stack([e, n, relief(e, n) + rng.normal(0.0, 0.015, count)])


def classified(watch: GroundSampler, xyz: NDArray[np.float64], before: int = OTHER) -> NDArray[np.uint8]:
    """The final classes of points."""
    x, y, z = (np.rint(axis / STEP_M).astype(np.int32) for axis in xyz.T)
    classes = np.full(len(xyz), before, np.uint8)
    watch.ground().classify(x, y, z, STEP_M, classes)
    return classes


@pytest.fixture(scope="module")
def watch() -> GroundSampler:
    """What was learned of the land with a wall on it, some of it tilled later, in a hundred scans."""
    watch = GroundSampler()
    xyz = land(1)
    wall = np.column_stack(
        [
            np.random.default_rng(2).uniform(5.0, 15.0, 8000),
            np.full(8000, 10.0),
            np.random.default_rng(3).uniform(0.0, 2.5, 8000),
        ]
    )
    wall[:, 2] += relief(wall[:, 0], wall[:, 1])
    low = np.column_stack([xyz[:30, :2], xyz[:30, 2] - 3.0])
    every = np.concatenate([xyz, wall, low])
    for part in np.array_split(every[np.random.default_rng(4).permutation(len(every))], 100):
        watch.add(part, np.ones(len(part), bool))
    return watch


def test_classify__land_is_ground(watch: GroundSampler) -> None:
    assert (classified(watch, land(5)) == GROUND).mean() > 0.999


def test_classify__what_is_above_stays_and_what_is_below_is_noise(watch: GroundSampler) -> None:
    inside = land(6, 5000)
    for lifted_m, before, after in ((0.6, OTHER, OTHER), (2.0, NOISE, NOISE), (-0.6, OTHER, NOISE)):
        lifted = inside + np.array([0.0, 0.0, lifted_m])
        assert (classified(watch, lifted, before) == after).mean() > 0.995
    assert (classified(watch, inside, NOISE) == GROUND).mean() > 0.999


def test_classify__a_wall_is_no_ground(watch: GroundSampler) -> None:
    e = np.linspace(5.5, 14.5, 200)
    top = np.column_stack([e, np.full(200, 10.0), relief(e, np.full(200, 10.0)) + 1.5])
    assert not (classified(watch, top) == GROUND).any()


@pytest.mark.parametrize("kind", [PointClass.VEHICLE, PointClass.IMPLEMENT])
def test_classify__leaves_the_machine_alone(watch: GroundSampler, kind: PointClass) -> None:
    assert (classified(watch, land(7, 2000), kind) == kind).all()


def test_classify__knows_nothing_of_land_not_seen(watch: GroundSampler) -> None:
    far = land(8, 500) + np.array([5000.0, -3000.0, 0.0])
    assert (classified(watch, far) == OTHER).all()
    assert (classified(GroundSampler(), far, NOISE) == NOISE).all()


def test_add__a_stray_return_far_away_costs_nothing() -> None:
    watch = GroundSampler()
    points = np.concatenate([[[1e8, -1e8, 0.0]], [[1.0, 1.0, 1e7]], land(9)])
    watch.add(points, np.ones(len(points), bool))
    assert (classified(watch, land(10, 5000)) == GROUND).mean() > 0.995


def test_add__takes_no_note_of_points_not_kept(watch: GroundSampler) -> None:
    points = land(11, 30_000)
    above = points + np.array([0.0, 0.0, 5.0])
    mixed = np.stack([points, above], axis=1).reshape(-1, 3)
    other = GroundSampler()
    other.add(mixed, np.tile([True, False], len(points)))
    other.add(above, np.zeros(len(above), bool))
    alone = GroundSampler()
    alone.add(points, np.ones(len(points), bool))
    probe = land(12, 5000)
    np.testing.assert_array_equal(classified(other, probe), classified(alone, probe))
