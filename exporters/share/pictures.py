"""Rasters of a result as pictures with the colours of their QGIS styles."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final
from xml.etree import ElementTree as ET

import numpy as np
from numpy.typing import NDArray
from rasterio.enums import Resampling
from scipy import ndimage

from furrowmap.core.readers.geotiff import open_geotiff
from furrowmap.exporters.files.result_folder import packaged_style, unreadable

MAX_PICTURE_SIDE: Final = 2400
"""Pixels of the longer side of a picture."""
WEBP_QUALITY: Final = "85"


@dataclass(frozen=True)
class StyledPicture:
    """A raster in colours.

    Attributes:
        rgba: (rows, columns, 4) uint8, north on top.
        box_m: west, south, east, north in the raster's CRS.
        legend: colour and label of the style's classes.
    """

    rgba: NDArray[np.uint8]
    box_m: tuple[float, float, float, float]
    legend: tuple[tuple[str, str], ...]


def draw_raster(path: Path, style: str) -> StyledPicture:
    """The raster in a file, at most :data:`MAX_PICTURE_SIDE` pixels long, as its QGIS style draws it."""
    root = ET.fromstring(packaged_style(style))  # noqa: S314 - a file of this package
    renderer = next(root.iter("rasterrenderer"))
    with open_geotiff(path, lambda file, fault: unreadable(file, ValueError(fault)), with_heights=False) as raster:
        share = min(1.0, MAX_PICTURE_SIDE / max(raster.shape))
        shape = tuple(max(1, round(side * share)) for side in raster.shape)
        west, south, east, north = raster.bounds
        if renderer.get("type") == "multibandcolor":
            rgb = raster.read((1, 2, 3), out_shape=(3, *shape), resampling=Resampling.average)
            seen = raster.dataset_mask(out_shape=shape)
            return StyledPicture(np.dstack([*rgb, seen]).astype(np.uint8), (west, south, east, north), ())
        values = _values(raster, shape)
    if renderer.get("type") == "hillshade":
        cell_m = ((east - west) / shape[1], (north - south) / shape[0])
        return StyledPicture(_shaded(values, cell_m, renderer), (west, south, east, north), ())
    items = list(renderer.iter("item"))
    legend = tuple((str(item.get("color")), str(item.get("label"))) for item in items)
    return StyledPicture(_coloured(values, items), (west, south, east, north), legend)


def _values(raster: Any, shape: Sequence[int]) -> NDArray[np.float32]:
    """The first band, nan where it has no value."""
    band = raster.read(1, out_shape=tuple(shape), resampling=Resampling.average, masked=True)
    values: NDArray[np.float32] = band.astype(np.float32).filled(np.nan)
    return values


def _coloured(values: NDArray[np.float32], items: Sequence[ET.Element]) -> NDArray[np.uint8]:
    """Colours between those of the style's classes; transparent where there is no value."""
    stops = [float(str(item.get("value"))) for item in items]
    colours = [str(item.get("color")) for item in items]
    known = np.isfinite(values)
    out = np.zeros((*values.shape, 4), np.uint8)
    for channel in range(3):
        parts = [int(colour[1 + 2 * channel : 3 + 2 * channel], 16) for colour in colours]
        out[..., channel] = np.where(known, np.rint(np.interp(np.where(known, values, 0.0), stops, parts)), 255)
    opacity = [int(str(item.get("alpha", "255"))) for item in items]
    out[..., 3] = np.where(known, np.interp(np.where(known, values, 0.0), stops, opacity), 0)
    return out


def _shaded(height_m: NDArray[np.float32], cell_m: tuple[float, float], renderer: ET.Element) -> NDArray[np.uint8]:
    """Hillshade (Horn 1981, as GDAL's) with the light and the exaggeration of the style."""
    azimuth, above = (np.radians(float(str(renderer.get(key)))) for key in ("azimuth", "angle"))
    known = np.isfinite(height_m)
    if not known.any():
        return np.zeros((*height_m.shape, 4), np.uint8)
    row, column = ndimage.distance_transform_edt(~known, return_distances=False, return_indices=True)
    whole = height_m[row, column].astype(np.float64) * float(str(renderer.get("zfactor")))
    east = ndimage.sobel(whole, axis=1) / (8.0 * cell_m[0])
    north = -ndimage.sobel(whole, axis=0) / (8.0 * cell_m[1])
    towards = np.sin(above) - np.cos(above) * (east * np.sin(azimuth) + north * np.cos(azimuth))
    light = np.clip(towards / np.sqrt(1.0 + east**2 + north**2), 0.0, 1.0)
    grey = np.round(255.0 * light)
    return np.dstack([grey, grey, grey, np.where(known, 255, 0)]).astype(np.uint8)
