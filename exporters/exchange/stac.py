"""STAC: the products of a run as an item, and many runs as a collection.

STAC 1.1 with the extensions projection 2.0, pointcloud 1.0 and processing 1.1.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from pyproj import CRS

from furrowmap.core.geodesy.crs_change import crs_change
from furrowmap.core.geodesy.stated_frame import stated_frame
from furrowmap.core.runtime.errors import InputError
from furrowmap.core.runtime.file_names import is_file_name
from furrowmap.core.runtime.json_text import json_text
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

if TYPE_CHECKING:
    import pystac

CATALOGUE: Final = "catalog.json"
COLLECTION: Final = "collection.json"
PROCESSING: Final = "https://stac-extensions.github.io/processing/v1.1.0/schema.json"
LICENCE: Final = "other"
"""The owner of the recording decides on the licence of its products."""
_KINDS: Final = {  # media type, title, roles
    CLOUD: ("application/vnd.laszip+copc", "Point cloud", ["data"]),
    FIELD: ("application/geopackage+sqlite3", "Trajectory and ground worked", ["data"]),
    REPORT: ("application/json", "Figures, warnings, provenance", ["metadata"]),
    REPORT_PAGE: ("text/html", "Report to read", ["overview"]),
    LEARNED: ("application/octet-stream", "What was learned of the implement, for the next session", ["data"]),
    STATES: ("text/csv", "When the tool went down and up", ["data"]),
    **{of_tool(LEARNED, n): ("application/octet-stream", f"Learned of implement {n}", ["data"]) for n in FURTHER_TOOLS},
    **{of_tool(STATES, n): ("text/csv", f"When implement {n} went down and up", ["data"]) for n in FURTHER_TOOLS},
    SESSION_FILE: ("application/toml", "Session as it was understood", ["metadata"]),
}
COG: Final = "image/tiff; application=geotiff; profile=cloud-optimized"
_EDGE_POINTS: Final = 6
_DIGITS_DEG: Final = 7
_NAME_BYTES: Final = 200
"""Longest name of a session in an identifier, so that a file can be named after it."""


def run_item(report: dict[str, Any]) -> pystac.Item:
    """The item of one run, with assets relative to it.

    Args:
        report: content of `report.json`; products without a media type here are left out.
    """
    import pystac
    from pystac.extensions.pointcloud import PhenomenologyType, PointcloudExtension
    from pystac.extensions.projection import ProjectionExtension

    figures = report["figures"]
    (west, south, low), (east, north, high) = figures["bounds_m"]
    crs, origin = _crs(report), result_origin(report)
    ring = footprint(crs, (west, south, east, north))
    lon, lat = zip(*ring, strict=True)
    item = pystac.Item(
        id=session_identifier(report),
        geometry={"type": "Polygon", "coordinates": [ring]},
        bbox=[min(lon), min(lat), max(lon), max(lat)],
        datetime=None,
        start_datetime=datetime.fromisoformat(figures["start"]),
        end_datetime=datetime.fromisoformat(figures["end"]),
        properties={
            "title": report["session"]["name"] or "Session without a name",
            "instruments": [report["session"]["lidar"].get("model") or ("lidar" if figures["points"] else "gnss")],
            "processing:software": {"furrowmap": report["furrowmap"]},
            "furrowmap:measured_epoch": origin.measured_epoch,
            "furrowmap:parameters": dict(origin.parameters),
            "furrowmap:inputs": [{"name": name, "sha256": digest} for name, digest in origin.inputs],
        },
        stac_extensions=[PROCESSING],
    )
    if contradiction := (report.get("verdict") or {}).get("text"):
        item.properties["furrowmap:contradiction"] = contradiction
    if unstated := (report.get("accuracy") or {}).get("unstated"):
        item.properties["furrowmap:unstated"] = unstated
    projection = ProjectionExtension.ext(item, add_if_missing=True)
    authority = crs.to_authority()
    projection.apply(
        code=":".join(authority) if authority else None,
        projjson=None if authority else json.loads(crs.to_json()),
        bbox=[west, south, east, north],
    )
    if figures["points"]:
        area_m2 = max((east - west) * (north - south), 1e-6)
        PointcloudExtension.ext(item, add_if_missing=True).apply(
            count=figures["points"],
            type=PhenomenologyType.LIDAR,
            encoding="COPC",
            schemas=_schemas(coloured=bool(report.get("colours"))),
            density=round(figures["points"] / area_m2, 3),
        )
    item.properties["furrowmap:height_m"] = [low, high]
    for name in report["products"]:
        if is_file_name(name) and (kind := _kind(name)):
            media, title, roles = kind
            item.add_asset(Path(name).stem.split(".")[0], pystac.Asset(f"./{name}", title, None, media, roles))
    return item


def write_item(path: Path, report: dict[str, Any]) -> None:
    """Write the item of a run beside its products."""
    item = run_item(report).to_dict(include_self_link=False)
    path.write_text(json_text(item), encoding="utf-8")


def write_collection(folder: Path, results: Sequence[ResultFolder], target: Path) -> None:
    """Write a collection over many runs: `collection.json`, and an item each that points to the products.

    `catalog.json` is where clients such as pystac-client begin; all links are relative, so that a server of plain files
    can serve the folder as it is.

    Args:
        results: of the runs.
        target: final folder of the collection, to which the assets are relative.

    Raises:
        InputError: if two results are of the same session.
    """
    import pystac

    items = []
    for result in results:
        item = run_item(result.report)
        for asset in item.assets.values():
            asset.href = link(result.folder / asset.href, target)
        items.append(item)
    names = [item.id for item in items]
    for name in names:
        if names.count(name) > 1:
            raise InputError("session-twice.write-collection", name=name)
    collection = pystac.Collection(
        id=target.name or "furrowmap",
        title=target.name or "furrowmap",
        description="Georeferenced clouds and worked ground, a session each, made by furrowmap.",
        extent=pystac.Extent.from_items(items),
        license=LICENCE,
        extra_fields={"furrowmap:products": [CATALOGUE, COLLECTION, *(f"{name}.json" for name in names)]},
    )
    collection.add_links([pystac.Link(rel, f"./{CATALOGUE}", "application/json") for rel in ("root", "parent")])
    for item in items:
        item.add_link(pystac.Link("root", f"./{CATALOGUE}", "application/json"))
        collection.add_link(pystac.Link("item", f"./{item.id}.json", "application/geo+json"))
        item.add_link(pystac.Link("collection", f"./{COLLECTION}", "application/json"))
        item.add_link(pystac.Link("parent", f"./{COLLECTION}", "application/json"))
        item.collection_id = collection.id
        value = item.to_dict(include_self_link=False, transform_hrefs=False)
        (folder / f"{item.id}.json").write_text(json_text(value), encoding="utf-8")
    catalogue = pystac.Catalog(f"{collection.id}-catalogue", collection.description, collection.title)
    catalogue.set_root(None)
    catalogue.add_link(pystac.Link("root", f"./{CATALOGUE}", "application/json"))
    catalogue.add_link(pystac.Link("child", f"./{COLLECTION}", "application/json", collection.title))
    for name, whole in ((CATALOGUE, catalogue), (COLLECTION, collection)):
        content = whole.to_dict(include_self_link=False, transform_hrefs=False)
        (folder / name).write_text(json_text(content), encoding="utf-8")


def _crs(report: dict[str, Any]) -> CRS:
    """The map's CRS in the reference frame that the session states."""
    stated_crs = report["session"]["crs"]
    flat, stated = CRS.from_user_input(stated_crs["map"]).to_2d(), stated_frame(stated_crs["coordinates"])
    return stated.map_crs(flat) if stated is not None else flat


def link(path: Path, start: Path) -> str:
    """The link to a file from a folder: relative, or a URI where it is on another drive of Windows."""
    return relative_path(path, start) or path.resolve().as_uri()


def session_identifier(report: dict[str, Any]) -> str:
    """The session's name in characters that a file name may have, and its start."""
    name = "".join(c if c.isalnum() else "-" for c in str(report["session"]["name"] or "session")).strip("-")
    words = "-".join(part for part in name.split("-") if part)[:80].encode()[:_NAME_BYTES].decode(errors="ignore")
    return f"{words or 'session'}-{datetime.fromisoformat(report['figures']['start']):%Y%m%dT%H%M%SZ}"


def footprint(crs: CRS, bounds: tuple[float, float, float, float]) -> list[list[float]]:
    """The box in longitude and latitude, counter-clockwise, with points along its edges."""
    west, south, east, north = bounds
    share = np.linspace(0.0, 1.0, _EDGE_POINTS)[:-1]
    x = np.concatenate([west + share * (east - west), np.full(len(share), east), east - share * (east - west)])
    x = np.concatenate([x, np.full(len(share), west)])
    y = np.concatenate([np.full(len(share), south), south + share * (north - south), np.full(len(share), north)])
    y = np.concatenate([y, north - share * (north - south)])
    lon, lat = crs_change(crs, CRS("EPSG:4326"), bounds)(x, y)
    ring = np.column_stack([lon, lat]).round(_DIGITS_DEG).tolist()
    return [*ring, ring[0]]


def _kind(name: str) -> tuple[str, str, list[str]] | None:
    if name == ORTHOPHOTO:
        return COG, "Orthophoto", ["visual"]
    if name.endswith(".tif"):
        return COG, Path(name).stem.replace("_", " ").upper(), ["data"]
    return _KINDS.get(name)


def _schemas(*, coloured: bool) -> list[Any]:
    """The dimensions of the cloud's points."""
    import laspy
    from pystac.extensions.pointcloud import Schema, SchemaType

    words = {"i": SchemaType.SIGNED, "u": SchemaType.UNSIGNED, "f": SchemaType.FLOATING}
    dimensions = [(name, np.dtype(str(kind))) for name, kind in laspy.PointFormat(7 if coloured else 6).dtype().descr]
    dimensions.append(("scan", np.dtype(np.uint32)))
    return [Schema.create(name, dtype.itemsize, words[dtype.kind]) for name, dtype in dimensions]
