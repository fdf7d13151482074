"""A vehicle with an IMU: positions and IMU, images, and the ground that strips see several times."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Final

import numpy as np

from furrowmap.core.coverage.field_work import ImplementTracker
from furrowmap.core.pipeline.solution import (
    FirstGuess,
    FlightCalibration,
    Solution,
    StopWatch,
    aided_by_images,
    companions,
    contradicts,
    ground_scale,
    held_against_control,
    with_doubtful_heights,
    without_unstated_accuracy,
)
from furrowmap.core.readers.reader import GivesTrack, Reader
from furrowmap.core.runtime.background import beside
from furrowmap.core.runtime.errors import Notice
from furrowmap.core.runtime.progress import Progress
from furrowmap.core.session.opened import LidarRecording, OpenSession, watched
from furrowmap.core.strips.boresight import (
    MAX_DRAWN_DEG,
    Boresight,
    boresight_notices,
    held_against_mounting,
    held_against_strips,
)
from furrowmap.core.strips.height_creep import held_against_heights
from furrowmap.core.strips.model_by_strips import LikelierModel, likelier_model
from furrowmap.core.strips.strip_adjustment import (
    StripAdjustment,
    calibrate_flight,
    scanner_goes_with_imu,
    timed_wrongly,
)
from furrowmap.core.strips.strip_differences import strip_differences
from furrowmap.core.strips.strips import StripReturns, ThinnedReturns, at_shifted_times, thinned_returns
from furrowmap.core.trajectory.located import Located, locate, middle_s
from furrowmap.core.trajectory.moving_mount import carrier_of
from furrowmap.core.trajectory.straight_passes import find_strips
from furrowmap.core.values.rotation import Mounting
from furrowmap.core.values.session import Session
from furrowmap.core.values.time_span import track_within
from furrowmap.core.values.trajectory import Trajectory

if TYPE_CHECKING:
    from furrowmap.core.images.image_aiding import ImageAid

IMU_CLOCK_STEP_S: Final = 1e-4
"""The session's offset of the IMU's clock is as precise."""


@dataclass(frozen=True)
class FlightScans:
    """The first reading of a flight's scans."""

    lidar: LidarRecording
    returns: ThinnedReturns
    implement: ImplementTracker


def first_guess(
    opened: OpenSession, positions: Reader, watch: StopWatch, progress: Progress
) -> tuple[FirstGuess, FlightScans]:
    """The trajectory from positions and IMU, aided by images; beside it, the scans are read a first time."""
    session = opened.session

    def located() -> Located:
        found = locate(positions, session, opened.frame, companions(opened))
        watch.lap("positions")
        return found

    survey = partial(_read_survey, opened)
    if session.camera is None or not session.camera.aid:
        with beside(survey, progress) as scans:
            guess = aided_by_images(opened, located(), positions, progress)
            watch.lap("images")
    else:
        from furrowmap.core.pipeline.session_aid import features_ahead

        # Features take all cores beside the trajectory; the adjustment of the images leaves them to the scans.
        with beside(partial(features_ahead, opened), progress) as features:
            found = located()
        with beside(survey, progress) as scans:
            guess = aided_by_images(opened, found, positions, progress, features.result())
            watch.lap("images")
    return guess, scans.result()


def _read_survey(opened: OpenSession, progress: Progress) -> FlightScans:
    """Read a flight's scans before its trajectory is known; the positions themselves say when it was."""
    positions = opened.positions()
    assert isinstance(positions, GivesTrack)
    track = track_within(positions.track(), opened.session.recording.span_s)
    lidar = opened.lidar(middle_s(track))
    implement = ImplementTracker(opened.session, flying=True)
    scans = map(implement.looked_at, watched(lidar.scans(), lidar, progress, "reading scans"))
    span_s = (float(track.t_s[0]), float(track.t_s[-1])) if len(track) else (0.0, 0.0)
    return FlightScans(lidar, thinned_returns(scans, span_s), implement)


def solve(opened: OpenSession, guess: FirstGuess, survey: FlightScans) -> Solution:
    """Boresight and trajectory by the strips; the recording gets the clock that they show."""
    session = opened.session
    carrier, mount_notices = carrier_of(guess.located, session, opened.inputs.mount)
    returns = survey.returns.posed(guess.located.trajectory if carrier is None else carrier)
    located, flown = _calibrate_flight(opened, guess.located, returns, carrier)
    other = _likelier_model(opened, guess.located, returns, carrier, flown, survey.lidar)
    if other is not None:
        # Poses and mounting that fit the elevations of another model are not those of the flight.
        located = replace(guess.located, notices=(*guess.located.notices, other.notice))
        flown = FlightCalibration(strips=flown.strips)
    located = without_unstated_accuracy(located, session)
    located, doubts = _held_against_mounting(located, flown.boresight, guess.aid)
    located = held_against_control(with_doubtful_heights(located), guess.aid)
    if located.trajectory is not guess.located.trajectory:
        carrier, mount_notices = _carrier_trajectory(opened, located, flown.strip_adjustment)
    notices = [*_boresight_notices(flown.boresight, session.lidar.mounting, located), *doubts]
    return Solution(
        guess,
        located,
        survey.lidar.ahead_by(-flown.clock_used_s),
        _mounting(session, flown.boresight),
        survey.implement,
        carrier,
        ground_scale(opened.frame, located.trajectory),
        flight=flown,
        mount_notices=tuple(mount_notices),
        mounting_notices=tuple(notices),
    )


def _mounting(session: Session, found: Boresight | None) -> Mounting:
    """The mounting of the scanner that is used: as the strips show it, else as the session states it."""
    return found.mounting if found is not None and found.certain else session.lidar.mounting


def _likelier_model(
    opened: OpenSession,
    guess: Located,
    returns: StripReturns,
    carrier: Trajectory | None,
    flown: FlightCalibration,
    lidar: LidarRecording,
) -> LikelierModel | None:
    """The model of which the scanner likely is, rather than the one that it is read as."""
    if flown.boresight is None or contradicts(guess):
        return None
    stated = opened.session.lidar.mounting
    return likelier_model(returns, guess.trajectory, stated, carrier, flown.boresight, lidar.beam_elevations())


def _carrier_trajectory(
    opened: OpenSession, located: Located, adjusted: StripAdjustment | None
) -> tuple[Trajectory | None, list[Notice]]:
    """The trajectory of the frame that carries the scanner, None for the vehicle's, and notices about its file."""
    turned = adjusted.turned if adjusted is not None else None
    if turned is None:
        return carrier_of(located, opened.session, opened.inputs.mount)
    carrier, notices = carrier_of(replace(located, trajectory=turned.carrier), opened.session, opened.inputs.mount)
    return turned.carrier if carrier is None else carrier, notices


def _calibrate_flight(
    opened: OpenSession, guess: Located, returns: StripReturns, carrier: Trajectory | None
) -> tuple[Located, FlightCalibration]:
    """Boresight, strips and their differences; the trajectory adjusted by the strips."""
    located, flown = _calibrated(opened, guess, returns, carrier)
    moved = flown.boresight is not None and flown.boresight.mounting.xyz_m != opened.session.lidar.xyz_m
    if moved and any(notice.key == "contradiction.creep" for notice in located.notices):
        # Ground that creeps from strip to strip looks like a scanner at another place, but not the other way round.
        return _calibrated(opened, guess, returns, carrier, place_known=True)
    return located, flown


def _calibrated(
    opened: OpenSession, guess: Located, returns: StripReturns, carrier: Trajectory | None, *, place_known: bool = False
) -> tuple[Located, FlightCalibration]:
    """As :func:`_calibrate_flight`; `place_known` says that the scanner's place stays as stated."""
    stated = opened.session.lidar.mounting
    located = guess
    walk = opened.session.lidar.rpy_walk_deg_rts
    ahead_s = _imu_ahead_s(opened.session, guess)
    by_imu = ahead_s != 0.0 and scanner_goes_with_imu(returns, guess.trajectory, stated, ahead_s, carrier)
    if by_imu:
        returns = at_shifted_times(returns, guess.trajectory if carrier is None else carrier, -ahead_s)
    found, returns, adjusted = calibrate_flight(returns, guess, stated, carrier, walk, place_known=place_known)
    if adjusted is not None:
        located = _adjusted_by_strips(guess, adjusted)
        carrier = _carrier_trajectory(opened, located, adjusted)[0]
        returns = at_shifted_times(returns, located.trajectory if carrier is None else carrier, 0.0)
    if found is not None and by_imu:
        found = replace(found, clock_used_s=found.clock_used_s - ahead_s)
    if found is not None and found.certain and ahead_s and abs(found.clock_used_s + ahead_s) < 0.5 * abs(ahead_s):
        notice = Notice("contradiction.positions-late", off_s=abs(ahead_s), is_ahead_s=ahead_s < 0.0)
        doubtful = timed_wrongly(located.trajectory, ahead_s)
        located = replace(located, trajectory=doubtful, notices=(*located.notices, notice))
    strips = find_strips(located.trajectory)
    used = _mounting(opened.session, found)
    differences = strip_differences(returns, strips, stated, used)
    if found is not None and found.coincides and not contradicts(located):
        doubtful, creeps = held_against_strips(located.trajectory, returns, strips, used)
        if creeps is not None:
            located = replace(located, trajectory=doubtful, notices=(*located.notices, creeps))
    return located, FlightCalibration(found, strips, differences, adjusted)


def _adjusted_by_strips(guess: Located, adjusted: StripAdjustment) -> Located:
    """The trajectory that strips adjusted; heights are held against what they find."""
    trajectory = adjusted.trajectory
    if contradicts(guess):
        # Strips know the errors of the poses by what the contradiction denies, so they do not make them smaller.
        return replace(
            guess, trajectory=replace(trajectory, sigma=np.maximum(trajectory.sigma, guess.trajectory.sigma))
        )
    if not adjusted.boresight.certain or adjusted.boresight.turned_deg > MAX_DRAWN_DEG:
        return replace(guess, trajectory=trajectory)
    trajectory, creeps = held_against_heights(trajectory, adjusted.before, adjusted.found)
    return replace(guess, trajectory=trajectory, notices=(*guess.notices, *([creeps] if creeps is not None else [])))


def _boresight_notices(found: Boresight | None, stated: Mounting, located: Located) -> list[Notice]:
    """Notices about the mounting, of which none blames it for what another cause explains."""
    keys = {notice.key for notice in located.notices}
    if "contradiction.elevations-of-another" in keys:
        return []
    notices = boresight_notices(found, stated)
    if "contradiction.lever-arm" in keys:
        # With another place of the IMU all places in the vehicle are off together.
        return [notice for notice in notices if notice.code != "lever-arm-off"]
    return notices


def _held_against_mounting(
    located: Located, found: Boresight | None, aid: ImageAid | None
) -> tuple[Located, list[Notice]]:
    """The trajectory with larger standard deviations of the attitude where the IMU may be turned, and why."""
    if found is None or (contradicts(located) and not found.certain):
        return located, []
    camera_deg = float(np.linalg.norm(aid.adjusted.correction_deg)) if aid is not None else np.inf
    trajectory, notice = held_against_mounting(located.trajectory, found, camera_deg)
    return replace(located, trajectory=trajectory), [notice] if notice is not None else []


def _imu_ahead_s(session: Session, located: Located) -> float:
    """By how much the IMU's clock was found to be ahead of the positions', beyond what the session states."""
    if session.imu is None or located.inertial is None:
        return 0.0
    ahead_s = located.inertial.minus_gnss_s - session.imu.minus_gnss_s
    return ahead_s if abs(ahead_s) > IMU_CLOCK_STEP_S else 0.0
