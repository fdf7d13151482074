"""A layer of a vector file as arrays, read by GDAL."""

from __future__ import annotations

import datetime as dt
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray
from pyproj import CRS

from furrowmap.core.runtime.arrays import FloatArray


@dataclass(frozen=True)
class VectorLayer:
    """The n features of a layer.

    Attributes:
        shapes: (n,) geometries; None where a feature has none.
        columns: (n,) values of each field: numbers (nan where empty, also of integers), texts (None where empty),
            times as datetime64[ms] in UTC, dates as datetime64[D].
        crs: of the geometries; None if the file states none.
    """

    shapes: NDArray[np.object_]
    columns: dict[str, NDArray[Any]]
    crs: CRS | None

    def __len__(self) -> int:
        return len(self.shapes)

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """Least x and y, greatest x and y; nan of a layer without coordinates."""
        west, south, east, north = shapely.total_bounds(self.shapes).tolist()
        return west, south, east, north

    @property
    def coordinates(self) -> FloatArray:
        """(n, 3) of points; heights are nan where they have none."""
        xyz: FloatArray = np.column_stack([part(self.shapes) for part in (shapely.get_x, shapely.get_y, shapely.get_z)])
        return xyz

    def where(self, kept: Any) -> VectorLayer:
        """The features that an index, a mask or a slice selects, in its order."""
        return VectorLayer(self.shapes[kept], {k: values[kept] for k, values in self.columns.items()}, self.crs)

    def rows(self) -> Iterator[dict[str, Any]]:
        """The fields of each feature as Python's own types, times with their zone; None where a field is empty."""
        columns = {name: values.tolist() for name, values in self.columns.items()}
        for name, values in self.columns.items():
            if values.dtype == "datetime64[ms]":
                columns[name] = [t if t is None else t.replace(tzinfo=dt.UTC) for t in columns[name]]
        for k in range(len(self)):
            row = {name: values[k] for name, values in columns.items()}
            yield {name: None if isinstance(v, float) and np.isnan(v) else v for name, v in row.items()}


def read_vector_layer(path: Path, name: str | None = None, *, times_as_text: bool = False) -> VectorLayer:
    """A layer of a vector file, by default the first.

    Args:
        times_as_text: read times and dates as text in ISO 8601, with the zone that the file states.

    Raises:
        ValueError: if the layer is a table without geometries.
        Exception: of GDAL, GEOS and PROJ, which have no family of their own, if the file is damaged.
    """
    import pyogrio.raw  # a tenth of a second, and most sessions name no vector file

    pyogrio.set_gdal_config_options({"GDAL_PAM_ENABLED": False})  # it would write `.aux.xml` beside a GeoPackage
    about, _, wkb, data = pyogrio.raw.read(path, layer=name, datetime_as_string=times_as_text)
    if wkb is None:
        raise ValueError(f"{'its first layer' if name is None else name} is a table without geometries")
    columns = dict(zip(map(str, about["fields"]), data, strict=True))
    crs = CRS.from_user_input(about["crs"]) if about["crs"] else None
    return VectorLayer(np.asarray(shapely.from_wkb(wkb), object), columns, crs)
