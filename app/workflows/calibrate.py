"""What a recording says about how its sensors are mounted and how their clocks stand to each other."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from furrowmap.core.adjustment.match_report import CLOCK_CERTAIN
from furrowmap.core.adjustment.matched import Matched
from furrowmap.core.adjustment.session_match import match_session
from furrowmap.core.session.opened import OpenSession, open_session
from furrowmap.core.session.toml_edit import with_value
from furrowmap.core.trajectory.located import locate
from furrowmap.core.values.errors import RefusedError
from furrowmap.core.values.mounting import Mounting
from furrowmap.core.values.progress import Progress, silent
from furrowmap.core.values.threads import using_threads
from furrowmap.exporters.files.atomic import atomic_output

ROUNDS: Final = 6
LARGEST_SHARE: Final = 0.85
ENOUGH_S: Final = 0.003
"""A clock offset found in parts is whole when the next part is smaller."""


@dataclass(frozen=True)
class Calibration:
    """What the session states, and what its recording shows.

    Attributes:
        stated: mounting in the session.
        found: mounting as the recording shows it; the stated one where that is right.
        sigma_deg: standard deviations of roll, pitch, yaw of the vehicle; inf where the recording does not show them.
        facing_shown: whether the recording shows which way the scanner faces; else the stated yaw is assumed, and the
            estimated one is good only if that is about right.
        height_m: of the vehicle's origin above the ground it stands on, and its standard deviation.
        stated_offset_s: `lidar_minus_gnss_s` in the session.
        offset_s: the same as the recording shows it, and its standard deviation; nan where it does not.
    """

    stated: Mounting
    found: Mounting
    sigma_deg: tuple[float, float, float]
    facing_shown: bool
    height_m: tuple[float, float]
    stated_offset_s: float
    offset_s: tuple[float, float]

    @property
    def mounting_differs(self) -> bool:
        """Whether the recording shows another mounting than the session states."""
        return self.found != self.stated

    @property
    def differs(self) -> bool:
        """Whether the recording shows anything else than the session states."""
        return self.mounting_differs or self.clock_differs

    @property
    def clock_differs(self) -> bool:
        """Whether the recording shows another clock offset than the session states."""
        return bool(abs(self.offset_s[0] - self.stated_offset_s) > CLOCK_CERTAIN * self.offset_s[1])


def calibrate(session: str | Path, *, write: bool = False, progress: Progress = silent) -> Calibration:
    """Estimate mounting and clock offset from a session's recording.

    Args:
        session: the session file.
        write: write what differs from the session into the file; its other lines and comments stay.
        progress: is called with each stage and its share.

    Raises:
        RefusedError: if the scans do not show enough of the ground, or the file's tables are written in a way that
            cannot be edited.
        FurrowmapError: if the session or its files do not make a trajectory.
    """
    file = Path(session)
    opened = open_session(file)
    with using_threads(opened.session.run.threads, by_default=True):
        found = _estimate(opened, progress)
    if write and found.differs:
        text = calibrated_text(file.read_bytes().decode("utf-8"), found)
        with atomic_output(file) as unfinished:
            unfinished.write_bytes(text.encode("utf-8"))
    return found


def _estimate(opened: OpenSession, progress: Progress) -> Calibration:
    """Estimate in several rounds, because the errors of the positions absorb a part of a clock offset."""
    session_file, session = opened.file, opened.session
    located = locate(opened.positions(), session, opened.frame)
    stated = session.recording.lidar_minus_gnss_s
    offset, sigma, matched = stated, float("nan"), None
    before = 0.0
    for _ in range(ROUNDS):
        attempt = opened.with_clock_offset(offset)
        if located.antenna is None:
            raise _not_shown(session_file, "its trajectory comes from a file, not from GNSS")
        try:
            lidar = attempt.lidar(float(np.mean(located.trajectory.span_s)))
            matched = match_session(located, lidar, session, progress=progress)
        except np.linalg.LinAlgError as error:
            why = "positions and ground leave a part of the drive without any hold"
            raise _not_shown(session_file, why) from error
        if matched is None:
            raise _not_shown(session_file, "the scans see too little ground")
        part, sigma = matched.clock_offset_s
        if abs(part) < max(ENOUGH_S, sigma):
            break
        # Each round shows a like share of what is left: the sum of that series is taken once two of them are known.
        share = part / before if before else 0.0
        offset += part / (1.0 - share) if 0.0 < share < LARGEST_SHARE else part
        before = part
    assert matched is not None
    return _answer(matched, session.lidar.mounting, stated, offset, sigma)


def _answer(matched: Matched, mounting: Mounting, stated_s: float, offset_s: float, sigma_s: float) -> Calibration:
    found = matched.calibration
    shown = (offset_s, sigma_s) if np.isfinite(sigma_s) else (float("nan"), float("nan"))
    return Calibration(
        mounting,
        matched.mounting,
        found.sigma_deg,
        matched.facing_shown,
        (found.height_m, found.sigma_height_m),
        stated_s,
        shown,
    )


def _not_shown(session_file: Path, why: str) -> RefusedError:
    return RefusedError(
        f"{session_file.name}: the recording shows no mounting, because {why}.",
        "There is nothing to calibrate with.",
        "Use a recording of some passes back and forth on open ground, with its GNSS log.",
        code="calibration-refused",
    )


def calibrated_text(text: str, calibration: Calibration) -> str:
    """A session file's text with what was found in its place; everything else, comments too, stays as it is.

    Raises:
        RefusedError: if the file writes its tables in a way that is not understood.
    """
    if calibration.mounting_differs:
        rpy = ", ".join(f"{angle:.2f}" for angle in calibration.found.rpy_deg)
        text = with_value(text, "lidar", "rpy_deg", f"[{rpy}]")
    if calibration.clock_differs:
        text = with_value(text, "recording", "lidar_minus_gnss_s", f"{calibration.offset_s[0]:.3f}")
    return text
