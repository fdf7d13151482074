"""A run: from an open session to placed points and the ground worked. Which story it is, the session says.

Every story ends with a :class:`~furrowmap.core.pipeline.solution.Solution`, from which on all are one.
"""

from __future__ import annotations

from furrowmap.core.pipeline import flight, placed, tractor
from furrowmap.core.pipeline.field_files import read_field_files
from furrowmap.core.pipeline.place import OpenSink, place
from furrowmap.core.pipeline.run_result import RunResult
from furrowmap.core.pipeline.solution import Checkpoint, Corrector, StopWatch
from furrowmap.core.pipeline.without_scans import run_without_scans
from furrowmap.core.runtime import arrays
from furrowmap.core.runtime.progress import Progress, silent
from furrowmap.core.session.opened import OpenSession
from furrowmap.core.values.session import Session


@arrays.keeping_files_out()
def run(
    opened: OpenSession,
    open_sink: OpenSink,
    progress: Progress = silent,
    checkpoint: Checkpoint | None = None,
    corrector: Corrector | None = None,
) -> RunResult:
    """Place every point of a session's recording, hand them to a sink scan by scan, and find the ground worked.

    A session without a scanner's recording gives the ground worked alone, and opens no sink.

    Args:
        open_sink: is called before the first scan.
        checkpoint: keeps what matching finds; an earlier run's is used instead of matching again.
        corrector: corrects the solution of every story; None for no correction.

    Raises:
        FurrowmapError: if the session's files do not make a cloud, or no trajectory with tool states.
    """
    if not opened.session.recording.lidar:
        return run_without_scans(opened, progress)
    watch = StopWatch()
    positions = opened.positions()
    if is_flight(opened.session):
        guess, survey = flight.first_guess(opened, positions, watch, progress)
        files = read_field_files(opened, guess.located.trajectory)
        if corrector is not None:
            corrector.expect_near(guess.located.trajectory)
        solution = flight.solve(opened, guess, survey)
    else:
        guess = tractor.first_guess(opened, positions, watch, progress)
        files = read_field_files(opened, guess.located.trajectory)
        if corrector is not None:
            corrector.expect_near(guess.located.trajectory)
        if guess.located.antenna is not None:
            solution = tractor.solve(opened, guess, progress, checkpoint)
        else:
            solution = placed.solve(opened, guess, progress)
    watch.lap("matching")
    return place(opened, solution, files, open_sink, watch, progress, corrector)


def is_flight(session: Session) -> bool:
    """Whether the trajectory comes from an IMU: of an aircraft, or of a vehicle without an implement."""
    return session.imu is not None and session.implement is None and session.trajectory is None
