"""Cells of bare soil, against heights whose quartiles are known."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from furrowmap.core.crops.bare_soil import SoilCells, noise_in_pixels, soil_cells, without_crop

FloatArray = NDArray[np.float64]


def points(*heights_m: float) -> FloatArray:
    """In one cell, about its middle."""
    n = len(heights_m)
    turn = 2.0 * np.pi * np.arange(n) / n
    return np.column_stack([10.125 + 0.05 * np.cos(turn), 20.125 + 0.05 * np.sin(turn), heights_m])


@pytest.mark.parametrize(("spread_m", "even"), [(0.059, True), (0.061, False)])
def test_cells__are_even_within_six_centimetres_between_their_quartiles(spread_m: float, even: bool) -> None:
    """The quartiles of five heights are the second and the fourth."""
    found = soil_cells(points(1.0, 2.0 - 0.4 * spread_m, 2.0, 2.0 + 0.6 * spread_m, 3.0))
    assert len(found) == even
    if even:
        assert found.xy_m[0] == pytest.approx((10.125, 20.125))
        assert found.height_m[0] == pytest.approx(2.0)
        # of a median, sqrt(pi / 2) times that of a mean of normal values, 1.349 of whose sigmas are between quartiles
        assert found.sigma_m[0] == pytest.approx(np.sqrt(np.pi / 2.0) * spread_m / 1.349 / np.sqrt(5.0), rel=1e-4)


@pytest.mark.parametrize(("count", "known"), [(2, False), (3, True)])
def test_cells__hold_three_points(count: int, known: bool) -> None:
    assert len(soil_cells(points(*[1.0] * count))) == known


def test_cells__are_a_quarter_of_a_metre_wide() -> None:
    random = np.random.default_rng(4)
    xyz = np.column_stack([random.uniform(0.0, 3.0, (20_000, 2)), np.zeros(20_000)])
    found = soil_cells(xyz)
    assert len(found) == 12 * 12
    assert np.abs(found.xy_m - 0.25 * (np.floor(found.xy_m / 0.25) + 0.5)).max() < 0.03
    assert found.sigma_m.max() < 0.001


def sloping(off_m: FloatArray) -> SoilCells:
    """Cells, square in number, of a slope with what is off it."""
    side = round(np.sqrt(len(off_m)))
    east, north = (axis.ravel() for axis in np.meshgrid(0.25 * np.arange(side), 0.25 * np.arange(side)))
    return SoilCells(np.column_stack([east, north]), 5.0 + 0.1 * east - 0.05 * north + off_m, np.full(side**2, 0.01))


def mixed(low_m: float, high_m: float) -> FloatArray:
    """The values between two, in any order: 900."""
    return np.random.default_rng(7).permutation(np.linspace(low_m, high_m, 900))


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(("wide_m", "limit_m"), [(0.002, 0.03), (0.04, 3.0 * 1.4826 * 0.02)])
def test_soil__is_within_three_standard_deviations_and_at_least_three_centimetres(
    wide_m: float, limit_m: float, sign: float
) -> None:
    """Half of values that are spread evenly are within half of their reach."""
    for times, kept in ((0.92, True), (1.08, False)):
        off = mixed(-wide_m, wide_m)
        off[450] = sign * times * limit_m
        found = without_crop(sloping(off))
        assert len(found) == 899 + kept


@pytest.mark.parametrize(("share", "height_m"), [(0.0, 0.3), (0.3, 0.1), (0.55, 0.3)])
def test_soil__is_found_below_crop_over_half_of_the_cells(share: float, height_m: float) -> None:
    off = mixed(-0.01, 0.01)
    crop = np.random.default_rng(8).random(900) < share
    found = without_crop(sloping(off + height_m * crop))
    assert sorted(map(tuple, found.xy_m.tolist())) == sorted(map(tuple, sloping(off).xy_m[~crop].tolist()))


@pytest.mark.parametrize("count", [0, 1, 2, 3])
def test_soil__of_few_cells_is_all_of_them(count: int) -> None:
    cells = sloping(np.zeros(4)).at(np.arange(count))
    assert len(without_crop(cells)) == count


def test_noise__is_that_of_normal_heights() -> None:
    random = np.random.default_rng(9)
    xy = random.uniform(0.0, 8.0, (60_000, 2))
    tilt = 0.01 * np.floor(xy[:, 0] / 0.1)  # of whole pixels
    found = noise_in_pixels(np.column_stack([xy, tilt + 0.012 * random.standard_normal(60_000)]), 0.1)
    assert found.mean() == pytest.approx(0.012, rel=0.02)
    assert len(noise_in_pixels(np.zeros((0, 3)), 0.1)) == 0
    assert len(noise_in_pixels(points(0.0, 0.1), 0.25)) == 0
