"""A field's boundary in the map frame."""

from __future__ import annotations

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from furrowmap.core.geodesy.projection import MapFrame
from furrowmap.core.values.errors import InputError, RefusedError


def boundary_on_map(boundary: BaseGeometry, frame: MapFrame) -> BaseGeometry:
    """The polygons of `boundary`, in longitude and latitude, in the map frame.

    Raises:
        InputError: if they lie where the map's CRS is not meant to be used.
    """
    try:
        return shapely.make_valid(
            shapely.transform(boundary, lambda xy: np.column_stack(frame.project(xy[:, 0], xy[:, 1])))
        )
    except RefusedError as error:
        lon, lat = boundary.centroid.coords[0]
        raise InputError(
            f"The field's boundary lies at {lat:.4f}, {lon:.4f} (latitude, longitude): {frame.name} is not for there.",
            "It is not the boundary of the field of this session.",
            "Name the right file in `[field] boundary`; GeoJSON has longitude before latitude.",
            code="boundary-elsewhere",
        ) from error
