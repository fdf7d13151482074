"""A part of a cloud's points that a browser can draw, as text that a page can read from disk."""

import base64
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.readers.las.cloud import Box, CloudFile, open_cloud
from furrowmap.core.values.scan import PointClass

MAX_SHARED_POINTS: Final = 1_000_000
COORDINATE_STEPS: Final = 65535
"""Coordinates are 16-bit numbers from the lowest to the highest of each axis."""
BYTES_A_POINT: Final = 14
"""In the file: base64 of six bytes of coordinates, one of the class and three of the colour."""
CLASS_COLOURS: Final = (
    (2, "#9c7a4a", "ground"),
    (1, "#5c9c4a", "other"),
    (64, "#d08020", "vehicle"),
    (65, "#c03030", "implement"),
    (66, "#ca785c", "horizontal plane"),
    (67, "#464646", "vertical plane"),
    (68, "#8c1478", "line"),
    (3, "#b2df8a", "low vegetation"),
    (4, "#5aae61", "medium vegetation"),
    (5, "#006837", "high vegetation"),
)
"""Code, colour and name of the classes, as the QGIS plugin draws them; noise is left out."""

MACHINE_CODES: Final = (int(PointClass.VEHICLE), int(PointClass.IMPLEMENT))
"""Classes that are hidden at first: each scan sees the machine anew, so it covers its own way."""


@dataclass(frozen=True)
class SharedPoints:
    """Points for a page: (n, 3) in the cloud's CRS, classes, colours (n, 3) or None, number of points in the cloud."""

    xyz_m: NDArray[np.float64]
    classification: NDArray[np.uint8]
    rgb: NDArray[np.uint8] | None
    of: int

    def plain(self, box: Box) -> dict[str, Any]:
        """What the page's viewer reads; colours of heights and the first view are those within a box."""
        low = self.xyz_m.min(axis=0)
        high = self.xyz_m.max(axis=0)
        high = np.maximum(high, low + 1e-3)
        steps = np.round((self.xyz_m - low) / (high - low) * COORDINATE_STEPS).astype("<u2")
        x, y, z = self.xyz_m.T
        there = (x >= box[0]) & (y >= box[1]) & (x <= box[2]) & (y <= box[3])
        there &= ~np.isin(self.classification, MACHINE_CODES)
        bottom, middle, top = np.quantile(z[there] if there.any() else z, (0.02, 0.5, 0.98)).tolist()
        codes = set(np.unique(self.classification).tolist())
        shown = {
            "xyz": _base64(steps),
            "classes": _base64(self.classification),
            "rgb": _base64(self.rgb) if self.rgb is not None else None,
            "low": low.tolist(),
            "high": high.tolist(),
            "ground": middle,
            "heights": [bottom, top],
            "hidden": list(MACHINE_CODES),
            "palette": [
                {"code": c, "colour": colour, "label": label} for c, colour, label in CLASS_COLOURS if c in codes
            ],
        }
        return {key: value for key, value in shown.items() if value is not None}


def shared_points(path: Path, most: int) -> SharedPoints | None:
    """Points of a cloud, evenly over it: of a COPC file from its coarse levels; without noise. None for no points."""
    cloud = open_cloud(path)
    resolution, expected = _resolution(cloud, most)
    random = np.random.default_rng(0)  # the same cloud gives the same points
    parts = []
    for batch in cloud.batches(resolution=resolution):
        keep = ~batch.withheld & (batch.classification != PointClass.NOISE)
        keep &= random.random(len(batch)) < 0.99 * most / max(expected, 1)  # hardly ever more than most
        parts.append(batch.where(keep))
    if not sum(len(part) for part in parts):
        return None
    xyz_m = np.concatenate([part.xyz_m for part in parts])[:most]
    colours = [part.rgb for part in parts if part.rgb is not None]
    rgb = (np.concatenate(colours)[:most] >> 8).astype(np.uint8) if len(colours) == len(parts) else None
    classes = np.concatenate([part.classification for part in parts])[:most]
    return SharedPoints(xyz_m, classes, rgb if rgb is not None and rgb.any() else None, cloud.points)


def _resolution(cloud: CloudFile, most: int) -> tuple[float | None, int]:
    """The coarsest resolution with enough points, and how many those are; None for all points."""
    if cloud.index is None or cloud.laz is None:
        return None, cloud.points
    level = cloud.index.keys[:, 0]
    points = np.asarray(cloud.laz.points)[cloud.index.chunks]
    upto = np.cumsum(np.bincount(level, points))
    enough = min(int(np.searchsorted(upto, most)), len(upto) - 1)
    return cloud.index.spacing / 2.0**enough, int(upto[enough])


def _base64(values: NDArray[Any]) -> str:
    return base64.b64encode(np.ascontiguousarray(values).tobytes()).decode("ascii")
