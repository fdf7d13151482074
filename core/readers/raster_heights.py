"""The heights of a GeoTIFF of any software in metres, whatever its scale, its offset, its unit and its nodata."""

import math
import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Final

import numpy as np
from pyproj import CRS
from pyproj.database import get_units_map

from furrowmap.core.geodesy.longitudes import expect_degrees, unwrapped_deg
from furrowmap.core.readers.geotiff import HEIGHT_BAND_NAME, expect_heights, open_geotiff, short_keys
from furrowmap.core.readers.vertical_keys import heights_by_keys, with_heights
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import InputError, Notice
from furrowmap.core.runtime.languages.texts import Text, Words
from furrowmap.core.runtime.memory import expect_disk
from furrowmap.core.runtime.write_errors import scratch_directory, writing_scratch
from furrowmap.core.values.height_units import expect_upward, in_metres, vertical_unit_m
from furrowmap.core.values.no_heights import NO_HEIGHT_BEYOND_M, NO_HEIGHTS, far_from_heights

_SAME_FOOT: Final = 1e-5
"""'ft' is written for both feet, which differ by 2e-6: the CRS then says which."""
_WINDOW_CELLS: Final = 1 << 20
_LOOKED_AT_CELLS: Final = 50_000_000
"""Of a larger raster every n-th window is looked at for numbers that are no heights."""
_UNITS_M: Final = {
    "m": 1.0, "meter": 1.0, "meters": 1.0, "metre": 1.0, "metres": 1.0,
    "dm": 0.1, "decimeter": 0.1, "decimeters": 0.1, "decimetre": 0.1, "decimetres": 0.1,
    "cm": 0.01, "centimeter": 0.01, "centimeters": 0.01, "centimetres": 0.01,
    "mm": 0.001, "millimeter": 0.001, "millimeters": 0.001, "millimetres": 0.001,
    "km": 1000.0, "kilometer": 1000.0, "kilometers": 1000.0, "kilometres": 1000.0,
    "ft": 0.3048, "feet": 0.3048, "international foot": 0.3048, "international feet": 0.3048,
    "foot us": 1200 / 3937, "us foot": 1200 / 3937, "us ft": 1200 / 3937, "us feet": 1200 / 3937, "ftus": 1200 / 3937,
    "us survey ft": 1200 / 3937, "us survey feet": 1200 / 3937, "survey foot": 1200 / 3937, "survey feet": 1200 / 3937,
    "sft": 1200 / 3937, "usft": 1200 / 3937, "ussurvey foot": 1200 / 3937, "ussurvey feet": 1200 / 3937,
    "u s survey foot": 1200 / 3937, "u s survey feet": 1200 / 3937, "yd": 0.9144, "in": 0.0254, "inch": 0.0254,
}  # fmt: skip
"""Metres in the units that GDAL's bands state; those of EPSG, such as 'foot', go by their names there."""


@dataclass(frozen=True)
class HeightScale:
    """What the numbers of a raster's first band mean.

    Attributes:
        crs: of the raster, with heights in metres; None where it has none.
        unit_m: metres in the unit that the file states.
        factor: a height in metres is a number times this plus `shift_m`.
        no_heights: numbers that the file does not declare as nodata, but that lie far from all heights.
        seen: whether there are such numbers.
        notices: what differs from heights in metres.
    """

    crs: CRS | None
    unit_m: float
    factor: float
    shift_m: float
    no_heights: tuple[float, ...]
    seen: bool
    notices: tuple[Notice, ...]

    @property
    def plain(self) -> bool:
        """Whether the numbers are heights in metres, as far as they have been looked at."""
        return self.factor == 1.0 and self.shift_m == 0.0 and not self.seen

    def heights_m(self, numbers: Any) -> FloatArray:
        """Heights of numbers of the band, a masked array as rasterio reads them: nan where there is none."""
        heights = np.ma.filled(numbers.astype(np.float64), np.nan)
        if self.no_heights:
            heights[np.isin(heights, self.no_heights)] = np.nan
        out: FloatArray = heights * self.factor + self.shift_m
        out[np.isinf(out)] = np.nan
        if self.seen:
            out[np.abs(out) > NO_HEIGHT_BEYOND_M] = np.nan
        return out


@dataclass(frozen=True)
class HeightRaster:
    """An open GeoTIFF whose first band is heights."""

    dataset: Any
    scale: HeightScale
    crs: CRS
    """With heights in metres."""

    def columns_rows(self, x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Columns and rows (n,), with fractions from the raster's corner, of places (n,) in its CRS."""
        dataset = self.dataset
        if self.crs.is_geographic:
            x = unwrapped_deg(x, 0.5 * (dataset.bounds.left + dataset.bounds.right))
        a, b, c, d, e, f = (~dataset.transform)[:6]
        return a * x + b * y + c, d * x + e * y + f

    def read_m(self, rows: tuple[int, int], columns: tuple[int, int]) -> FloatArray:
        """Heights (rows, columns) in metres from a first row and column to before a last; nan where there is none.

        They may lie beside the raster. rasterio's own boundless reading takes wrong cells of turned rasters (1.4).
        """
        out = np.full((rows[1] - rows[0], columns[1] - columns[0]), np.nan)
        top = max(rows[0], 0)
        bottom = min(rows[1], self.dataset.height)
        left = max(columns[0], 0)
        right = min(columns[1], self.dataset.width)
        if top < bottom and left < right:
            numbers = self.dataset.read(1, window=((top, bottom), (left, right)), masked=True)
            inside = np.s_[top - rows[0] : bottom - rows[0], left - columns[0] : right - columns[0]]
            out[inside] = self.scale.heights_m(numbers)
        return out


@contextmanager
def open_heights(path: Path, unusable: Callable[[Path, Words], InputError]) -> Iterator[HeightRaster]:
    """A GeoTIFF of heights above a datum, of any software; rotated or sheared cells are as the transform says.

    Raises:
        InputError: as :func:`~furrowmap.core.readers.geotiff.open_geotiff`, or if it has no CRS, holds something else
            than heights, or states a unit that is none of length.
    """
    with open_geotiff(path, unusable) as raster:
        expect_known_heights(raster, path, unusable)
        scale = height_scale(raster, path)
        assert scale.crs is not None
        if scale.crs.is_geographic:
            expect_degrees(path, np.array(raster.bounds).reshape(2, 2), scale.crs, "layer")
        yield HeightRaster(raster, scale, scale.crs)


def expect_known_heights(raster: Any, path: Path, unusable: Callable[[Path, Words], InputError]) -> None:
    """Raises InputError where the first band of an open raster is no heights, or states a unit that is none of length.

    Errors as :func:`~furrowmap.core.readers.geotiff.expect_heights`.
    """
    expect_heights(raster, path, unusable)
    if raster.units[0] and _unit_m(raster.units[0]) is None:
        raise unusable(
            path, Text("states its heights in {unit!r}, which is no known unit of length", unit=raster.units[0])
        )


def height_scale(raster: Any, path: Path) -> HeightScale:
    """What the numbers of an open raster's first band mean; a band that states another unit holds no heights."""
    crs = CRS.from_wkt(raster.crs.to_wkt()) if raster.crs is not None else None
    stated = raster.units[0] or ""
    number_scale = float(raster.scales[0])
    offset = float(raster.offsets[0])
    if not _may_hold_heights(raster):
        return HeightScale(crs, 1.0, number_scale, offset, (), seen=False, notices=())
    if crs is not None:
        expect_upward(crs, path)
    crs, stated, odd = _in_unit_of_keys(crs, stated, path)
    unit_m, notices = _height_unit(crs, stated, path)
    notices = [*odd, *notices]
    factor = number_scale * unit_m
    shift_m = offset * unit_m
    if unit_m != 1.0:
        notices.append(Notice("heights-in-feet", unit_m=unit_m))
    no_heights, seen = _undeclared(raster, factor, shift_m)
    if seen:
        values = ", ".join(f"{value:.7g}" for value in seen[:5]) + (", …" if len(seen) > 5 else "")
        notices.append(Notice("nodata-undeclared", path=path.name, values=values))
    return HeightScale(in_metres(crs), unit_m, factor, shift_m, no_heights, seen=bool(seen), notices=tuple(notices))


@contextmanager
def plain_heights(raster: Any, scale: HeightScale, path: Path) -> Iterator[Any]:
    """A dataset whose first band is heights in metres and whose nodata is nan: for GDAL's warping.

    It is the raster itself where its heights are so already, else a temporary file.
    """
    if scale.plain:
        yield raster
        return
    import rasterio

    count = raster.count
    kind = "float64" if np.dtype(raster.dtypes[0]).itemsize > 2 else "float32"
    with scratch_directory() as folder:
        copy = folder / "heights.tif"
        expect_disk(path, folder, raster.width * raster.height * count * np.dtype(kind).itemsize)
        profile = {
            "width": raster.width, "height": raster.height, "count": count, "dtype": kind,
            "crs": raster.crs, "transform": raster.transform, "nodata": math.nan, "BIGTIFF": "IF_SAFER",
        }  # fmt: skip
        with writing_scratch(), rasterio.open(copy, "w", driver="GTiff", **profile) as out:
            for window in _windows(raster):
                bands = raster.read(window=window, masked=True)
                for band in range(1, count + 1):
                    values = scale.heights_m(bands[0]) if band == 1 else bands[band - 1].astype(kind).filled(math.nan)
                    out.write(values.astype(kind), band, window=window)
        with rasterio.open(copy, driver="GTiff") as plain:
            yield plain


def _may_hold_heights(raster: Any) -> bool:
    """Whether the first band is heights, as far as a file says."""
    ours = raster.tags().get("TIFFTAG_SOFTWARE", "").startswith("furrowmap")
    return (raster.descriptions[0] == HEIGHT_BAND_NAME or not ours) and (
        not raster.units[0] or _unit_m(raster.units[0]) is not None
    )


def _in_unit_of_keys(crs: CRS | None, stated: str, path: Path) -> tuple[CRS | None, str, tuple[Notice, ...]]:
    """A compound CRS whose heights have the unit of the file's keys, and the band's unit where it is the file's own.

    GDAL drops the unit of keys beside the code of a vertical CRS, and gives bands without a unit that of the CRS.
    """
    if crs is None or not crs.is_compound:
        return crs, stated, ()
    heights, odd = heights_by_keys(path.name, short_keys(path), crs)
    changed = crs if heights is None else with_heights(crs, heights)
    before_m = vertical_unit_m(crs) or 1.0
    if math.isclose(before_m, vertical_unit_m(changed) or 1.0, rel_tol=_SAME_FOOT):
        return crs, stated, ()
    derived = math.isclose(_unit_m(stated) or before_m, before_m, rel_tol=_SAME_FOOT)
    return changed, "" if derived else stated, odd


def _height_unit(crs: CRS | None, stated: str, path: Path) -> tuple[float, list[Notice]]:
    """Metres in the unit of heights: that of the band, else of the CRS, as a cloud's."""
    by_band = _unit_m(stated) if stated else None
    by_crs = vertical_unit_m(crs) if crs is not None else None
    if by_band is None:
        return by_crs or 1.0, []
    if by_crs is None or crs is None or not (crs.is_compound or len(crs.axis_info) > 2):
        return by_band, []
    if math.isclose(by_band, by_crs, rel_tol=_SAME_FOOT):
        return by_crs, []
    names = {"stated_by": f"'{stated}'", "other_by": crs.name}
    return by_band, [Notice("height-units-differ", path=path.name, unit_m=by_band, other_m=by_crs, **names)]


def _unit_m(text: str) -> float | None:
    """Metres in a unit of length by its name; None for no such unit."""
    words = " ".join(re.sub(r"[^a-z]+", " ", text.lower()).split())
    return _UNITS_M.get(words, _units_of_epsg().get(words))


@cache
def _units_of_epsg() -> dict[str, float]:
    units = get_units_map(auth_name="EPSG", category="linear")
    return {" ".join(re.sub(r"[^a-z]+", " ", name.lower()).split()): one.conv_factor for name, one in units.items()}


def _undeclared(raster: Any, factor: float, shift_m: float) -> tuple[tuple[float, ...], list[float]]:
    """Numbers far from all heights that are no heights though the file does not say so, and which of them are there."""
    kind = np.dtype(raster.dtypes[0])
    if kind.kind not in "iuf" or (kind.kind == "f" and _is_ours(raster)) or factor == 0.0:
        return (), []
    ends = (float(np.iinfo(kind).min), float(np.iinfo(kind).max)) if kind.kind in "iu" else ()
    candidates = np.unique([*NO_HEIGHTS, *ends])
    low = math.inf
    high = -math.inf
    seen: set[float] = set()
    windows = list(_windows(raster))
    for window in windows[:: max(1, math.ceil(raster.width * raster.height / _LOOKED_AT_CELLS))]:
        numbers = raster.read(1, window=window, masked=True).compressed().astype(np.float64)
        seen.update(np.unique(numbers[np.isinf(numbers)]).tolist())
        numbers = numbers[np.isfinite(numbers)]
        odd = np.isin(numbers, candidates) | (np.abs(numbers * factor + shift_m) > NO_HEIGHT_BEYOND_M)
        heights = numbers[~odd]
        if len(heights):
            low = min(low, float(heights.min()))
            high = max(high, float(heights.max()))
        seen.update(np.unique(numbers[odd])[:1000].tolist())
    far = far_from_heights(candidates, low, high, factor, with_zero=0.0 in seen)
    named = sorted(one for one in seen if one in far or abs(one * factor + shift_m) > NO_HEIGHT_BEYOND_M)
    return tuple(far.tolist()), named


def _is_ours(raster: Any) -> bool:
    """Whether furrowmap wrote it, with nan where there is no height, and nobody changed that."""
    ours = raster.tags().get("TIFFTAG_SOFTWARE", "").startswith("furrowmap")
    return ours and raster.nodata is not None and math.isnan(raster.nodata)


def _windows(raster: Any) -> Iterator[Any]:
    """Windows of whole blocks that cover a raster, each of about a million cells."""
    from rasterio.windows import Window

    rows, columns = raster.block_shapes[0]
    more = max(1, _WINDOW_CELLS // (rows * columns))
    if columns >= raster.width:
        rows *= more
    else:
        columns *= more
    for top in range(0, raster.height, rows):
        for left in range(0, raster.width, columns):
            yield Window(left, top, min(columns, raster.width - left), min(rows, raster.height - top))
