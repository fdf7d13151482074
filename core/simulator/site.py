"""Location and size of the simulated field."""

from __future__ import annotations

import datetime as dt
import functools
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import msgspec
import numpy as np

from furrowmap.core.runtime.errors import InputError
from furrowmap.core.simulator.drive import DrivenPath
from furrowmap.core.simulator.noise import FloatArray
from furrowmap.core.simulator.scenario import Scenario, ScenarioField

if TYPE_CHECKING:
    from pyproj import Transformer

CELL_M: Final = 0.025
"""Cell size of the simulated ground; the ground truth has cells twice as large."""
CROP_CELL_M: Final = 0.02
"""Cell size of the crop on it; its truth has cells twice as large, as wide as the pixels that crops are measured in."""
MAX_SITE_CELLS: Final = 80_000_000
"""Five hectares; the ground takes about 40 bytes per cell during its computation."""


def lay_out(scenario: Scenario, path: DrivenPath) -> Scenario:
    """`scenario` with the ground, the start and the boundary laid round the drive where they are not stated.

    InputError if the ground would be too large to hold.
    """
    lane = math.radians(90.0 - scenario.drive.lane_heading_deg)
    east = path.u_m * math.cos(lane) - path.v_m * math.sin(lane)
    north = path.u_m * math.sin(lane) + path.v_m * math.cos(lane)
    size, start = lay_round(scenario.field, scenario.drive.start_xy_m, east, north)
    half = 0.5 * scenario.implement.width_m + 0.8
    round_the_drive = (path.u_m.min() - half, path.u_m.max() + half, path.v_m.min() - half, path.v_m.max() + half)
    boundary = tuple(
        round(float(value), 1) if math.isnan(stated) else stated
        for value, stated in zip(round_the_drive, scenario.field.boundary_uv_m, strict=True)
    )
    replace = msgspec.structs.replace
    field = replace(scenario.field, size_e_m=size[0], size_n_m=size[1], boundary_uv_m=boundary)
    return replace(scenario, field=field, drive=replace(scenario.drive, start_xy_m=start))


def lay_round(
    field: ScenarioField, start_xy_m: tuple[float, float], east: FloatArray, north: FloatArray
) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Size of the ground, and the start on it, as stated or laid round a way from the start, (n,) east and north.

    InputError if the ground would be too large to hold.
    """
    size = tuple(
        math.ceil(np.ptp(values) + 2.0 * field.margin_m) if math.isnan(stated) else stated
        for values, stated in ((east, field.size_e_m), (north, field.size_n_m))
    )
    start = tuple(
        round(0.5 * whole - 0.5 * float(values.min() + values.max()), 3) if math.isnan(stated) else stated
        for values, whole, stated in zip((east, north), size, start_xy_m, strict=True)
    )
    if size[0] * size[1] / CELL_M**2 > MAX_SITE_CELLS:
        raise InputError(
            "scenario-too-large",
            east_m=size[0],
            north_m=size[1],
            cell_m=CELL_M,
            most_cells=MAX_SITE_CELLS * CELL_M**2 / 10000.0,
        )
    return size, start


@dataclass(frozen=True)
class SimulatedSite:
    """Georeference of the local frame.

    Attributes:
        e0_m, n0_m: map coordinates of the local origin, whole metres.
        h0_m: ellipsoidal height of the local origin.
        t0_us: microseconds of UTC since 1970 of the local time's origin.
    """

    crs: str
    e0_m: float
    n0_m: float
    h0_m: float
    geoid_m: float
    t0_us: int

    @property
    def t0_s(self) -> float:
        """Local time's origin in seconds of UTC since 1970."""
        return self.t0_us / 1e6

    def utc(self, t_s: float) -> dt.datetime:
        """UTC of a local time."""
        return dt.datetime(1970, 1, 1, tzinfo=dt.UTC) + dt.timedelta(microseconds=self.t0_us + round(t_s * 1e6))

    def geographic(self, e_m: FloatArray, n_m: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(longitude, latitude) in degrees of local positions, in the map CRS's own datum."""
        lon, lat = _to_degrees(self.crs).transform(np.asarray(e_m) + self.e0_m, np.asarray(n_m) + self.n0_m)
        return np.asarray(lon, np.float64), np.asarray(lat, np.float64)

    def earth_m(self, xyz_m: FloatArray) -> FloatArray:
        """(n, 3) earth-centred, earth-fixed coordinates of local positions (n, 3)."""
        lon, lat = (np.radians(a) for a in self.geographic(xyz_m[:, 0], xyz_m[:, 1]))
        a, square = _ellipsoid(self.crs)
        height = xyz_m[:, 2] + self.h0_m
        across = a / np.sqrt(1.0 - square * np.sin(lat) ** 2)
        out: FloatArray = np.column_stack([
            (across + height) * np.cos(lat) * np.cos(lon),
            (across + height) * np.cos(lat) * np.sin(lon),
            (across * (1.0 - square) + height) * np.sin(lat),
        ])  # fmt: skip
        return out

    def earth_axes(self, xyz_m: FloatArray) -> FloatArray:
        """(n, 3, 3) grid east, grid north and up at local positions (n, 3), as columns in earth-centred axes."""
        lon, lat = (np.radians(a) for a in self.geographic(xyz_m[:, 0], xyz_m[:, 1]))
        up = np.column_stack([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)])
        step = np.array([0.0, 50.0, 0.0])
        north = self.earth_m(xyz_m + step) - self.earth_m(xyz_m - step)
        north -= (north * up).sum(axis=1, keepdims=True) * up
        north /= np.linalg.norm(north, axis=1, keepdims=True)
        return np.stack([np.cross(north, up), north, up], axis=-1)

    def map_scale(self, xyz_m: FloatArray) -> float:
        """Metres of the map for a metre on the ground, at a local position (3,)."""
        step = np.array([50.0, 0.0, 0.0])
        ends = self.earth_m(np.stack([xyz_m - step, xyz_m + step]))
        return float(100.0 / np.linalg.norm(ends[1] - ends[0]))

    def convergence_deg(self, e_m: FloatArray, n_m: FloatArray) -> FloatArray:
        """Direction of grid north seen from true north, clockwise positive, at local positions."""
        lon0, lat0 = self.geographic(e_m, n_m)
        lon1, lat1 = self.geographic(e_m, np.asarray(n_m) + 10.0)
        return np.degrees(np.arctan2((lon1 - lon0) * np.cos(np.radians(lat0)), lat1 - lat0))


@functools.cache
def _ellipsoid(crs: str) -> tuple[float, float]:
    """Semi-major axis, and square of the first eccentricity."""
    from pyproj import CRS

    geod = CRS(crs).get_geod()
    assert geod is not None
    return geod.a, geod.es


@functools.cache
def _to_degrees(crs: str) -> Transformer:
    from pyproj import CRS, Transformer

    return Transformer.from_crs(crs, CRS(crs).geodetic_crs, always_xy=True)


def find_site(scenario: Scenario) -> SimulatedSite:
    """The site of a scenario; InputError if the CRS is unknown, not projected, or not good at the place."""
    from pyproj import CRS, Transformer
    from pyproj.exceptions import CRSError, ProjError

    place = scenario.place
    try:
        crs = CRS(place.crs)
        to_map = Transformer.from_crs(crs.geodetic_crs, crs, always_xy=True)
        e, n = to_map.transform(*place.lon_lat_deg, errcheck=True)
    except (CRSError, ProjError) as error:
        raise InputError(
            "scenario-crs.unusable-there", crs=place.crs, lon_lat_deg=list(place.lon_lat_deg), error=error
        ) from error
    if not crs.is_projected:
        raise InputError("scenario-crs", crs=place.crs)
    return SimulatedSite(place.crs, float(round(e)), float(round(n)), place.height_m, place.geoid_m, scenario.t0_us)
