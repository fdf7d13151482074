"""Returns without a neighbour, in range images made for it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from furrowmap.core.implement.machine_voxels import isolated
from furrowmap.core.values.scan import Scan


def scan_of(range_m: NDArray[np.float64]) -> Scan:
    """A scan of a range image (lasers, columns); 0 is no return."""
    laser, column = np.nonzero(range_m)
    order = np.lexsort((laser, column))
    laser, column = laser[order], column[order]
    distance, azimuth, elevation = range_m[laser, column], np.radians(0.2 * column), np.radians(2.0 * laser - 15.0)
    flat = np.cos(elevation) * distance
    xyz = np.column_stack([flat * np.cos(azimuth), -flat * np.sin(azimuth), np.sin(elevation) * distance])
    one = np.ones(len(laser), np.uint8)
    return Scan(
        0,
        1e-5 * np.arange(len(laser)),
        xyz.astype(np.float32),
        one,
        laser.astype(np.uint8),
        column.astype(np.uint16),
        one,
        one,
    )


def test_isolated__is_dust_before_a_wall_and_not_a_post() -> None:
    image = np.full((16, 200), 20.0)
    image[5, 30] = 3.0  # a speck
    image[2:14, 90] = 8.0  # a post, one firing wide
    image[7, 120:122] = 4.0  # two returns of a straw
    scan = scan_of(image)
    speck = (scan.laser == 5) & (scan.column == 30)
    assert np.array_equal(isolated(scan), speck)


def test_isolated__is_a_return_alone_in_the_sky_and_none_of_a_slanting_ground() -> None:
    image = np.zeros((16, 300))
    image[:6] = 2.4 / np.sin(np.radians(15.0 - 2.0 * np.arange(6)))[:, None]
    image[12, 150] = 40.0
    scan = scan_of(image)
    assert np.array_equal(isolated(scan), scan.laser == 12)


@pytest.mark.parametrize("range_m", [2.0, 15.0, 60.0])
@pytest.mark.parametrize(
    ("lasers", "columns", "beside"),
    [
        *((0, 1, True), (0, 2, True), (0, -2, True), (0, 3, False), (0, -3, False), (1, 0, True), (-1, 0, True)),
        *((1, 2, True), (-1, -2, True), (1, 3, False), (-1, 3, False), (2, 0, False), (-2, 1, False)),
    ],
)
def test_support__is_of_an_adjacent_laser_two_firings_away_and_within_30_cm_and_2_percent(
    range_m: float, lasers: int, columns: int, beside: bool
) -> None:
    for nearer, alike in ((0.98, True), (1.02, False)):
        image = np.zeros((16, 100))
        image[:8] = 30.0
        image[12, 50] = range_m
        image[12 + lasers, 50 + columns] = range_m - nearer * (0.3 + 0.02 * range_m)
        scan = scan_of(image)
        pair = scan.laser >= 9
        supported = ~isolated(scan)
        assert supported[~pair].all()
        farther = pair & (scan.laser == 12) & (scan.column == 50)
        assert bool(supported[farther].all()) is (beside and alike)


@pytest.mark.parametrize(("alone", "found"), [(29, True), (33, False)])
def test_isolated__are_at_most_a_third_of_the_returns(alone: int, found: bool) -> None:
    image = np.zeros((16, 200))
    image[0, :60] = 20.0
    image[10, 3 * np.arange(alone)] = 9.0
    assert isolated(scan_of(image)).sum() == (alone if found else 0)


def test_isolated__of_no_return_is_none() -> None:
    assert isolated(scan_of(np.zeros((16, 10)))).shape == (0,)


@pytest.mark.parametrize("unknown", ["column", "laser"])
def test_isolated__is_nothing_where_the_scan_does_not_know_its_lasers_or_firings(unknown: str) -> None:
    scan = scan_of(np.random.default_rng(1).uniform(3.0, 60.0, (16, 200)))
    scan = replace(scan, **{unknown: np.zeros_like(getattr(scan, unknown))})
    assert not isolated(scan).any()
