"""The recording of a flight, and the files that a tractor with an IMU or a moving mount has as well.

The aircraft flies lines with rounded corners, and wind and gusts move it. The IMU measures in earth-centred,
earth-fixed coordinates: specific force is acceleration plus Coriolis acceleration minus normal gravity, which holds the
centrifugal one (Groves 2013, Principles of GNSS, Inertial and Multisensor Integrated Navigation Systems, chapter 2);
both derivatives are differences of fourth order of the path, through which splines of fifth degree are laid.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import msgspec
import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import make_interp_spline
from scipy.ndimage import gaussian_filter, gaussian_filter1d, maximum_filter
from scipy.spatial.transform import Rotation

from furrowmap.core.runtime.progress import Progress
from furrowmap.core.simulator.drive import AFTER_S, DRIVE_RATE_HZ, LEAD_IN_S
from furrowmap.core.simulator.machine_motion import (
    SimulatedMotion,
    SimulatedMountMotion,
    mount_rotation,
    vehicle_rotation,
)
from furrowmap.core.simulator.noise import Float32Array, FloatArray, band_noise, gauss_markov, random_for
from furrowmap.core.simulator.rays import Beams, Firings, Met, make_optics, make_scene
from furrowmap.core.simulator.recording import SCANNERS, World, cast_in_order, record, recording_file, second_file
from furrowmap.core.simulator.scenario import (
    Flight,
    Scenario,
    ScenarioImu,
    ScenarioLidar,
    ScenarioLineScanner,
    toml_keys,
)
from furrowmap.core.simulator.simulated_receiver import receive, report, sentences
from furrowmap.core.simulator.site import CELL_M, CROP_CELL_M, SimulatedSite, find_site, lay_round
from furrowmap.core.simulator.soil_over_time import Ground, ground_height, make_ground
from furrowmap.core.simulator.truth import quarters, write_trajectory

_NONE: Final = np.zeros(1)
_BEAM: Final = Beams(_NONE, _NONE, _NONE, _NONE, step_m=0.002)
_LINES_PER_BATCH: Final = 20_000
"""Beams cast together."""


def record_lines(
    file: Path, world: World, line: ScenarioLineScanner, duration_s: float, progress: Progress
) -> dict[str, Any]:
    """Write the scans as CSV: time, angle about the scanner's z axis from its x axis, range; its figures."""
    scenario = world.scenario
    site = world.site
    optics = make_optics(scenario, _BEAM, mount_rotation(scenario.lidar.true_rpy_deg))
    scene = make_scene(scenario, world.ground, world.crop)
    sweeps = max(0, math.floor((duration_s + scenario.lidar.stop_s - scenario.lidar.start_s) * line.rate_hz))
    stamped_s = site.t0_s + scenario.clock.true_lidar_minus_gnss_s
    met = np.zeros(len(Met), np.int64)
    last_s = scenario.lidar.start_s
    with file.open("w", encoding="ascii", newline="") as out:
        out.write("time_unix_s,angle_deg,range_m,intensity\n")
        batches = _batches(world, line, sweeps * line.beams)
        for first, firings, returns in cast_in_order(scene, optics, batches):
            seen = returns.ticks[0, :, 0] > 0
            met += np.bincount(returns.met[0, seen, 0], minlength=len(Met))
            last_s = float(firings.t_s[-1])
            rows = np.column_stack([
                stamped_s + firings.t_s[seen], -np.degrees(firings.azimuth_rad[seen]),
                _BEAM.step_m * returns.ticks[0, seen, 0], returns.reflectivity[0, seen, 0],
            ])  # fmt: skip
            np.savetxt(out, rows, fmt="%.6f,%.4f,%.3f,%d")
            progress("lidar", (first + len(seen)) / (sweeps * line.beams))
    counts = {kind.name.lower(): int(met[kind]) for kind in Met if kind is not Met.NOTHING}
    return {
        "lidar": {
            "points": sum(counts.values()),
            **counts,
            "sweeps": sweeps,
            "first_firing_unix_s": round(site.t0_s + scenario.lidar.start_s, 6),
            "last_packet_unix_s": round(site.t0_s + last_s, 6),
        },
        "laser_bias_m": {"0": round(float(optics.lasers[0, 3]), 4)},
    }


def _batches(world: World, line: ScenarioLineScanner, beams: int) -> Iterator[tuple[int, Firings]]:
    """Beams one after another, evenly over the share of a turn in which there are any."""
    step_deg = line.field_deg / (line.beams - 1)
    still = np.zeros(_LINES_PER_BATCH)
    for first in range(0, beams, _LINES_PER_BATCH):
        sweep, beam = np.divmod(first + np.arange(min(_LINES_PER_BATCH, beams - first)), line.beams)
        angle_deg = beam * step_deg - 0.5 * line.field_deg
        t_s = world.scenario.lidar.start_s + (sweep + beam * step_deg / 360.0) / line.rate_hz
        xyz, rotation = world.motion.at(t_s)
        none = still[: len(t_s)]
        azimuth = -np.radians(angle_deg)
        yield first, Firings(first, t_s, azimuth, none, xyz, rotation, none, none, world.mounted(t_s))


GRID_STEP_S: Final = 0.005
"""Of the differences."""
IMU_LEAD_IN_S: Final = 0.2
"""The log begins this long before t0."""
EARTH_RADPS: Final = 7.292115e-5
MG: Final = 9.80665e-3
GRS80: Final = (9.7803267715, 0.001931851353, 0.00669438002290)
"""Normal gravity at the equator, Somigliana's constant, square of the first eccentricity (Moritz 2000)."""
_RATE: Final = "gyro_x_dps,gyro_y_dps,gyro_z_dps"
_FORCE: Final = "force_x_mps2,force_y_mps2,force_z_mps2"


@dataclass(frozen=True)
class SimulatedImuLog:
    """What the IMU says: times, angular rate and specific force (n, 3) in its axes, with their errors.

    `bias` (n, 6) are errors of rate (degrees per second) and force that change slowly, without those of scale.
    """

    t_s: FloatArray
    rate_dps: FloatArray
    force_mps2: FloatArray
    bias: FloatArray


def measure(imu: ScenarioImu, motion: SimulatedMotion, site: SimulatedSite, end_s: float, seed: int) -> SimulatedImuLog:
    """The measurements from `BEFORE_S` before t0 to `end_s`."""
    t_s = np.arange(-round(IMU_LEAD_IN_S * imu.rate_hz), int(end_s * imu.rate_hz) + 1) / imu.rate_hz
    rate, force = exact(motion, site, t_s, np.asarray(imu.xyz_m))
    mounted = mount_rotation(imu.rpy_deg)
    true = np.concatenate([np.degrees(rate @ mounted), force @ mounted], axis=1)
    rng = random_for(seed, "imu")
    step_s = 1.0 / imu.rate_hz
    n = len(t_s)
    columns = np.empty((n, 6))
    bias = np.empty((n, 6))
    errors = (
        (imu.gyro_noise_deg_s_rthz, imu.gyro_bias_deg_s, imu.gyro_walk_deg_s_rts, imu.gyro_instability_deg_s, 1.0),
        (imu.accel_noise_mg_rthz, imu.accel_bias_mg, imu.accel_walk_mg_rts, imu.accel_instability_mg, MG),
    )
    for column in range(6):
        density, spread, walk, instability, unit = errors[column // 3]
        scale = (imu.gyro_scale, imu.accel_scale)[column // 3] * rng.standard_normal()
        slow = spread * rng.standard_normal() + walk * np.sqrt(step_s) * np.cumsum(rng.standard_normal(n))
        slow += gauss_markov(rng, n, step_s, instability, imu.instability_s)
        bias[:, column] = unit * slow
        noise = unit * density * np.sqrt(imu.rate_hz) * rng.standard_normal(n)
        columns[:, column] = (1.0 + scale) * true[:, column] + bias[:, column] + noise
    return SimulatedImuLog(t_s, columns[:, :3], columns[:, 3:], bias)


def exact(
    motion: SimulatedMotion, site: SimulatedSite, t_s: FloatArray, arm_m: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Angular rate against inertial space (rad/s) and specific force at a point of the vehicle, in its axes."""
    angles = np.column_stack([motion.roll_rad, motion.pitch_rad, motion.yaw_rad])
    path = make_interp_spline(motion.t_s, np.column_stack([motion.xyz_m, angles]), 5)
    seconds = np.arange(np.floor(t_s[0]) - 1.0, t_s[-1] + 3.0)
    place = path(np.clip(seconds, motion.t_s[0], motion.t_s[-1]))
    map_axes = site.earth_axes(place[:, :3])
    by_axis = make_interp_spline(seconds, map_axes.reshape(-1, 9), 1)

    def earth(at_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        now = path(at_s)
        axes = by_axis(at_s).reshape(-1, 3, 3) @ vehicle_rotation(now[:, 3], now[:, 4], now[:, 5])
        return site.earth_m(now[:, :3]) + axes @ arm_m, axes

    (p0, axes), *rest = (earth(t_s + k * GRID_STEP_S) for k in (0, -2, -1, 1, 2))
    p = [place - p0 for place, _ in rest]
    velocity = (p[0] - 8.0 * p[1] + 8.0 * p[2] - p[3]) / (12.0 * GRID_STEP_S)
    acceleration = (-p[0] + 16.0 * p[1] + 16.0 * p[2] - p[3]) / (12.0 * GRID_STEP_S**2)
    wide, near = (
        np.asarray(Rotation.from_matrix(rest[a][1].transpose(0, 2, 1) @ rest[b][1]).as_rotvec(), np.float64)
        for a, b in ((0, 3), (1, 2))
    )
    turning = (8.0 * near - wide) / (12.0 * GRID_STEP_S)
    spin = np.array([0.0, 0.0, EARTH_RADPS])
    up = by_axis(t_s).reshape(-1, 3, 3)[:, :, 2]
    now = path(t_s)
    _, lat = site.geographic(now[:, 0], now[:, 1])
    gravity = normal_gravity_mps2(lat, now[:, 2] + site.h0_m)
    force = acceleration + 2.0 * np.cross(spin, velocity) + gravity[:, None] * up
    back = axes.transpose(0, 2, 1)
    return turning + back @ spin, np.einsum("kij,kj->ki", back, force)


def normal_gravity_mps2(lat_deg: FloatArray, height_m: FloatArray) -> FloatArray:
    """Of GRS80: Somigliana's formula, and the usual gradient with height."""
    equator, constant, square = GRS80
    sine2 = np.sin(np.radians(lat_deg)) ** 2
    surface = equator * (1.0 + constant * sine2) / np.sqrt(1.0 - square * sine2)
    out: FloatArray = surface - (3.0877e-6 - 4.3e-9 * sine2) * height_m + 0.72e-12 * height_m**2
    return out


EAR_M: Final = 0.04
"""Standard deviation of the crop's height from plant to plant."""
PLANT_CELLS: Final = 1.2
"""Radius of a plant, in cells of the crop: the standard deviation of the normal curve that smooths heights."""
GAPS: Final = 0.002
"""Share of a plot's cells around which nothing stands in three by three cells."""
TRUTH_PIXEL_M: Final = 2.0 * CROP_CELL_M
"""Of the truth of soil and crop."""
CHECKS: Final = 6
CROP_CLEARANCE_M: Final = 0.4
"""Check points lie this far from crop and walls."""
SURVEY_M: Final = (0.003, 0.005)
"""Standard deviation of surveyed points, horizontal and vertical."""


def make_crop(scenario: Scenario, flight: Flight, ground: Ground) -> tuple[Float32Array, NDArray[np.int16]] | None:
    """Height of the crop on cells of CROP_CELL_M, and the plot of each (from 1; 0: none); None without plots."""
    if not flight.plots_m:
        return None
    rng = random_for(scenario.seed, "crop")
    shape = tuple(round(k * CELL_M / CROP_CELL_M) for k in ground.before.shape)
    crop = np.zeros(shape, np.float32)
    plot = np.zeros(shape, np.int16)
    plants = gaussian_filter(rng.standard_normal(shape, np.float32), PLANT_CELLS, mode="wrap")
    plants *= EAR_M / float(plants.std())
    gap = maximum_filter(rng.uniform(size=shape) < GAPS, 3, mode="wrap")
    e, n = ((np.arange(k) + 0.5) * CROP_CELL_M for k in (shape[1], shape[0]))
    for number, (e0, n0, direction, length, width, height) in enumerate(flight.plots_m, 1):
        c = math.cos(math.radians(direction))
        s = math.sin(math.radians(direction))
        reach_m = 0.5 * math.hypot(length, width) + CROP_CELL_M
        cols = slice(*np.searchsorted(e, (e0 - reach_m, e0 + reach_m)))
        rows = slice(*np.searchsorted(n, (n0 - reach_m, n0 + reach_m)))
        along = c * (e[None, cols] - e0) + s * (n[rows, None] - n0)
        across = c * (n[rows, None] - n0) - s * (e[None, cols] - e0)
        inside = (np.abs(along) <= 0.5 * length) & (np.abs(across) <= 0.5 * width)
        grown = np.where(gap[rows, cols], 0.0, np.maximum(height + plants[rows, cols], 0.0))
        crop[rows, cols][inside] = grown[inside]
        plot[rows, cols][inside] = number
    return crop, plot


def write_mounting(file: Path, lidar: ScenarioLidar) -> None:
    """The true mounting, and its rotation from the stated one about the vehicle's axes."""
    left = mount_rotation(lidar.true_rpy_deg) @ mount_rotation(lidar.rpy_deg).T
    boresight = np.degrees([left[2, 1] - left[1, 2], left[0, 2] - left[2, 0], left[1, 0] - left[0, 1]]) / 2.0
    file.write_text(
        f"[lidar]\nxyz_m = {list(lidar.true_xyz_m)}\nrpy_deg = {list(lidar.true_rpy_deg)}\n"
        f"boresight_rpy_deg = {[round(float(b), 6) for b in boresight]}\n",
        encoding="utf-8",
    )


def write_ground(folder: Path, world: World, plots: NDArray[np.int16] | None) -> dict[str, Any]:
    """surface.npz, parcels_truth.csv and the check points; their figures."""
    scenario = world.scenario
    site = world.site
    ground = world.ground
    rows, cols = (math.floor(m / TRUTH_PIXEL_M) for m in (scenario.field.size_n_m, scenario.field.size_e_m))
    e, n = ((np.arange(2 * k) + 0.5) * CROP_CELL_M for k in (cols, rows))
    soil = np.empty((rows, cols))
    for row, north in enumerate(n.reshape(-1, 2)):
        place = np.meshgrid(e, north)
        height = ground_height(ground, place[0].ravel(), place[1].ravel(), np.zeros(4 * cols))
        soil[row] = height.reshape(2, cols, 2).mean(axis=(0, 2))
    canopy = np.zeros(soil.shape, np.float32)
    parcel = np.zeros(soil.shape, np.int16)
    if world.crop is not None and plots is not None:
        canopy, parcel = (quarters(fine, rows, cols).max(axis=2) for fine in (world.crop, plots))
    np.savez_compressed(
        folder / "truth" / "surface.npz",
        soil=soil.astype(np.float32), canopy_height=canopy.astype(np.float32), parcel=parcel,
        e0=site.e0_m, n0=site.n0_m, cell_m=TRUTH_PIXEL_M, h0_m=site.h0_m, t0_unix_s=site.t0_s,
    )  # fmt: skip
    _write_parcels(folder / "truth" / "parcels_truth.csv", canopy, parcel, world.motion.scale)
    _write_checks(folder, scenario, site, soil, canopy)
    return {"parcels": int(parcel.max()), "map_scale": round(world.motion.scale, 8)}


def _write_parcels(file: Path, canopy: Float32Array, parcel: NDArray[np.int16], scale: float) -> None:
    """Heights and volumes of the plots (volumes on the ground, not on the map)."""
    lines = ["id,mean_height_m,mean_height_crop_m,p50_m,p95_m,sd_m,cover,volume_m3,area_m2\n"]
    area = (TRUTH_PIXEL_M / scale) ** 2
    for number in range(1, int(parcel.max()) + 1):
        here = canopy[parcel == number].astype(np.float64)
        stands = here >= 0.10
        crop = float(here[stands].mean()) if stands.any() else 0.0
        quantiles = ",".join(f"{q:.5f}" for q in np.quantile(here, (0.5, 0.95)))
        lines.append(
            f"{number},{here.mean():.5f},{crop:.5f},{quantiles},{here.std():.5f},{stands.mean():.5f},"
            f"{here.sum() * area:.5f},{len(here) * area:.5f}\n"
        )
    file.write_text("".join(lines), encoding="ascii")


def _write_checks(
    folder: Path, scenario: Scenario, site: SimulatedSite, soil: FloatArray, canopy: Float32Array
) -> None:
    """Points on open ground: as surveyed, and in truth/."""
    rng = random_for(scenario.seed, "survey")
    taken = canopy > 0
    e, n = ((np.arange(k) + 0.5) * TRUTH_PIXEL_M for k in (soil.shape[1], soil.shape[0]))
    for e0, n0, direction, length, thick, *_ in scenario.walls:
        c = math.cos(math.radians(direction))
        s = math.sin(math.radians(direction))
        along = c * (e - e0)[None, :] + s * (n - n0)[:, None]
        across = c * (n - n0)[:, None] - s * (e - e0)[None, :]
        taken |= (np.abs(along) <= 0.5 * length) & (np.abs(across) <= 0.5 * thick)
    margin = min(scenario.field.margin_m, 0.25 * min(scenario.field.size_e_m, scenario.field.size_n_m))
    inner = (e > margin) & (e < e[-1] - margin), (n > margin) & (n < n[-1] - margin)
    taken = maximum_filter(taken, 2 * round(CROP_CLEARANCE_M / TRUTH_PIXEL_M) + 1)
    row, col = np.nonzero(~taken & inner[1][:, None] & inner[0][None, :])
    chosen = rng.choice(len(row), min(CHECKS, len(row)), replace=False)
    true: list[str] = []
    surveyed: list[str] = []
    for number, k in enumerate(chosen, 1):
        near = soil[max(row[k] - 3, 0) : row[k] + 4, max(col[k] - 3, 0) : col[k] + 4]
        place = np.array([e[col[k]] + site.e0_m, n[row[k]] + site.n0_m, near.mean() + site.h0_m])
        seen = place + rng.standard_normal(3) * (SURVEY_M[0], SURVEY_M[0], SURVEY_M[1])
        for lines, point in ((true, place), (surveyed, seen)):
            lines.append(f"K{number},{point[0]:.4f},{point[1]:.4f},{point[2]:.4f}\n")
    head = "name,e_m,n_m,h_m\n"
    (folder / "truth" / "check_points.csv").write_text(head + "".join(true), encoding="ascii")
    (folder / "check_points.csv").write_text(head + "".join(surveyed), encoding="ascii")


GRAVITY_MPS2: Final = 9.81
"""Against which the aircraft tilts; the IMU measures the normal gravity of the place."""
TILT_S: Final = 0.15
"""An aircraft follows the acceleration that is asked of it this slowly."""


def lay_out_flight(scenario: Scenario, flight: Flight) -> Scenario:
    """`scenario` with ground and start laid round the path where they are not stated; InputError if too large."""
    e, n = _turn(waypoints(flight), flight.heading_deg).T
    size, start = lay_round(scenario.field, flight.start_xy_m, e, n)
    replace = msgspec.structs.replace
    return replace(
        scenario,
        field=replace(scenario.field, size_e_m=size[0], size_n_m=size[1]),
        drive=replace(scenario.drive, start_xy_m=start),  # rows of the soil count from there
        flight=replace(flight, start_xy_m=start),
    )


def waypoints(flight: Flight) -> FloatArray:
    """(n, 2) corners of the path: along the first strip, and to the left of it."""
    if flight.waypoints_m:
        return np.array(((0.0, 0.0), *flight.waypoints_m))
    path: list[tuple[float, float]] = []
    for k in range(flight.strips):
        ends = ((0.0, k * flight.spacing_m), (flight.strip_m, k * flight.spacing_m))
        path += ends if k % 2 == 0 else ends[::-1]
    wide = (flight.strips - 1) * flight.spacing_m
    over = 0.5 * flight.spacing_m
    places = flight.strip_m * (np.arange(flight.cross_strips) + 0.5) / max(flight.cross_strips, 1)
    if path[-1][0] > 0.0:
        places = places[::-1]
    for k, along in enumerate(places):
        across = ((float(along), wide + over), (float(along), -over))
        path += across if k % 2 == 0 else across[::-1]
    return np.array(path)


def duration_s(flight: Flight) -> float:
    """From t0 to the end of hovering."""
    length = float(np.hypot(*np.diff(waypoints(flight), axis=0).T).sum())
    return flight.hover_start_s + length / flight.speed_mps + flight.hover_end_s


def fly(scenario: Scenario, flight: Flight, scale: float, rng: np.random.Generator) -> SimulatedMotion:
    """The flight in space, at `RATE_HZ` from `BEFORE_S` before t0 to `AFTER_S` after its end.

    The aircraft tilts so that its thrust carries it along the path against gravity and the air; gusts tilt it further.
    `scale` is map metres for a metre on the ground.
    """
    count = math.floor((duration_s(flight) + LEAD_IN_S + AFTER_S) * DRIVE_RATE_HZ) + 1
    t_s = np.arange(count) / DRIVE_RATE_HZ - LEAD_IN_S
    en, yaw = _along(t_s, flight)
    en = en + np.array(flight.start_xy_m)
    en += flight.wander_m * np.column_stack([band_noise(rng, count, DRIVE_RATE_HZ, 0.03, 0.3) for _ in range(2)])
    yaw = yaw + np.radians(flight.yaw_wander_deg) * band_noise(rng, count, DRIVE_RATE_HZ, 0.05, 0.5)
    soil = scenario.soil
    field = scenario.field
    rise = 0.01 * soil.slope_percent
    towards = math.radians(soil.slope_towards_deg)
    ground = 0.5 * rise * (field.size_e_m * math.sin(towards) + field.size_n_m * math.cos(towards))
    height = ground + flight.height_m + flight.heave_m * band_noise(rng, count, DRIVE_RATE_HZ, 0.05, 0.5)
    velocity = np.gradient(en, 1.0 / DRIVE_RATE_HZ, axis=0)
    pushed = np.gradient(velocity, 1.0 / DRIVE_RATE_HZ, axis=0) + flight.drag_per_s * (
        velocity - np.array(flight.wind_mps)
    )
    pushed = gaussian_filter1d(pushed, TILT_S * DRIVE_RATE_HZ, axis=0, mode="nearest")
    ahead = pushed[:, 0] * np.cos(yaw) + pushed[:, 1] * np.sin(yaw)
    left = pushed[:, 1] * np.cos(yaw) - pushed[:, 0] * np.sin(yaw)
    gusts = [np.radians(flight.gust_deg) * band_noise(rng, count, DRIVE_RATE_HZ, 0.2, 2.0) for _ in range(2)]
    still = np.zeros(count)
    return SimulatedMotion(
        t_s,
        np.column_stack([en, height]),
        gusts[0] - np.arctan2(left, np.hypot(ahead, GRAVITY_MPS2)),
        gusts[1] - np.arctan2(ahead, GRAVITY_MPS2),
        yaw,
        still,
        still,
        scale,
    )


def _along(t_s: FloatArray, flight: Flight) -> tuple[FloatArray, FloatArray]:
    """The path (n, 2) from its start, towards east and north, and the heading of the nose (n,) as yaw."""
    corners = _turn(waypoints(flight), flight.heading_deg)
    legs = np.diff(corners, axis=0)
    length = np.hypot(*legs.T)
    legs = legs[length > 0.0]
    length = length[length > 0.0]
    ends = np.concatenate([[0.0], np.cumsum(length)])
    distance = np.clip((t_s - flight.hover_start_s) * flight.speed_mps, 0.0, ends[-1])
    corner = np.concatenate([np.zeros((1, 2)), np.cumsum(legs, axis=0)]) + corners[0]
    sharp = np.column_stack([np.interp(distance, ends, corner[:, k]) for k in range(2)])
    width = flight.turn_s * DRIVE_RATE_HZ
    smooth = gaussian_filter1d(sharp, width, axis=0, mode="nearest", truncate=6.0)
    if not math.isnan(flight.nose_deg):
        return smooth, np.full(len(t_s), math.radians(90.0 - flight.nose_deg))
    course = np.unwrap(np.arctan2(legs[:, 1], legs[:, 0]))
    leg = np.clip(np.searchsorted(ends, distance, side="right") - 1, 0, len(legs) - 1)
    return smooth, gaussian_filter1d(course[leg], width, mode="nearest", truncate=6.0)


def _turn(uv_m: FloatArray, heading_deg: float) -> FloatArray:
    """Along and left of a heading, as east and north."""
    yaw = math.radians(90.0 - heading_deg)
    u, v = uv_m.T
    return np.column_stack([u * math.cos(yaw) - v * math.sin(yaw), u * math.sin(yaw) + v * math.cos(yaw)])


@dataclass(frozen=True)
class Written:
    """A recording that was written; `recording` is the name of the capture or table of scans."""

    scenario: Scenario
    recording: str
    figures: dict[str, Any]


def write_flight(folder: Path, scenario: Scenario, flight: Flight, progress: Progress) -> Written:
    """The recording of an aircraft and its truth, into `folder` and `folder/truth`; InputError as `lay_out_flight`."""
    scenario = lay_out_flight(scenario, flight)
    assert scenario.flight is not None
    flight = scenario.flight
    site = find_site(scenario)
    ground = make_ground(scenario, [])
    middle = np.array([0.5 * scenario.field.size_e_m, 0.5 * scenario.field.size_n_m, flight.height_m])
    motion = fly(scenario, flight, site.map_scale(middle), random_for(scenario.seed, "flight"))
    crop = make_crop(scenario, flight, ground)
    world = World(scenario, site, ground, motion, None if crop is None else crop[0], moving(scenario))
    length_s = duration_s(flight)
    end_s = length_s + scenario.lidar.stop_s
    truth = folder / "truth"
    capture = "scans.csv" if scenario.line else recording_file(scenario.lidar)
    write_session(folder, scenario, capture)
    fixes = receive(scenario.gnss.rtk, scenario.antenna.xyz_m, site, motion, end_s, scenario.seed, "gnss.nmea")
    (folder / "gnss.nmea").write_text(sentences(fixes, site, "0001"), encoding="ascii", newline="")
    write_sensors(folder, world, end_s)
    if scenario.line is not None:
        lidar = record_lines(folder / capture, world, scenario.line, length_s, progress)
    else:
        lidar, _ = record(folder / capture, world, length_s, progress)
    progress("truth", 0.0)
    write_trajectory(truth / "trajectory.csv", motion, site, DRIVE_RATE_HZ, place_digits=6)
    write_mounting(truth / "mounting_truth.toml", scenario.lidar)
    found = write_ground(folder, world, None if crop is None else crop[1])
    figures = {
        "name": scenario.name,
        "seed": scenario.seed,
        "t0_unix_s": site.t0_s,
        "duration_s": round(length_s, 3),
        **flight_figures(motion),
        **found,
        **lidar,
        "gnss": {"gnss.nmea": report(fixes)},
    }
    return Written(scenario, capture, figures)


def moving(scenario: Scenario) -> SimulatedMountMotion | None:
    """The motion of the mount; None where it is rigid."""
    return (
        SimulatedMountMotion.with_random_phases(scenario.mount, scenario.seed) if scenario.mount is not None else None
    )


def write_sensors(folder: Path, world: World, end_s: float) -> None:
    """The log of the IMU and the file of the mount, and the truth of the biases, where there are such."""
    scenario = world.scenario
    site = world.site
    if scenario.imu is not None:
        log = measure(scenario.imu, world.motion, site, end_s, scenario.seed)
        head = f"time_unix_s,{_RATE},{_FORCE}"
        table = np.column_stack([site.t0_s + log.t_s + scenario.imu.time_offset_s, log.rate_dps, log.force_mps2])
        np.savetxt(folder / "imu.csv", table, fmt="%.4f" + ",%.5f" * 6, header=head, comments="", encoding="ascii")
        i = slice(None, None, max(1, scenario.imu.rate_hz // 10))  # biases at 10 Hz
        table = np.column_stack([site.t0_s + log.t_s[i], log.bias[i]])
        np.savetxt(folder / "truth" / "imu_bias.csv", table, fmt="%.4f" + ",%.6f" * 6, header=head, comments="")
    if world.mount is not None:
        world.mount.write(folder / "mount.csv", site, end_s, scenario.seed)


def flight_figures(motion: SimulatedMotion) -> dict[str, Any]:
    """Length and tilt of a flight."""
    tilt = np.degrees(np.hypot(motion.roll_rad, motion.pitch_rad))
    return {
        "length_m": round(float(np.hypot(*np.diff(motion.xyz_m[:, :2], axis=0).T).sum()), 1),
        "tilt_max_deg": round(float(tilt.max()), 2),
        "tilt_rms_deg": round(float(np.sqrt((tilt**2).mean())), 2),
    }


def write_session(folder: Path, scenario: Scenario, capture: str, *tables: tuple[str, dict[str, Any]]) -> None:
    """The session as its user states it, with further tables: headers and keys."""
    second = scenario.second_lidar
    first = {} if second is None else {"name": second.first_name}
    stated: list[tuple[str, dict[str, Any]]] = [
        (
            "[recording]",
            {"lidar": [capture], "gnss": ["gnss.nmea"], "lidar_minus_gnss_s": scenario.clock.lidar_minus_gnss_s},
        ),
        ("[crs]", {"map": scenario.place.crs, "heights": "ellipsoidal", "coordinates": "as-recorded"}),
        ("[antenna]", {"xyz_m": scenario.antenna.xyz_m}),
        (
            "[lidar]" if second is None else "[[lidar]]",
            first | _lidar_keys(scenario.lidar, line=scenario.line is not None),
        ),
    ]
    if second is not None:
        own = {"name": second.name, "files": [second_file(second)], "minus_gnss_s": second.minus_gnss_s}
        stated.append(("[[lidar]]", own | _lidar_keys(second)))
    if scenario.imu is not None:
        stated.append(("[imu]", _imu_keys(scenario.imu)))
    if scenario.mount is not None:
        stated.append(("[mount]", {"attitude": "mount.csv"}))
    text = toml_keys({"furrowmap": 1, "name": scenario.title})
    text += "".join(f"\n{header}\n{toml_keys(keys)}" for header, keys in (*stated, *tables))
    (folder / "session.toml").write_text(text, encoding="utf-8")


def _lidar_keys(lidar: ScenarioLidar, *, line: bool = False) -> dict[str, Any]:
    stated = "" if line else SCANNERS[lidar.model].stated
    return ({"model": stated} if stated else {}) | {"xyz_m": lidar.xyz_m, "rpy_deg": lidar.rpy_deg}


def _imu_keys(imu: ScenarioImu) -> dict[str, Any]:
    """`[imu]` with the figures of its data sheet; those that are zero are left to the class."""
    noise = {
        "gyro_deg_s_rthz": imu.gyro_noise_deg_s_rthz,
        "accel_mg_rthz": imu.accel_noise_mg_rthz,
        "gyro_bias_deg_s": imu.gyro_bias_deg_s,
        "accel_bias_mg": imu.accel_bias_mg,
        "gyro_walk_deg_s_rts": imu.gyro_walk_deg_s_rts,
        "accel_walk_mg_rts": imu.accel_walk_mg_rts,
    }
    return {
        "files": ["imu.csv"],
        "xyz_m": imu.xyz_m,
        "rpy_deg": imu.rpy_deg,
        "class": imu.kind,
        "noise": {key: value for key, value in noise.items() if value > 0.0},
    }
