"""Scan matching of a session: from its first guess and its scans to the adjusted trajectory."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import chain, islice
from typing import Final

import numpy as np

from furrowmap.core.adjustment.knots import knots_over, start_from
from furrowmap.core.matching.antenna_sway import SWAY_CLOCK_SIGMA_S
from furrowmap.core.matching.clock_offset import CLOCK_CERTAIN_SIGMAS, motion_certainty
from furrowmap.core.matching.consistency import (
    Cause,
    GroundTilt,
    Seen,
    clock_notice,
    contradiction_notice,
    enlarge_sigmas,
    ground_tilt,
)
from furrowmap.core.matching.laser_elevations import other_model
from furrowmap.core.matching.matched import (
    FACING_ASSUMED,
    LEVER_ASSUMED,
    OF_MOUNTING,
    Matched,
    Prepared,
    height_is_off,
    matched_by,
    prepare,
    slow_errors_unchecked,
)
from furrowmap.core.matching.placing import Tool
from furrowmap.core.matching.returns import ground_returns
from furrowmap.core.matching.schedule import solve
from furrowmap.core.matching.yaw_ambiguity import facing
from furrowmap.core.runtime.background import SCANS_AHEAD, ahead
from furrowmap.core.runtime.errors import Notice
from furrowmap.core.runtime.progress import Progress, silent
from furrowmap.core.session.opened import LidarRecording, watched
from furrowmap.core.trajectory.located import Located, lever_arm_m
from furrowmap.core.values.scan import Scan
from furrowmap.core.values.session import Session
from furrowmap.core.values.trajectory import Trajectory

FIRST_SCANS: Final = 20
"""Scans that show how the ground lies."""
CLOCK_ROUNDS: Final = 6
"""Clocks that are off are corrected at most so often, less one."""
UNSOLVED: Final = Notice("matching-unsolved")
"""Positions and ground do not determine a part of the trajectory."""
OVERTURNED_DEG: Final = 90.0
"""No vehicle on wheels rolls so far: without heights, poses may do so with the ground that they see."""


@dataclass(frozen=True)
class MatchedSession:
    """What scan matching of a session found.

    Attributes:
        trajectory: of the vehicle frame: the adjusted one, or the first guess where the scans were not matched.
        matched: the result of scan matching; None where the scans were not matched.
    """

    trajectory: Trajectory
    notices: tuple[Notice, ...]
    matched: Matched | None


def match_session(
    located: Located,
    lidar: LidarRecording,
    session: Session,
    on_scan: Callable[[Scan | None], None] | None = None,
    progress: Progress = silent,
) -> MatchedSession:
    """Match a session's scans to the ground, where they see enough of it, and determine a trajectory with positions.

    Where scans show that the clocks are off, they are read and matched again with the offset found, until that is
    whole. An offset that is only suspected is tried where results contradict each other. Where they still do so with
    another offset, the stated one is used.

    `on_scan` gets each scan as it is read, and None after the last.
    """
    offset_s = 0.0
    tried = False
    found: Matched | None = None

    def report(share: float) -> None:
        progress("matching scans", share)

    try:
        for number in range(CLOCK_ROUNDS):
            took = on_scan if not number else None
            prepared, ground = _prepared(located, lidar.ahead_by(offset_s), session, took, progress)
            if prepared is None:
                break
            if prepared.clock is not None and prepared.clock.certain and not tried:
                offset_s = offset_s + prepared.clock.clock_s
                tried = True
                continue
            matched = matched_by(prepared, solve(prepared.problem, prepared.first, report))
            constants = matched.seen.constants
            if constants.clock_off or (offset_s and abs(constants.clock_s) > constants.clock_sigma_s):
                offset_s += constants.clock_s
            elif matched.seen.cause is not None and not tried and (suspected_s := _suspected_s(matched, prepared)):
                offset_s = offset_s + suspected_s
                tried = True
            elif matched.seen.cause is not None and offset_s:
                break
            else:
                found = replace(matched, clock_used_s=offset_s)
                break
        if found is None and offset_s:
            prepared, ground = _prepared(located, lidar, session, None, progress)
        if prepared is None:
            return _unmatched(located, ground, session)
        if found is None:
            found = matched_by(prepared, solve(prepared.problem, prepared.first, report))
        if max(float(np.abs(angle_deg).max()) for angle_deg in found.trajectory.attitude_deg()[:2]) > OVERTURNED_DEG:
            return MatchedSession(located.trajectory, (*located.notices, UNSOLVED), None)
        found = _judged(found, prepared, located, session)
    except np.linalg.LinAlgError:
        return MatchedSession(located.trajectory, (*located.notices, UNSOLVED), None)
    return MatchedSession(found.trajectory, (*located.notices, *found.notices), found)


def _unmatched(located: Located, ground: GroundTilt, session: Session) -> MatchedSession:
    """The first guess, with what is assumed of it and what the lie of the ground contradicts."""
    assert located.antenna is not None
    possible = ((FACING_ASSUMED, not ground.facing.shown), (LEVER_ASSUMED, any(lever_arm_m(session))))
    assumed = (*(notice for notice, holds in possible if holds), slow_errors_unchecked(located.antenna))
    notices = (*located.notices, *assumed)
    seen = Seen(ground=ground)
    if (notice := contradiction_notice(seen)) is None:
        return MatchedSession(located.trajectory, notices, None)
    lever_m = np.asarray(lever_arm_m(session))
    trajectory = enlarge_sigmas(located.trajectory, seen, lever_m, np.asarray(session.lidar.mounting.xyz_m))
    return MatchedSession(trajectory, (*notices, notice), None)


def _suspected_s(matched: Matched, prepared: Prepared) -> float:
    """The offset of the clocks that may explain a contradiction; 0 for none, or where the sway shows a lever arm."""
    sway = matched.seen.sway
    if sway.clock_s or (sway.off and not sway.unrelated):
        return sway.clock_s
    return prepared.clock.clock_s if prepared.clock is not None else 0.0


def _judged(matched: Matched, prepared: Prepared, located: Located, session: Session) -> Matched:
    """The result with notices of an offset in use and of a contradiction, whose standard deviations are enlarged."""
    seen = matched.seen
    sensor = prepared.first.sensor
    if seen.cause is Cause.UNKNOWN and located.with_lever is not None:
        x, y, z = lever_arm_m(session)
        others = [(-x, y, z), (x, -y, z), (-x, -y, z), (y, x, z), (y, -x, z), (-y, x, z)]
        returns = prepared.problem.returns
        start = prepared.start
        better = [motion_certainty(returns, sensor, start, located.with_lever(lever)) for lever in others]
        if max(better) > CLOCK_CERTAIN_SIGMAS:
            seen = replace(seen, lever_m=others[int(np.argmax(better))])
    if matched.clock_used_s:
        stated_s = session.recording.lidar_minus_gnss_s
        used_s = matched.clock_used_s
        notice = clock_notice(stated_s, used_s, min(seen.constants.clock_sigma_s, SWAY_CLOCK_SIGMA_S))
        matched = replace(matched, notices=(notice, *matched.notices))
    if height_is_off(matched.calibration):
        sigma = matched.trajectory.sigma.copy()
        sigma[:, 2] = np.hypot(sigma[:, 2], matched.calibration.height_m)
        matched = replace(matched, trajectory=replace(matched.trajectory, sigma=sigma))
    contradiction = contradiction_notice(seen)
    if contradiction is None:
        return matched
    if seen.cause is Cause.MODEL:
        # A mounting that fits the elevations of another model is not the scanner's.
        rest = tuple(notice for notice in matched.notices if not notice.code.startswith(OF_MOUNTING))
        matched = replace(matched, notices=rest)
    turned_deg = _turned_deg(seen, prepared, located)
    trajectory = enlarge_sigmas(matched.trajectory, seen, prepared.problem.lever_m, sensor.xyz_m, turned_deg)
    return replace(matched, trajectory=trajectory, seen=seen, notices=(contradiction, *matched.notices))


def _turned_deg(seen: Seen, prepared: Prepared, located: Located) -> float:
    """By how much headings change with the lever arm that fits better (RMS); 0 where there is none."""
    lever_m = seen.lever_m
    if lever_m is None and seen.sway.off and not seen.sway.clock_s:
        x, y, z = (prepared.problem.lever_m + seen.sway.lever_m).tolist()
        lever_m = x, y, z
    if lever_m is None or located.with_lever is None:
        return 0.0
    start = located.trajectory
    other = located.with_lever(lever_m)
    headings = (np.unwrap(np.radians(one.attitude_deg()[2])) for one in (start, other))
    now, then = (np.interp(start.t_s, one.t_s, heading) for one, heading in zip((start, other), headings, strict=True))
    return float(np.degrees(np.sqrt(np.mean(((then - now + np.pi) % (2.0 * np.pi) - np.pi) ** 2))))


def _prepared(
    located: Located,
    lidar: LidarRecording,
    session: Session,
    on_scan: Callable[[Scan | None], None] | None,
    progress: Progress,
) -> tuple[Prepared | None, GroundTilt]:
    """Read the scans; also how the ground lies in the vehicle frame."""
    assert located.antenna is not None
    scans = iter(watched(ahead(lidar.scans(), SCANS_AHEAD), lidar, progress, "reading scans"))
    mounting = session.lidar.mounting
    first = list(islice(scans, FIRST_SCANS))
    ground = ground_tilt(first, mounting)
    if not any(key.startswith("lidar.") for key in session.unstated):
        ground = replace(ground, model=other_model(first, mounting, lidar.beam_elevations()))
    returns = ground_returns(chain(first, scans), mounting, located.trajectory, on_scan)
    if on_scan is not None:
        on_scan(None)
    lever_m = lever_arm_m(session)
    tool = tool_of(session)
    prepared = prepare(returns, located.trajectory, located.antenna, lever_m, mounting, tool, ground, located.aid)
    if prepared is None and len(t_s := returns.standing.t_s):
        knots = knots_over(t_s)
        origin_m = np.round(np.median(located.trajectory.xyz_m, axis=0))
        state = start_from(located.trajectory, knots, origin_m)
        sensor_m = np.asarray(mounting.xyz_m)
        ground = replace(ground, facing=facing(returns, knots, state, sensor_m))
    return prepared, ground


def tool_of(session: Session) -> Tool | None:
    """The line at which the session's implement changes the soil; None where it states none."""
    implement = session.implement
    return Tool(implement.xy_m, 0.5 * implement.width_m) if implement is not None else None
