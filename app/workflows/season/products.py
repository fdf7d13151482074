"""What a season has beside its parts: a virtual raster for each mosaic of a date, and the catalogue."""

from __future__ import annotations

import datetime as dt
from collections.abc import Iterator, Mapping, Sequence
from importlib.metadata import version
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np

from furrowmap.core.surfaces.grid import MOST_CELLS, Grid
from furrowmap.exporters.exchange.season_catalogue import (
    RasterAsset,
    SeasonContent,
    Table,
    TableItem,
    TileItem,
    write_season_catalogue,
)
from furrowmap.exporters.farm.virtual_raster import virtual_raster
from furrowmap.exporters.files.provenance import Origin
from furrowmap.workflows.season.parts import COVERAGE, TITLES, Planned, SeasonPlan

Parts = Mapping[str, Planned]
Told = Mapping[str, Any]


def put_virtual_mosaics(plan: SeasonPlan, parts: Parts, told: Told) -> None:
    """Write a virtual raster over the tiles of each mosaic of a date, such as `mosaics/2026-05-01/dsm.vrt`.

    None is written where it would have more cells than a raster may have, as fields far from each other do.
    """
    tiles = [(part.place, part.kind, part, told[name]["files"]) for name, part in parts.items() if part.grid]
    tiles = [tile for tile in tiles if tile[3]]
    for (place, kind), group in groupby(sorted(tiles, key=lambda tile: tile[:2]), key=lambda tile: tile[:2]):
        members = [(part, plan.staging / place / files[0][0]) for _, _, part, files in group]
        grids = [part.grid for part, _ in members if part.grid is not None]
        west, north = min(grid.west for grid in grids), max(grid.north for grid in grids)
        rows = north - min(grid.north - grid.rows for grid in grids)
        columns = max(grid.west + grid.columns for grid in grids) - west
        if rows * columns > MOST_CELLS:
            continue
        whole = Grid(grids[0].cell_m, west, north, (rows, columns))
        nodata = None if kind == COVERAGE else float("nan")
        sources = [(path, part.grid, nodata) for part, path in members if part.grid is not None]
        folder = plan.staging / place
        folder.mkdir(parents=True, exist_ok=True)
        origin = Origin(f"{TITLES[kind]}, {members[0][0].date}")
        text = virtual_raster(folder, whole, plan.crs, plan.bands[kind], sources, origin)
        (folder / f"{kind}.vrt").write_text(text, encoding="utf-8")


def put_catalogue(plan: SeasonPlan, parts: Parts, told: Told, target: Path) -> None:
    """Write the catalogue of a season into its staging folder."""
    content = SeasonContent(
        crs=plan.crs,
        software=version("furrowmap"),
        sessions=[(session.folder, session.report, session.date) for session in plan.sessions],
        tiles=list(_tile_items(plan, parts, told)),
        tables={
            kind: Table(title, columns, items)
            for kind, title in (("points", "Points of all sessions"), ("trajectories", "Poses of all sessions"))
            if (items := list(_table_items(kind, parts, told))) and (columns := _columns(kind))
        },
    )
    write_season_catalogue(plan.staging, content, target)


def _columns(kind: str) -> Sequence[Mapping[str, str]]:
    from furrowmap.exporters.exchange.partitions import POINT_COLUMNS, POSE_COLUMNS, table_columns

    return table_columns(POINT_COLUMNS if kind == "points" else POSE_COLUMNS)


def _tile_items(plan: SeasonPlan, parts: Parts, told: Told) -> Iterator[TileItem]:
    found: dict[tuple[dt.date, tuple[int, int]], list[tuple[Planned, Any]]] = {}
    for name, part in parts.items():
        if part.tile is not None and told[name]["files"]:
            found.setdefault((part.date, part.tile), []).append((part, told[name]))
    for (date, (column, row)), members in sorted(found.items(), key=lambda item: item[0]):
        rasters = {part.kind: _raster(plan, part, said) for part, said in members}
        grid = members[0][0].grid
        assert grid is not None
        yield TileItem(f"{date}_x{column}_y{row}", date, _span(members), grid, rasters)


def _raster(plan: SeasonPlan, part: Planned, said: Any) -> RasterAsset:
    bands = []
    for band, (least, most, cells) in zip(plan.bands[part.kind], said["bands"], strict=True):
        kind = {"data_type": "uint16"} if part.kind == COVERAGE else {"data_type": "float32", "nodata": "nan"}
        assert part.grid is not None
        share = 100.0 * cells / (part.grid.rows * part.grid.columns)
        known = {"minimum": least, "maximum": most} if cells else {}
        statistics = {"statistics": {**known, "valid_percent": round(share, 3)}}
        bands.append({"name": band.description, "unit": band.unit, **kind, **statistics})
    return RasterAsset(f"{part.place}/{said['files'][0][0]}", TITLES[part.kind], bands)


def _table_items(kind: str, parts: Parts, told: Told) -> Iterator[TableItem]:
    own = [(part, told[name]) for name, part in parts.items() if part.kind == kind and told[name]["files"]]
    for date, group in groupby(sorted(own, key=lambda one: one[0].date), key=lambda one: one[0].date):
        members = list(group)
        bounds = np.array([said["bounds_m"] for _, said in members])
        west, south = bounds[:, :2].min(axis=0).tolist()
        east, north = bounds[:, 2:].max(axis=0).tolist()
        files = [(f"{part.place}/{file}", int(rows)) for part, said in members for file, rows in said["files"]]
        yield TableItem(f"{kind}_{date}", date, _span(members), (west, south, east, north), files)


def _span(members: Sequence[tuple[Planned, Any]]) -> tuple[dt.datetime, dt.datetime]:
    return min(part.span[0] for part, _ in members), max(part.span[1] for part, _ in members)
