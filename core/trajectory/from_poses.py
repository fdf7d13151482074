"""The trajectory that a file of poses states, transformed to the map frame."""

from dataclasses import replace

import numpy as np

from furrowmap.core.geodesy.projection import MapFrame
from furrowmap.core.runtime.errors import InputError
from furrowmap.core.trajectory.vehicle_motion import HALF_WINDOW_S, STANDING_MPS, local_velocity, longest_gap_s
from furrowmap.core.values.pose_track import PoseTrack
from furrowmap.core.values.trajectory import Motion, Trajectory, trajectory_from_attitude


def trajectory_from_poses(track: PoseTrack, frame: MapFrame) -> Trajectory:
    """The trajectory of the vehicle frame that `track` states.

    Raises:
        InputError: if there are fewer than two poses.
        RefusedError: if the place lies outside the area for which the map's CRS is meant.
    """
    if len(track) < 2:
        raise InputError("trajectory-empty", source=track.source, track=len(track))
    if track.projected:
        e = track.position[:, 0]
        n = track.position[:, 1]
        lon, lat = frame.to_lon_lat(e, n)
        frame.project(lon, lat)  # refuses coordinates that lie outside the CRS's area
    else:
        lon = track.position[:, 0]
        lat = track.position[:, 1]
        e, n = frame.project(lon, lat)
    heading = track.heading_deg - frame.convergence_deg(lon, lat) if track.true_north else track.heading_deg
    max_gap_s = longest_gap_s(track.t_s)
    segment = np.cumsum(np.diff(track.t_s, prepend=track.t_s[:1]) > max_gap_s, dtype=np.intp)
    velocity = local_velocity(track.t_s, np.column_stack([e, n]), segment, HALF_WINDOW_S / 2)
    turned = np.radians(heading)
    speed = velocity[:, 0] * np.sin(turned) + velocity[:, 1] * np.cos(turned)
    motion = np.where(speed > STANDING_MPS, Motion.FORWARD, np.where(speed < -STANDING_MPS, Motion.REVERSE, 0))
    trajectory = trajectory_from_attitude(
        track.t_s,
        np.column_stack([e, n, track.position[:, 2]]),
        track.roll_deg,
        track.pitch_deg,
        heading,
        max_gap_s=max_gap_s,
        speed_mps=np.where(motion == 0, 0.0, speed),
        motion=motion.astype(np.int8),
    )
    return replace(trajectory, sigma=track.sigma)
