"""STAC catalogue of a season: sessions, tiles of the mosaics, points and trajectories.

STAC 1.1 with the extensions projection 2.0, raster 2.0, table 1.2, and those of :mod:`.stac`. All links are relative,
so that a server of plain files can serve the folder as it is.
"""

from __future__ import annotations

import datetime as dt
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from pyproj import CRS

from furrowmap.core.runtime.json_text import json_text
from furrowmap.core.surfaces.grid import Grid
from furrowmap.exporters.exchange.stac import CATALOGUE, COG, COLLECTION, LICENCE, PROCESSING, footprint, link, run_item

if TYPE_CHECKING:
    import pystac

Box = tuple[float, float, float, float]
Span = tuple[dt.datetime, dt.datetime]

STAC_FOLDER: Final = "stac"
PARQUET: Final = "application/vnd.apache.parquet"
_RASTER: Final = "https://stac-extensions.github.io/raster/v2.0.0/schema.json"
_TABLE: Final = "https://stac-extensions.github.io/table/v1.2.0/schema.json"
_GEOJSON: Final = "application/geo+json"
_UP: Final = "../.."
"""From a collection's folder to the season's."""


@dataclass(frozen=True)
class RasterAsset:
    """A raster of an item.

    Attributes:
        path: relative to the season's folder.
        title: to read.
        bands: as STAC has them: name, unit, data type, statistics.
    """

    path: str
    title: str
    bands: Sequence[Mapping[str, Any]]


@dataclass(frozen=True)
class TileItem:
    """A tile of the mosaics of a date.

    Attributes:
        date: it belongs to.
        span: of its sessions.
        grid: of its rasters.
        rasters: by product.
    """

    name: str
    date: dt.date
    span: Span
    grid: Grid
    rasters: Mapping[str, RasterAsset]


@dataclass(frozen=True)
class TableItem:
    """The files of a table of a date.

    Attributes:
        date: it belongs to.
        span: of its sessions.
        bounds_m: of all its rows.
        files: path relative to the season's folder, and number of rows.
    """

    name: str
    date: dt.date
    span: Span
    bounds_m: Box
    files: Sequence[tuple[str, int]]


@dataclass(frozen=True)
class Table:
    """A table of a season.

    Attributes:
        title: to read.
        columns: name and type of each.
        items: an item for each date.
    """

    title: str
    columns: Sequence[Mapping[str, str]]
    items: Sequence[TableItem]


@dataclass(frozen=True)
class SeasonContent:
    """What a catalogue lists.

    Attributes:
        crs: of mosaics and tables, without heights.
        software: version of furrowmap.
        sessions: folder and report of each, with its date.
        tiles: of the mosaics.
    """

    crs: CRS
    software: str
    sessions: Sequence[tuple[Path, Mapping[str, Any], dt.date]] = ()
    tiles: Sequence[TileItem] = ()
    tables: Mapping[str, Table] = field(default_factory=dict)


def write_season_catalogue(folder: Path, content: SeasonContent, target: Path) -> None:
    """Write `catalog.json`, and below `stac/` a collection each of sessions, mosaics and tables, with their items.

    Args:
        content: what to list.
        target: final folder of the season, to which links to results are relative.

    Raises:
        OSError: if a file cannot be written.
    """
    import pystac

    name = target.resolve().name or "season"
    found: dict[str, tuple[str, list[pystac.Item], dict[str, Any]]] = {}
    if content.sessions:
        sessions = [_session(*session, target) for session in content.sessions]
        found["sessions"] = "Sessions", sessions, {}
    if content.tiles:
        found["mosaics"] = "Mosaics of each date, in tiles of one grid", [_tile(t, content) for t in content.tiles], {}
    for key, table in content.tables.items():
        items = [_table(item, table.columns, content) for item in table.items]
        more = {"table:columns": list(table.columns), "table:primary_geometry": "geometry"}
        found[key] = table.title, items, more
    for key, (title, items, more) in found.items():
        _write_collection(folder / STAC_FOLDER / key, _collection(f"{name}-{key}", title, items, more), items)
    catalogue = pystac.Catalog(name, "Products of a season, made by furrowmap.", name)
    catalogue.set_root(None)
    catalogue.add_link(pystac.Link("root", f"./{CATALOGUE}", "application/json"))
    for key, (title, _, _) in found.items():
        place = f"./{STAC_FOLDER}/{key}/{COLLECTION}"
        catalogue.add_link(pystac.Link("child", place, "application/json", title))
    _write(folder / CATALOGUE, catalogue)


def _collection(name: str, title: str, items: Sequence[pystac.Item], more: Mapping[str, Any]) -> pystac.Collection:
    """A collection over items."""
    import pystac

    extensions = [_TABLE] if "table:columns" in more else []
    extent = pystac.Extent.from_items(items)
    description = f"{title}, made by furrowmap."
    return pystac.Collection(
        name, description, extent, title, license=LICENCE, stac_extensions=extensions, extra_fields=dict(more)
    )


def _write_collection(folder: Path, collection: pystac.Collection, items: Sequence[pystac.Item]) -> None:
    import pystac

    folder.mkdir(parents=True, exist_ok=True)
    root = f"{_UP}/{CATALOGUE}"
    collection.set_root(None)
    for rel in ("root", "parent"):
        collection.add_link(pystac.Link(rel, root, "application/json"))
    for item in items:
        collection.add_link(pystac.Link("item", f"./{item.id}.json", _GEOJSON))
        item.add_link(pystac.Link("root", root, "application/json"))
        for rel in ("collection", "parent"):
            item.add_link(pystac.Link(rel, f"./{COLLECTION}", "application/json"))
        item.collection_id = collection.id
        _write(folder / f"{item.id}.json", item)
    _write(folder / COLLECTION, collection)


def _write(path: Path, what: pystac.Catalog | pystac.Item) -> None:
    path.write_text(json_text(what.to_dict(include_self_link=False, transform_hrefs=False)), encoding="utf-8")


def _session(folder: Path, report: Mapping[str, Any], date: dt.date, target: Path) -> pystac.Item:
    item = run_item(dict(report))
    for asset in item.assets.values():
        asset.href = link(folder / asset.href, target / STAC_FOLDER / "sessions")
    item.properties["furrowmap:date"] = date.isoformat()
    return item


def _tile(tile: TileItem, content: SeasonContent) -> pystac.Item:
    import pystac

    bounds = tile.grid.bounds_m
    item = _item(tile.name, tile.date, tile.span, bounds, content)
    item.stac_extensions.append(_RASTER)
    item.properties |= {"proj:shape": list(tile.grid.shape), "proj:transform": [*tile.grid.transform, 0.0, 0.0, 1.0]}
    for product, raster in tile.rasters.items():
        fields = {"bands": [dict(band) for band in raster.bands], "raster:spatial_resolution": tile.grid.cell_m}
        asset = pystac.Asset(f"{_UP}/{raster.path}", raster.title, None, COG, ["data"], fields)
        item.add_asset(product, asset)
    return item


def _table(table: TableItem, columns: Sequence[Mapping[str, str]], content: SeasonContent) -> pystac.Item:
    import pystac

    item = _item(table.name, table.date, table.span, table.bounds_m, content)
    item.stac_extensions.append(_TABLE)
    item.properties |= {
        "table:columns": list(columns),
        "table:row_count": sum(rows for _, rows in table.files),
        "table:primary_geometry": "geometry",
    }
    for path, rows in table.files:
        asset = pystac.Asset(f"{_UP}/{path}", Path(path).name, None, PARQUET, ["data"], {"table:row_count": rows})
        item.add_asset(Path(path).stem, asset)
    return item


def _item(name: str, date: dt.date, span: Span, bounds_m: Box, content: SeasonContent) -> pystac.Item:
    import pystac
    from pystac.extensions.projection import ProjectionExtension

    ring = footprint(content.crs, bounds_m)
    lon, lat = zip(*ring, strict=True)
    item = pystac.Item(
        id=name,
        geometry={"type": "Polygon", "coordinates": [ring]},
        bbox=[min(lon), min(lat), max(lon), max(lat)],
        datetime=None,
        start_datetime=span[0],
        end_datetime=span[1],
        properties={"processing:software": {"furrowmap": content.software}, "furrowmap:date": date.isoformat()},
        stac_extensions=[PROCESSING],
    )
    authority = content.crs.to_authority()
    ProjectionExtension.ext(item, add_if_missing=True).apply(
        code=":".join(authority) if authority else None,
        projjson=None if authority else json.loads(content.crs.to_json()),
        bbox=list(bounds_m),
    )
    return item
