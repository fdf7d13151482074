"""What a recording says about how its sensors are mounted and how their clocks stand to each other."""

import datetime as dt
import math
import tomllib
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from furrowmap.core.matching.session_match import UNSOLVED, match_session
from furrowmap.core.pipeline.solution import companions
from furrowmap.core.runtime.errors import RefusedError
from furrowmap.core.runtime.plain_reads import read_plain_bytes
from furrowmap.core.runtime.progress import Progress, silent
from furrowmap.core.runtime.settings import using_threads
from furrowmap.core.session.machine_file import LearnedMounting, learned, load_machine
from furrowmap.core.session.opened import OpenSession, open_session, watched
from furrowmap.core.session.toml_edit import with_value
from furrowmap.core.strips.strip_adjustment import calibrate_flight
from furrowmap.core.strips.strips import strip_returns
from furrowmap.core.trajectory.located import Located, locate
from furrowmap.core.trajectory.moving_mount import carrier_of
from furrowmap.core.values.margins import margin
from furrowmap.core.values.rotation import Mounting
from furrowmap.exporters.files.atomic import atomic_output
from furrowmap.workflows.session.known_machines import machine_file, write_machine


@dataclass(frozen=True)
class Calibration:
    """What the session states, and what its recording shows.

    Attributes:
        stated: mounting in the session.
        found: mounting as the recording shows it; the stated one where that is right.
        sigma_deg: standard deviations of roll, pitch, yaw of the vehicle; inf where the recording does not show them.
        facing_shown: whether the recording shows which way the scanner faces; else the stated yaw is assumed, and the
            estimated one is good only if that is about right.
        height_m: of the vehicle's origin above the ground it stands on, and its standard deviation; nan and inf for an
            aircraft.
        stated_offset_s: `lidar_minus_gnss_s` in the session.
        offset_s: the same as the recording shows it, and its standard deviation; nan where it does not.
        clock_differs: whether the recording certainly and uniquely shows another offset than the session states.
        date: UTC day of the recording.
    """

    stated: Mounting
    found: Mounting
    sigma_deg: tuple[float, float, float]
    facing_shown: bool
    height_m: tuple[float, float]
    stated_offset_s: float
    offset_s: tuple[float, float]
    clock_differs: bool
    date: dt.date

    @property
    def mounting_differs(self) -> bool:
        """Whether the recording shows another mounting than the session states."""
        return self.found != self.stated

    @property
    def differs(self) -> bool:
        """Whether the recording shows anything else than the session states."""
        return self.mounting_differs or self.clock_differs


def calibrate(
    session: str | Path, *, write: bool = False, machine: str | Path | None = None, progress: Progress = silent
) -> Calibration:
    """Estimate mounting and clock offset from a session's recording.

    Args:
        write: write what differs from the session into the file, with the day of the recording and standard deviations
            as a comment; its other lines and comments stay.
        machine: name or file of a machine's profile, into which the mounting is written with them.

    Raises:
        RefusedError: if the scans do not show enough of the ground, or the file's tables are written in a way that
            cannot be edited.
        FurrowmapError: if the session or its files do not make a trajectory.
    """
    file = Path(session)
    profile = machine_file(machine) if machine is not None else None
    before = load_machine(profile) if profile is not None else None
    opened = open_session(file)
    with using_threads(opened.session.run.threads, by_default=True):
        found = _calibrate_session(opened, progress)
    if write and found.differs:
        write_calibration(file, found)
    if profile is not None and before is not None:
        mounting = LearnedMounting(found.found, found.sigma_deg, found.date, opened.session.name)
        write_machine(profile, learned(before, mounting))
    return found


def write_calibration(session_file: Path, calibration: Calibration) -> None:
    """Write what differs from a session into its file; its other lines and comments stay."""
    text = calibrated_text(read_plain_bytes(session_file).decode("utf-8"), calibration)
    with atomic_output(session_file) as unfinished:
        unfinished.write_bytes(text.encode("utf-8"))


def _calibrate_session(opened: OpenSession, progress: Progress) -> Calibration:
    session_file = opened.file
    session = opened.session
    located = locate(opened.positions(), session, opened.frame, companions(opened))
    if located.source == "imu" and located.antenna is None:
        return _calibrate_by_strips(opened, located, progress)
    if located.antenna is None:
        raise _not_shown(session_file, "its trajectory comes from a file, not from GNSS")
    lidar = opened.lidar(float(np.mean(located.trajectory.span_s)))
    known = match_session(located, lidar, session, progress=progress)
    if UNSOLVED in known.notices:
        raise _not_shown(session_file, "positions and ground leave a part of the drive without any hold")
    matched = known.matched
    if matched is None:
        raise _not_shown(session_file, "the scans see too little ground")
    found = matched.calibration
    constants = matched.seen.constants
    stated_s = session.recording.lidar_minus_gnss_s
    offset_s = stated_s + matched.clock_used_s + constants.clock_s
    shown = math.isfinite(constants.clock_sigma_s)
    return Calibration(
        stated=session.lidar.mounting,
        found=matched.mounting,
        sigma_deg=found.sigma_deg,
        facing_shown=matched.facing_shown,
        height_m=(found.height_m, found.sigma_height_m),
        stated_offset_s=stated_s,
        offset_s=(offset_s, constants.clock_sigma_s) if shown else (math.nan, math.nan),
        clock_differs=bool(matched.clock_used_s),
        date=_day(located),
    )


def _calibrate_by_strips(opened: OpenSession, located: Located, progress: Progress) -> Calibration:
    """The boresight of a scanner on an aircraft, from ground that is seen at several times."""
    stated = opened.session.lidar.mounting
    trajectory = located.trajectory
    carrier, _ = carrier_of(located, opened.session, opened.inputs.mount)
    lidar = opened.lidar(float(np.mean(trajectory.span_s)))
    scans = watched(lidar.scans(), lidar, progress, "reading scans")
    returns = strip_returns(scans, carrier if carrier is not None else trajectory)
    found, _, _ = calibrate_flight(returns, located, stated, carrier)
    if found is None or not found.certain:
        raise _not_shown(opened.file, "too little smooth ground is seen at several times")
    stated_s = opened.session.recording.lidar_minus_gnss_s
    return Calibration(
        stated=stated,
        found=found.mounting if found.differs or found.mounting.xyz_m != stated.xyz_m else stated,
        sigma_deg=found.sigma_deg,
        facing_shown=True,
        height_m=(math.nan, math.inf),
        stated_offset_s=stated_s,
        offset_s=(stated_s - found.time_offset_s[0], found.time_offset_s[1]),
        clock_differs=bool(found.clock_used_s),
        date=_day(located),
    )


def _day(located: Located) -> dt.date:
    """UTC day of a trajectory's beginning."""
    return dt.datetime.fromtimestamp(located.trajectory.span_s[0], dt.UTC).date()


def _not_shown(session_file: Path, why: str) -> RefusedError:
    return RefusedError("calibration-refused", session_file=session_file.name, why=why)


def calibrated_text(text: str, calibration: Calibration) -> str:
    """A session file's text with what was found in its place; everything else, comments too, stays as it is."""
    if calibration.mounting_differs:
        rpy = ", ".join(f"{angle:.3f}" for angle in calibration.found.rpy_deg)
        sigma = ", ".join(margin(value) if math.isfinite(value) else "not shown" for value in calibration.sigma_deg)
        origin = f"calibrated with the recording of {calibration.date}: {sigma} degrees (95 %)"
        text = with_value(text, "lidar", "rpy_deg", f"[{rpy}]", origin)
    if calibration.found.xyz_m != calibration.stated.xyz_m:
        xyz = ", ".join(f"{place:.3f}" for place in calibration.found.xyz_m)
        text = with_value(text, "lidar", "xyz_m", f"[{xyz}]")
    if calibration.clock_differs:
        said = tomllib.loads(text)
        lidar = said.get("lidar", {})
        offset = f"{calibration.offset_s[0]:.4f}"
        its_own = "minus_gnss_s" in (lidar[0] if isinstance(lidar, list) else lidar)
        if its_own:
            text = with_value(text, "lidar", "minus_gnss_s", offset)
        if not its_own or "lidar_minus_gnss_s" in said["recording"]:
            text = with_value(text, "recording", "lidar_minus_gnss_s", offset)
    return text
