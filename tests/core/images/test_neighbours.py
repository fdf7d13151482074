"""Which images show the same ground, of cameras that look straight down on a level field."""

from __future__ import annotations

import numpy as np
import pytest

from furrowmap.core.images.image_frames import FramePoses
from furrowmap.core.images.pinhole import inside, unproject
from furrowmap.core.images.ties import overlapping, seen_in
from furrowmap.core.values.camera import Camera

CAMERA = Camera(900, 700, 500.0, 500.0, 449.5, 349.5)
DEPTH_M = 10.0
WIDE_M, HIGH_M = 899 / 50.0, 699 / 50.0
"""Ground between the middles of the outermost pixels."""


def above(*east_north_m: tuple[float, float]) -> FramePoses:
    n = len(east_north_m)
    xyz = np.column_stack([np.array(east_north_m, np.float64), np.full(n, DEPTH_M)])
    return FramePoses(np.arange(float(n)), xyz, np.tile(np.diag([1.0, -1.0, -1.0]), (n, 1, 1)))


@pytest.mark.parametrize(
    ("east", "north", "pair"),
    [
        (0.99, 0.0, True),  # one column of seven
        (-0.99, 0.0, True),
        (1.01, 0.0, False),
        (0.99, 0.1, False),  # six of it
        (0.24, 0.99, True),  # seven of one row
        (0.26, 0.99, False),
        (0.24, -0.99, True),
        (0.0, 1.01, False),
    ],
)
def test_pair__shares_a_tenth_of_9_by_7_places(east: float, north: float, pair: bool) -> None:
    """Shifted by shares of its width and height: seven of 63 are a ninth, and six are not a tenth."""
    poses = above((0.0, 0.0), (east * WIDE_M, north * HIGH_M))
    assert overlapping(poses, CAMERA, DEPTH_M) == [(0, 1)] * pair


def test_images__are_matched_with_the_ten_that_show_most_of_the_same() -> None:
    """Along a line those are five on each side; more where one of a pair has fewer, as at the ends."""
    count = 40
    pairs = overlapping(above(*[(0.11 * k * WIDE_M, 0.0) for k in range(count)]), CAMERA, DEPTH_M)
    inner = {(a, b) for a, b in pairs if a >= 12 and b < count - 12}
    assert inner == {(a, b) for a in range(12, count - 12) for b in range(a + 1, min(a + 6, count - 12))}
    met = np.bincount(np.ravel(pairs), minlength=count)
    assert met[[0, -1]].tolist() == [9, 9]  # all that they share anything with
    assert met[1:-1].min() >= 10
    assert pairs == sorted(set(pairs))


def test_points_in_another_image__are_shifted_by_the_way_between() -> None:
    poses = above((0.0, 0.0), (0.3 * WIDE_M, 0.1 * HIGH_M))
    pixels = np.array([[449.5, 349.5], [600.0, 100.0], [10.0, 690.0]])
    seen = seen_in(poses, CAMERA, 0, 1, DEPTH_M * unproject(CAMERA, pixels))
    assert seen == pytest.approx(pixels + np.array([-0.3 * 899, 0.1 * 699]), abs=1e-9)
    assert inside(CAMERA, seen).tolist() == [True, True, False]
    assert inside(CAMERA, seen, margin_px=260.0).all()  # the third is 259.7 columns beside the image


def test_images__without_a_neighbour_have_no_pair() -> None:
    assert overlapping(above((0.0, 0.0), (500.0, 0.0)), CAMERA, DEPTH_M) == []
