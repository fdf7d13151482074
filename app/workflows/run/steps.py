"""The long steps of a run, known before it begins."""

from pathlib import Path
from typing import Final

from furrowmap.core.runtime.errors import FurrowmapError
from furrowmap.core.runtime.progress import Step
from furrowmap.core.session.session_file import load_session
from furrowmap.core.values.session import Session

_LAST: Final = (
    Step("writing cloud", 16.0, beside=True),
    Step("making surfaces", 4.0, beside=True),
)


def planned_steps(session: Path) -> tuple[Step, ...]:
    """The long steps of a run of a session, with their usual share of its time; none for a session that is not valid.

    Shares are rough: they make a bar advance evenly, and nothing else.
    """
    try:
        stated = load_session(session)
    except FurrowmapError:
        return ()  # the run says what is wrong
    return (Step("hashing inputs", 3.0), *_until_products(stated), Step("writing layers", 3.0))


def _until_products(session: Session) -> tuple[Step, ...]:
    if not session.recording.lidar:
        return (Step("reading positions", 5.0),)
    steps = [Step("reading scans", 15.0)]
    if session.camera is not None:
        steps += [Step("finding features", 15.0), Step("matching images", 10.0), Step("adjusting images", 5.0)]
    if session.trajectory is None and session.imu is None:
        steps.append(Step("matching scans", 12.0))
    if session.field.control_points is not None:
        steps.append(Step("looking at control points", 10.0))
    steps.append(Step("placing points", 10.0))
    if session.camera is not None:
        steps.append(Step("reading images", 5.0))
    steps += _LAST
    if session.parcels is not None:
        steps.append(Step("measuring parcels", 2.0, beside=True))
    return tuple(steps)
