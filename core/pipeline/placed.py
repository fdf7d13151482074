"""A vehicle whose trajectory is known, from a file or attitude logs: nothing is matched, and its points are placed."""

from __future__ import annotations

import numpy as np

from furrowmap.core.coverage.field_work import ImplementTracker
from furrowmap.core.pipeline.solution import (
    FirstGuess,
    Solution,
    ground_scale,
    held_against_control,
    with_doubtful_heights,
    without_unstated_accuracy,
)
from furrowmap.core.pipeline.tractor import learned_implements, look_for_implement
from furrowmap.core.runtime.progress import Progress
from furrowmap.core.session.opened import OpenSession
from furrowmap.core.trajectory.moving_mount import carrier_of


def solve(opened: OpenSession, guess: FirstGuess, progress: Progress) -> Solution:
    """The trajectory as it is, and a scanner mounted as stated."""
    session = opened.session
    carrier, mount_notices = carrier_of(guess.located, session, opened.inputs.mount)
    lidar = opened.lidar(float(np.mean(guess.located.trajectory.span_s)))
    implement = ImplementTracker(session, learned_implements(opened))
    look_for_implement(implement, lidar, progress)
    located = with_doubtful_heights(without_unstated_accuracy(guess.located, session))
    located = held_against_control(located, guess.aid)
    if located.trajectory is not guess.located.trajectory:
        carrier, mount_notices = carrier_of(located, session, opened.inputs.mount)
    scale = ground_scale(opened.frame, located.trajectory)
    return Solution(
        guess, located, lidar, session.lidar.mounting, implement, carrier, scale, mount_notices=tuple(mount_notices)
    )
