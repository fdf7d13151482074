"""Features of a cloud as the layers of `features.gpkg`."""

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import shapely
from pyproj import CRS

from furrowmap.core.features.objects import LineObject, PlanePiece, Plants
from furrowmap.exporters.files.atomic import atomic_output
from furrowmap.exporters.files.provenance import Origin
from furrowmap.exporters.vectors.field_layers import Layer, geometry_array, numbers, texts
from furrowmap.exporters.vectors.geopackage import write_styled_layers


def feature_layers(planes: Sequence[PlanePiece], lines: Sequence[LineObject], plants: Plants) -> list[Layer]:
    """The layers, the topmost of a map first."""
    normals = np.array([plane.normal for plane in planes]).reshape(-1, 3)
    level = np.hypot(normals[:, 0], normals[:, 1]) < 1e-6
    azimuth = np.degrees(np.arctan2(normals[:, 0], normals[:, 1])) % 360.0
    return [
        Layer(
            "plants",
            "2.5D Point",
            "Tops of plants: trees, shrubs, hedges",
            geometry_array(shapely.points(plants.top_m)),
            {
                "height_m": plants.height_m,
                "area_m2": plants.area_m2,
                "width_m": np.sqrt(4.0 * plants.area_m2 / math.pi),
                "points": plants.points,
            },
        ),
        Layer(
            "lines",
            "2.5D LineString",
            "Poles, posts and trunks; wires and rails; fences; the feet of walls; ditches, ridges and edges of banks",
            geometry_array([line.shape for line in lines]),
            {
                "kind": texts(line.kind for line in lines),
                "height_m": numbers(line.height_m for line in lines),
                "length_m": numbers(line.length_m for line in lines),
                "points": np.array([line.points for line in lines], np.int64),
            },
        ),
        Layer(
            "planes",
            "2.5D MultiPolygon",
            "Outlines of planes: horizontal ones up to 45 degrees, such as roofs, and vertical ones, such as walls",
            geometry_array([shapely.multipolygons(shapely.get_parts(plane.shape)) for plane in planes]),
            {
                "kind": texts("vertical" if plane.vertical else "horizontal" for plane in planes),
                "area_m2": numbers(plane.area_m2 for plane in planes),
                "tilt_deg": numbers(math.degrees(math.acos(min(1.0, abs(float(z))))) for z in normals[:, 2]),
                "azimuth_deg": np.where(level, np.nan, azimuth),
                **{f"normal_{name}": normals[:, k] for k, name in enumerate("enh")},
                "height_m": numbers(plane.top_m - plane.base_m for plane in planes),
                "rms_m": numbers(plane.rms_m for plane in planes),
                "points": np.array([plane.points for plane in planes], np.int64),
            },
        ),
    ]


def write_features(path: Path, layers: Sequence[Layer], crs: CRS | str, origin: Origin) -> None:
    """Write `features.gpkg` with its layers and their styles."""
    with atomic_output(path) as unfinished:
        write_styled_layers(unfinished, layers, crs, origin)
