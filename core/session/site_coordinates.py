"""What will happen to the coordinates of a session, with figures at its site."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from pyproj import CRS, Geod

from furrowmap.core.geodesy.coordinates import JGD2024_SINCE_S, TransformSummary, transform_poses, transform_track
from furrowmap.core.geodesy.crs_choice import choose_crs
from furrowmap.core.geodesy.projection import MapFrame, middle_deg
from furrowmap.core.readers.reader import GivesPoses, GivesTrack
from furrowmap.core.session.opened import open_session
from furrowmap.core.values.clock import iso_utc
from furrowmap.core.values.compass import compass_word
from furrowmap.core.values.errors import InputError
from furrowmap.core.values.gnss import Fix

FloatArray = NDArray[np.float64]

HECTARE_M: Final = 100.0
_JAPAN_RESULTS: Final = ("JGD2011", "JGD2024")
"""Newer databases of PROJ call JGD2011's horizontal CRS by the later name, with the same codes."""


@dataclass(frozen=True)
class SiteCoordinates:
    """A session's coordinates at the middle of its positions.

    Attributes:
        frame: the map.
        brought: what is done to the positions.
        lon_deg, lat_deg: on the map, after that.
        easting_m, northing_m: likewise.
        span_s: time of the positions.
        convergence_deg: true heading less grid heading.
        scale: map distance over distance on the ellipsoid.
        hectare_m2: area on the ellipsoid of a square whose sides are 100 m on the map.
        beside: another CRS that suits the place better than the session's; empty where none does.
    """

    frame: MapFrame
    brought: TransformSummary
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
        """A subject and what is to be said of it, in the order of the steps."""
        return [
            ("place", f"{self.lat_deg:.6f}, {self.lon_deg:.6f} (latitude, longitude), {self._when()}"),
            ("positions", self._positions()),
            ("heights", self._heights()),
            ("map", self._map()),
            ("grid", self._grid()),
            ("areas", self._areas()),
        ]

    def plain(self) -> dict[str, Any]:
        """For JSON."""
        return {
            **self.brought.account(self.frame),
            "map": self.frame.name,
            "lon_deg": round(self.lon_deg, 9),
            "lat_deg": round(self.lat_deg, 9),
            "easting_m": round(self.easting_m, 3),
            "northing_m": round(self.northing_m, 3),
            "convergence_deg": round(self.convergence_deg, 6),
            "scale": round(self.scale, 8),
            "hectare_m2": round(self.hectare_m2, 3),
            "words": dict(self.sentences),
            "warnings": self.brought.notices,
        }

    def _when(self) -> str:
        return f"recorded from {iso_utc(self.span_s[0])} to {iso_utc(self.span_s[1])}"

    def _positions(self) -> str:
        move, stated = self.brought.epoch, self.frame.stated
        if move is not None:
            across_m = float(np.hypot(move.east_m, move.north_m))
            way = compass_word(move.east_m, move.north_m)
            rise = "up" if move.up_m > 0 else "down"
            return (
                f"are moved from the current epoch to the map's with {move.file}: {100 * across_m:.1f} cm to the {way} "
                f"({100 * move.east_m:+.1f} cm east, {100 * move.north_m:+.1f} cm north) and "
                f"{100 * abs(move.up_m):.1f} cm {rise}, "
                f"which differs by {1000 * move.spread_m:.1f} mm at most over the site"
            )
        if stated is not None:
            return (
                f"stay where they are, in {stated.name}, as the products' CRS says; maps of other epochs lie beside it"
            )
        base = self.frame.crs.geodetic_crs
        datum = base.name if base is not None else self.frame.name
        also = ""
        if datum in _JAPAN_RESULTS:
            also = " and of JGD2024, whose longitudes and latitudes are the same, under the same EPSG code"
        return f"stay where they are: they are taken as coordinates of {datum.replace('JGD2024', 'JGD2011')}{also}"

    def _heights(self) -> str:
        move = self.brought.heights
        system = self.frame.heights
        if move is None and system.vertical is not None:
            return f"stay as they are stated: they are taken as heights above {system.name} ({system.source})"
        if move is None:
            return f"stay above the ellipsoid{self._above_the_sea()}"
        low_m, high_m = move.geoid_m
        return (
            f"are brought above {move.heights} ({move.source}): the geoid lies {0.5 * (low_m + high_m):.3f} m above "
            f"the ellipsoid, with {1000 * (high_m - low_m):.1f} mm of difference over the site"
        )

    def _above_the_sea(self) -> str:
        """Which geoids a user in Japan may choose among."""
        base = self.frame.crs.geodetic_crs
        if base is None or base.name not in _JAPAN_RESULTS:
            return ""
        since = self.span_s[0] >= JGD2024_SINCE_S
        right, when = ("JPGEO2024", "from 1 April 2025 on") if since else ("GSIGEO2011", "before 1 April 2025")
        return f'; for heights above the sea write `heights = "{right}"`, the geoid of recordings made {when}'

    def _map(self) -> str:
        words = (
            f"{self.frame.name} ({self.frame.whole_crs.name}): easting {self.easting_m:.3f} m, northing "
            f"{self.northing_m:.3f} m; easting comes first in all products, whatever the authority's order is"
        )
        return f"{words}. {self.beside}" if self.beside else words

    def _grid(self) -> str:
        side = "west" if self.convergence_deg < 0 else "east"
        return (
            f"north of the grid lies {abs(self.convergence_deg):.4f}° {side} of true north; 1 km on the ground is "
            f"{1000 * self.scale:.3f} m on the map"
        )

    def _areas(self) -> str:
        return (
            f"one hectare of the map is {self.hectare_m2:,.1f} m² on the ellipsoid; layers hold both, `area_m2` and "
            "`area_ellipsoid_m2`"
        )


def site_coordinates(session_file: Path) -> SiteCoordinates:
    """What a session's coordinates are and what will be done to them.

    Raises:
        FurrowmapError: as the run would, if they cannot be brought to the map.
    """
    opened = open_session(session_file)
    session, frame, reader = opened.session, opened.frame, opened.positions()
    if isinstance(reader, GivesPoses) and session.trajectory is not None:
        poses, brought = transform_poses(reader.poses(), frame)
        t_s = poses.t_s
        if poses.projected:
            lon, lat = frame.to_lon_lat(poses.position[:, 0], poses.position[:, 1])
        else:
            lon, lat = poses.position[:, 0], poses.position[:, 1]
    else:
        assert isinstance(reader, GivesTrack)
        recorded = reader.track()
        placed = np.isfinite(recorded.lon_deg) & np.isfinite(recorded.lat_deg) & (recorded.fix != Fix.NONE)
        if not placed.any():
            raise InputError(
                f"{recorded.source or 'The GNSS log'}: none of its {len(recorded)} epochs has a position.",
                "Where the site is cannot be told.",
                "Use the whole log of the drive; `furrowmap inspect` says what it holds.",
                code="gnss-no-positions",
            )
        track, brought = transform_track(recorded[placed], frame)
        lon, lat, t_s = track.lon_deg, track.lat_deg, track.t_s
    return _at(frame, brought, *middle_deg(lon, lat), (float(t_s[0]), float(t_s[-1])))


def _at(
    frame: MapFrame, brought: TransformSummary, lon: float, lat: float, span_s: tuple[float, float]
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
    if (
        choice is not None
        and authority is not None
        and choice.code != ":".join(authority)
        and not _suits(named, lon, lat)
    ):
        beside = f"{choice.code} ({choice.name}) suits the place better"
    return SiteCoordinates(
        frame, brought, lon, lat, e, n, span_s, float(frame.convergence_deg(*here)[0]), frame.scale(lon, lat),
        abs(float(area_m2)), beside,
    )  # fmt: skip


def _suits(crs: CRS, lon: float, lat: float) -> bool:
    """Whether the place lies within the CRS's area of use."""
    area = crs.area_of_use
    if area is None:
        return True
    return bool((lon - area.west) % 360.0 <= (area.east - area.west) % 360.0 and area.south <= lat <= area.north)
