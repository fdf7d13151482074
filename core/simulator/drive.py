"""The drive: speed along the line that the middle of the rear axle drives, its passes, and the turns between them.

A turn is put together from arcs whose curvature rises and falls along `ramp_m`, as steering does (clothoids), and is
symmetrical about the line half-way between two lanes; the one angle left open is found by bisection on its width.
"""

import functools
import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.simulator.noise import FloatArray, band_noise
from furrowmap.core.simulator.scenario import FrontImplement, ScenarioDrive, ScenarioImplement

PATH_STEP_M: Final = 0.01
"""Spacing of the points along the line."""


@dataclass(frozen=True)
class DrivenPath:
    """The line driven, in points about `STEP_M` apart.

    Attributes:
        distance_m: (n,) metres driven since the start, forwards or backwards.
        u_m: (n,) along the first lane, from the start.
        v_m: (n,) to the left of it.
        yaw_rad: (n,) of the nose, counter-clockwise from the first lane's direction.
        gear: (n,) 1 where the way up to the next point goes forward, -1 where it goes backward.
        stops: (distance_m, seconds) of every stand between start and end.
        passes: (distance_m where the tool is lowered, distance_m where it is lifted) of every pass.
    """

    distance_m: FloatArray
    u_m: FloatArray
    v_m: FloatArray
    yaw_rad: FloatArray
    gear: FloatArray
    limit_mps: FloatArray
    stops: tuple[tuple[float, float], ...]
    passes: tuple[tuple[float, float], ...]


@dataclass(frozen=True)
class _Piece:
    """A stretch driven in one gear, from the origin along x: points, headings, and its length."""

    x: FloatArray
    y: FloatArray
    yaw: FloatArray
    length_m: float
    gear: int


def plan_path(drive: ScenarioDrive, rng: np.random.Generator) -> DrivenPath:
    """Passes and turns of `drive`, with a driver who wanders a little."""
    line = _Line()
    for number, (lane_m, pass_m) in enumerate(zip(drive.lanes_m, drive.pass_m, strict=True)):
        if number:
            side = 1.0 if number % 2 else -1.0
            width_m = round(side * (lane_m - drive.lanes_m[number - 1]), 9)
            for piece in _turn(drive, width_m):
                line.drive(piece, drive.speed_turn_mps * (1.0 if piece.gear > 0 else 0.85), drive.gear_s)
        work_mps = drive.speed_work_mps * drive.speed_factors[number]
        line.drive(_straight(drive.lead_in_m), work_mps, 0.0)
        begin = line.length_m
        line.drive(_straight(pass_m), work_mps, 0.0)
        line.passes.append((begin, line.length_m))
        line.stops += [(begin + at_m, stand_s) for i, at_m, stand_s in drive.stops if i == number]
        line.drive(_straight(drive.run_out_m), drive.speed_turn_mps, 0.0)
    return _wander(line.whole(), drive.wander_m, rng)


class _Line:
    """Pieces put end to end."""

    def __init__(self) -> None:
        self.length_m = 0.0
        self.stops: list[tuple[float, float]] = []
        self.passes: list[tuple[float, float]] = []
        self._at = (0.0, 0.0, 0.0)
        self._gear = 1
        self._parts: list[tuple[FloatArray, ...]] = []

    def drive(self, piece: _Piece, limit_mps: float, gear_s: float) -> None:
        n = len(piece.x) - 1
        if n < 1:
            return
        if piece.gear != self._gear:
            self.stops.append((self.length_m, gear_s))
            self._gear = piece.gear
        x0, y0, yaw0 = self._at
        c = math.cos(yaw0)
        s = math.sin(yaw0)
        x = x0 + c * piece.x - s * piece.y
        y = y0 + s * piece.x + c * piece.y
        yaw = yaw0 + piece.yaw
        way = self.length_m + np.linspace(0.0, piece.length_m, n + 1)
        one = np.ones(n)
        self._parts.append((way[:n], x[:n], y[:n], yaw[:n], one * piece.gear, one * limit_mps))
        self.length_m += piece.length_m
        self._at = (float(x[-1]), float(y[-1]), float(yaw[-1]))

    def whole(self) -> DrivenPath:
        end = tuple(np.array([value]) for value in (self.length_m, *self._at, self._gear, self._parts[-1][5][-1]))
        way, u, v, yaw, gear, limit = (np.concatenate(part) for part in zip(*self._parts, end, strict=True))
        return DrivenPath(way, u, v, yaw, gear, limit, tuple(self.stops), tuple(self.passes))


def _straight(length_m: float, gear: int = 1) -> _Piece:
    n = math.ceil(length_m / PATH_STEP_M)
    x = np.linspace(0.0, length_m, n + 1) if n else np.zeros(1)
    return _Piece(x * gear, np.zeros(len(x)), np.zeros(len(x)), length_m, gear)


def _arc(angle_rad: float, radius_m: float, ramp_m: float, gear: int = 1) -> _Piece:
    """An arc that turns the nose by `angle_rad`, left positive, its curvature rising and falling along `ramp_m`."""
    turn = abs(angle_rad)
    plateau = turn * radius_m - ramp_m
    peak = 1.0 / radius_m
    if plateau < 0.0:
        plateau = 0.0
        peak = turn / ramp_m
    length = plateau + 2.0 * ramp_m
    n = max(1, math.ceil(length / PATH_STEP_M))
    way = np.linspace(0.0, length, n + 1)
    middle = 0.5 * (way[1:] + way[:-1])
    curvature = peak * np.clip(np.minimum(middle, length - middle) / ramp_m, 0.0, 1.0)
    step = length / n
    yaw = np.concatenate([[0.0], np.cumsum(curvature * step)])
    yaw *= turn / yaw[-1] if turn else 0.0
    across = 0.5 * (yaw[1:] + yaw[:-1])
    x = np.concatenate([[0.0], np.cumsum(np.cos(across) * step)])
    y = np.concatenate([[0.0], np.cumsum(np.sin(across) * step)])
    side = math.copysign(1.0, angle_rad)
    if gear < 0:  # driven backwards, the nose turns the same way while the line runs to the other side
        return _Piece(-x, -side * y, side * yaw, length, gear)
    return _Piece(x, side * y, side * yaw, length, gear)


@functools.lru_cache(maxsize=16)
def _turn(drive: ScenarioDrive, width_m: float) -> list[_Piece]:
    """Pieces from the end of one lane to the beginning of the next, `width_m` to the left, the other way round."""
    side, width = math.copysign(1.0, width_m), abs(width_m)

    def arc(angle_deg: float, gear: int = 1, radius_m: float = drive.radius_m) -> _Piece:
        return _arc(side * math.radians(angle_deg), radius_m, drive.ramp_m, gear)

    def half(radius_m: float) -> list[_Piece]:
        return [arc(180.0, 1, radius_m)]

    def omega(out_deg: float) -> list[_Piece]:
        return [arc(-out_deg), arc(180.0 + 2.0 * out_deg), arc(-out_deg)]

    def fishtail(out_deg: float) -> list[_Piece]:
        return [arc(out_deg), arc(180.0 - 2.0 * out_deg, -1), arc(out_deg)]

    def solved(shape: Callable[[float], list[_Piece]], low: float, high: float) -> list[_Piece]:
        return shape(_bisect(lambda open_: side * _width(shape(open_)) - width, low, high))

    quarter = arc(90.0)
    two_quarters_m = 2.0 * abs(float(quarter.y[-1]))
    if width >= two_quarters_m:
        return [quarter, _straight(width - two_quarters_m), quarter]
    if width >= side * _width(half(drive.radius_m)):
        return solved(half, drive.radius_m, 3.0 * drive.radius_m)
    if drive.turns == "loop":
        return solved(omega, 0.0, 89.0)
    if width >= side * _width(fishtail(89.0)):
        return [quarter, _straight(two_quarters_m - width, -1), quarter]
    return solved(fishtail, 1.0, 89.0)


def _width(pieces: list[_Piece]) -> float:
    line = _Line()
    for piece in pieces:
        line.drive(piece, 1.0, 0.0)
    return float(line.whole().v_m[-1])


def _bisect(f: Callable[[float], float], low: float, high: float) -> float:
    rising = f(high) > f(low)
    for _ in range(50):
        middle = 0.5 * (low + high)
        if (f(middle) > 0.0) == rising:
            high = middle
        else:
            low = middle
    return 0.5 * (low + high)


def _wander(path: DrivenPath, wander_m: float, rng: np.random.Generator) -> DrivenPath:
    """`path` with smooth deviations to the sides, none where the machine starts, ends or changes its direction."""
    n = len(path.distance_m)
    if wander_m == 0.0:
        return path
    wave = np.fft.rfftfreq(n, PATH_STEP_M)
    shape = np.exp(-0.5 * (wave * 2.0 * np.pi * 1.0) ** 2)  # correlated over about a metre and a half
    side = np.fft.irfft(np.fft.rfft(rng.standard_normal(n)) * shape, n)
    side *= wander_m / max(float(side.std()), 1e-12)
    fixed = [path.distance_m[0], path.distance_m[-1], *path.distance_m[1:][np.diff(path.gear) != 0]]
    ordered = np.sort(np.array(fixed))
    i = np.searchsorted(ordered, path.distance_m).clip(1, len(ordered) - 1)
    nearest_m = np.minimum(np.abs(path.distance_m - ordered[i - 1]), np.abs(ordered[i] - path.distance_m))
    x = np.clip(nearest_m / 1.5, 0.0, 1.0)
    side *= x * x * (3.0 - 2.0 * x)
    turn = np.arctan(np.gradient(side, path.distance_m)) * path.gear
    u = path.u_m - side * np.sin(path.yaw_rad)
    v = path.v_m + side * np.cos(path.yaw_rad)
    return DrivenPath(path.distance_m, u, v, path.yaw_rad + turn, path.gear, path.limit_mps, path.stops, path.passes)


DRIVE_RATE_HZ: Final = 200
"""Samples per second of all motion."""
LEAD_IN_S: Final = 0.5
AFTER_S: Final = 0.8
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
    way = path.distance_m
    square = path.limit_mps**2
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
