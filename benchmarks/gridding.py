"""Gridding and raster writing: furrowmap beside numpy, scipy and GDAL's own driver, in the same run.

    python benchmarks/gridding.py [--points 20000000] [--rounds 3]

The points are those of a scanner that drives over a field: 100,000 to a turn, each turn about a place of its own, as
they come from a recording. Cells are 5 cm. Of several rounds the fastest counts; rates are millions of points a second
by the wall clock, files megabytes of the array a second. Ratios within one run hold from machine to machine, absolute
figures do not.
"""

from __future__ import annotations

import argparse
import resource
import tempfile
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import rasterio
from numpy.typing import NDArray
from pyproj import CRS
from scipy.stats import binned_statistic_2d

from furrowmap.core.surfaces.grid import Grid, Surface
from furrowmap.core.surfaces.spool import PointSpool, TilePoints
from furrowmap.core.surfaces.statistic import Statistic, cell_surface
from furrowmap.exporters.rasters.cog import SURFACE_BANDS, Origin, cog_output, surface_arrays

FloatArray = NDArray[np.float64]

CELL_M = 0.05
TURN = 100_000
FEWER = 20
"""scipy is given one point in so many."""


def scanned(points: int, seed: int = 0) -> FloatArray:
    """Points (n, 3) of turns along lanes 2 m apart, within 12 m of the scanner."""
    rng = np.random.default_rng(seed)
    turns = -(-points // TURN)
    xyz = np.empty((turns * TURN, 3))
    azimuth = np.linspace(0.0, 2.0 * np.pi, TURN)
    for turn in range(turns):
        part = xyz[turn * TURN : (turn + 1) * TURN]
        lane, along = divmod(turn * 1.0, 40.0)
        distance = rng.choice(np.linspace(2.0, 12.0, 16), TURN)
        part[:, 0] = 20.0 + along + distance * np.cos(azimuth)
        part[:, 1] = 20.0 + 2.0 * lane + distance * np.sin(azimuth)
        part[:, 2] = 270.0 + rng.normal(0.0, 0.01, TURN)
    return xyz[:points]


def gridded(xyz: FloatArray, name: str) -> list[Surface]:
    """The tiles of a surface as `furrowmap surface` makes them: through the scratch file, on two cores."""
    statistic = Statistic.parse(name)

    def surface(tile: TilePoints) -> Surface:
        return cell_surface(tile.grid, tile.cell, tile.height_m, tile.base_m, statistic)

    with PointSpool(CELL_M, 270.0) as spool, ThreadPoolExecutor(2) as pool:
        for part in np.array_split(xyz, max(1, len(xyz) // TURN)):
            spool.add(part)
        return list(pool.map(lambda key: surface(spool.tile(key)), spool.tiles))


def mosaic(tiles: list[Surface], grid: Grid) -> NDArray[np.float32]:
    """The bands (4, rows, columns) of tiles as one array over a grid."""
    columns, rows = (sorted({getattr(tile.grid, side) for tile in tiles}) for side in ("west", "north"))
    size = tiles[0].grid.rows
    cover = Grid(CELL_M, columns[0], rows[-1], (rows[-1] - rows[0] + size, columns[-1] - columns[0] + size))
    bands = np.full((4, *cover.shape), np.nan, np.float32)
    for tile in tiles:
        bands[:, *tile.grid.window_in(cover)] = np.stack([np.asarray(band) for band in surface_arrays(tile)])
    return bands[:, *grid.window_in(cover)]


def bincount(xyz: FloatArray, grid: Grid) -> NDArray[np.float64]:
    """Count and mean by numpy."""
    column = ((xyz[:, 0] - grid.bounds_m[0]) / CELL_M).astype(np.int64)
    row = ((grid.bounds_m[3] - xyz[:, 1]) / CELL_M).astype(np.int64)
    cell = row * grid.columns + column
    count = np.bincount(cell, minlength=grid.rows * grid.columns)
    return np.bincount(cell, xyz[:, 2], grid.rows * grid.columns) / np.maximum(count, 1)


def binned(xyz: FloatArray, grid: Grid, statistic: str) -> None:
    """One statistic by scipy."""
    west, south, east, north = grid.bounds_m
    binned_statistic_2d(
        xyz[:, 0], xyz[:, 1], xyz[:, 2], statistic, bins=[grid.columns, grid.rows], range=[[west, east], [south, north]]
    )


def gdal(path: Path, arrays: NDArray[np.float32], grid: Grid) -> None:
    """The same array by GDAL's COG driver with its own choices."""
    profile = {"height": grid.rows, "width": grid.columns, "count": len(arrays), "dtype": "float32", "nodata": np.nan}
    where = {"crs": "EPSG:6677", "transform": rasterio.Affine(*grid.transform)}
    with rasterio.open(path, "w", driver="COG", **profile, **where) as file:
        file.write(arrays)


def fastest(work: Callable[[], object], rounds: int) -> tuple[float, float]:
    """Seconds by the wall clock, and of all cores together."""
    times = []
    for _ in range(rounds):
        begin, busy = time.perf_counter(), time.process_time()
        work()
        times.append((time.perf_counter() - begin, time.process_time() - busy))
    wall, cores = zip(*times, strict=True)
    return min(wall), min(cores)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--points", type=int, default=20_000_000)
    parser.add_argument("--rounds", type=int, default=3)
    args = parser.parse_args()
    xyz = scanned(args.points)
    few = xyz[::FEWER]
    low, high = xyz.min(axis=0), xyz.max(axis=0)
    grid = Grid.of_bounds(CELL_M, (low[0], low[1], high[0], high[1]))
    n = len(xyz) / 1e6
    print(f"{n:.1f} M points, {grid.columns} x {grid.rows} cells")

    def told(what: str, millions: float, work: Callable[[], object]) -> None:
        wall_s, cores_s = fastest(work, args.rounds)
        print(f"{what:<52} {millions / wall_s:8.1f} M points/s, {millions / cores_s:8.1f} a second of one core")

    told("furrowmap: count, mean, spread, min, max", n, lambda: gridded(xyz, "mean"))
    told("furrowmap: median, spread, count", n, lambda: gridded(xyz, "median"))
    told("furrowmap: trimmed mean, spread, count", n, lambda: gridded(xyz, "trimmed"))
    told("numpy bincount: count and mean", n, lambda: bincount(xyz, grid))
    told("scipy binned_statistic_2d: mean", len(few) / 1e6, lambda: binned(few, grid, "mean"))
    arrays = mosaic(gridded(xyz, "mean"), grid)
    with tempfile.TemporaryDirectory() as folder:
        ours, theirs = Path(folder, "ours.tif"), Path(folder, "gdal.tif")
        origin = Origin("Surface")

        def write_ours() -> None:
            with cog_output(ours, grid, CRS("EPSG:6677"), SURFACE_BANDS, origin) as write:
                write(grid, list(arrays))

        own_s = fastest(write_ours, args.rounds)
        gdal_s = fastest(lambda: gdal(theirs, arrays, grid), args.rounds)
        megabytes = arrays.nbytes / 1e6
        for name, seconds, path in (("furrowmap", own_s, ours), ("GDAL's COG driver", gdal_s, theirs)):
            rates = [megabytes / each for each in seconds]
            size = path.stat().st_size / 1e6
            print(f"{name + ': COG':<52} {rates[0]:8.1f} MB/s, {rates[1]:8.1f} a second of one core, {size:.1f} MB")
    print(f"most memory: {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6:.2f} GB")


if __name__ == "__main__":
    main()
