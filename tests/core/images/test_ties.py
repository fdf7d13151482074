"""Points that matches make of features, and their choice."""

from __future__ import annotations

import numpy as np

from furrowmap.core.images.ties import Ties, thin_ties, tracks

SIZE = (800, 600)


def features(*places: tuple[float, float]) -> np.ndarray:
    return np.array([(u, v, 0.1) for u, v in places])


def pair(*matches: tuple[int, int]) -> np.ndarray:
    return np.array(matches, np.int64)


def test_matches__join_to_one_point_over_several_images() -> None:
    seen = {0: features((1, 1), (2, 2)), 1: features((3, 3), (4, 4)), 5: features((5, 5))}
    ties = tracks(seen, {(0, 1): pair((0, 1)), (1, 5): pair((1, 0))})
    assert ties.points == 1
    assert ties.frame.tolist() == [0, 1, 5]
    assert ties.pixel[:, 0].tolist() == [1.0, 4.0, 5.0]


def test_point_at_two_places_of_an_image__is_left_out() -> None:
    seen = {0: features((1, 1), (9, 9)), 1: features((3, 3)), 2: features((5, 5), (7, 7))}
    matches = {(0, 1): pair((0, 0)), (1, 2): pair((0, 0)), (0, 2): pair((1, 0))}
    assert tracks(seen, matches).points == 0
    assert tracks(seen, {}).points == 0


def test_points_seen_once__go_when_observations_are_chosen() -> None:
    ties = Ties(np.array([0, 1, 0, 1]), np.array([0, 0, 1, 1]), np.zeros((4, 2)), np.ones(4))
    chosen = ties.chosen(np.array([True, False, True, True]))
    assert chosen.point.tolist() == [0, 0]
    assert chosen.frame.tolist() == [0, 1]


def test_thinning__keeps_some_points_in_each_part_of_the_images() -> None:
    rng = np.random.default_rng(0)
    crowd = np.column_stack([rng.uniform(0, 60, 500), rng.uniform(0, 60, 500)])
    lonely = np.array([[700.0, 500.0]])
    pixel = np.repeat(np.concatenate([crowd, lonely]), 2, axis=0)
    ties = Ties(np.tile([0, 1], 501), np.repeat(np.arange(501), 2), pixel, np.full(1002, 0.1))
    kept = thin_ties(ties, SIZE)
    assert (kept.pixel == lonely).all(axis=1).sum() == 2
    assert kept.points < 20
