"""The published steps, each against cases made by hand."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from furrowmap.core.crops.published import (
    christiansen2017,
    fill_pixels,
    grown_region,
    highest_voxels,
    plane_heights,
    points_in_polygon,
    soil_plane,
    statistical_outliers,
    voxels,
)
from furrowmap.core.surfaces.grid import Grid

NAN = float("nan")


def test_points_in_polygon__keeps_what_lies_within() -> None:
    triangle = shapely.Polygon([(0, 0), (2, 0), (0, 2)])
    points = np.array([[0.5, 0.5, 1.0], [1.5, 1.5, 1.0], [-0.1, 0.5, 1.0], [0.1, 1.8, 2.0]])
    assert points_in_polygon(points, triangle).tolist() == [[0.5, 0.5, 1.0], [0.1, 1.8, 2.0]]


def test_statistical_outliers__by_the_definition() -> None:
    rng = np.random.default_rng(3)
    points = np.concatenate([rng.normal(size=(300, 3)), [[9.0, 9.0, 9.0]]])
    apart = np.sort(np.linalg.norm(points[:, None] - points[None, :], axis=2), axis=1)[:, 1:9].mean(axis=1)
    expected = apart > apart.mean() + 2.0 * apart.std(ddof=1)
    found = statistical_outliers(points, neighbours=8, sigmas=2.0)
    assert (found == expected).all()
    assert found[-1]


def test_statistical_outliers__of_fewer_points_than_neighbours_are_none() -> None:
    assert not statistical_outliers(np.zeros((5, 3)), neighbours=5).any()


def test_statistical_outliers__agree_with_open3d() -> None:
    open3d = pytest.importorskip("open3d", reason="the extra open3d is not installed")
    rng = np.random.default_rng(4)
    points = np.concatenate([rng.normal(size=(2000, 3)), rng.uniform(-8, 8, (40, 3))])
    cloud = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(points))
    _, kept = cloud.remove_statistical_outlier(nb_neighbors=21, std_ratio=1.5)
    expected = np.ones(len(points), bool)
    expected[np.asarray(kept)] = False
    assert (statistical_outliers(points, neighbours=20, sigmas=1.5) == expected).all()


def test_voxels__a_point_on_a_face_belongs_to_the_voxel_beyond() -> None:
    points = np.array([[0.0, 0.0, 0.0], [0.5, 0.0, 0.0], [0.25, 0.999, 0.0], [0.3, 0.2, -0.125], [0.3, 0.2, -0.1]])
    found = voxels(points, size_m=(0.5, 1.0, 0.125))
    assert found.tolist() == [[0, 0, -1], [0, 0, 0], [1, 0, 0]]


def test_highest_voxels__is_the_middle_of_the_topmost() -> None:
    grid = Grid.of_bounds(1.0, (0.0, 0.0, 1.9, 1.9))
    occupied = np.array([[0, 0, 3], [0, 0, 7], [1, 1, -2], [5, 5, 9]])
    found = highest_voxels(occupied, grid, height_m=0.1)
    assert found == pytest.approx(np.array([[NAN, -0.15], [0.75, NAN]]), nan_ok=True)


def test_filled__with_six_of_eight_but_not_with_five() -> None:
    pixels = np.array([[1.0, 2.0, 3.0], [4.0, NAN, 5.0], [NAN, NAN, 6.0]])
    assert fill_pixels(pixels)[1, 1] == pytest.approx(21.0 / 6.0)
    pixels[0, 0] = NAN
    assert np.isnan(fill_pixels(pixels)[1, 1])


def test_filled__goes_on_until_nothing_changes() -> None:
    pixels = np.ones((6, 7))
    pixels[2, 2:5] = pixels[3, 3] = NAN
    # the ends of the bar of the T have six neighbours, its middle and foot five until the ends are filled
    assert not np.isnan(fill_pixels(pixels)).any()
    pixels[3, 2:5] = pixels[4, 2:5] = NAN
    # nothing begins in a square of three by three, whose corners have five
    assert np.isnan(fill_pixels(pixels)).sum() == 9


@settings(max_examples=50, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_filled__keeps_what_is_known_and_stays_within_it(seed: int) -> None:
    rng = np.random.default_rng(seed)
    pixels = rng.uniform(size=(9, 11))
    pixels[rng.uniform(size=pixels.shape) < 0.3] = NAN
    out = fill_pixels(pixels)
    known = np.isfinite(pixels)
    assert (out[known] == pixels[known]).all()
    if known.any():
        assert np.nanmin(out) >= np.nanmin(pixels)
        assert np.nanmax(out) <= np.nanmax(pixels)
    # mirrored pixels are filled as the mirror of the filled
    assert fill_pixels(pixels[::-1]) == pytest.approx(out[::-1], nan_ok=True)


def test_soil_plane__of_a_tilted_field_without_its_crop() -> None:
    grid = Grid.of_bounds(0.5, (100.0, 200.0, 109.9, 207.9))
    plane = (12.0, 0.03, -0.01)
    pixels = plane_heights(plane, grid)
    crop = np.zeros(grid.shape, bool)
    crop[4:12, 5:15] = True
    pixels[crop] += 0.6
    pixels[0, 0] = NAN
    assert soil_plane(pixels, grid, ~crop) == pytest.approx(plane, abs=1e-9)


def test_soil_plane__is_unknown_with_pixels_on_one_line() -> None:
    grid = Grid.of_bounds(1.0, (0.0, 0.0, 4.9, 4.9))
    line = np.zeros(grid.shape, bool)
    line[2] = True
    assert np.isnan(soil_plane(np.ones(grid.shape), grid, line)).all()


def test_grown_region__ends_at_a_step() -> None:
    heights = np.array([[0.50, 0.52, 0.30, 0.31], [0.51, 0.55, 0.33, 0.32], [0.49, 0.50, NAN, 0.30]])
    region = grown_region(heights)
    assert region.tolist() == [[True, True, False, False], [True, True, False, False], [True, True, False, False]]


def test_grown_region__goes_over_corners_but_not_over_gaps() -> None:
    heights = np.full((3, 5), NAN)
    heights[0, 0] = heights[1, 1] = heights[0, 2] = heights[0, 4] = 0.5
    assert np.argwhere(grown_region(heights)).tolist() == [[0, 0], [0, 2], [1, 1]]


def test_grown_region__follows_the_mean_of_the_region() -> None:
    heights = np.array([[0.50, 0.45, 0.40, 0.36, 0.33, 0.25]])
    # means 0.5, 0.475, 0.45, 0.4275, 0.408: the last is 0.158 below
    assert grown_region(heights).tolist() == [[True, True, True, True, True, False]]


def test_christiansen2017__of_a_box_of_crop_on_a_slope() -> None:
    rng = np.random.default_rng(1)
    around, crop, net = shapely.box(0, 0, 4, 3), shapely.box(0.5, 0.5, 3.5, 2.5), shapely.box(1, 1, 3, 2)
    xy = rng.uniform((0, 0), (4, 3), (60_000, 2))
    soil = 10.0 + 0.02 * xy[:, 0]
    stands = shapely.contains_xy(crop, *xy.T)
    points = np.column_stack([xy, soil + np.where(stands, 0.5, 0.0)])
    found = christiansen2017(points, net, crop, around)
    assert found.mean_height_m == pytest.approx(0.5, abs=0.003)
    assert found.volume_m3 == pytest.approx(0.5 * net.area, rel=0.01)


def test_filled__is_the_definition_pass_by_pass() -> None:
    pixels = np.random.default_rng(11).random((30, 41))
    pixels[np.random.default_rng(12).random(pixels.shape) < 0.3] = NAN
    expected = pixels.copy()
    while True:
        wide = np.pad(expected, 1, constant_values=NAN)
        around = np.stack([
            wide[1 + i : 31 + i, 1 + j : 42 + j] for i in (-1, 0, 1) for j in (-1, 0, 1) if (i, j) != (0, 0)
        ])  # fmt: skip
        known = np.isfinite(around).sum(axis=0)
        ready = np.isnan(expected) & (known >= 6)
        if not ready.any():
            break
        expected[ready] = np.nansum(around, axis=0)[ready] / known[ready]
    assert fill_pixels(pixels) == pytest.approx(expected, nan_ok=True)
