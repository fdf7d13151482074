"""Stands that are no plots: canopy height model, height percentiles, gaps and profiles of clouds."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np
import shapely
from numpy.typing import NDArray

from furrowmap.core.crops.parcel_areas import elsewhere_error, read_parcels
from furrowmap.core.crops.stand import Stand, stand_of
from furrowmap.core.geodesy.projection import scale_at
from furrowmap.core.pointclouds.joined_clouds import Clouds, near_box, no_points_error
from furrowmap.core.pointclouds.spool_clouds import cell_for, spool_clouds
from furrowmap.core.pointclouds.spooled_clouds import SpooledClouds
from furrowmap.core.pointclouds.surfaces import CloudTile, GroundMethod, cloud_tiles, finer_cells
from furrowmap.core.readers.areas.rings import ring_at, rings_of
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import Notice
from furrowmap.core.runtime.progress import Progress, silent
from furrowmap.core.runtime.record_spool import RecordSpool, square_keys, square_of
from furrowmap.core.surfaces.grid import Grid
from furrowmap.core.surfaces.spool import PointSpool
from furrowmap.core.surfaces.statistic import Statistic
from furrowmap.core.values.crs import name_of
from furrowmap.core.values.parcel import Parcel
from furrowmap.exporters.files.file_records import FileRecord, file_records, joint_record
from furrowmap.exporters.files.provenance import Origin
from furrowmap.exporters.files.result_folder import (
    CANOPY,
    CANOPY_HEIGHT,
    CANOPY_PRODUCTS,
    CANOPY_PROFILES,
    CANOPY_REPORT,
    CANOPY_TABLE,
)
from furrowmap.exporters.files.staging import recover, refuse_products, staged_folder
from furrowmap.exporters.rasters.cog import Band, cog_output
from furrowmap.exporters.vectors.crop_layers import canopy_layer, write_parcel_table, write_profiles
from furrowmap.exporters.vectors.geopackage import write_styled_layers
from furrowmap.exporters.vectors.qgis_styles import write_raster_style
from furrowmap.settings import CanopySettings
from furrowmap.workflows.clouds.inputs import input_records, open_inputs, write_account
from furrowmap.workflows.clouds.surface import ground_method, no_warning

MAX_PIXEL_M: Final = 1.0
GROUND_REACH_M: Final = 20.0
"""Around polygons, for the ground below their edges."""
HIGHEST: Final = Statistic.parse("max")
_HEIGHT: Final = np.dtype([("height_m", "<f4"), ("column", "<i4"), ("row", "<i4")])


def canopy(
    clouds: Sequence[str | Path],
    out: str | Path,
    settings: CanopySettings,
    *,
    overwrite: bool = False,
    progress: Progress = silent,
    warn: Callable[[Notice], None] = no_warning,
) -> dict[str, Any]:
    """Describe a stand that is no plot: canopy height model, and heights, gaps and profile by cell or polygon.

    Args:
        clouds: LAS, LAZ or COPC files, which are used together.
        out: folder for the products, made if it does not exist; all of them are written or none.
        warn: is called once with each warning, as early as it is known.

    Returns:
        The content of `canopy.json`: inputs, CRS, parameters, figures of the whole, warnings, products.

    Raises:
        InputError: if a file cannot be read, or no point is left.
        RefusedError: if the folder holds such products.
    """
    folder = Path(out)
    recover(folder)
    refuse_products(folder, CANOPY_PRODUCTS, overwrite=overwrite)
    opened = open_inputs(clouds, settings)
    file = Path(settings.polygons) if settings.polygons is not None else None
    areas: tuple[Parcel, ...] = ()
    if file is not None:
        areas, decided = read_parcels(file, opened.crs)
        opened = replace(opened, notices=(*opened.notices, *decided))
    box = settings.box
    far = tuple[Notice, ...]()
    if box is None and areas:
        west, south, east, north = shapely.total_bounds([area.gross for area in areas]).tolist()
        box = (west - GROUND_REACH_M, south - GROUND_REACH_M, east + GROUND_REACH_M, north + GROUND_REACH_M)
    elif box is None:
        box, far = near_box(opened, progress)
    plots = file_records([file], file.parent) if file is not None else []
    records = [*input_records(opened, progress), *plots]
    with staged_folder(folder) as staging:
        pixel_m = settings.pixel_m or min(cell_for(opened, box, settings.classes, progress), MAX_PIXEL_M)
        factor = finer_cells(pixel_m)
        fine_m = pixel_m / factor
        with PointSpool(fine_m, folder=staging) as points, PointSpool(fine_m, folder=staging) as ground:
            spooled = spool_clouds(opened, points, ground, box, settings.classes, progress=progress)
            if points.grid is None:
                raise no_points_error(opened, box)
            method = ground_method(settings.ground, spooled)
            grid = points.grid.coarser(factor)
            stands = _write_products(staging, opened, spooled, grid, areas, settings, method, records, progress)
        if file is not None and not any(stand.returns for stand in stands):
            raise elsewhere_error(file, opened.points, box or (0.0, 0.0, 0.0, 0.0))
        for notice in (notices := [*opened.notices, *far, *spooled.notices]):
            warn(notice)
        content = {
            "polygons_file": joint_record(file, plots) if file is not None else None,
            "crs": name_of(opened.crs),
            "parameters": {
                "ground": method,
                "cell_m": settings.cell_m,
                "ground_m": settings.ground_m,
                "layer_m": settings.layer_m,
                "pixel_m": pixel_m,
            },
            "figures": _figures(stands),
        }
        return write_account(staging, CANOPY_REPORT, opened, records, content, notices)


def _write_products(
    folder: Path,
    clouds: Clouds,
    spooled: SpooledClouds,
    grid: Grid,
    areas: Sequence[Parcel],
    settings: CanopySettings,
    method: GroundMethod,
    records: Sequence[FileRecord],
    progress: Progress,
) -> list[Stand]:
    """Write the canopy height model, the layer and the tables; the stands."""
    origin = Origin("canopy height", inputs=[(record.name, record.sha256) for record in records], span_s=spooled.span_s)
    with (
        RecordSpool(_HEIGHT, folder.parent) as heights,
        cog_output(folder / CANOPY_HEIGHT, grid, clouds.crs, [Band("canopy height")], origin) as put,
    ):
        area_at = _area_index(areas, settings.cell_m)
        for tile in cloud_tiles(spooled, method, grid.cell_m, HIGHEST, progress=progress):
            if tile.above_m is not None:
                put(tile.grid, [np.maximum(tile.above_m, 0.0)])
                _collect(heights, tile, area_at)
        stands, shapes = _stands(heights, clouds, areas, settings, grid.cell_m)
    write_raster_style(folder / CANOPY_HEIGHT, "height_above_ground.qml")
    layer = canopy_layer(stands, shapes, areas)
    write_styled_layers(folder / CANOPY, [layer], clouds.crs, origin)
    write_parcel_table(folder / CANOPY_TABLE, layer)
    write_profiles(folder / CANOPY_PROFILES, stands, settings.layer_m)
    return stands


def _stands(
    heights: RecordSpool, clouds: Clouds, areas: Sequence[Parcel], settings: CanopySettings, pixel_m: float
) -> tuple[list[Stand], list[shapely.Polygon]]:
    """The stands and their shapes: polygons in the order of the file, or cells with returns, north first."""
    cell_m = settings.cell_m
    if cell_m is None:
        named = [(k, area.id, area.gross) for k, area in enumerate(areas)]
    else:
        named = []
        for key, column, row in sorted(((key, *square_of(key)) for key in heights.counts), key=lambda s: (-s[2], s[1])):
            west = column * cell_m
            south = row * cell_m
            # The name of a cell is its southwestern corner, and the same in every cloud.
            square = shapely.box(west, south, west + cell_m, south + cell_m)
            named.append((key, f"{west:.10g}_{south:.10g}", square))
    stands = []
    place = named[0][2].centroid if named else shapely.Point()
    pixel_m2 = (pixel_m / scale_at(clouds.crs, place.x, place.y)) ** 2 if named else 0.0
    for key, name, _ in named:
        own = heights.read([key])
        pixel = (own["column"].astype(np.int64) << 32) + own["row"]
        above = own["height_m"].astype(np.float64)
        stands.append(stand_of(name, above, pixel, pixel_m2, settings.ground_m, settings.layer_m))
    return stands, [shape for _, _, shape in named]


def _area_index(areas: Sequence[Parcel], cell_m: float | None) -> Callable[[FloatArray, FloatArray], NDArray[np.int64]]:
    """The key (n,) of the polygon or cell of each easting and northing (n,); -1 for none."""
    if cell_m is not None:
        return lambda east_m, north_m: square_keys(np.floor(east_m / cell_m), np.floor(north_m / cell_m))
    shapes = [area.gross for area in areas]
    west, south, _, _ = shapely.total_bounds(shapes).tolist()
    rings = rings_of(shapes, (west, south))
    return lambda east_m, north_m: ring_at(rings, east_m - west, north_m - south)


def _collect(
    heights: RecordSpool,
    tile: CloudTile,
    area_at: Callable[[FloatArray, FloatArray], NDArray[np.int64]],
) -> None:
    """Add the heights above the ground of a tile's points under the key of their area, that of their pixel's middle."""
    grid = tile.grid
    assert tile.above_m is not None
    own = tile.points
    ground_m = (tile.dsm.height_m - tile.above_m).ravel()
    above = own.height_m + own.base_m - ground_m[own.cell]
    row, column = np.divmod(own.cell.astype(np.int64), grid.columns)
    east = grid.west + column
    north = grid.north - 1 - row
    key = area_at((east + 0.5) * grid.cell_m, (north + 0.5) * grid.cell_m)
    kept = np.isfinite(above) & (key >= 0)
    records = np.empty(int(kept.sum()), _HEIGHT)
    records["height_m"] = above[kept]
    records["column"] = east[kept]
    records["row"] = north[kept]
    heights.add(records, key[kept])


def _figures(stands: Sequence[Stand]) -> dict[str, Any]:
    """Figures of all areas together."""
    seen = [stand for stand in stands if stand.returns]
    returns = sum(stand.returns for stand in seen)
    area = sum(stand.area_m2 for stand in seen)
    gaps = sum(stand.gap_fraction * stand.returns for stand in seen)
    tops = sum(stand.top_height_m * stand.area_m2 for stand in seen)
    return {
        "areas": len(stands),
        "area_m2": round(area, 3),
        "returns": returns,
        "gap_fraction": gaps / returns if returns else None,
        "top_height_m": tops / area if area else None,
        "max_height_m": max((stand.max_height_m for stand in seen if stand.max_height_m > 0.0), default=None),
    }
