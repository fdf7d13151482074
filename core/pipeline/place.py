"""From a solution and the scans to points in the sink, the implement and the ground worked."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from importlib.util import find_spec
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.coverage.field_boundary import ground_to_map
from furrowmap.core.coverage.field_work import FieldWork
from furrowmap.core.geodesy.projection import MapFrame
from furrowmap.core.implement.machine_voxels import MachineVoxels
from furrowmap.core.pipeline.field_files import FieldFiles, boundary_notices
from furrowmap.core.pipeline.notices import placement_notices, position_notices, refuse_empty, session_notices
from furrowmap.core.pipeline.run_result import RunResult
from furrowmap.core.pipeline.scanners import (
    FurtherRecording,
    classifiers,
    further_notices,
    further_recordings,
    together,
)
from furrowmap.core.pipeline.solution import Corrector, FirstGuess, Solution, StopWatch, ground_scale, run_result
from furrowmap.core.pointclouds.placed_scans import PLACED_AHEAD, PlacedScan, Placement, Placer, place_scans
from furrowmap.core.readers.areas.area import nothing_within
from furrowmap.core.runtime.background import SCANS_AHEAD, ahead, behind
from furrowmap.core.runtime.errors import Notice
from furrowmap.core.runtime.languages.texts import figure_text
from furrowmap.core.runtime.progress import Progress
from furrowmap.core.session.opened import OpenSession, watched
from furrowmap.core.values.images import CONTRADICTING
from furrowmap.core.values.scan import Scan
from furrowmap.core.values.trajectory import Trajectory

if TYPE_CHECKING:
    from furrowmap.core.images.image_frames import Frames
    from furrowmap.core.matching.relative_mounting import RelativeMounting


class OpenSink(Protocol):
    """Opens what takes the points of a run: a function of each scan's points, as they are placed."""

    def __call__(
        self, frame: MapFrame, origin_m: tuple[float, float, float], frames: Frames | None
    ) -> Callable[[PlacedScan], None]:
        """The sink, before the first scan.

        Args:
            origin_m: local origin of the points' coordinates.
            frames: of the camera, where the session has one and some frames have a pose.
        """
        ...


def place(
    opened: OpenSession,
    solution: Solution,
    files: FieldFiles,
    open_sink: OpenSink,
    watch: StopWatch,
    progress: Progress,
    corrector: Corrector | None = None,
) -> RunResult:
    """Place every point and hand it to the sink; find the implement and the ground worked.

    Raises:
        FurrowmapError: if no point has a place on the ground to map.
    """
    machine = solution.implement.learn(solution.located.trajectory)
    watch.lap("implement")
    if corrector is not None:
        solution = corrector.corrected(solution, machine, progress)
        watch.lap("control")
    further = _further_scanners(opened, solution, progress)
    if further:
        watch.lap("scanners")
    frames, about_frames = camera_frames(opened, solution.located.trajectory, solution.guess)
    sink = open_sink(opened.frame, solution.placer().origin_m, frames)
    placement = _place_all(opened, solution, machine, further, sink, progress)
    watch.lap("placing")
    refuse_empty(placement, solution.located.trajectory, opened.session)
    work = _work(opened, solution, further, files)
    notices = [
        *_notices_before(solution),
        *about_frames,
        *_notices(opened, solution, files, placement, work),
        *further_notices(opened, further),
        *solution.mounting_notices,
    ]
    watch.lap("work")
    return replace(
        run_result(opened, solution.located, placement, work, solution.lidar.clocks, notices, watch),
        matched=solution.matched,
        image_aid=solution.guess.aid,
        control=solution.control,
        further_scanners=_mountings(opened, further),
        **vars(solution.flight),
    )


def _mountings(opened: OpenSession, further: Sequence[FurtherRecording]) -> dict[str, RelativeMounting]:
    """The mounting of each scanner but the first, by its name."""
    return {lidar.name: one.found for lidar, one in zip(opened.session.further_lidars, further, strict=True)}


def _notices_before(solution: Solution) -> tuple[Notice, ...]:
    """What positions, scans, mount and images show, in the order of the work; complete once all scans were read."""
    guess = solution.guess
    of_scans = (*solution.lidar.notices, *solution.mount_notices)
    return (*guess.position_notices, *solution.located.notices, *of_scans, *guess.image_notices)


def _notices(
    opened: OpenSession, solution: Solution, files: FieldFiles, placement: Placement, work: FieldWork
) -> list[Notice]:
    """What the session leaves out, and what the points, the field and the work show."""
    return [
        *session_notices(opened.session, solution.located, matched=solution.matched is not None),
        *position_notices(placement, solution.located),
        *placement_notices(placement),
        *files.field_notices,
        *_field_notices(opened, work, solution),
        *files.state_notices,
        *work.notices,
    ]


def _further_scanners(opened: OpenSession, solution: Solution, progress: Progress) -> list[FurtherRecording]:
    """The session's scanners but the first one, calibrated against it."""
    trajectory = solution.located.trajectory
    return further_recordings(
        opened, solution.lidar, solution.mounting, solution.matched, trajectory, solution.implement, progress
    )


def _place_all(
    opened: OpenSession,
    solution: Solution,
    machine: MachineVoxels | None,
    further: Sequence[FurtherRecording],
    sink: Callable[[PlacedScan], None],
    progress: Progress,
) -> Placement:
    """Place the scans of all scanners, without the errors of their lasers."""
    corrected = solution.lidar.scans()
    if solution.matched is not None and solution.matched.ranges is not None:
        corrected = map(solution.matched.ranges.corrected, corrected)
    moving = ahead(solution.implement.following(corrected), SCANS_AHEAD)
    scans = together(watched(moving, solution.lidar, progress, "placing points"), further)
    placer = solution.placer()
    placers = [placer, *(replace(placer, mounting=one.found.mounting) for one in further)]
    with behind(sink, PLACED_AHEAD) as add:
        standing = opened.session.run.standing
        return place_within(opened, scans, placers, add, classifiers(machine, further), standing=standing)


def place_within(
    opened: OpenSession,
    scans: Iterator[Scan],
    placers: Sequence[Placer],
    sink: Callable[[PlacedScan], None],
    classify: Sequence[Callable[[Scan], NDArray[np.uint8]]],
    *,
    standing: bool,
) -> Placement:
    """Place the scans and hand on the points that lie on the ground to map; placers and classes are of each scanner."""
    file = opened.inputs.within
    area = ground_to_map(file, opened.frame) if file is not None else None
    placement = place_scans(
        scans,
        placers[0],
        standing=standing,
        sink=sink,
        classify=lambda scan: classify[scan.scanner](scan),
        within=area,
        further=placers[1:],
    )
    if area is not None and not placement.points and placement.points_elsewhere:
        east_m, north_m = np.median(placement.poses.xyz_m[:, :2], axis=0).tolist()
        raise nothing_within(area, figure_text(f"{placement.points_elsewhere:,} points"), (east_m, north_m))
    return placement


def _work(opened: OpenSession, solution: Solution, further: Sequence[FurtherRecording], files: FieldFiles) -> FieldWork:
    """The states of the implement and the ground worked, by the first scanner that shows it."""
    shown = ((k, one.implement) for k, one in enumerate(further, start=1) if one.implement is not None)
    number, tracker = next(shown, (0, solution.implement))
    work = tracker.work(solution.located.trajectory, opened.frame, files.boundary, list(files.states))
    return replace(work, scanner=number)


def _field_notices(opened: OpenSession, work: FieldWork, solution: Solution) -> list[Notice]:
    """Whether the ground worked lies in the field, and what was decided about the ground to map."""
    notices = boundary_notices(work, solution.located.trajectory)
    if opened.inputs.within is not None:
        notices += ground_to_map(opened.inputs.within, opened.frame).notices
    return notices


def camera_frames(opened: OpenSession, trajectory: Trajectory, guess: FirstGuess) -> tuple[Frames | None, list[Notice]]:
    """The frames that have a pose, with the camera as they show it, else as stated; and notices about them."""
    camera = opened.session.camera
    if camera is None or any(notice.code == CONTRADICTING for notice in guess.image_notices):
        return None, []
    if not camera.is_known:
        return None, [Notice("images-unused.no-intrinsics")]
    if find_spec("PIL") is None:
        return None, [Notice("images-unused")]
    images, notices = opened.images()
    if not images:
        return None, notices
    from furrowmap.core.images.image_frames import frames_along

    used = guess.aid.camera if guess.aid is not None else opened.camera()
    frames, unposed = frames_along(images, used, trajectory, ground_scale(opened.frame, trajectory))
    return frames, notices + unposed
