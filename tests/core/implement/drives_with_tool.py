"""Drives with a tool: in closed form, and those of the sample recordings' truth."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import geopandas as gpd
import numpy as np
import pandas as pd
from numpy.typing import NDArray

from furrowmap.core.geodesy.projection import MapFrame, map_frame
from furrowmap.core.readers.reader import ReadOptions, open_recording
from furrowmap.core.session.session_file import load_session
from furrowmap.core.trajectory.from_poses import trajectory_from_poses
from furrowmap.core.values.session import Crs, Session
from furrowmap.core.values.tool_states import ToolStates
from furrowmap.core.values.trajectory import Trajectory, trajectory_from_attitude
from tests.core.trajectory.drives import Drive

FRAME = map_frame(Crs(map="EPSG:6677"))
PLACE_M = np.array([16_600.0, 96_500.0])


def trajectory_of(drive: Drive, sigma: tuple[float, ...] | None = None) -> Trajectory:
    """The true trajectory of a level drive."""
    n = len(drive.t_s)
    trajectory = trajectory_from_attitude(
        drive.t_s,
        np.column_stack([drive.en_m + PLACE_M, np.full(n, 250.0)]),
        0.0,
        0.0,
        90.0 - np.degrees(drive.yaw_rad),
        max_gap_s=1.0,
        speed_mps=drive.speed_mps,
        motion=np.sign(np.round(drive.speed_mps, 3)).astype(np.int8),
    )
    return trajectory if sigma is None else replace(trajectory, sigma=np.tile(sigma, (n, 1)))


def states_of(
    trajectory: Trajectory, *down_s: tuple[float, float], sigma_s: float = 0.0, unknown_s: tuple[float, float] = (0, 0)
) -> ToolStates:
    """Down between times (seconds after the trajectory's beginning), unknown in one span, up otherwise."""
    first, last = trajectory.span_s
    cuts = np.unique([0.0, *np.ravel(down_s), *unknown_s, last - first])
    middle = 0.5 * (cuts[1:] + cuts[:-1])
    state = np.zeros(len(middle), np.int8)
    for begin, end in down_s:
        state[(middle > begin) & (middle < end)] = 1
    state[(middle > unknown_s[0]) & (middle < unknown_s[1])] = -1
    sigma = np.array([0.0, *[sigma_s] * (len(cuts) - 2), 0.0])
    times = cuts + first
    return ToolStates(times[:-1], times[1:], state, np.ones(len(state)), sigma[:-1], sigma[1:])


@dataclass(frozen=True)
class Sample:
    """A sample recording's truth."""

    session: Session
    frame: MapFrame
    trajectory: Trajectory
    states: ToolStates
    passes: gpd.GeoDataFrame
    coverage: gpd.GeoDataFrame
    overlaps: gpd.GeoDataFrame
    boundary_file: Path


def sample(folder: Path) -> Sample:
    """The truth of the sample recording in `folder`: the tool crosses its working depth between two rows."""
    session = load_session(folder / "session.toml")
    frame = map_frame(session.crs)
    poses = open_recording((folder / "truth" / "trajectory.csv",), ReadOptions()).poses()
    tool = pd.read_csv(folder / "truth" / "implement.csv")
    t, down = tool.time_unix_s.to_numpy(), (tool.state == "down").to_numpy()
    depth = tool.tool_height_m.to_numpy() - session.implement.working_depth_m
    k = np.flatnonzero(np.diff(down.astype(int)))
    cuts = np.concatenate([t[:1], t[k] + depth[k] / (depth[k] - depth[k + 1]) * (t[k + 1] - t[k]), t[-1:]])
    state = np.concatenate([down[:1], down[k + 1]]).astype(np.int8)
    zero = np.zeros(len(state))
    layers = [
        gpd.read_file(folder / "truth" / "worked.gpkg", layer=name) for name in ("passes", "coverage", "overlaps")
    ]
    return Sample(
        session,
        frame,
        trajectory_from_poses(poses, frame),
        ToolStates(cuts[:-1], cuts[1:], state, zero + 1.0, zero, zero),
        *layers,
        folder / "boundary.geojson",
    )


def disturbed(
    drive: Trajectory, en_m: NDArray[np.float64], heading_deg: NDArray[np.float64], sigma: tuple[float, ...]
) -> Trajectory:
    """The same drive with errors of position (n, 2) and heading (n,) added, and what is said of them."""
    roll, pitch, heading = drive.attitude_deg()
    trajectory = trajectory_from_attitude(
        drive.t_s,
        drive.xyz_m + np.column_stack([en_m, np.zeros(len(en_m))]),
        roll,
        pitch,
        heading + heading_deg,
        max_gap_s=drive.max_gap_s,
        speed_mps=drive.speed_mps,
        motion=drive.motion,
    )
    return replace(trajectory, sigma=np.tile(sigma, (len(drive), 1)))


def thinned(path: Trajectory, step: int) -> Trajectory:
    """Every so many-th pose."""
    kept = slice(None, None, step)
    roll, pitch, heading = path.attitude_deg()
    return trajectory_from_attitude(
        path.t_s[kept],
        path.xyz_m[kept],
        roll[kept],
        pitch[kept],
        heading[kept],
        max_gap_s=path.max_gap_s,
        speed_mps=path.speed_mps[kept],
        motion=path.motion[kept],
    )
