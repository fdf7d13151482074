"""Evaluation of one GNSS log against another."""

import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np

from furrowmap.core.accuracy.evaluation import Evaluation, at_rest, evaluate
from furrowmap.core.readers.reader import GivesPoses, GivesTrack, ReadOptions, open_recording
from furrowmap.core.runtime.errors import InputError, Notice
from furrowmap.core.runtime.progress import Progress, silent
from furrowmap.core.values.gnss import Fix, GnssTrack

PLACE_PATTERN: Final = re.compile(r"\s*([-+]?\d+(?:\.\d*)?)\s*,\s*([-+]?\d+(?:\.\d*)?)\s*,\s*([-+]?\d+(?:\.\d*)?)\s*")
"""LAT,LON,HEIGHT of a stationary antenna."""
PLACE_CHARACTERS: Final = re.compile(r"[-+\d.,;\s]+")
"""A reference of these characters only is meant as a place."""


def evaluate_logs(
    test: Path,
    reference: str,
    *,
    date: str | None = None,
    antenna_offset_m: tuple[float, float, float] = (0.0, 0.0, 0.0),
    max_gap_s: float | None = None,
    fixed_reference_only: bool = False,
    progress: Progress = silent,
) -> Evaluation:
    """Evaluate the positions of a log against a reference, paired as by :func:`.match`.

    Args:
        reference: another log, a trajectory, or LAT,LON,HEIGHT of a stationary antenna.
        date: UTC date of the first position, for logs without dates.
        antenna_offset_m: of the test antenna from the reference antenna: forward, left, up.

    Raises:
        InputError: if a log cannot be read, has no positions, or there is nothing to compare.
    """
    progress(f"Reading {test.name}", 0.0)
    options = ReadOptions(date=date)
    place = None if Path(reference).exists() else _place(reference)
    try:
        judged, notices = _track([test], options)
    except InputError as error:
        if error.code != "no-date" or place:
            raise _with_date(error) from None
        try:
            dated, _ = _track([Path(reference)], options)
        except InputError as fault:
            raise _with_date(fault) from None
        judged, notices = _track([test], ReadOptions(near_s=float(dated.t_s[0])))
    if place:
        lat, lon, height = place
        judge = at_rest(lon, lat, height, judged, f"the place {reference.strip()}")
        more: list[Notice] = []
    else:
        progress(f"Reading {Path(reference).name}", 0.0)
        near_s = float(judged.t_s[0]) if len(judged) else None
        judge, more = _track([Path(reference)], ReadOptions(date=date, near_s=near_s))
    progress("Comparing", 0.0)
    found = evaluate(
        judged, judge, antenna_offset_m=antenna_offset_m, max_gap_s=max_gap_s, fixed_reference_only=fixed_reference_only
    )
    return replace(found, notices=(*notices, *more, *found.notices))


def _place(text: str) -> tuple[float, float, float] | None:
    """Latitude, longitude and height; None where the text is not meant to be a place."""
    if not PLACE_CHARACTERS.fullmatch(text):
        return None
    found = PLACE_PATTERN.fullmatch(text)
    if found is None:
        raise InputError("bad-place", text=text)
    lat, lon, height = (float(number) for number in found.groups())
    if abs(lat) > 90.0 or abs(lon) > 360.0:
        raise InputError("bad-place.no-such-position", text=text, lat=lat, lon=lon)
    return lat, lon, height


def _with_date(error: InputError) -> InputError:
    """The error with the remedy of this command, which has an option where a session has a key."""
    if error.code != "no-date":
        return error
    return InputError("no-date.receiver", what=error.words("what"), meaning=error.words("meaning"))


def _track(paths: Sequence[Path], options: ReadOptions) -> tuple[GnssTrack, list[Notice]]:
    """The positions in a log, or in a trajectory whose coordinates are geographic."""
    reader = open_recording(paths, options)
    if isinstance(reader, GivesTrack):
        return reader.track(), reader.notices
    if isinstance(reader, GivesPoses):
        poses = reader.poses()
        if poses.projected:
            raise InputError("trajectory-projected", source=poses.source)
        lon_deg, lat_deg, height_m = poses.position.T
        sigma_e_m, sigma_n_m, sigma_h_m = poses.sigma[:, :3].T
        track = GnssTrack.build(
            poses.t_s,
            source=poses.source,
            service="",
            lon_deg=lon_deg,
            lat_deg=lat_deg,
            height_m=height_m,
            fix=np.full(len(poses), Fix.MANUAL, np.int8),
            sigma_e_m=sigma_e_m,
            sigma_n_m=sigma_n_m,
            sigma_h_m=sigma_h_m,
            heading_deg=poses.heading_deg % 360.0,
        )
        return track, reader.notices
    raise InputError("no-positions", paths=paths[0], title=reader.title)
