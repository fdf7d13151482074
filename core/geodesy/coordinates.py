"""Transformation of recorded positions to the frame, epoch and heights of the map, with a record of each step."""

from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
from pyproj import CRS

from furrowmap.core.geodesy.longitudes import middle_deg
from furrowmap.core.geodesy.projection import GEOIDS_OF_JAPAN, MapFrame, height_system
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import InputError, Notice, RefusedError
from furrowmap.core.values.clock import iso_utc
from furrowmap.core.values.crs import LARGEST_DATUM_SHIFT_M, datum_shift_m, name_of
from furrowmap.core.values.gnss import Fix, GnssTrack
from furrowmap.core.values.pose_track import PoseTrack

JGD2000_UNTIL_S: Final = 1_319_122_800.0
"""21 October 2011 in Japan: since then survey results and network corrections are in JGD2011."""
JGD2024_SINCE_S: Final = 1_743_433_200.0
"""1 April 2025 in Japan: from then on survey results and network corrections are in JGD2024."""
YEAR_S: Final = 31_556_952.0
FAR_DEG: Final = 1.0
"""Positions this far from the median are receiver errors and stay unchanged."""
OF_TODAY: Final = frozenset({"clas", "madoca", "ppp", "ppp-rtk"})
"""Services whose positions are in the satellite frame at the current epoch."""
DEGREES_OF_A_DRIVE: Final = 0.5
"""Eastings and northings within the range of degrees that vary by less than this raise a notice."""
EPOCH_APART: Final = 1.0
"""Years between a stated epoch and the recording beyond which a notice is raised."""


@dataclass(frozen=True)
class EpochMove:
    """Shift of the positions by a parameter file: the mean along the map axes, and the greatest deviation from it."""

    file: str
    east_m: float
    north_m: float
    up_m: float
    spread_m: float


@dataclass(frozen=True)
class HeightMove:
    """Change of the heights by a geoid model or grid; least and greatest geoid height that was subtracted."""

    heights: str
    source: str
    geoid_m: tuple[float, float]


@dataclass(frozen=True)
class TransformSummary:
    """Steps of a transformation; `epoch` and `heights` are None where nothing changed."""

    epoch: EpochMove | None = None
    heights: HeightMove | None = None
    notices: tuple[Notice, ...] = ()

    def account(self, frame: MapFrame) -> dict[str, Any]:
        """For `report.json`: the coordinate system and every step applied."""
        base = frame.crs.geodetic_crs
        epoch = self.epoch
        heights = self.heights
        moves: list[dict[str, Any]] = []
        if epoch is not None:
            moves.append(
                {
                    "step": "epoch",
                    "parameters": epoch.file,
                    "east_m": round(epoch.east_m, 4),
                    "north_m": round(epoch.north_m, 4),
                    "up_m": round(epoch.up_m, 4),
                    "spread_m": round(epoch.spread_m, 4),
                }
            )
        if heights is not None:
            low, high = heights.geoid_m
            moves.append(
                {
                    "step": "heights",
                    "geoid": heights.heights,
                    "source": heights.source,
                    "up_m": round(-0.5 * (low + high), 4),
                    "geoid_m": [round(low, 4), round(high, 4)],
                }
            )
        return {
            "crs": frame.whole_crs.name,
            "wkt": frame.wkt,
            "frame": base.name if base is not None else None,
            "epoch": frame.stated.epoch if frame.stated is not None else None,
            "heights": frame.heights.name,
            "moves": moves,
        }


UNCHANGED: Final = TransformSummary()


def transform_track(track: GnssTrack, frame: MapFrame) -> tuple[GnssTrack, TransformSummary]:
    """A GNSS track in the frame, epoch and heights of the map.

    InputError if parameters or geoid do not cover a position, or the parameters are of another year; RefusedError if
    the datum of the map is not one of satellite positioning.
    """
    lon, lat, height, done = _transform(frame, track.t_s, track.lon_deg, track.lat_deg, track.height_m)
    by_ppp = track.service in OF_TODAY or bool(np.mean(track.fix == Fix.PPP) > 0.5)
    if by_ppp and frame.as_recorded and frame.stated is None:
        service = track.service.upper() or "PPP"
        notice = Notice("epoch-of-the-day", source=track.source, service=service, frame=frame.name)
        done = replace(done, notices=(notice, *done.notices))
    return replace(track, lon_deg=lon, lat_deg=lat, height_m=height), done


def transform_poses(track: PoseTrack, frame: MapFrame) -> tuple[PoseTrack, TransformSummary]:
    """Poses of a trajectory file, those in map coordinates unchanged; errors as :func:`transform_track`."""
    if track.projected:
        en = track.position[:, :2]
        if bool(((np.abs(en) <= (180.0, 90.0)) & (np.ptp(en, axis=0) < DEGREES_OF_A_DRIVE)).all()):
            return track, TransformSummary(
                notices=(
                    Notice("coordinates-look-like-degrees", source=track.source, easting=en[0, 0], northing=en[0, 1]),
                )
            )
        if frame.as_recorded and frame.heights.vertical is None:
            return track, UNCHANGED
        return track, TransformSummary(notices=(Notice("coordinates-of-the-map", source=track.source),))
    lon, lat, height, done = _transform(frame, track.t_s, *track.position.T)
    return replace(track, position=np.column_stack([lon, lat, height])), done


def places_on_map(t_s: FloatArray, lon_lat_h: FloatArray, frame: MapFrame) -> tuple[FloatArray, TransformSummary]:
    """Easting, northing and height of places; nan where one is not known. Errors as :func:`transform_track`.

    Args:
        t_s: (n,) times in Unix seconds, which do not decrease.
        lon_lat_h: (n, 3) longitude and latitude in degrees and ellipsoidal height in metres.

    Returns:
        (n, 3) metres on the map, and the steps of the transformation.
    """
    known = np.isfinite(lon_lat_h).all(axis=1)
    out = np.full((len(t_s), 3), np.nan)
    if not known.any():
        return out, UNCHANGED
    lon, lat, height, done = _transform(frame, t_s[known], *lon_lat_h[known].T)
    out[known] = np.column_stack([*frame.project(lon, lat), height])
    return out, done


def _transform(
    frame: MapFrame, t_s: FloatArray, lon_deg: FloatArray, lat_deg: FloatArray, height_m: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, TransformSummary]:
    known = np.isfinite(lon_deg) & np.isfinite(lat_deg)
    if not known.any():
        return lon_deg, lat_deg, height_m, UNCHANGED
    middle = middle_deg(lon_deg[known], lat_deg[known])
    with np.errstate(invalid="ignore"):
        known &= np.abs((lon_deg - middle[0] + 180.0) % 360.0 - 180.0) < FAR_DEG
        known &= np.abs(lat_deg - middle[1]) < FAR_DEG
    lon = lon_deg[known]
    lat = lat_deg[known]
    height = height_m[known]
    notices = []
    if frame.unused is not None:
        notices.append(Notice("heights-not-asked-for", unused=frame.unused.name, code=name_of(frame.unused)))
    notices += _epoch_notices(frame, t_s[known])
    if frame.stated is None:
        notices += check_datum(frame.crs, frame.name, *middle, float(np.median(t_s[known])))
    epoch = None
    if frame.parameters is not None:
        holds = frame.parameters.holds_s
        first_s = t_s[known][0]
        last_s = t_s[known][-1]
        if holds is not None and not (holds[0] <= first_s and last_s < holds[1]):
            raise InputError(
                "epoch-out-of-range",
                parameters=frame.parameters.name,
                holds=iso_utc(holds[0]),
                holds_other=iso_utc(holds[1]),
                first_time=iso_utc(first_s),
                last_time=iso_utc(last_s),
            )
        before = np.column_stack([*frame.project(lon, lat), np.zeros(len(lon))])
        lon, lat, up = frame.parameters.to_map(lon, lat, np.zeros(len(lon)))
        height = height + up
        epoch = _epoch_move(frame.parameters.name, np.column_stack([*frame.project(lon, lat), up]) - before)
    elif frame.change is not None:
        before = np.column_stack([*frame.project(lon, lat), np.zeros(len(lon))])
        lon, lat, up = frame.change.to_map(t_s[known], lon, lat, height)
        height = height + up
        epoch = _epoch_move(frame.change.name, np.column_stack([*frame.project(lon, lat), up]) - before)
    heights = None
    if frame.heights.vertical is not None:
        geoid = frame.heights.geoid_m(lon, lat)
        missing = np.flatnonzero(~np.isfinite(geoid))
        if len(missing):
            raise InputError(
                "geoid-outside",
                heights=frame.heights.name,
                lat_deg=lat[missing[0]],
                lon_deg=lon[missing[0]],
                missing=len(missing) - 1,
                positions=len(geoid),
            )
        height = height - geoid
        heights = HeightMove(frame.heights.name, frame.heights.source, (float(geoid.min()), float(geoid.max())))
        notices += _mixed(frame, t_s[known], *middle_deg(lon, lat))
    out = [column.copy() for column in (lon_deg, lat_deg, height_m)]
    for column, values in zip(out, (lon, lat, height), strict=True):
        column[known] = values
    return out[0], out[1], out[2], TransformSummary(epoch, heights, tuple(notices))


def _epoch_move(name: str, moved_m: FloatArray) -> EpochMove:
    """The mean of shifts (n, 3), and the greatest deviation from it."""
    mean = moved_m.mean(axis=0)
    spread = float(np.linalg.norm(moved_m - mean, axis=1).max())
    return EpochMove(name, float(mean[0]), float(mean[1]), float(mean[2]), spread)


def check_datum(crs: CRS, name: str, lon_deg: float, lat_deg: float, time_s: float) -> list[Notice]:
    """Notices about the datum of a map for satellite positions at a site and time.

    RefusedError if it is far from theirs.
    """
    base = crs.geodetic_crs
    if base is None:
        return []
    apart = datum_shift_m(base, round(lon_deg, 1), round(lat_deg, 1))
    if apart is not None and apart > LARGEST_DATUM_SHIFT_M:
        if np.isinf(apart):
            raise RefusedError("crs-datum.unknown", name=name, base=base.name)
        raise RefusedError("crs-datum", name=name, base=base.name, apart_m=apart, lat_deg=lat_deg, lon_deg=lon_deg)
    if base.name == "JGD2000" and time_s > JGD2000_UNTIL_S:
        return [Notice("datum-superseded", name=name)]
    return []


def _epoch_notices(frame: MapFrame, t_s: FloatArray) -> list[Notice]:
    """Notices of parameters without a year, and of a stated epoch far from that of the recording."""
    if frame.parameters is not None and frame.parameters.holds_s is None:
        return [Notice("epoch-unchecked", parameters=frame.parameters.name)]
    recorded = 1970.0 + float(np.median(t_s)) / YEAR_S
    if frame.stated is not None and abs(frame.stated.epoch - recorded) > EPOCH_APART:
        return [Notice("epoch-apart", epoch=frame.stated.epoch, recorded=recorded)]
    return []


def _mixed(frame: MapFrame, t_s: FloatArray, lon_deg: float, lat_deg: float) -> list[Notice]:
    """Notice where a geoid of Japan is combined with ellipsoidal heights of another realisation."""
    belongs = GEOIDS_OF_JAPAN.get(frame.heights.name)
    if belongs is None:
        return []
    stated = frame.stated.name if frame.stated is not None else None
    holds_s = frame.parameters.holds_s if frame.parameters is not None else None
    at_s = holds_s[0] if holds_s is not None else float(np.median(t_s))
    results = None if stated is not None else "JGD2024" if at_s >= JGD2024_SINCE_S else "JGD2011"
    if results == belongs:
        return []
    base = frame.crs.geodetic_crs or frame.crs
    here = np.array([lon_deg]), np.array([lat_deg])
    both = [float(height_system(name, base).geoid_m(*here)[0]) for name in GEOIDS_OF_JAPAN]
    return [
        Notice(
            "epoch-and-geoid",
            heights=frame.heights.name,
            belongs=belongs,
            stated=stated,
            parameters=frame.parameters.name if frame.parameters is not None and holds_s is not None else None,
            results=results,
            geoids=" and ".join(GEOIDS_OF_JAPAN),
            apart_cm=100.0 * abs(both[0] - both[1]),
            moved=results is None,
        )
    ]
