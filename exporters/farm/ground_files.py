"""Files beside a farm map that show the ground of all its sessions: a virtual raster, and a virtual point cloud."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

from pyproj import CRS

from furrowmap.core.runtime.errors import FurrowmapError
from furrowmap.core.runtime.file_names import leads_out, resolved
from furrowmap.core.runtime.json_text import json_text
from furrowmap.core.surfaces.grid import Grid
from furrowmap.core.values.crs import crs_of_file
from furrowmap.exporters.exchange.stac import run_item
from furrowmap.exporters.farm.surface_file import SurfaceFile, same_map, surface_file
from furrowmap.exporters.farm.virtual_raster import virtual_raster
from furrowmap.exporters.files.atomic import atomic_output, relative_path
from furrowmap.exporters.files.provenance import Origin
from furrowmap.exporters.files.result_folder import CLOUD, DSM
from furrowmap.exporters.rasters.windows import enclosing

_STAC: Final = "1.0.0"
_EXTENSIONS: Final = (
    "https://stac-extensions.github.io/pointcloud/v1.0.0/schema.json",
    "https://stac-extensions.github.io/projection/v1.1.0/schema.json",
)
"""As PDAL and QGIS write virtual point clouds."""


def write_ground_files(
    farm_map: Path, results: Sequence[tuple[Path, dict[str, Any]]], crs: CRS
) -> tuple[Path | None, Path | None]:
    """Write a virtual raster of the sessions' `dsm.tif`, the latest on top, and a virtual point cloud of their clouds.

    Both lie beside the farm map and copy no cell and no point; None where no session has such a product.
    A surface is in it if it is in the CRS of the farm map and has the cells of the latest one.
    """
    surface, clouds = (farm_map.with_name(f"{farm_map.stem}_{name}") for name in ("surface.vrt", "clouds.vpc"))
    texts = {surface: _surface(surface, [folder for folder, _ in results], crs), clouds: _clouds(clouds, results, crs)}
    for path, text in texts.items():
        if text is None:
            path.unlink(missing_ok=True)
        else:
            with atomic_output(path) as unfinished:
                unfinished.write_text(text, encoding="utf-8")
    return surface if texts[surface] is not None else None, clouds if texts[clouds] is not None else None


def _surface(path: Path, folders: Sequence[Path], crs: CRS) -> str | None:
    found: list[tuple[SurfaceFile, Grid]] = []
    for folder in folders:
        try:
            file = surface_file(folder / DSM) if _is_own(folder / DSM) else None
        except FurrowmapError:  # damaged since: `furrowmap mosaic` reports it
            continue
        if file is not None and file.grid is not None and same_map(file.crs, crs):
            found.append((file, file.grid))
    found = [entry for entry in found if entry[0].cell_m == found[-1][0].cell_m]
    if not found:
        return None
    sources = [(file.path, grid, file.nodata) for file, grid in found]
    last = found[-1][0]
    whole = enclosing([grid for _, grid in found])
    origin = Origin("Surfaces of the farm map's sessions, the latest on top")
    return virtual_raster(resolved(path).parent, whole, last.crs, last.bands[:1], sources, origin)


def _is_own(path: Path) -> bool:
    """Whether it is a file, and no link that leads out of its folder."""
    return path.is_file() and not leads_out(path, path.parent)


def _clouds(path: Path, results: Sequence[tuple[Path, dict[str, Any]]], crs: CRS) -> str | None:
    features = []
    for folder, report in results:
        cloud = folder / CLOUD
        if not _is_own(cloud) or not same_map(crs_of_file(report["session"]["crs"]["map"]), crs):
            continue
        item = run_item(report)
        (west, south, low), (east, north, high) = report["figures"]["bounds_m"]
        properties = {name: value for name, value in item["properties"].items() if name.startswith("pc:")}
        properties |= {
            "datetime": report["figures"]["start"],
            "proj:wkt2": crs.to_wkt(),
            "proj:bbox": [west, south, low, east, north, high],
        }
        href = relative_path(cloud, path.parent)
        features.append(
            {
                "type": "Feature",
                "stac_version": _STAC,
                "stac_extensions": list(_EXTENSIONS),
                "id": item["id"],
                "geometry": item["geometry"],
                "bbox": [*item["bbox"][:2], low, *item["bbox"][2:], high],
                "properties": properties,
                "links": [],
                "assets": {"data": {"href": f"./{href}" if href else cloud.as_uri(), "roles": ["data"]}},
            }
        )
    return json_text({"type": "FeatureCollection", "features": features}) if features else None


def report_of(text: str) -> dict[str, Any]:
    """A session's report as the farm map has it; empty where it is none of a run."""
    report = json.loads(text or "{}")
    return report if isinstance(report, dict) and "session" in report else {}
