"""A machine on the ground: scans are matched to the soil, which shows attitude, mounting and clock."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Final

import msgspec
import numpy as np

from furrowmap.core.coverage.field_work import ImplementTracker
from furrowmap.core.implement.saved import load_implement
from furrowmap.core.implement.seen_implement import SeenImplement
from furrowmap.core.pipeline.solution import (
    Checkpoint,
    FirstGuess,
    Solution,
    StopWatch,
    aided_by_images,
    companions,
    ground_scale,
    held_against_control,
    with_doubtful_heights,
    without_unstated_accuracy,
)
from furrowmap.core.readers.reader import Reader
from furrowmap.core.runtime.progress import Progress
from furrowmap.core.session.opened import LidarRecording, OpenSession, watched
from furrowmap.core.trajectory.located import locate
from furrowmap.core.trajectory.moving_mount import carrier_of
from furrowmap.core.values.session import Session

if TYPE_CHECKING:
    from furrowmap.core.matching.matched import Matched

MIN_YAW_CHANGE_DEG: Final = 20.0
"""A mounting whose yaw differs by more sees the implement elsewhere."""


def first_guess(opened: OpenSession, positions: Reader, watch: StopWatch, progress: Progress) -> FirstGuess:
    """The trajectory from positions and what stands beside them, aided by images."""
    located = locate(positions, opened.session, opened.frame, companions(opened))
    watch.lap("positions")
    guess = aided_by_images(opened, located, positions, progress)
    watch.lap("images")
    return guess


def solve(opened: OpenSession, guess: FirstGuess, progress: Progress, checkpoint: Checkpoint | None) -> Solution:
    """Match the scans to the ground; what an earlier run kept of that is used instead."""
    from furrowmap.core.matching.session_match import match_session

    carrier, mount_notices = carrier_of(guess.located, opened.session, opened.inputs.mount)
    recording = opened.lidar(float(np.mean(guess.located.trajectory.span_s)))
    implement = ImplementTracker(opened.session, learned_implements(opened))
    kept = checkpoint.load() if checkpoint is not None else None
    # The implement sees the scans while they are read.
    found = kept or match_session(guess.located, recording, opened.session, implement.add_scan, progress)
    if checkpoint is not None and kept is None:
        checkpoint.save(found)
    located = replace(guess.located, trajectory=found.trajectory, notices=found.notices)
    matched = found.matched
    lidar = recording if matched is None else recording.ahead_by(matched.clock_used_s)
    if matched is not None and _seen_elsewhere(opened, matched):
        # The yaw ambiguity of the mounting was resolved otherwise than stated, or the clocks are off.
        implement = ImplementTracker(_as_mounted(opened, matched), learned_implements(opened))
        look_for_implement(implement, lidar, progress)
    elif kept is not None:
        look_for_implement(implement, lidar, progress)
    located = with_doubtful_heights(without_unstated_accuracy(located, opened.session))
    located = held_against_control(located, guess.aid)
    if located.trajectory is not guess.located.trajectory:
        carrier, mount_notices = carrier_of(located, opened.session, opened.inputs.mount)
    # Matching takes metres on the ground for metres of the map, within whose reach they differ by millimetres.
    scale = ground_scale(opened.frame, located.trajectory) if matched is None else 1.0
    return Solution(
        guess,
        located,
        lidar,
        opened.session.lidar.mounting if matched is None else matched.mounting,
        implement,
        carrier,
        scale,
        matched,
        mount_notices=tuple(mount_notices),
    )


def learned_implements(opened: OpenSession) -> list[SeenImplement | None]:
    """What earlier sessions learned of each implement."""
    learned = (tool.learned for tool in opened.inputs.tools)
    return [load_implement(file) if file is not None else None for file in learned]


def look_for_implement(implement: ImplementTracker, lidar: LidarRecording, progress: Progress) -> None:
    """Read the scans for the implement alone."""
    for scan in watched(lidar.scans(), lidar, progress, "reading scans"):
        implement.add_scan(scan)


def _is_turned(opened: OpenSession, matched: Matched) -> bool:
    """Whether the scanner faces elsewhere than stated."""
    forward = opened.session.lidar.mounting.rotation[:, 0]
    return bool(matched.mounting.rotation[:, 0] @ forward < np.cos(np.radians(MIN_YAW_CHANGE_DEG)))


def _seen_elsewhere(opened: OpenSession, matched: Matched) -> bool:
    """Whether the implement was looked for on another side of the vehicle, or at other times."""
    return _is_turned(opened, matched) or matched.clock_used_s != 0.0


def _as_mounted(opened: OpenSession, matched: Matched) -> Session:
    """The session with the mounting that the scans show, where it is turned."""
    session = opened.session
    if not _is_turned(opened, matched):
        return session
    return msgspec.structs.replace(
        session, lidar=msgspec.structs.replace(session.lidar, rpy_deg=matched.mounting.rpy_deg)
    )
