"""Opens two GNSS logs and judges one by the other."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np

from furrowmap.core.evaluation.evaluation import Evaluation, evaluate
from furrowmap.core.evaluation.matching import at_rest
from furrowmap.core.readers.reader import GivesPoses, GivesTrack, ReadOptions, open_recording
from furrowmap.core.values.errors import InputError, Notice
from furrowmap.core.values.gnss import Fix, GnssTrack
from furrowmap.core.values.pose_track import PoseTrack
from furrowmap.core.values.progress import Progress, silent

PLACE: Final = re.compile(r"\s*([-+]?\d+(?:\.\d*)?)\s*,\s*([-+]?\d+(?:\.\d*)?)\s*,\s*([-+]?\d+(?:\.\d*)?)\s*")
"""LAT,LON,HEIGHT of an antenna at rest."""
NUMBERS: Final = re.compile(r"[-+\d.,;\s]+")
"""What is meant to be a place."""


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
    """Judge the positions in one log by those in another.

    Args:
        test: a log of positions, of any kind that is read.
        reference: another one, or a trajectory, or LAT,LON,HEIGHT of an antenna at rest.
        date: UTC date of the first position, for logs without dates.
        antenna_offset_m: of the test's antenna from the reference's: forward, left, up.
        max_gap_s: longer steps of the reference are gaps.
        fixed_reference_only: leave out epochs at which the reference is not fixed.
        progress: is told what goes on.

    Raises:
        InputError: if a log cannot be read, has no positions, or there is nothing to compare.
    """
    progress(f"Reading {test.name}", 0.0)
    options = ReadOptions(date=date)
    place = None if Path(reference).exists() else PLACE.fullmatch(reference)
    if place is None and NUMBERS.fullmatch(reference) and not Path(reference).exists():
        raise InputError(
            f"{reference!r} is neither a file nor a place.",
            "A place is LAT,LON,HEIGHT: degrees, degrees, metres above the ellipsoid, with decimal points.",
            "Write it as 35.339325776,139.522173128,65.712.",
            code="bad-place",
        )
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
        lat, lon, height = (float(number) for number in place.groups())
        if abs(lat) > 90.0 or abs(lon) > 360.0:
            raise InputError(
                f"{reference!r}: there is no latitude {lat:g}°, longitude {lon:g}°.",
                "A place is LAT,LON,HEIGHT: degrees, degrees, metres above the ellipsoid.",
                "Look at the order: latitude comes first.",
                code="bad-place",
            )
        judge = at_rest(lon, lat, height, judged, f"the place {reference.strip()}")
        more: list[Notice] = []
    else:
        progress(f"Reading {Path(reference).name}", 0.0)
        near_s = float(judged.t_s[0]) if len(judged) else None
        judge, more = _track([Path(reference)], ReadOptions(date=date, near_s=near_s))
    progress("Comparing", 0.0)
    found = evaluate(
        judged,
        judge,
        antenna_offset_m=antenna_offset_m,
        max_gap_s=max_gap_s,
        fixed_reference_only=fixed_reference_only,
    )
    return replace(found, notices=(*notices, *more, *found.notices))


def _with_date(error: InputError) -> InputError:
    """An error with the remedy of this command, where it has another than a session."""
    if error.code != "no-date":
        return error
    what, meaning, _ = error.lines
    return InputError(what, meaning, "Give the UTC date of its first position: --date YYYY-MM-DD.", code=error.code)


def _track(paths: Sequence[Path], options: ReadOptions) -> tuple[GnssTrack, list[Notice]]:
    """The positions in a log, or in a trajectory whose coordinates are geographic."""
    reader = open_recording(paths, options)
    if isinstance(reader, GivesTrack):
        return reader.track(), reader.notices
    if isinstance(reader, GivesPoses):
        return _of_poses(reader.poses()), reader.notices
    raise InputError(
        f"{paths[0]}: {reader.title} holds no positions of a receiver.",
        "There is nothing in it to compare.",
        "Give a GNSS log, a trajectory in geographic coordinates, or LAT,LON,HEIGHT of an antenna at rest.",
        code="no-positions",
    )


def _of_poses(poses: PoseTrack) -> GnssTrack:
    if poses.projected:
        raise InputError(
            f"{poses.source}: its positions are of a map, and it does not say of which.",
            "A receiver's log is in longitude and latitude.",
            "Give the trajectory with the columns lon_deg, lat_deg, h_m.",
            code="trajectory-projected",
        )
    return GnssTrack.build(
        poses.t_s,
        source=poses.source,
        service="",
        lon_deg=poses.position[:, 0],
        lat_deg=poses.position[:, 1],
        height_m=poses.position[:, 2],
        fix=np.full(len(poses), Fix.MANUAL, np.int8),
        sigma_e_m=poses.sigma[:, 0],
        sigma_n_m=poses.sigma[:, 1],
        sigma_h_m=poses.sigma[:, 2],
        heading_deg=poses.heading_deg % 360.0,
    )
