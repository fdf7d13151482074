"""Features of simulated yards, whose truth is known for each point, and of single shapes."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely
from numpy.typing import NDArray

from benchmarks.yards import Kind, Yard, yard
from furrowmap.core.features.classes import Feature, FeatureCode, feature_codes
from furrowmap.core.features.classification import (
    Classified,
    FeatureTile,
    classify,
    colour_segments,
    greenness,
    vote_classes,
)
from furrowmap.core.features.objects import PlanePiece, join_planes, outline_plane, plane_foot, plants
from furrowmap.core.surfaces.ground_filter import classify_ground

CELL_M = 0.06


@pytest.fixture(scope="module")
def seen() -> Yard:
    return yard(8, 20.0, 0.7)


@pytest.fixture(scope="module")
def found(seen: Yard) -> Classified:
    return classify(FeatureTile(seen.xyz_m, classify_ground(seen.xyz_m), CELL_M, seen.rgb))


def f1(kind: NDArray[np.int8], feature: NDArray[np.uint8]) -> list[float]:
    """F1 of each class."""
    both = [np.count_nonzero((kind == k) & (feature == k + 1)) for k in Kind]
    return [
        2.0 * n / (np.count_nonzero(kind == k) + np.count_nonzero(feature == k + 1))
        for k, n in zip(Kind, both, strict=True)
    ]


def test_features__of_a_yard_are_what_stands_in_it(seen: Yard, found: Classified) -> None:
    ground, horizontal, vertical, line, scatter = f1(seen.kind, found.feature)
    assert min(ground, horizontal, vertical) > 0.9
    assert min(line, scatter) > 0.8


def test_planes__are_those_of_the_shed(seen: Yard, found: Classified) -> None:
    """Each rectangle of the shed that is seen has a plane with its normal, whose outline has its area."""
    for k, rectangle in enumerate(np.array(seen.scene.rectangles)):
        corner, u, v = rectangle[:3], rectangle[3:6], rectangle[6:9]
        normal = np.cross(u, v) / np.linalg.norm(np.cross(u, v))
        if rectangle[9] != Kind.HORIZONTAL:
            continue
        middle = corner + 0.5 * (u + v)
        same = [p for p in found.planes if abs(p.normal @ normal) > 0.995 and abs((p.centre_m - middle) @ normal) < 0.1]
        assert same, k
        outline = outline_plane(
            same[0], found.voxel_m[same[0].members], np.ones(len(same[0].members), int), 2 * CELL_M, 0.0
        )
        assert outline.area_m2 == pytest.approx(np.linalg.norm(np.cross(u, v)), rel=0.2)


def test_lines__poles_are_as_high_as_they_are(seen: Yard, found: Classified) -> None:
    cylinders = np.array(seen.scene.cylinders)
    tall = cylinders[(cylinders[:, 5] - cylinders[:, 2]) > 3.0]
    assert len(tall)
    for begin, end in zip(tall[:, :3], tall[:, 3:6], strict=True):
        near = [x for x in found.lines if x.upright and math.dist(x.path_m[0, :2], begin[:2]) < 0.3]
        assert any(abs(line.path_m[:, 2].max() - end[2]) < 0.4 for line in near)


def test_classes__have_their_codes() -> None:
    feature = np.array([*Feature, Feature.SCATTER, Feature.SCATTER, Feature.SCATTER], np.uint8)
    above = np.array([1.0, 0.0, 3.0, 1.0, 1.0, 0.5, 0.1, 2.0, np.nan])
    codes = feature_codes(feature, above).tolist()
    assert codes == [1, 2, 66, 67, 68, 4, 3, 5, 4]
    assert {*codes} == {*FeatureCode}


def test_a_cloud_without_ground__has_planes_all_the_same() -> None:
    rng = np.random.default_rng(1)
    wall = np.column_stack([rng.uniform(0, 4, 4000), rng.normal(0, 0.01, 4000), rng.uniform(0, 2, 4000)])
    found = classify(FeatureTile(wall, np.zeros(4000, bool), CELL_M))
    assert np.mean(found.feature == Feature.VERTICAL_PLANE) > 0.95
    assert np.isnan(found.above_m).all()


@pytest.mark.parametrize("count", [1, 2, 5])
def test_few_points__are_classified(count: int) -> None:
    xyz = np.arange(3.0 * count).reshape(-1, 3)
    assert len(classify(FeatureTile(xyz, np.zeros(count, bool), 0.1)).feature) == count
    assert (classify(FeatureTile(xyz, np.ones(count, bool), 0.1)).feature == Feature.GROUND).all()


def test_segments__outvote_a_weak_candidate_and_leave_lines_alone() -> None:
    evidence = np.array([[0.0, 0.9, 0.0, 0.1]] * 20 + [[0.0, 0.4, 0.0, 0.6]] * 5 + [[0.0, 0.0, 0.9, 0.1]])
    segment = np.zeros(26, np.int64)
    alone = vote_classes(evidence, np.full(26, -1), None).tolist()
    assert alone == [Feature.VERTICAL_PLANE] * 20 + [Feature.SCATTER] * 5 + [Feature.LINE]
    assert vote_classes(evidence, segment, None).tolist() == [Feature.VERTICAL_PLANE] * 25 + [Feature.LINE]
    leaves = np.tile([0.2, 0.5, 0.1], (26, 1))
    weak = np.array([[0.0, 0.6, 0.0, 0.4]] * 26)
    assert (vote_classes(weak, segment, leaves) == Feature.SCATTER).all()
    assert (vote_classes(weak, segment, np.full((26, 3), np.nan)) == Feature.VERTICAL_PLANE).all()


def test_colours__of_a_cloud_part_it_where_they_change() -> None:
    x, y = (a.ravel() for a in np.mgrid[0:40, 0:20] * 0.1)
    rgb = np.where((x < 2.0)[:, None], [0.2, 0.5, 0.2], [0.6, 0.5, 0.4])
    segment = colour_segments(np.column_stack([x, y, 0 * x]), rgb, 0.15)
    assert len(np.unique(segment)) == 2
    assert len(np.unique(segment[x < 2.0])) == 1
    assert greenness(np.array([[0.2, 0.5, 0.1], [0.5, 0.5, 0.5]])).tolist() == [1.0, 0.0]


def test_plants__are_parted_at_their_saddle() -> None:
    rng = np.random.default_rng(3)
    xy = rng.uniform(0.0, 8.0, (40_000, 2))
    height = np.maximum(
        3.0 - 1.5 * np.hypot(xy[:, 0] - 2.0, xy[:, 1] - 4.0), 2.0 - np.hypot(xy[:, 0] - 5.5, xy[:, 1] - 4.0)
    )
    kept = height > 0.2
    found = plants(np.column_stack([xy, height + 10.0])[kept], height[kept])
    order = np.argsort(-found.height_m)
    assert len(found) == 2
    np.testing.assert_allclose(found.height_m[order], [3.0, 2.0], atol=0.1)
    np.testing.assert_allclose(found.top_m[order], [[2.0, 4.0, 13.0], [5.5, 4.0, 12.0]], atol=0.3)
    assert found.points.sum() == kept.sum()
    assert len(plants(np.zeros((0, 3)), np.zeros(0))) == 0


def test_pieces__of_one_wall_are_joined_and_others_are_not() -> None:
    def part(x: float, y: float, normal: tuple[float, float, float] = (0.0, 1.0, 0.0)) -> PlanePiece:
        return PlanePiece(np.array([x, y, 1.0]), np.array(normal), shapely.box(-1.0, -1.0, 1.0, 1.0), 100, 0.01, 0.0)

    one = join_planes([part(0.0, 0.0), part(2.1, 0.02, (0.01, -0.99995, 0.0)), part(0.0, 1.0), part(9.0, 0.0)])
    assert len(one) == 3
    assert one[0].points == 200
    assert one[0].area_m2 == pytest.approx(8.0, abs=0.2)
    wall = plane_foot(one[0], "wall")
    assert wall.length_m == pytest.approx(4.1, abs=0.05)
    assert wall.height_m == pytest.approx(2.0, abs=0.05)
    assert one[0].top_m == pytest.approx(2.0, abs=0.05)
    assert join_planes([]) == []
