"""The points of LAS, LAZ and COPC files as structured arrays."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.readers.las.cloud import BATCH_POINTS, Box, CloudFile, open_cloud
from furrowmap.core.readers.las.points import CloudBatch
from furrowmap.core.runtime.errors import RefusedError

if TYPE_CHECKING:
    import pyproj

POINT: Final = np.dtype(
    [
        ("x", "f8"),
        ("y", "f8"),
        ("z", "f8"),
        ("t_s", "f8"),
        ("intensity", "u2"),
        ("return_number", "u1"),
        ("returns", "u1"),
        ("classification", "u1"),
        ("point_source_id", "u2"),
        ("red", "u2"),
        ("green", "u2"),
        ("blue", "u2"),
    ]
)
"""A point: easting, northing and height in the file's CRS, UTC in seconds (nan where unknown), LAS attributes."""


@dataclass(frozen=True)
class Points:
    """Points of a cloud, read on demand.

    ``np.asarray(points)`` or `read` gives all of them, `chunks` a part at a time.

    Attributes:
        file: the opened file.
        bounds: minimum x, minimum y, maximum x, maximum y of the points wanted; None for all.
        classes: classes of the points wanted; None for all.
    """

    file: CloudFile
    bounds: Box | None = None
    classes: frozenset[int] | None = None

    def __repr__(self) -> str:
        return f"Points({str(self.file.path)!r}, bounds={self.bounds}, classes={self.classes and sorted(self.classes)})"

    @cached_property
    def crs(self) -> pyproj.CRS | None:
        """The CRS; None where the file states none."""
        return self.file.crs

    def chunks(self, points: int = BATCH_POINTS) -> Iterator[NDArray[np.void]]:
        """Structured arrays (n,) of dtype `POINT`, about `points` at a time, in the order of the file.

        Raises:
            InputError: if the points turn out to be damaged.
        """
        for batch in self.file.batches(self.bounds, batch_points=points):
            kept = ~batch.withheld
            if self.classes is not None:
                kept &= np.isin(batch.classification, list(self.classes))
            if kept.any():
                yield _to_structured(batch.where(kept))

    def read(self) -> NDArray[np.void]:
        """All points, a structured array (n,) of dtype `POINT`; 45 bytes a point."""
        return np.concatenate([np.empty(0, POINT), *self.chunks()])

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray[Any]:
        """All points, for numpy."""
        del copy  # is always a new array
        return self.read() if dtype is None else self.read().astype(dtype)

    def to_open3d(self) -> Any:
        """An `open3d.geometry.PointCloud` of all points, with their colours where they have any.

        Raises:
            RefusedError: if Open3D is not installed.
        """
        try:
            import open3d
        except ImportError as error:
            raise RefusedError("no-open3d", error=error) from None
        points = self.read()
        cloud = open3d.geometry.PointCloud()
        cloud.points = open3d.utility.Vector3dVector(np.column_stack([points[axis] for axis in "xyz"]))
        colours = np.column_stack([points[name] for name in ("red", "green", "blue")])
        if colours.any():
            cloud.colors = open3d.utility.Vector3dVector(colours / np.iinfo(np.uint16).max)
        return cloud


def open_points(path: str | Path, bounds: Box | None = None, classes: Iterable[int] | None = None) -> Points:
    """Open the points of a LAS, LAZ or COPC file.

    Args:
        bounds: minimum x, minimum y, maximum x, maximum y of the points wanted, in the file's CRS; of a COPC file only
            the nodes within are read.
        classes: classes of the points wanted, such as (2,) for ground; None for all.

    Raises:
        InputError: if the file is missing, damaged or of another format.
    """
    return Points(open_cloud(Path(path)), bounds, frozenset(classes) if classes is not None else None)


def _to_structured(batch: CloudBatch) -> NDArray[np.void]:
    out = np.zeros(len(batch), POINT)
    out["x"], out["y"], out["z"] = batch.xyz_m.T
    out["t_s"] = batch.t_s if batch.t_s is not None else np.nan
    for name in ("intensity", "return_number", "returns", "classification", "point_source_id"):
        out[name] = getattr(batch, name)
    if batch.rgb is not None:
        out["red"], out["green"], out["blue"] = batch.rgb.T
    return out
