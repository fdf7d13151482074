"""The coordinate transformations of a session, with values at its site."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from pyproj import Geod

from furrowmap.core.geodesy.coordinates import JGD2024_SINCE_S, TransformSummary, transform_poses, transform_track
from furrowmap.core.geodesy.crs_choice import choose_crs
from furrowmap.core.geodesy.longitudes import middle_deg
from furrowmap.core.geodesy.projection import MapFrame
from furrowmap.core.readers.reader import GivesPoses, GivesTrack
from furrowmap.core.runtime.errors import InputError
from furrowmap.core.session.opened import open_session
from furrowmap.core.values.clock import iso_utc
from furrowmap.core.values.gnss import Fix
from furrowmap.core.values.rotation import compass_direction

HECTARE_M: Final = 100.0
_JAPAN_RESULTS: Final = ("JGD2011", "JGD2024")
"""Newer databases of PROJ name the horizontal CRS of JGD2011 JGD2024, with the same codes."""


@dataclass(frozen=True)
class SiteCoordinates:
    """The coordinates of a session at the middle of its positions.

    Attributes:
        lon_deg: longitude after the transformation.
        convergence_deg: true heading minus grid heading.
        scale: map distance divided by distance on the ellipsoid.
        hectare_m2: area on the ellipsoid of a square of 100 m × 100 m on the map.
        beside: a more suitable CRS than that of the session, if there is one; else empty.
    """

    frame: MapFrame
    transform: TransformSummary
    lon_deg: float
    lat_deg: float
    easting_m: float
    northing_m: float
    span_s: tuple[float, float]
    convergence_deg: float
    scale: float
    hectare_m2: float
    beside: str

    @property
    def sentences(self) -> list[tuple[str, str]]:
        """Subjects and their descriptions, in the order of the steps."""
        when = f"recorded from {iso_utc(self.span_s[0])} to {iso_utc(self.span_s[1])}"
        on_map = (
            f"{self.frame.name} ({self.frame.whole_crs.name}): easting {self.easting_m:.3f} m, northing "
            f"{self.northing_m:.3f} m; all products have easting first, regardless of the axis order of the authority"
        )
        side = "west" if self.convergence_deg < 0 else "east"
        grid = (
            f"grid north is {abs(self.convergence_deg):.4f}° {side} of true north; 1 km on the ellipsoid is "
            f"{1000 * self.scale:.3f} m on the map"
        )
        areas = (
            f"one hectare on the map is {self.hectare_m2:,.1f} m² on the ellipsoid; layers have both, `area_m2` and "
            "`area_ellipsoid_m2`"
        )
        return [
            ("place", f"{self.lat_deg:.6f}, {self.lon_deg:.6f} (latitude, longitude), {when}"),
            ("positions", self._positions()),
            ("heights", self._heights()),
            ("map", f"{on_map}. {self.beside}" if self.beside else on_map),
            ("grid", grid),
            ("areas", areas),
        ]

    def plain(self) -> dict[str, Any]:
        """For JSON."""
        return {
            **self.transform.account(self.frame),
            "map": self.frame.name,
            "lon_deg": round(self.lon_deg, 9),
            "lat_deg": round(self.lat_deg, 9),
            "easting_m": round(self.easting_m, 3),
            "northing_m": round(self.northing_m, 3),
            "convergence_deg": round(self.convergence_deg, 6),
            "scale": round(self.scale, 8),
            "hectare_m2": round(self.hectare_m2, 3),
            "words": dict(self.sentences),
            "warnings": self.transform.notices,
        }

    def _positions(self) -> str:
        move = self.transform.epoch
        stated = self.frame.stated
        if move is not None:
            across_m = float(np.hypot(move.east_m, move.north_m))
            way = compass_direction(move.east_m, move.north_m)
            rise = "up" if move.up_m > 0 else "down"
            begin = "current epoch" if self.frame.change is None else "frame of the receiver"
            return (
                f"are transformed from the {begin} to that of the map with {move.file}: "
                f"{100 * across_m:.1f} cm {way} "
                f"({100 * move.east_m:+.1f} cm east, {100 * move.north_m:+.1f} cm north) and "
                f"{100 * abs(move.up_m):.1f} cm {rise}, "
                f"varying by at most {1000 * move.spread_m:.1f} mm over the site"
            )
        if stated is not None:
            return f"are not transformed; the CRS of the products is {stated.name}, and maps of other epochs are offset"
        base = self.frame.crs.geodetic_crs
        datum = base.name if base is not None else self.frame.name
        also = ""
        if datum in _JAPAN_RESULTS:
            also = " and JGD2024, which have the same longitudes, latitudes and EPSG code"
        return f"are not transformed; they are taken as coordinates of {datum.replace('JGD2024', 'JGD2011')}{also}"

    def _heights(self) -> str:
        move = self.transform.heights
        system = self.frame.heights
        if move is None and system.vertical is not None:
            return f"are not transformed; they are taken as heights above {system.name} ({system.source})"
        if move is None:
            return f"are ellipsoidal{self._above_the_sea()}"
        low_m, high_m = move.geoid_m
        return (
            f"are transformed to heights above {move.heights} ({move.source}): the geoid is "
            f"{0.5 * (low_m + high_m):.3f} m above the ellipsoid, varying by "
            f"{1000 * (high_m - low_m):.1f} mm over the site"
        )

    def _above_the_sea(self) -> str:
        """The geoid models for a site in Japan."""
        base = self.frame.crs.geodetic_crs
        if base is None or base.name not in _JAPAN_RESULTS:
            return ""
        since = self.span_s[0] >= JGD2024_SINCE_S
        right, when = ("JPGEO2024", "since 1 April 2025") if since else ("GSIGEO2011", "before 1 April 2025")
        return f'; for heights above sea level write `heights = "{right}"`, the geoid model for recordings {when}'


def site_coordinates(session_file: str | Path) -> SiteCoordinates:
    """The coordinates of a session and their transformation. Raises FurrowmapError if they cannot be transformed."""
    opened = open_session(Path(session_file))
    session = opened.session
    frame = opened.frame
    reader = opened.positions()
    if isinstance(reader, GivesPoses) and session.trajectory is not None:
        poses, transform = transform_poses(reader.poses(), frame)
        t_s = poses.t_s
        if poses.projected:
            lon, lat = frame.to_lon_lat(poses.position[:, 0], poses.position[:, 1])
        else:
            lon = poses.position[:, 0]
            lat = poses.position[:, 1]
    else:
        assert isinstance(reader, GivesTrack)
        recorded = reader.track()
        placed = np.isfinite(recorded.lon_deg) & np.isfinite(recorded.lat_deg) & (recorded.fix != Fix.NONE)
        if not placed.any():
            raise InputError("gnss-no-positions", source=recorded.source or "The GNSS log", recorded=len(recorded))
        track, transform = transform_track(recorded[placed], frame)
        lon = track.lon_deg
        lat = track.lat_deg
        t_s = track.t_s
    return _at(frame, transform, *middle_deg(lon, lat), (float(t_s[0]), float(t_s[-1])))


def _at(
    frame: MapFrame, transform: TransformSummary, lon: float, lat: float, span_s: tuple[float, float]
) -> SiteCoordinates:
    here = np.array([lon]), np.array([lat])
    e, n = (float(axis[0]) for axis in frame.project(*here))
    half = 0.5 * HECTARE_M
    corners = frame.to_lon_lat(e + half * np.array([-1, 1, 1, -1]), n + half * np.array([-1, -1, 1, 1]))
    ellipsoid = frame.crs.ellipsoid
    assert ellipsoid is not None
    area_m2, _ = Geod(a=ellipsoid.semi_major_metre, b=ellipsoid.semi_minor_metre).polygon_area_perimeter(*corners)
    choice = choose_crs(lon, lat)
    named = frame.named or frame.crs
    authority = named.to_authority()
    beside = ""
    area = named.area_of_use
    suits = area is None or (
        (lon - area.west) % 360.0 <= (area.east - area.west) % 360.0 and area.south <= lat <= area.north
    )
    if choice is not None and authority is not None and choice.code != ":".join(authority) and not suits:
        beside = f"{choice.code} ({choice.name}) is more suitable at this site"
    return SiteCoordinates(
        frame, transform, lon, lat, e, n, span_s, float(frame.convergence_deg(*here)[0]), frame.scale(lon, lat),
        abs(float(area_m2)), beside,
    )  # fmt: skip
