"""Surfaces of worked ground against ground whose heights before and after are known."""

from __future__ import annotations

import os
import threading
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from furrowmap.core.coverage.field_surfaces import BESIDE_M, FieldPoints, FieldTile, SoilSums, field_tile
from furrowmap.core.surfaces.grid import Grid
from furrowmap.core.surfaces.passage import LineTrack, Passages
from furrowmap.core.surfaces.spool import SPOOL_TILE, TilePoints
from furrowmap.core.surfaces.statistic import MEDIAN

GRID = Grid(0.05, 0, SPOOL_TILE, (SPOOL_TILE, SPOOL_TILE))
PASSED_S = 100.0
BEFORE_M, AFTER_M = 1.0, 1.03
EASTING, NORTHING = np.meshgrid(*GRID.centres_m())
WORKED = (abs(NORTHING - 6.0) < 1.0).ravel()
BESIDE = (abs(NORTHING - 6.0) < 1.0 + BESIDE_M).ravel() & ~WORKED


def passages() -> Passages:
    """A line 2 m wide that passes all cells about 6 m north within half a second."""
    t = np.linspace(0.0, 1.0, 50)
    middle = np.column_stack([-1.0 + 15.0 * t, np.full(50, 6.0)])
    return Passages([LineTrack(1, PASSED_S + 0.5 * t, middle, np.tile([0.0, 1.0], (50, 1)))])


def looks(t_s: float, height_m: float, where: NDArray[np.bool_], each: int = 3) -> tuple[NDArray[np.generic], ...]:
    """Returns of one moment, `each` in every cell of `where`, with a millimetre of noise."""
    cell = np.repeat(np.flatnonzero(where), each).astype(np.uint16)
    noise = np.random.default_rng(int(t_s)).normal(0.0, 0.001, len(cell))
    return cell, (height_m + noise).astype(np.float32), np.full(len(cell), t_s, np.float32)


def tile(*seen: tuple[NDArray[np.generic], ...]) -> FieldTile:
    cell, height, t_s = (np.concatenate(arrays) for arrays in zip(*seen, strict=True))
    return field_tile(TilePoints(GRID, cell, height, t_s, 0.0, 0.0), passages(), MEDIAN)


@pytest.mark.skipif(not Path("/proc/self/fd").is_dir(), reason="the system does not list the files a process has open")
def test_points__are_given_up_at_the_end_begun_or_not(tmp_path: Path) -> None:
    """The scratch file is closed, and no thread is left that would write to it."""

    def held() -> tuple[int, int]:
        links = [link for link in Path("/proc/self/fd").iterdir() if link.is_symlink()]
        return sum(str(tmp_path) in os.path.realpath(link) for link in links), threading.active_count()

    _, before = held()
    with FieldPoints(tmp_path):
        pass
    with FieldPoints(tmp_path) as points:
        points.begin((0.0, 0.0, 0.0))
        assert held()[0] == 1
    assert held() == (0, before)


EVERYWHERE = np.ones(SPOOL_TILE * SPOOL_TILE, bool)


def test_worked_ground__has_the_height_of_its_latest_soil() -> None:
    found = tile(looks(50.0, BEFORE_M, EVERYWHERE, 9), looks(150.0, AFTER_M, WORKED), looks(150.0, BEFORE_M, ~WORKED))
    wanted = np.where(WORKED, AFTER_M, BEFORE_M).reshape(GRID.shape)
    assert np.allclose(found.after.height_m, wanted, atol=0.004)
    assert np.allclose(found.before.height_m, BEFORE_M, atol=0.004)
    assert np.array_equal(found.after.count.ravel(), np.where(WORKED | BESIDE, 3, 12))
    assert np.array_equal(found.number.ravel(), WORKED.astype(np.int32))


def test_change__is_told_where_both_were_seen_and_beside_it_is_nothing() -> None:
    half = (EASTING < 6.4).ravel()
    found = tile(looks(50.0, BEFORE_M, half), looks(150.0, AFTER_M, WORKED), looks(150.0, BEFORE_M, ~WORKED))
    change = found.change_m.ravel()
    assert np.array_equal(np.isfinite(change), half & (WORKED | BESIDE))
    assert np.allclose(change[half & WORKED], AFTER_M - BEFORE_M, atol=0.006)
    assert np.allclose(change[half & BESIDE], 0.0, atol=0.006)
    sums = SoilSums()
    sums.add_tile(found)
    moved = sums.moved(GRID.cell_area_m2)
    assert moved is not None
    area_m2 = float(WORKED.sum()) * GRID.cell_area_m2
    assert moved.worked.area_m2 == pytest.approx(area_m2)
    assert moved.worked.compared_m2 == pytest.approx(float((half & WORKED).sum()) * GRID.cell_area_m2)
    assert moved.worked.mean_m == pytest.approx(AFTER_M - BEFORE_M, rel=0.01)
    assert moved.passes[1] == moved.worked
    assert moved.beside_m == pytest.approx(0.0, abs=1e-4)


def test_worked_ground__that_was_not_seen_since_has_no_height() -> None:
    found = tile(looks(50.0, BEFORE_M, EVERYWHERE))
    seen = np.isfinite(found.after.height_m).ravel()
    assert np.array_equal(seen, ~WORKED)
    assert not np.isfinite(found.change_m).any()
    assert np.isfinite(found.before.height_m).all()


def test_dust_over_the_worked_soil__is_no_surface() -> None:
    dusty = WORKED & (EASTING.ravel() % 0.4 < 0.2)
    found = tile(
        looks(50.0, BEFORE_M, EVERYWHERE),
        looks(101.0, AFTER_M + 1.2, dusty, 9),
        looks(150.0, AFTER_M, WORKED & (NORTHING.ravel() < 6.5)),
    )
    assert np.nanmax(found.after.height_m.ravel()[WORKED]) < AFTER_M + 0.01


def test_walls_on_land_that_is_not_worked__stay() -> None:
    wall = (abs(NORTHING - 10.0) < 0.1).ravel()
    found = tile(looks(50.0, BEFORE_M, EVERYWHERE & ~wall), looks(50.0, BEFORE_M + 2.0, wall))
    assert np.allclose(found.after.height_m.ravel()[wall], BEFORE_M + 2.0, atol=0.005)


def test_ground_without_work__is_the_same_before_and_after() -> None:
    cell, height, t_s = looks(50.0, BEFORE_M, EVERYWHERE)
    found = field_tile(TilePoints(GRID, cell, height, t_s, 0.0, 0.0), Passages([]), MEDIAN)
    assert found.before is found.after
    sums = SoilSums()
    sums.add_tile(found)
    assert sums.moved(GRID.cell_area_m2) is None
