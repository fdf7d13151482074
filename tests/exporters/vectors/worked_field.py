"""A field worked in closed form: two passes side by side, with an overlap, a strip missed and a boundary."""

from __future__ import annotations

import numpy as np
import shapely

from furrowmap.core.coverage.field_work import FieldWork, events, pass_depths, tool_paths
from furrowmap.core.coverage.worked_ground import worked_ground
from furrowmap.core.implement.states import ToolHistory
from furrowmap.core.values.session import Implement
from furrowmap.core.values.trajectory import ScanPoses
from tests.core.implement.drives_with_tool import FRAME, states_of, trajectory_of
from tests.core.trajectory.drives import drive

TILLER = Implement(width_m=1.7, xy_m=(-1.5, 0.0), working_depth_m=0.12)
LEGS = ((20, 1.0, 0), (8, 1.0, 24.6), (20, 1.0, 0), (4, 0, 0), (8, 1.0, 24.6), (20, 1.0, 0))
DOWN_S = ((2.0, 18.0), (31.0, 46.0), (63.0, 78.0))
LIFTED_M = 0.45


def worked_field() -> tuple[ScanPoses, FieldWork]:
    """The poses of the scans, and what the tool did: down three times, its height known but for two seconds."""
    trajectory = trajectory_of(drive(*LEGS), sigma=(0.01, 0.01, 0.02, 0.1, 0.1, 0.2))
    states = states_of(trajectory, *DOWN_S, sigma_s=0.02)
    t_s = trajectory.t_s[1:-1]
    state, confidence = states.at(t_s)
    height = np.where(state == 1, 0.0, LIFTED_M)
    height[100:120] = np.nan
    number = np.arange(len(t_s))
    history = ToolHistory(
        t_s=t_s,
        tool_height_m=height,
        soil_height_m=np.zeros(len(t_s)),
        state=state,
        confidence=confidence,
        states=states,
        threshold_m=0.12,
        lifted_m=LIFTED_M,
        notices=(),
    )
    boundary = shapely.box(*(trajectory.xyz_m[:, :2].min(axis=0) - 3), *(trajectory.xyz_m[:, :2].max(axis=0) + 3))
    ground = worked_ground(trajectory, states, TILLER, FRAME, boundary)
    work = FieldWork(
        history=history,
        boundary=boundary,
        ground=ground,
        depths=pass_depths([p.times for p in ground.passes], t_s, height, history.soil_height_m, 0.12),
        paths=tuple(tool_paths(trajectory, states, TILLER)),
        events=tuple(events(trajectory, states, TILLER)),
    )
    poses = trajectory.at(t_s)
    scans = ScanPoses(
        scan=number,
        t_s=t_s,
        xyz_m=poses.xyz_m,
        quaternion=poses.quaternion,
        speed_mps=trajectory.speed_mps[1:-1],
        motion=trajectory.motion[1:-1],
        fix=np.where(number < 300, 4, 5).astype(np.int8),
        sigma=trajectory.sigma[1:-1],
        heading_from=np.full(len(t_s), "gnss"),
        position_from=np.full(len(t_s), "gnss"),
        height_from=np.full(len(t_s), "ground"),
        level_from=np.full(len(t_s), "assumed"),
        points=np.full(len(t_s), 25_000),
    )
    return scans, work
