"""What each story of a run ends with: the vehicle's trajectory, the scanner's mounting and clock, and findings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from time import perf_counter
from typing import TYPE_CHECKING, Final, Protocol

import numpy as np

from furrowmap.core.coverage.field_work import FieldWork, ImplementTracker
from furrowmap.core.geodesy.projection import MapFrame
from furrowmap.core.pipeline.causes import by_cause
from furrowmap.core.pipeline.run_result import RunResult
from furrowmap.core.pointclouds.placed_scans import Placement, Placer
from furrowmap.core.readers.reader import Reader
from furrowmap.core.runtime import arrays
from furrowmap.core.runtime.errors import CONTRADICTION, Notice
from furrowmap.core.runtime.progress import Progress
from furrowmap.core.session.opened import LidarRecording, OpenSession
from furrowmap.core.strips.boresight import Boresight
from furrowmap.core.strips.strip_adjustment import StripAdjustment
from furrowmap.core.strips.strip_differences import StripDifferences
from furrowmap.core.trajectory.located import Companions, Located
from furrowmap.core.trajectory.straight_passes import Strip
from furrowmap.core.values.images import ImageFile
from furrowmap.core.values.rotation import Mounting
from furrowmap.core.values.scan import ClockReading
from furrowmap.core.values.session import Session
from furrowmap.core.values.trajectory import Trajectory

if TYPE_CHECKING:
    from furrowmap.core.images.image_aiding import ImageAid
    from furrowmap.core.images.image_features import ImageFeatures
    from furrowmap.core.implement.machine_voxels import MachineVoxels
    from furrowmap.core.matching.matched import Matched
    from furrowmap.core.matching.session_match import MatchedSession
    from furrowmap.core.pipeline.control.control_points import ControlResult

ORIGIN_STEP_M: Final = 100.0
"""The local origin of the points is a multiple of this."""


@dataclass(frozen=True)
class FlightCalibration:
    """What the ground that a flight sees several times shows: fields of :class:`RunResult`."""

    boresight: Boresight | None = None
    strips: tuple[Strip, ...] = ()
    strip_differences: StripDifferences | None = None
    strip_adjustment: StripAdjustment | None = None

    @property
    def clock_used_s(self) -> float:
        """Time by which the scanner's clock is behind, where that is corrected."""
        return self.boresight.clock_used_s if self.boresight is not None and self.boresight.certain else 0.0


@dataclass(frozen=True)
class FirstGuess:
    """The trajectory before scans are matched.

    Attributes:
        aid: by images; None without them.
        image_notices: about the images.
        position_notices: of the reader of the positions.
    """

    located: Located
    aid: ImageAid | None
    image_notices: tuple[Notice, ...] = ()
    position_notices: tuple[Notice, ...] = ()


@dataclass(frozen=True)
class Solution:
    """The trajectory and the scanner with it.

    Attributes:
        guess: from which it was made.
        lidar: the first scanner's recording, with the clock that is used.
        mounting: of the first scanner, which is used.
        implement: has seen the first scanner's scans.
        carrier: trajectory of the frame that carries the scanner; None for the vehicle's.
        scale: metres of the map for a metre on the ground, by which points are placed.
        matched: the result of scan matching; None where the scans were not matched.
        mount_notices: about the file of a moving mount.
        mounting_notices: about the mounting that a flight shows.
        control: what control points showed that corrected it; None without any.
    """

    guess: FirstGuess
    located: Located
    lidar: LidarRecording
    mounting: Mounting
    implement: ImplementTracker
    carrier: Trajectory | None
    scale: float
    matched: Matched | None = None
    flight: FlightCalibration = field(default_factory=FlightCalibration)
    mount_notices: tuple[Notice, ...] = ()
    mounting_notices: tuple[Notice, ...] = ()
    control: ControlResult | None = None

    def placer(self) -> Placer:
        """What places the points of the first scanner."""
        return placer_of(self.located, self.mounting, self.carrier, self.scale)


class Checkpoint(Protocol):
    """Keeps what the longest stage found, for a run that continues after this one was killed."""

    def load(self) -> MatchedSession | None:
        """What an earlier run of the same session and recordings kept; None for nothing."""
        ...

    def save(self, found: MatchedSession) -> None:
        """Keep what matching found."""
        ...


class Corrector(Protocol):
    """Corrects a solution by what is known of the ground, before points are placed by it."""

    def expect_near(self, trajectory: Trajectory) -> None:
        """Raise InputError if nothing lies where the drive goes that could correct it; called before the long work."""
        ...

    def corrected(self, solution: Solution, machine: MachineVoxels | None, progress: Progress) -> Solution:
        """The solution with a corrected trajectory; `machine` is as the first scanner sees it."""
        ...


class StopWatch:
    """Seconds of each stage."""

    def __init__(self) -> None:
        self.laps_s: dict[str, float] = {}
        self._last = perf_counter()

    def lap(self, stage: str) -> None:
        """End a stage."""
        arrays.release()
        now = perf_counter()
        self.laps_s[stage] = round(now - self._last, 3)
        self._last = now


def companions(opened: OpenSession) -> Companions:
    """The recordings of a session that go into the trajectory beside the positions."""
    session = opened.session
    return Companions(
        opened.inertial if session.imu is not None else None, opened.attitude if session.attitude is not None else None
    )


def ground_scale(frame: MapFrame, trajectory: Trajectory) -> float:
    """Metres of the map for a metre on the ground in the middle of a trajectory."""
    e, n, h = np.median(trajectory.xyz_m, axis=0)
    lon, lat = frame.to_lon_lat(np.array([e]), np.array([n]))
    return frame.ground_scale(float(lon[0]), float(lat[0]), float(h))


def placer_of(located: Located, mounting: Mounting, carrier: Trajectory | None = None, scale: float = 1.0) -> Placer:
    """What places the points of a scanner mounted so, against a round local origin in the middle of the drive."""
    middle = np.median(located.trajectory.xyz_m, axis=0)
    e, n, h = (np.round(middle / ORIGIN_STEP_M) * ORIGIN_STEP_M).tolist()
    return Placer(located.trajectory, mounting, (e, n, h), carrier, scale)


def aided_by_images(
    opened: OpenSession,
    located: Located,
    positions: Reader,
    progress: Progress,
    features: Mapping[ImageFile, ImageFeatures] | None = None,
) -> FirstGuess:
    """The trajectory aided by the images of the session's camera, where it has one; `features` as they were found."""
    camera = opened.session.camera
    about_positions = tuple(positions.notices)
    if camera is None or not camera.is_known:
        return FirstGuess(located, None, position_notices=about_positions)
    from furrowmap.core.pipeline.session_aid import aid_session

    scale = ground_scale(opened.frame, located.trajectory)
    aided = aid_session(opened, located, scale, progress, features)
    return FirstGuess(aided.located, aided.aid, aided.notices, about_positions)


def contradicts(located: Located) -> bool:
    """Whether measurements contradict each other."""
    return any(notice.code == CONTRADICTION for notice in located.notices)


def without_unstated_accuracy(located: Located, session: Session) -> Located:
    """The trajectory without standard deviations where the session leaves out a place that the cloud rests on.

    Nobody knows how wrong an assumed place is; the noise of the positions says nothing of it.
    """
    return replace(located, trajectory=located.trajectory.without_accuracy()) if session.unstated else located


def with_doubtful_heights(located: Located) -> Located:
    """The trajectory with larger standard deviations of the heights where these, or a part, may lack the geoid's."""
    most_m = max(located.height_levels_m, located.separation_off_m)
    if not most_m:
        return located
    sigma = located.trajectory.sigma.copy()
    sigma[:, 2] = np.hypot(sigma[:, 2], most_m)
    return replace(located, trajectory=replace(located.trajectory, sigma=sigma))


def held_against_control(located: Located, aid: ImageAid | None) -> Located:
    """The trajectory with larger standard deviations where all control points contradict it alike."""
    if aid is None or aid.control.control_shift_m is None:
        return located
    sigma = located.trajectory.sigma.copy()
    sigma[:, :3] = np.hypot(sigma[:, :3], aid.control.control_shift_m)
    return replace(located, trajectory=replace(located.trajectory, sigma=sigma))


def run_result(
    opened: OpenSession,
    located: Located,
    placement: Placement,
    work: FieldWork,
    clocks: tuple[ClockReading, ...],
    notices: Sequence[Notice],
    watch: StopWatch,
) -> RunResult:
    """The result of a run or a preview, its warnings sorted by what to do first."""
    return RunResult(
        session=opened.session,
        inputs=opened.inputs.all,
        frame=opened.frame,
        located=located,
        placement=placement,
        work=work,
        clocks=clocks,
        notices=by_cause(tuple(dict.fromkeys(notices))),
        timings_s=watch.laps_s,
    )
