"""Timing of the drive: speeds along the path, stops, lifting and lowering of the implement."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.simulator.noise import FloatArray, band_noise
from furrowmap.core.simulator.path import DrivenPath
from furrowmap.core.simulator.scenario import FrontImplement, ScenarioDrive, ScenarioImplement

DRIVE_RATE_HZ = 200
"""Samples per second of all motion."""
LEAD_IN_S = 0.5
AFTER_S = 0.8
"""Duration for which the drive is known before its start and after its end."""


@dataclass(frozen=True)
class SimulatedTrack:
    """The drive in the plane, at `RATE_HZ` from `BEFORE_S` before t0 to `AFTER_S` after its end.

    Attributes:
        e_m, n_m: (n,) rear axle, local.
        yaw_rad: (n,) of the nose, counter-clockwise from east, without jumps.
        speed_mps: (n,) forward positive.
        tool_m: (n,) height of the tool above its working position.
        down: (n,) whether the tool is in the ground.
    """

    t_s: FloatArray
    e_m: FloatArray
    n_m: FloatArray
    yaw_rad: FloatArray
    speed_mps: FloatArray
    tool_m: FloatArray
    down: NDArray[np.bool_]
    duration_s: float


def drive_path(
    path: DrivenPath, drive: ScenarioDrive, implement: ScenarioImplement, rng: np.random.Generator
) -> SimulatedTrack:
    """The `path` driven, from ``drive.start_xy_m`` in the direction of ``drive.lane_heading_deg``."""
    knots_s, knots_m, speeds_mps = _timetable(path, drive)
    duration_s = float(knots_s[-1]) + drive.stand_end_s
    count = math.floor((duration_s + AFTER_S + LEAD_IN_S) * DRIVE_RATE_HZ) + 1
    t_s = np.arange(count) / DRIVE_RATE_HZ - LEAD_IN_S
    i = np.clip(np.searchsorted(knots_s, t_s, side="right") - 1, 0, len(knots_s) - 2)
    span = knots_s[i + 1] - knots_s[i]
    since = np.clip(t_s - knots_s[i], 0.0, span)
    acceleration = (speeds_mps[i + 1] - speeds_mps[i]) / np.where(span > 0.0, span, 1.0)
    distance_m = knots_m[i] + speeds_mps[i] * since + 0.5 * acceleration * since**2
    moving = (t_s > knots_s[0]) & (t_s < knots_s[-1])
    speed_mps = np.where(moving, speeds_mps[i] + acceleration * since, 0.0)
    u, v, yaw = (np.interp(distance_m, path.distance_m, values) for values in (path.u_m, path.v_m, path.yaw_rad))
    gear = path.gear[np.clip(np.searchsorted(path.distance_m, distance_m, side="right") - 1, 0, len(path.gear) - 1)]
    lane = math.radians(90.0 - drive.lane_heading_deg)
    first_there_s = knots_s[np.searchsorted(knots_m, np.array(path.passes) - 1e-9)]

    def moved(since_s: FloatArray) -> FloatArray:
        x = np.clip(since_s / implement.move_s, 0.0, 1.0)
        return x * x * (3.0 - 2.0 * x)

    lifted = np.ones(len(t_s))
    for lowered_s, lifted_s in first_there_s:
        lifted -= moved(t_s - lowered_s) - moved(t_s - lifted_s)
    jitter = band_noise(rng, len(t_s), DRIVE_RATE_HZ, 0.5, 3.0) * implement.jitter_m
    tool_m = implement.lift_m * lifted + (1.0 - np.clip(lifted, 0.0, 1.0)) * jitter
    return SimulatedTrack(
        t_s,
        drive.start_xy_m[0] + u * math.cos(lane) - v * math.sin(lane),
        drive.start_xy_m[1] + u * math.sin(lane) + v * math.cos(lane),
        yaw + lane,
        speed_mps * gear,
        tool_m,
        tool_m < implement.working_depth_m,
        duration_s,
    )


def drive_front(
    path: DrivenPath, drive: ScenarioDrive, front: FrontImplement, rng: np.random.Generator
) -> SimulatedTrack:
    """The same drive with the height and state of the implement in front."""
    ends = [
        (max(lowered_m - front.ahead_m, 0.0), max(lifted_m - front.ahead_m, 0.0))
        for number, (lowered_m, lifted_m) in enumerate(path.passes)
        if not front.passes or number in front.passes
    ]
    return drive_path(replace(path, passes=tuple(ends)), drive, front, rng)


def _timetable(path: DrivenPath, drive: ScenarioDrive) -> tuple[FloatArray, FloatArray, FloatArray]:
    """(time, way, speed) at every point of the way, stands as two points at one way.

    The speed is the highest that keeps the limits and stops with the stated acceleration: each limit spreads as
    ``v² + 2·a·distance`` to both sides, and the lowest of all counts.
    """
    way, square = path.distance_m, path.limit_mps**2
    stops = sorted(path.stops)
    standing = np.searchsorted(way, [at_m for at_m, _ in stops])
    square[standing] = square[0] = square[-1] = 0.0
    rise = 2.0 * drive.accel_mps2 * way
    square = np.minimum.accumulate(square - rise) + rise
    square = np.minimum.accumulate((square + rise)[::-1])[::-1] - rise
    speed = np.sqrt(np.maximum(square, 0.0))
    t_s = drive.stand_start_s + np.concatenate([[0.0], np.cumsum(2.0 * np.diff(way) / (speed[1:] + speed[:-1]))])
    for index, (_, stand_s) in zip(standing[::-1], stops[::-1], strict=True):
        t_s[index + 1 :] += stand_s
        t_s, way, speed = (np.insert(values, index + 1, values[index]) for values in (t_s, way, speed))
        t_s[index + 1] += stand_s
    return t_s, way, speed
