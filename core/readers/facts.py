"""Facts about positions and poses for `inspect`, for all formats."""

from collections.abc import Callable
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from pyproj import Geod

from furrowmap.core.geodesy.longitudes import middle_deg
from furrowmap.core.readers.epochs import GAP_INTERVALS
from furrowmap.core.readers.implausible_positions import spans_in_words
from furrowmap.core.runtime.errors import Notice
from furrowmap.core.values.clock import iso_utc
from furrowmap.core.values.gnss import Fix, GnssTrack

JUMP_M: Final = 2.0
CARRIER_JUMP_M: Final = 1.0


def position_facts(track: GnssTrack) -> dict[str, Any]:
    """Fixes, location, distance, heights and speed of a receiver's positions."""
    if not len(track):
        return {}
    fixes = {fix.label: int(np.sum(track.fix == fix)) for fix in Fix}
    lon_deg, lat_deg = middle_deg(track.lon_deg, track.lat_deg)
    facts: dict[str, Any] = {
        "epochs_by_fix": {label: count for label, count in fixes.items() if count},
        "place": {
            "lat_deg": round(lat_deg, 6),
            "lon_deg": round(lon_deg, 6),
        },
        "distance_m": round(float(steps_m(track).sum()), 1),
    }
    if np.isfinite(track.height_m).any():
        facts["height_m"] = [round(float(np.nanmin(track.height_m)), 3), round(float(np.nanmax(track.height_m)), 3)]
    if np.isfinite(track.speed_mps).any():
        facts["speed_max_mps"] = round(float(np.nanmax(track.speed_mps)), 2)
    stated = {
        "sigmas": track.sigma_e_m,
        "speed": track.speed_mps,
        "course": track.course_deg,
        "heading": track.heading_deg,
        "height": track.height_m,
    }
    facts["stated_for_epochs"] = {name: int(np.isfinite(values).sum()) for name, values in stated.items()}
    return facts


def steps_m(track: GnssTrack) -> NDArray[np.float64]:
    """Horizontal distances (n − 1,) on the ellipsoid from each position to the next."""
    lon = track.lon_deg
    lat = track.lat_deg
    distance: NDArray[np.float64] = np.asarray(Geod(ellps="WGS84").inv(lon[:-1], lat[:-1], lon[1:], lat[1:])[2])
    return distance


def jump_notices(track: GnssTrack, when: Callable[[float], str] = iso_utc) -> list[Notice]:
    """A notice with times and places if positions jump by more than the speed around the step explains.

    The limit is :data:`JUMP_M`, or :data:`CARRIER_JUMP_M` between carrier-phase solutions, plus 1.5 times the distance
    by the median speed over five steps, so that neither braking nor a single spike counts as motion. Gaps are not
    considered.
    """
    if len(track) < 6:
        return []
    dt = np.diff(track.t_s)
    step = steps_m(track)
    expected = np.median(np.lib.stride_tricks.sliding_window_view(np.pad(step / dt, 2, mode="edge"), 5), axis=1) * dt
    carrier = np.isin(track.fix, (Fix.FIXED, Fix.FLOAT))
    least_m = np.where(carrier[1:] & carrier[:-1], CARRIER_JUMP_M, JUMP_M)
    jump = (step > 1.5 * expected + least_m) & (dt <= GAP_INTERVALS * np.median(dt))
    if not jump.any():
        return []
    largest_m = float((step - expected)[jump].max())
    with_fix = int(np.sum(jump & (np.diff(track.fix) != 0)))
    return [
        Notice(
            "position-jumps",
            source=track.source,
            jump=int(jump.sum()),
            least_m=least_m[jump].min(),
            with_fix=with_fix,
            largest_m=largest_m,
            track=spans_in_words(track, np.append(False, jump), when),
        )
    ]
