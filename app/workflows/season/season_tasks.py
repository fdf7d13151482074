"""The parts of a season, as workers make them: a tile of a mosaic, or the tables of a session."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import shapely
from numpy.typing import NDArray
from pyproj import CRS

from furrowmap.core.geodesy.crs_change import crs_change
from furrowmap.core.readers.las.cloud import open_cloud
from furrowmap.core.runtime.errors import FurrowmapError
from furrowmap.core.runtime.write_errors import as_furrowmap_error
from furrowmap.core.surfaces.grid import Grid
from furrowmap.exporters.exchange.vectors import changed_crs
from furrowmap.exporters.farm.surface_file import same_map, surface_file
from furrowmap.exporters.farm.surface_mosaic import write_mosaic_part
from furrowmap.exporters.farm.traffic import write_worked
from furrowmap.exporters.files.provenance import Origin
from furrowmap.exporters.files.result_folder import FIELD, TRAJECTORY, open_result, reading_result
from furrowmap.workflows.season.season_sources import PASSES

TABLE_BATCH_POINTS: Final = 500_000


@dataclass(frozen=True)
class MosaicTile:
    """A tile of a mosaic: CRS, bands by description (none for coverage), and sources in order of sessions."""

    out: Path
    grid: Grid
    crs: CRS
    bands: tuple[str, ...]
    sources: tuple[Path, ...]
    origin: Origin


@dataclass(frozen=True)
class SessionTables:
    """Points or trajectory of a session to be written.

    Attributes:
        out: folder of the date.
        source: its cloud, or its result for the trajectory.
        crs: of the season, without heights.
        own_crs: of the session, likewise.
        spacing_m: of the points that suffices; 0 for all.
    """

    out: Path
    name: str
    source: Path
    crs: CRS
    own_crs: CRS
    spacing_m: float
    most_rows: int
    origin: Origin


Part = MosaicTile | SessionTables
PartAccount = dict[str, Any]
"""Account of a part: `files` with their rows, and `bounds_m`; of a tile `bands`: least, greatest, known cells."""


def write_part(part: Part) -> PartAccount | FurrowmapError:
    """Write a part; returns its account, or the error that ended it."""
    try:
        if isinstance(part, SessionTables):
            return _write_tables(part)
        return _write_tile(part) if part.bands else _write_coverage(part)
    except Exception as error:  # noqa: BLE001 whatever ends a part is raised where the season is made
        return as_furrowmap_error(error)


def _write_tile(tile: MosaicTile) -> PartAccount:
    tile.out.parent.mkdir(parents=True, exist_ok=True)
    surfaces = [surface_file(path) for path in tile.sources]
    found = write_mosaic_part(surfaces, tile.out, tile.grid, tile.crs, tile.bands, tile.origin)
    if found is None:
        return {"files": []}
    return {"files": [[tile.out.name, 0]], "bands": [[*row] for row in found.tolist()]}


def _write_coverage(tile: MosaicTile) -> PartAccount:
    shapes = [_passes(folder, tile.crs) for folder in tile.sources]
    passes = np.concatenate(shapes) if shapes else np.empty(0, object)
    passes = passes[shapely.intersects(passes, shapely.box(*tile.grid.bounds_m))]
    if not len(passes):
        return {"files": []}
    tile.out.parent.mkdir(parents=True, exist_ok=True)
    most = write_worked(tile.out, passes, tile.grid, tile.crs, tile.origin)
    return {"files": [[tile.out.name, 0]], "bands": [[0, most, tile.grid.rows * tile.grid.columns]]}


def _passes(folder: Path, crs: CRS) -> NDArray[np.object_]:
    layer = open_result(folder).layer(PASSES)
    if not same_map(CRS(layer.crs), crs):
        layer = changed_crs({PASSES: layer}, crs)[0][PASSES]
    return layer.shapes[~shapely.is_missing(layer.shapes)]


def _write_tables(tables: SessionTables) -> PartAccount:
    from furrowmap.exporters.exchange.partitions import POINT_SCHEMA, POSE_SCHEMA, Partition

    is_cloud = tables.source.is_file()
    schema = POINT_SCHEMA if is_cloud else POSE_SCHEMA
    with Partition(tables.out, tables.name, schema, tables.crs, tables.origin, tables.most_rows) as partition:
        if is_cloud:
            resolution = tables.spacing_m or None
            for batch in open_cloud(tables.source).batches(resolution=resolution, batch_points=TABLE_BATCH_POINTS):
                points = batch.where(~batch.withheld)
                if not len(points):
                    continue
                colours = points.rgb.T if points.rgb is not None else (None, None, None)
                columns = {
                    "session": np.full(len(points), tables.name, object),
                    "time": points.t_s,
                    **dict(zip(("red", "green", "blue"), colours, strict=True)),
                }
                names = ("intensity", "return_number", "returns", "classification", "point_source_id")
                columns |= {name: getattr(points, name) for name in names}
                partition.write(_to_season_crs(points.xyz_m, tables), columns)
        else:
            layer = open_result(tables.source).layer(TRAJECTORY)
            with reading_result(tables.source / FIELD):
                layer = layer.where(np.argsort(layer.columns["t_s"], kind="stable"))
                columns = layer.columns | {
                    "time": layer.columns["t_s"],
                    "session": np.full(len(layer), tables.name, object),
                }
                if len(layer):
                    partition.write(_to_season_crs(layer.coordinates, tables), columns)
    return {"files": [list(one) for one in partition.files], "bounds_m": partition.bounds_m.tolist()}


def _to_season_crs(xyz_m: NDArray[np.float64], tables: SessionTables) -> NDArray[np.float64]:
    """Coordinates (n, 3) in the CRS of the season; heights are unchanged."""
    if same_map(tables.own_crs, tables.crs):
        return xyz_m
    west, south = xyz_m[:, :2].min(axis=0).tolist()
    east, north = xyz_m[:, :2].max(axis=0).tolist()
    change = crs_change(tables.own_crs, tables.crs, (west, south, east, north))
    return np.column_stack([change.points(xyz_m[:, :2]), xyz_m[:, 2:]])
