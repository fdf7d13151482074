"""How often each spot of a farm was worked and driven on, and when it was worked last, as a raster."""

from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import shapely
from numpy.typing import NDArray
from pyproj import CRS
from rasterio import Affine
from rasterio.enums import MergeAlg
from rasterio.features import rasterize

from furrowmap.core.coverage.wheel_traffic import wheel_passages
from furrowmap.core.runtime.progress import Progress, silent
from furrowmap.core.surfaces.grid import Grid
from furrowmap.exporters.files.provenance import Origin
from furrowmap.exporters.rasters.cog import Band, cog_output
from furrowmap.exporters.rasters.windows import share_done, windows

ShapeArray = NDArray[np.object_]

EPOCH: Final = np.datetime64("1970-01-01")
WORKED: Final = Band("times worked", "1", 0)
LAST_DAY: Final = Band("last day worked, days since 1970-01-01", "1", 0)
DRIVEN: Final = Band("passages of wheels", "1", 0)


@dataclass(frozen=True)
class Wheels:
    """The wheels of an axle at the origin of the vehicle frame; its track width is between the middles of the tyres."""

    track_width_m: float
    tyre_width_m: float


def write_traffic(
    path: Path,
    passes: ShapeArray,
    day: NDArray[np.datetime64],
    tracks: ShapeArray,
    crs: CRS,
    cell_m: float,
    wheels: Wheels | None,
    origin: Origin,
    progress: Progress = silent,
) -> Grid:
    """Write the raster as a cloud-optimised GeoTIFF of 16-bit numbers; window by window, in bounded memory.

    `passes` are polygons of passes, with their days, and `tracks` a line of the rear axle a session.
    Bands: times worked, last day worked (days since 1970-01-01, 0 for never), and passages of wheels where `wheels` are
    known. A cell counts where its centre was worked or driven on.
    """
    west, south, east, north = shapely.total_bounds(np.concatenate([passes, tracks])).tolist()
    margin = 0.5 * (wheels.track_width_m + wheels.tyre_width_m) if wheels is not None else 0.0
    grid = Grid.of_bounds(cell_m, (west - margin, south - margin, east + margin, north + margin))
    bands = (WORKED, LAST_DAY, *([DRIVEN] if wheels is not None else []))
    order = np.argsort(day, kind="stable")
    passes = passes[order]
    days = (day[order] - EPOCH).astype(np.int64)
    trees = shapely.STRtree(passes), shapely.STRtree(tracks)
    with cog_output(path, grid, crs, bands, origin, counts=True) as put:
        for tile, _ in windows(grid, 0):
            box = shapely.box(*tile.bounds_m)
            rows = np.sort(trees[0].query(box))
            arrays = [*_worked(tile, passes[rows], days[rows])]
            if wheels is not None:
                near = shapely.buffer(box, margin)
                driven = np.zeros(tile.shape, np.uint16)
                for track in tracks[np.sort(trees[1].query(near))]:
                    if paths := _paths_near(track, near):
                        driven += wheel_passages(tile, paths, wheels.track_width_m, wheels.tyre_width_m)
                arrays.append(driven)
            put(tile, arrays)
            progress("counting traffic", share_done(tile, grid))
    return grid


def write_worked(path: Path, passes: ShapeArray, grid: Grid, crs: CRS, origin: Origin) -> int:
    """Write how often each cell was worked, as the first band of :func:`write_traffic`; the greatest number."""
    most = 0
    tree = shapely.STRtree(passes)
    days = np.zeros(len(passes), np.int64)
    with cog_output(path, grid, crs, (WORKED,), origin, counts=True) as put:
        for tile, _ in windows(grid, 0):
            rows = np.sort(tree.query(shapely.box(*tile.bounds_m)))
            times, _ = _worked(tile, passes[rows], days[rows])
            most = max(most, int(times.max()))
            put(tile, [times])
    return most


def _worked(tile: Grid, passes: ShapeArray, day: NDArray[np.int64]) -> list[NDArray[np.uint16]]:
    """Times worked and the last day of it; the passes are in order of time."""
    times = np.zeros(tile.shape, np.uint16)
    last = np.zeros(tile.shape, np.uint16)
    if not len(passes):
        return [times, last]
    west, south, east, north = tile.bounds_m
    cut = shapely.clip_by_rect(passes, west - tile.cell_m, south - tile.cell_m, east + tile.cell_m, north + tile.cell_m)
    known = ~shapely.is_empty(cut)
    shapes = cut[known].tolist()
    days = day[known].tolist()
    if shapes:
        place = {"transform": Affine(*tile.transform)}
        rasterize(((shape, 1) for shape in shapes), out=times, merge_alg=MergeAlg.add, **place)
        rasterize(zip(shapes, days, strict=True), out=last, **place)
    return [times, last]


def _paths_near(track: shapely.MultiLineString, near: shapely.Polygon) -> list[NDArray[np.float64]]:
    """The lines (n, 3) of a track with the distance driven, without the segments far from a tile."""
    west, south, east, north = near.bounds
    found = []
    driven_m = 0.0
    for line in shapely.get_parts(track):
        xy = shapely.get_coordinates(line)
        along = driven_m + np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(xy, axis=0).T))])
        driven_m = float(along[-1])
        low = np.minimum(xy[1:], xy[:-1])
        high = np.maximum(xy[1:], xy[:-1])
        touches = ((high >= (west, south)) & (low <= (east, north))).all(axis=1)
        # One more segment on either side, so that corners look the same from every tile.
        kept = np.convolve(touches, [1, 1, 1])[1:-1] > 0
        edges = np.flatnonzero(np.diff(np.concatenate([[0], kept.astype(np.int8), [0]])))
        path = np.column_stack([xy, along])
        found += [path[a : b + 1] for a, b in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True)]
    return found
