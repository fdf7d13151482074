"""A solution corrected by control points: one way for all stories, between their solution and the placing of points."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from furrowmap.core.implement.machine_voxels import MachineVoxels, classifier
from furrowmap.core.pipeline.control.control_points import GroundControl, read_control
from furrowmap.core.pipeline.control.correction import Correction, correction, error_model
from furrowmap.core.pipeline.control.returns_at_points import ReturnsAtPoints
from furrowmap.core.pipeline.control.seen_points import Sight, seen_point
from furrowmap.core.pipeline.solution import Solution
from furrowmap.core.pointclouds.placed_scans import place_scans
from furrowmap.core.pointclouds.survey_targets import TargetSizes
from furrowmap.core.runtime.background import SCANS_AHEAD, ahead
from furrowmap.core.runtime.progress import Progress
from furrowmap.core.session.opened import OpenSession, watched
from furrowmap.core.values.trajectory import Trajectory


def control_of(opened: OpenSession) -> GroundControl:
    """The control points that a session names. Errors as :func:`read_control`."""
    path = opened.inputs.ground_control
    assert path is not None
    field = opened.session.field
    sizes = TargetSizes(field.control_disc_m, field.control_checkerboard_m)
    return read_control(path, opened.frame.whole_crs, sizes, opened.inputs.check_points)


def by_control(
    solution: Solution, control: GroundControl, machine: MachineVoxels | None, progress: Progress
) -> Solution:
    """The solution with the positions that control points correct, and with what they showed.

    The scans are read once more: points are placed as the solution has them, and those around control points looked at.

    Args:
        machine: as the first scanner sees it; None where not known.
    """
    found = _found(solution, control, machine, progress)
    located = solution.located
    trajectory = found.applied(located.trajectory)
    carrier = found.applied(solution.carrier, keep_sigma=True) if solution.carrier is not None else None
    located = replace(located, trajectory=_doubtful(trajectory, found), notices=(*located.notices, *found.notices))
    return replace(solution, located=located, carrier=carrier, control=found.result)


def _found(solution: Solution, control: GroundControl, machine: MachineVoxels | None, progress: Progress) -> Correction:
    """The error of positions by what the first scanner sees of the points."""
    placer = solution.placer()
    around = ReturnsAtPoints(control.xyz_m, placer.origin_m, max(target.reach_m for target in control.target))
    scans = ahead(solution.lidar.scans(), SCANS_AHEAD)
    if solution.matched is not None and solution.matched.ranges is not None:
        scans = map(solution.matched.ranges.corrected, scans)
    place_scans(
        watched(scans, solution.lidar, progress, "looking at control points"),
        placer,
        standing=True,
        sink=around.add,
        classify=classifier(machine),
    )
    trajectory = solution.located.trajectory
    held = solution.matched is not None or solution.flight.strip_adjustment is not None
    model = error_model(trajectory, control.xyz_m, held=held)
    boresight = solution.flight.boresight
    angles_deg = boresight.sigma_deg if boresight is not None and boresight.certain else (0.0,)
    sight = Sight(
        trajectory,
        solution.mounting,
        float(np.sqrt(np.mean(np.square(angles_deg)))),
        model.common_sigma_deg,
    )
    seen = [seen_point(place, around.at(k), sight, control.target[k]) for k, place in enumerate(control.xyz_m)]
    return correction(control, seen, trajectory, model)


def _doubtful(trajectory: Trajectory, found: Correction) -> Trajectory:
    """The trajectory with larger standard deviations where all points contradict it alike."""
    if found.contradicts_m is None:
        return trajectory
    sigma = trajectory.sigma.copy()
    sigma[:, :3] = np.hypot(sigma[:, :3], found.contradicts_m)
    return replace(trajectory, sigma=sigma)
