"""A grid of plots from the corners of a trial."""

from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import shapely
from pyproj import CRS, Proj
from pyproj.exceptions import CRSError

from furrowmap.core.crops.parcel_areas import plot_grid
from furrowmap.core.geodesy.projection import scale_at
from furrowmap.core.readers.areas.area import placed
from furrowmap.core.runtime.errors import InputError, Notice
from furrowmap.core.values.crs import crs_of_file
from furrowmap.core.values.parcel import Parcel
from furrowmap.core.values.plot_grid import PlotGrid
from furrowmap.exporters.files.atomic import refuse_existing
from furrowmap.exporters.vectors.crop_layers import expect_suffix, write_parcels

LOCAL_MAP_DEG: Final = 5.0
"""About the origin of a map that states no area of use."""


@dataclass(frozen=True)
class Place:
    """A point on the map: easting and northing, or longitude and latitude; without a CRS in that of the output."""

    x: float
    y: float
    crs: str | None = None


@dataclass(frozen=True)
class Plots:
    """The plots of a grid in the order of their numbers, in the CRS of the output, and how well the corners fit."""

    parcels: tuple[Parcel, ...]
    crs: str
    warnings: tuple[Notice, ...]


def plots(
    grid: PlotGrid,
    out: str | Path | None,
    crs: str,
    corner: Place,
    *,
    end: Place | None = None,
    azimuth_deg: float | None = None,
    overwrite: bool = False,
) -> Plots:
    """Lay out the plots of a trial.

    Args:
        grid: sizes, in metres on the ground, and numbering.
        out: GeoPackage or GeoJSON; None to write nothing.
        crs: of the output, projected in metres.
        corner: outer corner of the first plot, where the base line begins.
        end: other end of the base line.
        azimuth_deg: instead: direction of the base line, clockwise from grid north.

    Raises:
        InputError: if a CRS is unknown or not projected in metres, a corner is in degrees in such a CRS, or corners and
            sizes make no grid.
        RefusedError: if the file exists.
        UsageError: if the file's name states another format.
    """
    if out is not None:
        expect_suffix(Path(out))
        refuse_existing(Path(out), overwrite=overwrite)
    target = _known(crs)
    if not target.is_projected or {axis.unit_name for axis in target.axis_info[:2]} != {"metre"}:
        raise InputError("crs-not-projected", crs=crs, target=target.name)
    begin = _on_map(corner, target, is_end=False)
    finish = _on_map(end, target, is_end=True) if end is not None else None
    found, notices = plot_grid(grid, begin, finish, azimuth_deg, scale_at(target, *begin.tolist()))
    if out is not None:
        write_parcels(Path(out), found, target)
    return Plots(found, target.to_string(), tuple(notices))


def _on_map(place: Place, target: CRS, *, is_end: bool) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    source = _known(place.crs) if place.crs is not None else target
    if _is_in_degrees(place, source):
        raise InputError("plots-degrees", is_end=is_end, x=place.x, y=place.y, source=source.name)
    point = placed([shapely.Point(place.x, place.y)], source, target, "The corner of the trial")[0]
    return np.array([point.x, point.y])


def _is_in_degrees(place: Place, source: CRS) -> bool:
    """Whether a place in a projected CRS is longitude and latitude, in either order.

    Near the origin of a map its eastings and northings may be as small: there a stated CRS counts.
    """
    if not source.is_projected or max(abs(place.x), abs(place.y)) > 180.0 or min(abs(place.x), abs(place.y)) > 90.0:
        return False
    lon, lat = Proj(source.to_2d())(place.x, place.y, inverse=True)
    area = source.area_of_use
    if area is None:
        box = (lon - LOCAL_MAP_DEG, lat - LOCAL_MAP_DEG, lon + LOCAL_MAP_DEG, lat + LOCAL_MAP_DEG)
    else:
        box = (area.west, area.south, area.east + 360.0 * (area.east < area.west), area.north)
    if not _is_within(box, lon, lat):
        return True
    angles = _is_within(box, place.x, place.y) or _is_within(box, place.y, place.x)
    return angles and place.crs is None


def _is_within(box: tuple[float, float, float, float], lon: float, lat: float) -> bool:
    west, south, east, north = box
    return south <= lat <= north and (west <= lon <= east or west <= lon + 360.0 <= east)


def _known(text: str) -> CRS:
    try:
        return crs_of_file(text)
    except CRSError as error:
        raise InputError("crs-unknown", text=text, error=error) from None
