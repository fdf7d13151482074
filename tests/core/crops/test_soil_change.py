"""Flights aligned by the bare soil that they have in common: offset, tilt, departures, and how well they are known."""

from __future__ import annotations

import numpy as np
import pytest
import shapely

from furrowmap.core.crops.bare_soil import SOIL_CELL_M, SoilCells
from furrowmap.core.crops.growth_between import MIN_COMMON_CELLS, joined_cells, soil_change
from furrowmap.core.values.parcel import Parcel

EAST, NORTH = 651_500.0, 6_133_880.0
PARCELS = tuple(
    Parcel(f"{k}", box, box)
    for k, box in enumerate(
        shapely.box(EAST + x, NORTH + y, EAST + x + 8.0, NORTH + y + 2.5)
        for x in (0.0, 10.0, 20.0)
        for y in (0.0, 4.0, 8.0)
    )
)
MIDDLE = np.array([EAST + 14.0, NORTH + 5.0])


def bare(rng: np.random.Generator) -> np.ndarray:
    """Centres (n, 2) of cells that no parcel covers."""
    first = np.floor(np.array([EAST - 3.0, NORTH - 3.0]) / SOIL_CELL_M)
    x, y = np.meshgrid(first[0] + np.arange(136), first[1] + np.arange(66))
    xy = (np.column_stack([x.ravel(), y.ravel()]) + 0.5) * SOIL_CELL_M
    sown = np.any([shapely.contains_xy(p.gross.buffer(0.12), *xy.T) for p in PARCELS], axis=0)
    return xy[~sown] + rng.uniform(-0.1, 0.1, (int((~sown).sum()), 2))


def flight(rng: np.random.Generator, offset_m: float, tilt: tuple[float, float], share: float = 0.7) -> SoilCells:
    """Cells of a wavy soil as a flight has it: some are missing, each has 5 mm of noise."""
    xy = bare(rng)
    xy = xy[rng.random(len(xy)) < share]
    height = 70.0 + 0.05 * np.sin(0.4 * xy[:, 0]) + offset_m + (xy - MIDDLE) @ np.array(tilt)
    return SoilCells(xy, height + 0.005 * rng.standard_normal(len(xy)), np.full(len(xy), 0.002))


def test_soil_change__finds_offset_and_tilt() -> None:
    rng = np.random.default_rng(4)
    change = soil_change(flight(rng, 0.0, (0.0, 0.0)), flight(rng, 0.137, (4e-4, -3e-4)), PARCELS)
    assert change is not None
    assert change.tilted
    assert change.trend[1:] == pytest.approx([4e-4, -3e-4], abs=4.0 * np.sqrt(np.diag(change.covariance)[1:]).max())
    assert change.trend_at(MIDDLE[None])[0] == pytest.approx(0.137, abs=0.002)
    for parcel in PARCELS:
        middle = np.array([[parcel.net.centroid.x, parcel.net.centroid.y]])
        true = 0.137 + float((middle - MIDDLE)[0] @ [4e-4, -3e-4])
        patch = change.under(parcel)
        assert patch.at(middle)[0] == pytest.approx(true, abs=0.003)
        assert 0.0 < patch.sigma_m < 0.0025
    assert change.plain()["offset_m"] == pytest.approx(change.trend[0], abs=1e-6)


def test_soil_change__has_no_tilt_where_none_shows_and_its_sigma_is_that_of_its_errors() -> None:
    rng = np.random.default_rng(7)
    tilted, ratios = 0, []
    for _ in range(5):
        change = soil_change(flight(rng, 0.0, (0.0, 0.0), 0.15), flight(rng, -0.05, (0.0, 0.0), 0.15), PARCELS)
        assert change is not None
        tilted += change.tilted
        ratios.append((change.trend_at(MIDDLE[None])[0] + 0.05) / np.sqrt(change.covariance[0, 0]))
    assert tilted <= 1
    assert 0.3 < np.sqrt(np.mean(np.square(ratios))) < 1.8


def test_soil_change__leaves_out_what_grew_on_bare_ground() -> None:
    rng = np.random.default_rng(2)
    after = flight(rng, 0.02, (0.0, 0.0))
    weeds = rng.random(len(after)) < 0.2
    after = SoilCells(after.xy_m, after.height_m + np.where(weeds, 0.15, 0.0), after.sigma_m)
    change = soil_change(flight(rng, 0.0, (0.0, 0.0)), after, PARCELS)
    assert change is not None
    assert change.trend_at(MIDDLE[None])[0] == pytest.approx(0.02, abs=0.002)


def test_soil_change__follows_what_departs_from_a_plane() -> None:
    rng = np.random.default_rng(5)
    after = flight(rng, 0.0, (0.0, 0.0))
    wave = 0.02 * np.sin(2.0 * np.pi * (after.xy_m[:, 0] - EAST) / 20.0)
    change = soil_change(
        flight(rng, 0.0, (0.0, 0.0)), SoilCells(after.xy_m, after.height_m + wave, after.sigma_m), PARCELS
    )
    assert change is not None
    for parcel in PARCELS:
        middle = np.array([[parcel.net.centroid.x, parcel.net.centroid.y]])
        true = 0.02 * np.sin(2.0 * np.pi * (middle[0, 0] - EAST) / 20.0)
        assert change.under(parcel).at(middle)[0] == pytest.approx(true, abs=0.005)


def test_soil_change__of_flights_that_share_no_ground_is_unknown() -> None:
    rng = np.random.default_rng(1)
    whole = flight(rng, 0.0, (0.0, 0.0))
    few = whole.at(np.arange(MIN_COMMON_CELLS - 1))
    assert soil_change(whole, few, PARCELS) is None
    assert soil_change(few.at(np.zeros(0, np.intp)), whole, PARCELS) is None


def test_joined_cells__hold_each_cell_once() -> None:
    rng = np.random.default_rng(3)
    one = SoilCells(bare(rng), np.zeros(len(bare(rng))), np.full(len(bare(rng)), 0.004))
    half = SoilCells(one.xy_m[::2], one.height_m[::2] + 0.01, one.sigma_m[::2])
    joined = joined_cells([one, half])
    assert len(joined) == len(one)
    assert sorted(np.unique(joined.height_m.round(6))) == [0.0, 0.005]
    assert joined.sigma_m.min() == pytest.approx(0.004 / np.sqrt(2.0))
