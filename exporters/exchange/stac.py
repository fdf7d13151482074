"""STAC 1.1: the products of a run as an item, many runs as a collection, a season as a catalogue of collections.

Extensions: projection 2.0, pointcloud 1.0, processing 1.1, raster 2.0 and table 1.2. All links are relative, so that a
server of plain files can serve a folder as it is; clients such as pystac-client begin with `catalog.json`.
"""

import datetime as dt
import json
from collections.abc import Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any, Final

import laspy
import numpy as np
import shapely
from pyproj import CRS

from furrowmap.core.geodesy.crs_change import crs_change
from furrowmap.core.geodesy.longitudes import cut_at_antimeridian, west_east_deg
from furrowmap.core.geodesy.projection import stated_frame
from furrowmap.core.runtime.errors import InputError
from furrowmap.core.runtime.file_names import is_file_name, resolved
from furrowmap.core.runtime.json_text import json_text
from furrowmap.core.surfaces.grid import Grid
from furrowmap.core.values.crs import crs_of_file
from furrowmap.exporters.files.atomic import relative_path
from furrowmap.exporters.files.result_folder import (
    CLOUD,
    FIELD,
    FURTHER_TOOLS,
    LEARNED,
    ORTHOPHOTO,
    REPORT,
    REPORT_PAGE,
    SESSION_FILE,
    STATES,
    ResultFolder,
    of_tool,
    result_origin,
)

StacItem = dict[str, Any]
"""A STAC item as JSON has it."""
Bounds = tuple[float, float, float, float]
DateSpan = tuple[dt.datetime, dt.datetime]

CATALOGUE: Final = "catalog.json"
COLLECTION: Final = "collection.json"
STAC_FOLDER: Final = "stac"
_STAC_VERSION: Final = "1.1.0"
_PROCESSING: Final = "https://stac-extensions.github.io/processing/v1.1.0/schema.json"
_PROJECTION: Final = "https://stac-extensions.github.io/projection/v2.0.0/schema.json"
_POINTCLOUD: Final = "https://stac-extensions.github.io/pointcloud/v1.0.0/schema.json"
_RASTER: Final = "https://stac-extensions.github.io/raster/v2.0.0/schema.json"
_TABLE: Final = "https://stac-extensions.github.io/table/v1.2.0/schema.json"
_LICENCE: Final = "other"
"""The owner of the recording decides on the licence of its products."""
_COG: Final = "image/tiff; application=geotiff; profile=cloud-optimized"
_PRODUCT_KINDS: Final = {  # media type, title, roles
    CLOUD: ("application/vnd.laszip+copc", "Point cloud", ["data"]),
    FIELD: ("application/geopackage+sqlite3", "Trajectory and ground worked", ["data"]),
    ORTHOPHOTO: (_COG, "Orthophoto", ["visual"]),
    REPORT: ("application/json", "Figures, warnings, provenance", ["metadata"]),
    REPORT_PAGE: ("text/html", "Report to read", ["overview"]),
    LEARNED: ("application/octet-stream", "What was learned of the implement, for the next session", ["data"]),
    STATES: ("text/csv", "When the tool went down and up", ["data"]),
    **{of_tool(LEARNED, n): ("application/octet-stream", f"Learned of implement {n}", ["data"]) for n in FURTHER_TOOLS},
    **{of_tool(STATES, n): ("text/csv", f"When implement {n} went down and up", ["data"]) for n in FURTHER_TOOLS},
    SESSION_FILE: ("application/toml", "Session as it was understood", ["metadata"]),
}
_PARQUET: Final = "application/vnd.apache.parquet"
_UP: Final = "../.."
"""From a collection's folder to the season's."""
_EDGE_POINTS: Final = 6
_FOOTPRINT_DIGITS: Final = 7
_IDENTIFIER_BYTES: Final = 200
"""Maximum length of a session's name in an identifier, so that a file can be named after it."""


def run_item(report: dict[str, Any]) -> StacItem:
    """The item of one run from its `report.json`, with assets relative to it, of products with a media type."""
    figures = report["figures"]
    session = report["session"]
    origin = result_origin(report)
    (west, south, low), (east, north, high) = figures["bounds_m"]
    crs = crs_of_file(session["crs"]["map"]).to_2d()
    frame = stated_frame(session["crs"]["coordinates"])
    span = dt.datetime.fromisoformat(figures["start"]), dt.datetime.fromisoformat(figures["end"])
    properties = {
        "title": session["name"] or "Session without a name",
        "instruments": [session["lidar"].get("model") or ("lidar" if figures["points"] else "gnss")],
        "processing:software": {"furrowmap": report["furrowmap"]},
        "furrowmap:measured_epoch": origin.measured_epoch,
        "furrowmap:parameters": dict(origin.parameters),
        "furrowmap:inputs": [{"name": name, "sha256": digest} for name, digest in origin.inputs],
        "furrowmap:height_m": [low, high],
    }
    if contradiction := (report.get("verdict") or {}).get("text"):
        properties["furrowmap:contradiction"] = contradiction
    if unstated := (report.get("accuracy") or {}).get("unstated"):
        properties["furrowmap:unstated"] = unstated
    if figures["points"]:
        properties |= {
            "pc:count": figures["points"],
            "pc:type": "lidar",
            "pc:encoding": "COPC",
            "pc:schemas": _point_dimensions(coloured=bool(report.get("colours"))),
            "pc:density": round(figures["points"] / max((east - west) * (north - south), 1e-6), 3),
        }
    crs = frame.map_crs(crs) if frame is not None else crs
    extensions = [_POINTCLOUD] if figures["points"] else []
    item = _item(session_identifier(report), crs, (west, south, east, north), span, properties, extensions)
    for name in filter(is_file_name, report["products"]):
        stem = Path(name).stem
        raster = (_COG, stem.replace("_", " ").upper(), ["data"]) if name.endswith(".tif") else None
        if kind := _PRODUCT_KINDS.get(name, raster):
            media, title, roles = kind
            item["assets"][stem.split(".")[0]] = {"href": f"./{name}", "type": media, "title": title, "roles": roles}
    return item


def write_item(path: Path, report: dict[str, Any]) -> None:
    """Write the item of a run beside its products."""
    path.write_text(json_text(run_item(report)), encoding="utf-8")


def write_collection(folder: Path, results: Sequence[ResultFolder], target: Path) -> None:
    """Write a collection over many runs: `collection.json`, and an item each that points to the products.

    Assets are relative to `target`, the final folder of the collection.
    """
    items = [_linked_item(result.folder, result.report, target) for result in results]
    names = [item["id"] for item in items]
    for name in names:
        same = [result.folder for result, other in zip(results, names, strict=True) if other == name]
        if len(same) > 1:
            raise InputError("session-twice", folders=tuple(same), session=name)
    name, files = target.name or "furrowmap", [CATALOGUE, COLLECTION, *(f"{name}.json" for name in names)]
    description = "Georeferenced clouds and worked ground, a session each, made by furrowmap."
    about = {"id": name, "title": name, "description": description, "furrowmap:products": files}
    _write_collection(folder, f"./{CATALOGUE}", about, items)
    _write_catalogue(folder, f"{name}-catalogue", description, name, {f"./{COLLECTION}": name})


def write_season_catalogue(
    folder: Path, target: Path, collections: Mapping[str, tuple[str, Sequence[StacItem], Mapping[str, Any]]]
) -> None:
    """Write `catalog.json`, and below `stac/` collections with their items: title, items and further fields by name."""
    name = resolved(target).name or "season"
    for key, (title, items, more) in collections.items():
        place = folder / STAC_FOLDER / key
        place.mkdir(parents=True, exist_ok=True)
        about = {"id": f"{name}-{key}", "title": title, "description": f"{title}, made by furrowmap.", **more}
        _write_collection(place, f"{_UP}/{CATALOGUE}", about, items)
    children = {f"./{STAC_FOLDER}/{key}/{COLLECTION}": title for key, (title, _, _) in collections.items()}
    _write_catalogue(folder, name, "Products of a season, made by furrowmap.", name, children)


def season_session_item(folder: Path, report: dict[str, Any], date: dt.date, season: Path) -> StacItem:
    """The item of a session in the catalogue of a season, which links to its result folder."""
    item = _linked_item(folder, report, season / STAC_FOLDER / "sessions")
    item["properties"]["furrowmap:date"] = date.isoformat()
    return item


def tile_item(
    name: str, date: dt.date, span: DateSpan, crs: CRS, grid: Grid, rasters: Mapping[str, tuple[str, str, list[Any]]]
) -> StacItem:
    """A tile of the mosaics of a date; `rasters` has path, title and bands (as STAC has them) of each product."""
    shape = {"proj:shape": list(grid.shape), "proj:transform": [*grid.transform, 0.0, 0.0, 1.0]}
    item = _item(name, crs, grid.bounds_m, span, _season_properties(date) | shape, [_RASTER])
    for product, (path, title, bands) in rasters.items():
        asset = {"href": f"{_UP}/{path}", "type": _COG, "title": title, "roles": ["data"]}
        item["assets"][product] = asset | {"bands": bands, "raster:spatial_resolution": grid.cell_m}
    return item


def table_item(
    name: str, date: dt.date, span: DateSpan, crs: CRS, bounds_m: Bounds, columns: object, files: Mapping[str, int]
) -> StacItem:
    """The files of a table of a date, by their path in the season's folder with their number of rows."""
    properties = _season_properties(date) | table_properties(columns) | {"table:row_count": sum(files.values())}
    item = _item(name, crs, bounds_m, span, properties, [_TABLE])
    for path, rows in files.items():
        asset = {"href": f"{_UP}/{path}", "type": _PARQUET, "title": Path(path).name, "roles": ["data"]}
        item["assets"][Path(path).stem] = asset | {"table:row_count": rows}
    return item


def table_properties(columns: object) -> dict[str, Any]:
    """What the extension "table" states of columns."""
    return {"table:columns": columns, "table:primary_geometry": "geometry"}


def session_identifier(report: dict[str, Any]) -> str:
    """The session's name in characters that a file name may have, and its start."""
    name = "".join(c if c.isalnum() else "-" for c in str(report["session"]["name"] or "session")).strip("-")
    words = "-".join(part for part in name.split("-") if part)[:80].encode()[:_IDENTIFIER_BYTES].decode(errors="ignore")
    return f"{words or 'session'}-{dt.datetime.fromisoformat(report['figures']['start']):%Y%m%dT%H%M%SZ}"


def _season_properties(date: dt.date) -> dict[str, Any]:
    return {"processing:software": {"furrowmap": version("furrowmap")}, "furrowmap:date": date.isoformat()}


def _item(
    name: str, crs: CRS, bounds_m: Bounds, span: DateSpan, properties: dict[str, Any], extensions: Sequence[str]
) -> StacItem:
    """An item without assets; its footprint has points along the edges of the bounds."""
    west, south, east, north = bounds_m
    corners = np.array([(west, south), (east, south), (east, north), (west, north), (west, south)])
    share = np.linspace(0.0, 1.0, _EDGE_POINTS)[:-1, None]
    x, y = (corners[:-1, None] + share * np.diff(corners, axis=0)[:, None]).reshape(-1, 2).T
    lon, lat = (values.round(_FOOTPRINT_DIGITS) for values in crs_change(crs, CRS("EPSG:4326"), bounds_m)(x, y))
    (footprint,) = cut_at_antimeridian(np.array([shapely.Polygon(np.column_stack([lon, lat]))], object))
    west, east = west_east_deg(lon)
    start, end = (moment.isoformat().replace("+00:00", "Z") for moment in span)
    authority = crs.to_authority()
    projection = {"proj:code": ":".join(authority)} if authority else {"proj:projjson": json.loads(crs.to_json())}
    times = {"datetime": None, "start_datetime": start, "end_datetime": end}
    return {
        "type": "Feature",
        "stac_version": _STAC_VERSION,
        "stac_extensions": [_PROCESSING, _PROJECTION, *extensions],
        "id": name,
        "geometry": json.loads(shapely.to_geojson(footprint)),
        "bbox": [west, float(lat.min()), east, float(lat.max())],
        "properties": properties | times | {"proj:code": None} | projection | {"proj:bbox": list(bounds_m)},
        "links": [],
        "assets": {},
    }


def _linked_item(folder: Path, report: dict[str, Any], start: Path) -> StacItem:
    """The item of a run whose assets are relative to `start`, or URIs where they are on another drive of Windows."""
    item = run_item(report)
    for asset in item["assets"].values():
        path = folder / asset["href"]
        asset["href"] = relative_path(path, start) or resolved(path).as_uri()
    return item


def _write_collection(folder: Path, root: str, about: Mapping[str, Any], items: Sequence[StacItem]) -> None:
    """Write a collection and its items."""
    links = [_link("root", root), _link("parent", root)]
    for item in items:
        links.append({"rel": "item", "href": f"./{item['id']}.json", "type": "application/geo+json"})
        own = [_link("root", root), _link("collection", f"./{COLLECTION}"), _link("parent", f"./{COLLECTION}")]
        content = item | {"links": own, "collection": about["id"]}
        (folder / f"{item['id']}.json").write_text(json_text(content), encoding="utf-8")
    boxes = np.array([item["bbox"] for item in items])
    west, east = west_east_deg(boxes[:, [0, 2]].ravel())
    interval = [
        choose((item["properties"][f"{end}_datetime"] for item in items), key=dt.datetime.fromisoformat)
        for choose, end in ((min, "start"), (max, "end"))
    ]
    box = [west, float(boxes[:, 1].min()), east, float(boxes[:, 3].max())]
    collection = {"type": "Collection", "stac_version": _STAC_VERSION, **about, "license": _LICENCE, "links": links}
    if "table:columns" in about:
        collection["stac_extensions"] = [_TABLE]
    collection["extent"] = {"spatial": {"bbox": [box]}, "temporal": {"interval": [interval]}}
    (folder / COLLECTION).write_text(json_text(collection), encoding="utf-8")


def _write_catalogue(folder: Path, name: str, description: str, title: str, children: Mapping[str, str]) -> None:
    """Write `catalog.json` over collections, given as titles by links."""
    links = [_link("root", f"./{CATALOGUE}"), *(_link("child", href) | {"title": t} for href, t in children.items())]
    about = {"type": "Catalog", "id": name, "stac_version": _STAC_VERSION, "title": title, "description": description}
    (folder / CATALOGUE).write_text(json_text(about | {"links": links}), encoding="utf-8")


def _link(rel: str, href: str) -> dict[str, str]:
    return {"rel": rel, "href": href, "type": "application/json"}


def _point_dimensions(*, coloured: bool) -> list[dict[str, Any]]:
    """The dimensions of the cloud's points."""
    words = {"i": "signed", "u": "unsigned", "f": "floating"}
    layout = laspy.PointFormat(7 if coloured else 6).dtype()
    dimensions = [*((name, layout[name]) for name in layout.names), ("scan", np.dtype(np.uint32))]
    return [{"name": name, "size": kind.itemsize, "type": words[kind.kind]} for name, kind in dimensions]
