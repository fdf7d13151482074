"""Moved surfaces, their changes and the ground that ties are made of, on planes in closed form."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import pytest
import rasterio
import shapely

from furrowmap.core.surfaces.grid import Grid
from furrowmap.core.surfaces.mean_change import HIDDEN_SHARE
from furrowmap.exporters.farm.surface_file import OpenSurface, open_surface, surface_file
from furrowmap.exporters.files.provenance import Origin
from furrowmap.exporters.rasters import tied_surfaces
from furrowmap.exporters.rasters.cog import SURFACE_BANDS, with_heights
from furrowmap.exporters.rasters.tied_surfaces import (
    Mover,
    ground_pairs,
    union_shapes,
    write_change,
    write_moved,
)
from tests.exporters.farm.result_folders import JAPAN
from tests.exporters.rasters.written_cogs import write_cog

ORIGIN = Origin("Surface", "field", [], None, {})
NOTHING = shapely.Polygon()
STILL = np.zeros(6)


@pytest.fixture
def files() -> Iterator[ExitStack]:
    with ExitStack() as stack:
        yield stack


def plane(grid: Grid, rise: tuple[float, float] = (0.0, 0.0), height_m: float = 0.0) -> np.ndarray:
    """Heights of cells, on a plane through the corner of the CRS."""
    return (grid.positions_m() @ rise).reshape(grid.shape) + height_m


def surface(
    files: ExitStack, path: Path, grid: Grid, height_m: np.ndarray, *, error_m: float = 0.01, spread_m: float = 0.0
) -> OpenSurface:
    full = np.ones(grid.shape)
    write_cog(path, grid, with_heights(JAPAN), SURFACE_BANDS, [height_m, full, full * spread_m, full * error_m], ORIGIN)
    return files.enter_context(open_surface(surface_file(path)))


def test_moved_surface__is_the_plane_that_was_moved(files: ExitStack, tmp_path: Path) -> None:
    """East, north and up, and a turn by a milliradian about the middle."""
    grid = Grid(0.25, 80, 160, (60, 40))
    one = surface(files, tmp_path / "dsm.tif", grid, plane(grid, (0.05, -0.1), 3.0), error_m=0.0625)
    middle_m = np.array([25.0, 32.0])
    move = np.array([0.3, -0.2, 0.5, 0.0, 0.0, 1e-3])
    write_moved(tmp_path / "moved.tif", Mover(one, move, middle_m), grid, JAPAN, ORIGIN)
    with rasterio.open(tmp_path / "moved.tif") as raster:
        assert raster.descriptions == ("height", "standard error")
        height, error = raster.read()
    east, north = (grid.positions_m() - middle_m).T
    before = np.column_stack([east - 0.3 + 1e-3 * north, north + 0.2 - 1e-3 * east]) + middle_m
    wanted = (before @ (0.05, -0.1)).reshape(grid.shape) + 3.5
    inner = (slice(3, -3), slice(3, -3))
    assert height[inner] == pytest.approx(wanted[inner], abs=4e-4)
    assert np.isfinite(height[inner]).all()
    assert (error == 0.0625).all()


def test_pieces__cover_the_common_ground_but_for_what_was_touched(
    files: ExitStack, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tied_surfaces, "PIECE_CELLS", 50)
    grids = Grid(0.5, 0, 100, (70, 110)), Grid(0.5, 20, 90, (80, 90))
    one, other = (
        surface(files, tmp_path / f"{k}.tif", grid, plane(grid, (0.01, 0.02), float(k))) for k, grid in enumerate(grids)
    )
    touched = shapely.box(12.0, 20.0, 14.1, 40.0)
    pairs = list(ground_pairs(one, other, touched))
    assert [(pair.west_m, pair.north_m, pair.one.shape) for pair in pairs] == [
        (pytest.approx(10.0), pytest.approx(45.0), (50, 50)),
        (pytest.approx(35.0), pytest.approx(45.0), (50, 40)),
        (pytest.approx(10.0), pytest.approx(20.0), (10, 50)),
        (pytest.approx(35.0), pytest.approx(20.0), (10, 40)),
    ]
    for pair in pairs:
        assert pair.cell_m == 0.5
        part = Grid(0.5, round(pair.west_m / 0.5), round(pair.north_m / 0.5), pair.one.shape)
        off = ~np.isfinite(pair.one)
        inside = shapely.contains(touched, shapely.points(part.positions_m())).reshape(part.shape)
        near = shapely.contains(touched.buffer(0.4), shapely.points(part.positions_m())).reshape(part.shape)
        assert (off == ~np.isfinite(pair.other)).all()
        assert (inside <= off).all()
        assert (off <= near).all()
        assert pair.one[~off] == pytest.approx(plane(part, (0.01, 0.02))[~off], abs=2e-4)
        assert pair.other[~off] - pair.one[~off] == pytest.approx(1.0, abs=2e-4)


def test_pieces__need_cells_that_both_dates_saw(
    files: ExitStack, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tied_surfaces, "PIECE_CELLS", 10)
    grid = Grid(0.05, 0, 1000, (4, 30))
    west, east = np.zeros(grid.shape), np.zeros(grid.shape)
    west[:, 20:], east[:, :20] = np.nan, np.nan
    east[3, 14] = 0.0
    one, other = (surface(files, tmp_path / f"{k}.tif", grid, each) for k, each in enumerate((west, east)))
    assert [pair.west_m for pair in ground_pairs(one, other, NOTHING)] == [pytest.approx(0.5)]
    away = surface(files, tmp_path / "away.tif", Grid(0.05, 2000, 1000, (20, 20)), np.zeros((20, 20)))
    assert not list(ground_pairs(one, away, NOTHING))
    ground = {"worked": NOTHING, "before": NOTHING, "touched": NOTHING}
    assert write_change(tmp_path / "c.tif", movers(one, away), JAPAN, ORIGIN, **ground) is None
    assert not (tmp_path / "c.tif").exists()


@pytest.mark.parametrize("pieces", [1, 63, 64, 65, 100, 128, 129, 640])
def test_pieces__are_at_most_64_from_all_of_the_ground(
    pieces: int, files: ExitStack, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also where every other part of it was not seen."""
    monkeypatch.setattr(tied_surfaces, "PIECE_CELLS", 2)
    grid = Grid(0.5, 0, 100, (1, 2 * pieces))
    every = surface(files, tmp_path / "a.tif", grid, np.zeros(grid.shape))
    other = np.tile([0.0, 0.0, np.nan, np.nan], pieces)[None, : 2 * pieces]
    half = surface(files, tmp_path / "b.tif", grid, other)
    for one, there in ((every, pieces), (half, (pieces + 1) // 2)):
        found = sorted(round(pair.west_m) for pair in ground_pairs(one, every, NOTHING))
        assert len(found) == len(set(found)) <= min(there, 64)
        assert len(found) >= min(there, 30)
        assert np.diff([-1, *found, pieces]).max() <= max(2.0, 4.0 * pieces / 64)


def movers(one: OpenSurface, other: OpenSurface) -> tuple[Mover, Mover]:
    return Mover(one, STILL, np.zeros(2)), Mover(other, STILL, np.zeros(2))


def test_change__is_told_for_worked_and_for_untouched_ground(files: ExitStack, tmp_path: Path) -> None:
    """Twelve metres by ten: the west worked for the first time and risen by 40 mm, the middle again, by 10 mm."""
    grid = Grid(0.05, 0, 200, (200, 240))
    east, north = grid.positions_m().T.reshape(2, *grid.shape)
    later = np.where(east < 3.0, 0.040, np.where(east < 5.0, 0.010, 0.002)) + 0.3
    later[(east < 3.0) & (north > 5.0)] = np.nan
    one = surface(files, tmp_path / "a.tif", grid, np.full(grid.shape, 0.3), error_m=0.003, spread_m=0.006)
    other = surface(files, tmp_path / "b.tif", grid, later, error_m=0.004, spread_m=0.008)
    ground = {
        "worked": shapely.box(0.0, 0.0, 5.0, 10.0),
        "before": shapely.box(3.0, 0.0, 20.0, 10.0),
        "touched": shapely.box(-1.0, 0.0, 6.0, 10.0),
    }
    path = tmp_path / "change.tif"
    found = write_change(path, movers(one, other), JAPAN, ORIGIN, **ground)
    assert found is not None
    with rasterio.open(path) as raster:
        assert raster.descriptions == ("change", "standard error")
        change, error = raster.read()
    assert change == pytest.approx(later - 0.3, abs=2.5e-4, nan_ok=True)
    assert (np.isfinite(error) == np.isfinite(later)).all()
    assert error[np.isfinite(error)] == pytest.approx(0.005, abs=1e-4)
    assert (found.moved.area_m2, found.moved.compared_m2) == (pytest.approx(50.0), pytest.approx(35.0))
    assert found.moved.mean_m == pytest.approx(0.6 * 0.040 + 0.4 * 0.010, abs=2e-4)
    fresh, again = 15.0 / 0.0025, 20.0 / 0.0025
    noise = 0.005 * np.hypot(0.6 / np.sqrt(fresh), 0.4 / np.sqrt(again))
    assert found.moved.sigma_m == pytest.approx(np.hypot(noise, HIDDEN_SHARE * 0.010), rel=0.03)
    assert len(found.places_m) == -(-(fresh + again) // 20)
    assert found.places_m[:, 0].max() < 5.0
    assert not ((found.places_m[:, 0] < 3.0) & (found.places_m[:, 1] > 5.0)).any()
    assert len(found.untouched_m) == 6.0 * 10.0 / 0.0025 / 5
    assert found.untouched_m == pytest.approx(0.002, abs=2e-4)


def test_union__of_no_shapes_is_empty() -> None:
    assert union_shapes([]).is_empty
    assert union_shapes([shapely.box(0, 0, 2, 1), shapely.box(1, 0, 3, 1)]).equals(shapely.box(0, 0, 3, 1))
