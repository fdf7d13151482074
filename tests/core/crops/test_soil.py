"""Soil under parcels against surfaces in closed form, and its standard deviation against the errors."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely

from furrowmap.core.crops.bare_soil import (
    MAX_SOIL_CELLS,
    HeightCovariance,
    SoilCells,
    estimate_covariance,
    interpolate_soil,
    noise_in_pixels,
    soil_cells,
    without_crop,
)
from furrowmap.core.crops.parcel_points import CellsNear, ParcelPoints
from furrowmap.core.crops.site_soil import soil_around
from furrowmap.core.values.parcel import Parcel

GROSS = shapely.box(0.0, 0.0, 10.0, 2.5)
PARCEL = Parcel("1", GROSS, shapely.box(1.0, 0.1, 9.0, 2.4))


def cells_around(height: object, rng: np.random.Generator, sigma_m: float) -> SoilCells:
    x, y = np.meshgrid(np.arange(-2.875, 13.0, 0.25), np.arange(-2.875, 5.5, 0.25))
    xy = np.column_stack([x.ravel(), y.ravel()])
    xy = xy[~shapely.contains_xy(GROSS.buffer(0.2), *xy.T)]
    z = np.asarray(height(xy)) + sigma_m * rng.standard_normal(len(xy))  # type: ignore[operator]
    return SoilCells(xy, z, np.full(len(xy), sigma_m))


def test_soil_cells__are_medians_of_even_cells() -> None:
    rng = np.random.default_rng(1)
    even = np.column_stack([rng.uniform(0, 0.25, (200, 2)), 5.0 + 0.01 * rng.standard_normal(200)])
    edge = np.column_stack([rng.uniform(0.25, 0.5, (200, 2)), rng.uniform(5.0, 5.6, 200)])
    few = np.array([[2.0, 2.0, 5.0], [2.01, 2.01, 5.0]])
    cells = soil_cells(np.concatenate([edge, even, few]))
    assert len(cells) == 1
    assert cells.height_m[0] == pytest.approx(np.median(even[:, 2]), abs=1e-9)
    assert cells.xy_m[0] == pytest.approx(even[:, :2].mean(axis=0))
    assert cells.sigma_m[0] == pytest.approx(1.25 * 0.01 / math.sqrt(200), rel=0.25)


def test_noise_in_pixels__is_that_of_the_returns_for_any_number_of_them() -> None:
    rng = np.random.default_rng(2)
    for count in (8_000, 60_000):
        points = np.column_stack([rng.uniform(0, 1.5, (count, 2)), 0.012 * rng.standard_normal(count)])
        assert noise_in_pixels(points, 0.04).mean() == pytest.approx(0.012, rel=0.02)


def test_without_crop__leaves_out_what_stands_on_the_soil() -> None:
    rng = np.random.default_rng(3)
    cells = cells_around(lambda xy: 3.0 + 0.02 * xy[:, 0], rng, 0.004)
    crop = rng.uniform(size=len(cells)) < 0.3
    raised = SoilCells(cells.xy_m, cells.height_m + np.where(crop, 0.4, 0.0), cells.sigma_m)
    kept = without_crop(raised)
    assert len(kept) == pytest.approx((~crop).sum(), abs=3)
    assert np.abs(kept.height_m - 3.0 - 0.02 * kept.xy_m[:, 0]).max() < 0.03


def test_interpolated__a_plane_is_found_exactly() -> None:
    def plane(xy: np.ndarray) -> np.ndarray:
        return 7.0 + 0.02 * xy[:, 0] - 0.01 * xy[:, 1]

    cells = cells_around(plane, np.random.default_rng(4), 0.0)
    cells = cells.at(np.arange(0, len(cells), 7))
    for relief in (HeightCovariance(0.0, 3.0, 0.005), HeightCovariance(0.02, 3.0, 0.005)):
        patch = interpolate_soil(PARCEL, cells, relief)
        assert patch is not None
        inside = np.array([[1.0, 0.2], [5.3, 1.1], [8.9, 2.3]])
        assert patch.at(inside) == pytest.approx(plane(inside), abs=1e-6)


def test_interpolated__errors_are_as_large_as_stated() -> None:
    """Random relief with the covariance that is assumed: the mean under the parcel against its standard deviation."""
    rng, relief = np.random.default_rng(5), HeightCovariance(0.02, 2.0, 0.006)
    cells = cells_around(lambda xy: np.zeros(len(xy)), rng, 0.0)
    cells = cells.at(np.arange(0, len(cells), 11))
    x, y = np.meshgrid(np.arange(1.25, 9.0, 0.5), np.arange(0.3, 2.4, 0.5))
    under = np.column_stack([x.ravel(), y.ravel()])
    places = np.concatenate([cells.xy_m, under])
    root = np.linalg.cholesky(relief.between(places, places) + 1e-9 * np.eye(len(places)))
    ratios = []
    for _ in range(40):
        height = root @ rng.standard_normal(len(places))
        seen = height[: len(cells)] + relief.cell_m * rng.standard_normal(len(cells))
        patch = interpolate_soil(PARCEL, SoilCells(cells.xy_m, seen, cells.sigma_m), relief)
        assert patch is not None
        ratios.append((patch.at(under).mean() - height[len(cells) :].mean()) / patch.sigma_m)
    assert np.sqrt(np.mean(np.square(ratios))) == pytest.approx(1.0, abs=0.25)


def test_relief_of__finds_the_covariance_that_made_the_heights() -> None:
    rng, true = np.random.default_rng(6), HeightCovariance(0.02, 3.0, 0.006)
    cells = cells_around(lambda xy: np.zeros(len(xy)), rng, 0.0)
    few = cells.at(np.arange(0, len(cells), 9))
    root = np.linalg.cholesky(true.between(few.xy_m, few.xy_m) + 1e-9 * np.eye(len(few)))
    surroundings = [
        SoilCells(few.xy_m, root @ rng.standard_normal(len(few)) + 0.006 * rng.standard_normal(len(few)), few.sigma_m)
        for _ in range(8)
    ]
    found = estimate_covariance(surroundings)
    assert found.cell_m == pytest.approx(true.cell_m, rel=0.2)
    here, away = np.zeros((1, 2)), np.array([[0.5, 0.0], [1.0, 0.0], [2.0, 0.0]])
    found_steps = found.relief_m**2 - found.between(here, away)
    assert found_steps == pytest.approx(true.relief_m**2 - true.between(here, away), rel=0.5)


def test_soil_around__a_plane_states_how_far_the_soil_departs_from_it() -> None:
    cells = cells_around(lambda xy: 0.03 * np.sin(xy[:, 0] / 2.0), np.random.default_rng(7), 0.002)
    surface, plane = (soil_around({"1": cells}, method).under(PARCEL) for method in ("surface", "plane"))
    assert surface is not None
    assert plane is not None
    assert plane.sigma_m > surface.sigma_m
    assert np.ptp(plane.height_m[2] - np.linspace(*plane.height_m[2][[0, -1]], plane.height_m.shape[1])) < 1e-9


def test_soil_around__is_unknown_where_none_is_seen() -> None:
    assert soil_around({"1": soil_cells(np.zeros((0, 3)))}).under(PARCEL) is None


def test_parcel_points__go_to_the_parcel_and_to_the_soil() -> None:
    other = Parcel("2", shapely.box(0.0, 3.0, 10.0, 5.5), shapely.box(1.0, 3.1, 9.0, 5.4))
    corner = np.array([600_000.0, 6_000_000.0, 0.0])
    points = corner + np.array(
        [
            *([5.0, 1.0, 70.5], [5.0, 4.0, 70.6], [5.0, 4.1, 70.61]),  # net parcels
            *([0.5, 1.0, 70.5], [5.0, 2.55, 70.2], [20.0, 1.0, 70.0]),  # gross, beside the crop, far away
            *([5.0, 2.68, 70.0], [5.01, 2.70, 70.01], [5.02, 2.72, 70.02]),  # the track between them
        ]
    )
    moved = [
        Parcel(one.id, *(shapely.transform(shape, lambda xy: np.add(xy, corner[:2])) for shape in (one.gross, one.net)))
        for one in (PARCEL, other)
    ]
    with ParcelPoints(moved, None) as collected:
        collected.add(points)
        assert collected.count == 3
        assert collected.of(0) == pytest.approx(points[:1], abs=1e-5)
        assert collected.of(1) == pytest.approx(points[1:3], abs=1e-5)
        soil = collected.soil()
        near = CellsNear(moved, soil)
    assert soil.height_m == pytest.approx([70.01], abs=1e-4)
    assert len(near["1"]) == len(near["2"]) == 1


def test_nearest__are_no_farther_than_any_other() -> None:
    cells = cells_around(lambda xy: np.zeros(len(xy)), np.random.default_rng(9), 0.0)
    away = shapely.distance(PARCEL.net, shapely.points(cells.xy_m))
    kept = cells.nearest(PARCEL)
    assert len(cells) > len(kept) == MAX_SOIL_CELLS
    assert shapely.distance(PARCEL.net, shapely.points(kept.xy_m)).max() == np.sort(away)[MAX_SOIL_CELLS - 1]
