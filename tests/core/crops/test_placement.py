"""Shifted parcels are found by the rims of the crop, right ones are not doubted."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from shapely.affinity import rotate, scale, translate

from furrowmap.core.crops.parcel_placement import parcel_shift, parcels_elsewhere
from furrowmap.core.readers.areas.rings import pixels_in
from furrowmap.core.surfaces.grid import Grid
from furrowmap.core.values.parcel import Parcel

GRID = Grid.of_bounds(0.1, (1000.0, 2000.0, 1040.0, 2030.0))
SOWN = [
    shapely.box(1010.0 + 6.0 * i, 2010.0 + 3.0 * j, 1015.0 + 6.0 * i, 2012.4 + 3.0 * j)
    for i in range(3)
    for j in range(3)
]


def crop(height_m: float = 0.5) -> np.ndarray:
    """A slope with waves, noise, and a crop of uneven height on what is sown; a corner is unknown."""
    rng = np.random.default_rng(1)
    easting, northing = GRID.centres_m()
    out = 0.02 * (easting - 1000.0) + 0.02 * np.sin(northing / 3.0)[:, None] + rng.normal(0.0, 0.01, GRID.shape)
    for k, shape in enumerate(SOWN):
        out += pixels_in(shape, GRID) * (height_m * (1.0 + 0.05 * (k % 4)))
    out[:40, :40] = np.nan
    return out.astype(np.float32)


def parcels(east_m: float, north_m: float) -> list[Parcel]:
    moved = [translate(shape, east_m, north_m) for shape in SOWN]
    return [Parcel(str(k), shape, shape.buffer(-0.3)) for k, shape in enumerate(moved)]


@pytest.mark.parametrize(("east_m", "north_m"), [(0.5, 0.0), (0.3, -0.4), (0.0, 1.0), (-3.0, 4.0)])
def test_shifted_parcels__are_found_with_their_shift(east_m: float, north_m: float) -> None:
    found = parcel_shift(crop(), GRID, parcels(east_m, north_m), 0.005)
    assert found is not None
    assert (found.east_m, found.north_m) == pytest.approx((-east_m, -north_m), abs=0.11)
    assert found.height_off_m > 0.02


@pytest.mark.parametrize(("height_m", "off_m"), [(0.5, 0.0), (0.5, 0.05), (0.0, 0.5)])
def test_right_parcels_and_bare_soil__are_not_doubted(height_m: float, off_m: float) -> None:
    assert parcel_shift(crop(height_m), GRID, parcels(off_m, 0.0), 0.005) is None


def test_two_parcels__show_nothing() -> None:
    assert parcel_shift(crop(), GRID, parcels(1.0, 0.0)[:2], 0.005) is None


WIDE = Grid.of_bounds(0.2, (960.0, 1960.0, 1080.0, 2060.0))
LAYOUT = [*SOWN[:6], shapely.box(1022.0, 2016.0, 1024.0, 2020.0)]
"""Not the same when it is mirrored."""


def field(height_m: float = 0.5, *, known_m: float = 60.0) -> np.ndarray:
    """Soil with noise, known so far from its middle, and a crop on the layout."""
    rng = np.random.default_rng(2)
    easting, northing = WIDE.centres_m()
    out = 0.01 * (easting - 1000.0) + rng.normal(0.0, 0.01, WIDE.shape)
    for shape in LAYOUT:
        out += pixels_in(shape, WIDE) * height_m
    away = np.maximum(np.abs(easting - 1020.0), np.abs(northing - 2010.0)[:, None])
    return np.where(away < known_m, out, np.nan).astype(np.float32)


def laid_out(east_m: float, north_m: float, times: tuple[float, float] = (1.0, 1.0)) -> list[Parcel]:
    middle = shapely.box(*shapely.total_bounds(LAYOUT)).centroid
    moved = [translate(scale(shape, *times, origin=middle), east_m, north_m) for shape in LAYOUT]
    return [Parcel(str(k), shape, shape.buffer(-0.3)) for k, shape in enumerate(moved)]


@pytest.mark.parametrize(("east_m", "north_m"), [(40.0, 0.0), (-20.0, 15.0), (0.0, 12.0)])
def test_parcels_of_a_neighbour__are_found_with_their_shift(east_m: float, north_m: float) -> None:
    found = parcels_elsewhere(field(known_m=25.0), WIDE, laid_out(east_m, north_m), 0.005, 0.0)
    assert found is not None
    assert (found.east_m, found.north_m) == pytest.approx((-east_m, -north_m), abs=0.21)
    assert found.mirrored == (False, False)
    assert not found.of_positions
    assert found.height_off_m > 0.3


@pytest.mark.parametrize("times", [(-1.0, 1.0), (1.0, -1.0), (-1.0, -1.0)])
def test_mirrored_parcels__are_found(times: tuple[float, float]) -> None:
    found = parcels_elsewhere(field(), WIDE, laid_out(0.0, 0.0, times), 0.005, 0.0)
    assert found is not None
    assert found.mirrored == (times[0] < 0.0, times[1] < 0.0)
    assert (found.east_m, found.north_m) == pytest.approx((0.0, 0.0), abs=0.21)
    assert not found.of_positions


@pytest.mark.parametrize("times", [(-1.0, 1.0), (1.0, -1.0)])
@pytest.mark.parametrize("convergence_deg", [-2.5, 2.0])
def test_parcels_mirrored_about_the_meridian__are_found(times: tuple[float, float], convergence_deg: float) -> None:
    """The grid heading of true north is minus the convergence."""
    middle = shapely.box(*shapely.total_bounds(LAYOUT)).centroid
    level = [rotate(shape, -convergence_deg, origin=middle) for shape in LAYOUT]
    stated = [rotate(scale(shape, *times, origin=middle), convergence_deg, origin=middle) for shape in level]
    wrong = [Parcel(str(k), shape, shape.buffer(-0.3)) for k, shape in enumerate(stated)]
    found = parcels_elsewhere(field(), WIDE, wrong, 0.005, convergence_deg)
    assert found is not None
    assert found.mirrored == (times[0] < 0.0, times[1] < 0.0)


def test_mirrored_parcels__are_found_where_crop_hides_a_third_of_the_soil() -> None:
    seen = field()
    seen[np.random.default_rng(3).random(seen.shape) < 0.3] = np.nan
    found = parcels_elsewhere(seen, WIDE, laid_out(0.0, 0.0, (-1.0, 1.0)), 0.005, 0.0)
    assert found is not None
    assert found.mirrored == (True, False)


@pytest.mark.parametrize("lower_m", [0.2, 0.4])
def test_right_parcels_lower_than_the_crop_around__are_not_doubted(lower_m: float) -> None:
    """The crop between such parcels stands out wherever they are moved onto it."""
    assert parcel_shift(crop(-lower_m), GRID, parcels(0.0, 0.0), 0.005) is None
    assert parcel_shift(field(-lower_m), WIDE, laid_out(0.0, 0.0), 0.005) is None
    assert parcels_elsewhere(field(-lower_m), WIDE, laid_out(0.0, 0.0), 0.005, 0.0) is None


@pytest.mark.parametrize("height_m", [0.5, 0.05, 0.0])
def test_right_parcels_and_bare_soil__are_nowhere_else(height_m: float) -> None:
    assert parcels_elsewhere(field(height_m), WIDE, laid_out(0.0, 0.0), 0.005, 0.0) is None


def test_a_taller_trial_beside__casts_no_doubt_on_the_right_parcels() -> None:
    taller = field(0.2)
    for shape in LAYOUT:
        taller += pixels_in(translate(shape, 0.0, -25.0), WIDE) * np.float32(1.0)
    assert parcels_elsewhere(taller, WIDE, laid_out(0.0, 0.0), 0.005, 0.0) is None
