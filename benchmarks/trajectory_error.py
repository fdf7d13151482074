"""The error of a trajectory against the truth of a simulated recording, read and computed apart from furrowmap.

Without an IMU the level of a whole session hangs on GNSS heights, whose error drifts. The error therefore splits into
one height offset and one tilt of the whole session (*absolute*: a plane in easting and northing added to the antenna's
heights, with the roll and pitch that go with it) and what remains without them (*shape*). The *oracle* is the plane
fitted to the GNSS heights' own errors: what a perfect shape gets from nothing but these heights.

Errors are result minus truth; angles are those of files (roll right side down, pitch nose up, heading clockwise from
grid north).
"""

from __future__ import annotations

import json
import math
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import geopandas as gpd
import numpy as np
from numpy.typing import NDArray
from pyproj import CRS, Transformer
from scipy.spatial.transform import Rotation

FloatArray = NDArray[np.float64]

SIGMAS = ("e_m", "n_m", "h_m", "roll_deg", "pitch_deg", "heading_deg")
MOVING_MPS = 0.10
"""True speed above which a heading counts as that of a moving machine."""
FIT_HEIGHT_M, FIT_ANGLE_DEG = 0.01, 0.1
"""What weighs the same in the fit of offset and tilt."""
GAP_S = 0.5
"""Positions further apart than this leave an outage between them."""


@dataclass(frozen=True)
class Poses:
    """The vehicle frame's origin and attitude at times.

    Attributes:
        t_s: (n,) seconds of UTC since 1970, rising.
        xyz_m: (n, 3) easting, northing and height in the map frame.
        rph_deg: (n, 3) roll, pitch, heading.
    """

    t_s: FloatArray
    xyz_m: FloatArray
    rph_deg: FloatArray

    def antenna_m(self, lever_m: FloatArray) -> FloatArray:
        """(n, 3) position of the antenna at `lever_m` in the vehicle frame."""
        roll, pitch, heading = self.rph_deg.T
        turn = Rotation.from_euler("ZYX", np.column_stack([90.0 - heading, -pitch, roll]), degrees=True)
        return self.xyz_m + turn.apply(lever_m)

    def at(self, t_s: FloatArray) -> Poses:
        """The poses at other times, between those known; headings must not jump."""
        xyz_m, rph_deg = (
            np.column_stack([np.interp(t_s, self.t_s, column) for column in values.T])
            for values in (self.xyz_m, self.rph_deg)
        )
        return Poses(t_s, xyz_m, rph_deg)


@dataclass(frozen=True)
class Positions:
    """What the receiver said of its antenna.

    Attributes:
        t_s: (n,) seconds of UTC since 1970.
        xyz_m: (n, 3) in the map frame, ellipsoidal height.
        quality: (n,) of the GGA sentences: 4 fixed, 5 float.
    """

    t_s: FloatArray
    xyz_m: FloatArray
    quality: NDArray[np.int64]

    def outages(self) -> Iterator[tuple[float, float]]:
        """(last position before, first position after) of every gap."""
        for i in np.flatnonzero(np.diff(self.t_s) > GAP_S):
            yield float(self.t_s[i]), float(self.t_s[i + 1])

    def floats(self) -> Iterator[tuple[float, float]]:
        """(first, last) position of every period without fixed ambiguities."""
        edges = np.flatnonzero(np.diff(np.concatenate([[False], self.quality == 5, [False]])))
        for begin, end in edges.reshape(-1, 2):
            yield float(self.t_s[begin]), float(self.t_s[end - 1])


@dataclass(frozen=True)
class Simulation:
    """A simulated recording: the true trajectory, the positions recorded, and the lever arm.

    Attributes:
        t0_s: start of the recording, seconds of UTC since 1970.
        truth: at 100 Hz, headings without jumps.
        speed_mps: (n,) over ground, of the true way.
        positions: those of the recording.
        lever_m: (3,) of the antenna in the vehicle frame.
        duration_s: of the drive.
        points: returns in the recording.
    """

    t0_s: float
    truth: Poses
    speed_mps: FloatArray
    positions: Positions
    lever_m: FloatArray
    duration_s: float
    points: int


@dataclass(frozen=True)
class Plane:
    """Height offset in the middle of the drive, and tilt, of a whole session."""

    offset_m: float
    tilt_deg: float


@dataclass(frozen=True)
class Period:
    """Scans without positions, or with float ones; times count from the start of the recording."""

    from_s: float
    to_s: float
    scans: int
    horizontal_rmse_m: float
    horizontal_max_m: float
    height_rmse_m: float
    heading_moving_rms_deg: float


@dataclass(frozen=True)
class Errors:
    """The figures of one session; `gnss_x_rmse_m` and `gnss_y_rmse_m` are those of the fixed positions."""

    scans: int
    scans_without_pose: int
    x_rmse_m: float
    y_rmse_m: float
    gnss_x_rmse_m: float
    gnss_y_rmse_m: float
    height_rmse_m: float
    roll_rms_deg: float
    pitch_rms_deg: float
    heading_moving_rms_deg: float
    heading_standing_rms_deg: float
    shape_roll_rms_deg: float
    shape_pitch_rms_deg: float
    shape_antenna_height_rms_m: float
    absolute: Plane
    oracle: Plane
    outages: tuple[Period, ...]
    floats: tuple[Period, ...]


def load_simulation(folder: Path) -> Simulation:
    """The truth in a simulated recording's folder."""
    session = tomllib.loads((folder / "session.toml").read_text(encoding="utf-8"))
    figures = json.loads((folder / "truth" / "figures.json").read_text(encoding="utf-8"))
    rows = np.loadtxt(folder / "truth" / "trajectory.csv", delimiter=",", skiprows=1)
    rows[:, 6] = np.unwrap(rows[:, 6], period=360.0)
    truth = Poses(rows[:, 0], rows[:, 1:4], rows[:, 4:7])
    velocity = np.gradient(truth.xyz_m[:, :2], truth.t_s, axis=0)
    speed_mps = np.convolve(np.hypot(*velocity.T), np.full(5, 0.2), mode="same")
    log = (folder / session["recording"]["gnss"][0]).read_text(encoding="ascii")
    positions = _positions(log, session["crs"]["map"], figures["t0_unix_s"])
    lever_m = np.array(session["antenna"]["xyz_m"], np.float64)
    return Simulation(
        figures["t0_unix_s"], truth, speed_mps, positions, lever_m, figures["duration_s"], figures["lidar"]["points"]
    )


def load_trajectory(field: Path) -> tuple[Poses, FloatArray]:
    """The layer ``trajectory`` of a ``field.gpkg``: poses, and (n, 6) stated sigmas in the order of `SIGMAS`."""
    layer = gpd.read_file(field, layer="trajectory").sort_values("t_s")
    xyz_m = np.column_stack([layer.geometry.x, layer.geometry.y, layer.geometry.z])
    rph_deg = layer[["roll_deg", "pitch_deg", "heading_deg"]].to_numpy(np.float64)
    sigmas = layer[[f"sigma_{name}" for name in SIGMAS]].to_numpy(np.float64)
    return Poses(layer["t_s"].to_numpy(np.float64), xyz_m, rph_deg), sigmas


def judge(poses: Poses, sigmas: FloatArray, simulation: Simulation) -> tuple[Errors, Mapping[str, FloatArray]]:
    """The errors of `poses`, and every error over its stated sigma by the names of `SIGMAS`.

    Headings are set against their sigma while the machine moves. Scans outside the time of the truth do not count.

    Raises:
        ValueError: no scan has a pose within the time of the truth.
    """
    known = (poses.t_s >= simulation.truth.t_s[0]) & (poses.t_s <= simulation.truth.t_s[-1])
    whole = known & np.isfinite(poses.xyz_m).all(axis=1) & np.isfinite(poses.rph_deg).all(axis=1)
    if not whole.any():
        raise ValueError("no scan has a pose within the time of the truth")
    said, stated = Poses(poses.t_s[whole], poses.xyz_m[whole], poses.rph_deg[whole]), sigmas[whole]
    true = simulation.truth.at(said.t_s)
    place = said.xyz_m - true.xyz_m
    attitude = said.rph_deg - true.rph_deg
    attitude[:, 2] = (attitude[:, 2] + 180.0) % 360.0 - 180.0
    moving = np.interp(said.t_s, simulation.truth.t_s, simulation.speed_mps) > MOVING_MPS
    absolute, shape_m, shape_deg, middle = _level(said, true, attitude, simulation.lever_m)
    oracle, gnss_rmse_m = _gnss_errors(simulation, middle)

    def period(begin_s: float, end_s: float) -> Period:
        now = (said.t_s >= begin_s) & (said.t_s <= end_s)
        away_m = np.hypot(place[now, 0], place[now, 1])
        return Period(
            from_s=begin_s - simulation.t0_s,
            to_s=end_s - simulation.t0_s,
            scans=int(now.sum()),
            horizontal_rmse_m=rms(away_m),
            horizontal_max_m=float(away_m.max(initial=0.0)),
            height_rmse_m=rms(place[now, 2]),
            heading_moving_rms_deg=rms(attitude[now & moving, 2]),
        )

    errors = Errors(
        scans=len(poses.t_s),
        scans_without_pose=int((known & ~whole).sum()),
        x_rmse_m=rms(place[:, 0]),
        y_rmse_m=rms(place[:, 1]),
        gnss_x_rmse_m=gnss_rmse_m[0],
        gnss_y_rmse_m=gnss_rmse_m[1],
        height_rmse_m=rms(place[:, 2]),
        roll_rms_deg=rms(attitude[:, 0]),
        pitch_rms_deg=rms(attitude[:, 1]),
        heading_moving_rms_deg=rms(attitude[moving, 2]),
        heading_standing_rms_deg=rms(attitude[~moving, 2]),
        shape_roll_rms_deg=rms(shape_deg[:, 0]),
        shape_pitch_rms_deg=rms(shape_deg[:, 1]),
        shape_antenna_height_rms_m=rms(shape_m),
        absolute=absolute,
        oracle=oracle,
        outages=tuple(period(*ends) for ends in simulation.positions.outages()),
        floats=tuple(period(*ends) for ends in simulation.positions.floats()),
    )
    over_sigma = {}
    for i, (name, error) in enumerate(zip(SIGMAS, np.column_stack([place, attitude]).T, strict=True)):
        counts = np.isfinite(stated[:, i]) & (stated[:, i] > 0.0) & (moving if name == "heading_deg" else True)
        over_sigma[name] = error[counts] / stated[counts, i]
    return errors, over_sigma


def rms(values: FloatArray) -> float:
    """Root mean square; nan of nothing."""
    return math.sqrt(float(np.mean(values**2))) if len(values) else math.nan


def _level(
    said: Poses, true: Poses, attitude_deg: FloatArray, lever_m: FloatArray
) -> tuple[Plane, FloatArray, FloatArray, FloatArray]:
    """One offset and one tilt fitted to the errors of antenna heights, rolls and pitches together.

    Returns:
        (the plane, (n,) antenna heights without it, (n, 2) roll and pitch without it, (2,) middle of the drive).
    """
    antenna = true.antenna_m(lever_m)
    height = said.antenna_m(lever_m)[:, 2] - antenna[:, 2]
    middle: FloatArray = antenna[:, :2].mean(axis=0)
    e, n = (antenna[:, :2] - middle).T
    heading = np.radians(true.rph_deg[:, 2])
    sin, cos, none, per_deg = np.sin(heading), np.cos(heading), np.zeros_like(e), 180.0 / math.pi
    of_height = np.column_stack([np.ones_like(e), e, n])
    of_roll = np.column_stack([none, -cos, sin]) * per_deg  # ground rising to the left lowers the right side
    of_pitch = np.column_stack([none, sin, cos]) * per_deg
    plane = np.linalg.lstsq(
        np.concatenate([of_height / FIT_HEIGHT_M, of_roll / FIT_ANGLE_DEG, of_pitch / FIT_ANGLE_DEG]),
        np.concatenate([height / FIT_HEIGHT_M, attitude_deg[:, 0] / FIT_ANGLE_DEG, attitude_deg[:, 1] / FIT_ANGLE_DEG]),
        rcond=None,
    )[0]
    shape_deg = attitude_deg[:, :2] - np.column_stack([of_roll @ plane, of_pitch @ plane])
    return _plane(plane), height - of_height @ plane, shape_deg, middle


def _gnss_errors(simulation: Simulation, middle: FloatArray) -> tuple[Plane, tuple[float, float]]:
    """The oracle's plane, and the RMSE in x and y of the fixed positions."""
    fixed = simulation.positions.quality == 4
    antenna = simulation.truth.at(simulation.positions.t_s[fixed]).antenna_m(simulation.lever_m)
    error = simulation.positions.xyz_m[fixed] - antenna
    about = np.column_stack([np.ones(len(antenna)), antenna[:, :2] - middle])
    return _plane(np.linalg.lstsq(about, error[:, 2], rcond=None)[0]), (rms(error[:, 0]), rms(error[:, 1]))


def _plane(offset_and_slopes: FloatArray) -> Plane:
    offset, east, north = (float(value) for value in offset_and_slopes)
    return Plane(offset, math.degrees(math.hypot(east, north)))


def _positions(log: str, crs: str, t0_s: float) -> Positions:
    """The GGA sentences of a log that begins on the day of `t0_s` and lasts less than a day."""
    midnight_s = math.floor(t0_s / 86400.0) * 86400.0
    rows = []
    for line in log.splitlines():
        field = line.split("*")[0].split(",")
        if field[0].endswith("GGA"):
            time_s = midnight_s + 3600.0 * int(field[1][:2]) + 60.0 * int(field[1][2:4]) + float(field[1][4:])
            lat = math.copysign(int(field[2][:2]) + float(field[2][2:]) / 60.0, 1 if field[3] == "N" else -1)
            lon = math.copysign(int(field[4][:3]) + float(field[4][3:]) / 60.0, 1 if field[5] == "E" else -1)
            altitude_m = float(field[9]) + float(field[11])
            rows.append((time_s + 86400.0 * (time_s < t0_s - 43200.0), lon, lat, altitude_m, int(field[6])))
    t_s, lon_deg, lat_deg, height_m, quality = np.array(rows).T
    to_map = Transformer.from_crs(CRS(crs).geodetic_crs, crs, always_xy=True)
    e_m, n_m = to_map.transform(lon_deg, lat_deg)
    return Positions(t_s, np.column_stack([e_m, n_m, height_m]), quality.astype(np.int64))
