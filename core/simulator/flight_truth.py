"""The ground truth of a flight: trajectory, mounting, ground and crop, points to check."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, maximum_filter

from furrowmap.core.simulator.flight_scenario import Flight
from furrowmap.core.simulator.motion import SimulatedMotion, mount_rotation
from furrowmap.core.simulator.noise import Float32Array, FloatArray, random_for
from furrowmap.core.simulator.recording import World
from furrowmap.core.simulator.scenario import Scenario, ScenarioLidar
from furrowmap.core.simulator.site import CELL_M, CROP_CELL_M, SimulatedSite
from furrowmap.core.simulator.soil import Ground, ground_height
from furrowmap.core.simulator.truth import quarters

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
    crop, plot = np.zeros(shape, np.float32), np.zeros(shape, np.int16)
    plants = gaussian_filter(rng.standard_normal(shape, np.float32), PLANT_CELLS, mode="wrap")
    plants *= EAR_M / float(plants.std())
    gap = maximum_filter(rng.uniform(size=shape) < GAPS, 3, mode="wrap")
    e, n = ((np.arange(k) + 0.5) * CROP_CELL_M for k in (shape[1], shape[0]))
    for number, (e0, n0, direction, length, width, height) in enumerate(flight.plots_m, 1):
        c, s = math.cos(math.radians(direction)), math.sin(math.radians(direction))
        along = c * (e[None, :] - e0) + s * (n[:, None] - n0)
        across = c * (n[:, None] - n0) - s * (e[None, :] - e0)
        inside = (np.abs(along) <= 0.5 * length) & (np.abs(across) <= 0.5 * width)
        crop[inside], plot[inside] = np.where(gap[inside], 0.0, np.maximum(height + plants[inside], 0.0)), number
    return crop, plot


def write_flight_trajectory(file: Path, motion: SimulatedMotion, site: SimulatedSite) -> None:
    """The vehicle frame at the rate of the motion, in map coordinates and in the angles of files."""
    columns = [
        site.t0_s + motion.t_s,
        *(motion.xyz_m + np.array([site.e0_m, site.n0_m, site.h0_m])).T,
        np.degrees(motion.roll_rad),
        np.degrees(motion.pitch_rad),
        (90.0 - np.degrees(motion.yaw_rad)) % 360.0,
    ]
    names = "time_unix_s,e_m,n_m,h_m,roll_deg,pitch_deg,heading_deg"
    np.savetxt(file, np.column_stack(columns), fmt="%.4f" + ",%.6f" * 3 + ",%.5f" * 3, header=names, comments="")


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
    scenario, site, ground = world.scenario, world.site, world.ground
    rows, cols = (math.floor(m / TRUTH_PIXEL_M) for m in (scenario.field.size_n_m, scenario.field.size_e_m))
    e, n = ((np.arange(2 * k) + 0.5) * CROP_CELL_M for k in (cols, rows))
    soil = np.empty((rows, cols))
    for row, north in enumerate(n.reshape(-1, 2)):
        place = np.meshgrid(e, north)
        height = ground_height(ground, place[0].ravel(), place[1].ravel(), np.zeros(4 * cols))
        soil[row] = height.reshape(2, cols, 2).mean(axis=(0, 2))
    canopy, parcel = np.zeros(soil.shape, np.float32), np.zeros(soil.shape, np.int16)
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
        c, s = math.cos(math.radians(direction)), math.sin(math.radians(direction))
        along, across = c * (e - e0)[None, :] + s * (n - n0)[:, None], c * (n - n0)[:, None] - s * (e - e0)[None, :]
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
