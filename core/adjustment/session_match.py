"""Scan matching of a session: from its first guess and its scans to the adjusted trajectory."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Final

import numpy as np

from furrowmap.core.adjustment.matched import Matched, match
from furrowmap.core.matching.placing import Tool
from furrowmap.core.matching.returns import ground_returns
from furrowmap.core.session.opened import LidarRecording, watched
from furrowmap.core.trajectory.located import Located, lever_arm_m
from furrowmap.core.values.ahead import ahead
from furrowmap.core.values.errors import Notice
from furrowmap.core.values.progress import Progress, silent
from furrowmap.core.values.scan import Scan
from furrowmap.core.values.session import Session

SCANS_AHEAD: Final = 32
"""Scans that are read while others are at work."""
_UNSOLVED: Final = Notice(
    "matching-unsolved",
    "The scans were not matched: positions and ground do not determine a part of the drive, so that the normal "
    "equations have no solution. The trajectory is that of GNSS alone.",
)


def matched_to_ground(
    located: Located,
    lidar: LidarRecording,
    session: Session,
    on_scan: Callable[[Scan], None] | None = None,
    progress: Progress = silent,
) -> tuple[Located, Matched | None]:
    """The adjusted trajectory with its notices, and the result of matching; the first guess and None without one.

    `on_scan` gets each scan as it is read.
    """
    try:
        matched = match_session(located, lidar, session, on_scan, progress)
    except np.linalg.LinAlgError:
        return replace(located, notices=(*located.notices, _UNSOLVED)), None
    if matched is None:
        return located, None
    return replace(located, trajectory=matched.trajectory, notices=(*located.notices, *matched.notices)), matched


def match_session(
    located: Located,
    lidar: LidarRecording,
    session: Session,
    on_scan: Callable[[Scan], None] | None = None,
    progress: Progress = silent,
) -> Matched | None:
    """Match a session's scans to the ground; None where they see too little of it.

    Raises:
        LinAlgError: if positions and ground do not determine a part of the trajectory.
    """
    assert located.antenna is not None
    implement = session.implement
    tool = Tool(implement.xy_m, 0.5 * implement.width_m) if implement is not None else None
    scans = watched(ahead(lidar.scans(), SCANS_AHEAD), lidar, progress, "reading scans")
    returns = ground_returns(scans, session.lidar.mounting, located.trajectory, on_scan)
    return match(
        returns,
        located.trajectory,
        located.antenna,
        lever_arm_m(session),
        session.lidar.mounting,
        tool,
        lambda share: progress("matching scans", share),
    )
