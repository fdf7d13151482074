"""A hectare worked in passes of 100 m: how near the ground worked is to the truth, and how large its layers are.

The drive is the simulator's (a driver who wanders, a tool that goes up and down), its poses ten a second with the
errors of matched scans or of GNSS alone; the truth is the simulator's own sweep of the same drive. `field.gpkg` is
measured without its layer `trajectory`, layer by layer.
"""

from __future__ import annotations

import sqlite3
import sys
import tempfile
from collections.abc import Mapping
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from time import process_time
from typing import Final

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.signal import lfilter

from furrowmap.core.coverage.field_work import Depth, FieldWork, events, tool_paths
from furrowmap.core.coverage.worked_ground import worked_ground
from furrowmap.core.geodesy.projection import map_frame
from furrowmap.core.simulator.drive import DRIVE_RATE_HZ, SimulatedTrack, drive_path, plan_path
from furrowmap.core.simulator.scenario import ScenarioDrive, ScenarioImplement
from furrowmap.core.simulator.soil_over_time import find_sweeps
from furrowmap.core.simulator.truth import swept
from furrowmap.core.values.session import Crs
from furrowmap.core.values.session import Implement as Stated
from furrowmap.core.values.tool_states import ToolStates
from furrowmap.core.values.trajectory import ScanPoses, Trajectory, trajectory_from_attitude
from furrowmap.exporters.vectors.geopackage import write_field

FloatArray = NDArray[np.float64]

CORNER_M = np.array([16_600.0, 96_500.0])
HECTARE_M2: Final = 1e4
SCANS_HZ = 10
DRIVE = ScenarioDrive(passes=63, pass_m=(100.0,), spacing_m=1.6, start_xy_m=(10.0, 10.0), lane_heading_deg=81.0)
TOOL = ScenarioImplement()
NOISE: Mapping[str, tuple[float, float, float, float, float]] = {
    "none": (0.0, 0.0, 1.0, 0.0, 0.0),
    "matched scans": (0.0005, 0.005, 60.0, 0.03, 0.004),
    "GNSS alone": (0.004, 0.010, 80.0, 0.25, 0.02),
}
"""White and slow error of a position (m), time of the slow one (s), heading's error (°), a transition's (s)."""


def main() -> int:
    rng = np.random.default_rng(14)
    track = drive_path(plan_path(DRIVE, rng), DRIVE, TOOL, rng)
    truth = [swept(sweep, TOOL.width_m) for sweep in find_sweeps(track, TOOL.xy_m)]
    whole = shapely.transform(shapely.union_all(truth), lambda xy: xy + CORNER_M)
    twice = sum(shape.area for shape in truth) - whole.area
    print(f"{len(truth)} passes, {whole.area / HECTARE_M2:.3f} ha, {len(track.t_s) / DRIVE_RATE_HZ / 3600:.2f} h\n")
    print("| errors | area | IoU | overlap, of the field | error over sigma | kB a hectare | s of CPU |")
    print("| --- | ---: | ---: | ---: | ---: | ---: | ---: |")
    sizes = {}
    for name, noise in NOISE.items():
        trajectory, states = driven(track, noise, rng)
        begin = process_time()
        stated = Stated(width_m=TOOL.width_m, xy_m=TOOL.xy_m, working_depth_m=TOOL.working_depth_m)
        ground = worked_ground(trajectory, states, stated, map_frame(Crs(map="EPSG:6677")))
        seconds = process_time() - begin
        depths = tuple(Depth(0.12, 0.01, 0.02) for _ in ground.passes)
        paths, found = tool_paths(trajectory, states, stated), events(trajectory, states, stated)
        work = FieldWork(ground=ground, depths=depths, paths=tuple(paths), events=tuple(found))
        sizes[name] = layer_bytes(work)
        worked, area = ground.figures.worked, ground.coverage.area
        iou = shapely.intersection(ground.coverage, whole).area / shapely.union(ground.coverage, whole).area
        overlap = ground.figures.overlap.grid_m2 - twice
        assert all(shapely.is_valid([ground.coverage, *(p.ground for p in ground.passes)]))
        print(
            f"| {name} | {area / whole.area - 1:+.3%} | {iou:.4f} | {overlap / whole.area:+.3%} | "
            f"{(area - whole.area) / worked.sigma_m2 if worked.sigma_m2 else float('nan'):.1f} | "
            f"{sum(sizes[name].values()) / 1000 / (whole.area / HECTARE_M2):.0f} | {seconds:.2f} |"
        )
    tables = sorted({table for size in sizes.values() for table in size})
    print(f"\n| kB | {' | '.join(sizes)} |\n| --- |{' ---: |' * len(sizes)}")
    for table in tables:
        print(f"| {table} | {' | '.join(f'{size.get(table, 0) / 1000:.0f}' for size in sizes.values())} |")
    return 0


def driven(
    track: SimulatedTrack, noise: tuple[float, float, float, float, float], rng: np.random.Generator
) -> tuple[Trajectory, ToolStates]:
    """The drive as a run knows it: poses at the scans, with errors, and the times at which the tool passed."""
    white_m, slow_m, slow_s, heading_deg, time_s = noise
    every = slice(None, None, DRIVE_RATE_HZ // SCANS_HZ)
    t = track.t_s[every] + 1_781_141_000.0
    n = len(t)
    place = np.column_stack([track.e_m, track.n_m])[every] + CORNER_M
    place = place + rng.normal(0.0, white_m, (n, 2)) + _slow(rng, n, 2, slow_m, slow_s)
    heading = 90.0 - np.degrees(track.yaw_rad[every]) + _slow(rng, n, 1, heading_deg, 3.0)[:, 0]
    speed = track.speed_mps[every]
    trajectory = trajectory_from_attitude(
        t,
        np.column_stack([place, np.zeros(n)]),
        0.0,
        0.0,
        heading % 360.0,
        max_gap_s=1.0,
        speed_mps=speed,
        motion=np.sign(np.round(speed, 2)).astype(np.int8),
    )
    sigma = [np.hypot(white_m, slow_m)] * 2 + [0.02, 0.1, 0.1, heading_deg]
    trajectory = replace(trajectory, sigma=np.tile(sigma, (n, 1)))
    height = track.tool_m - TOOL.working_depth_m
    k = np.flatnonzero((height[1:] < 0.0) != (height[:-1] < 0.0))
    cuts = track.t_s[k] + height[k] / (height[k] - height[k + 1]) / DRIVE_RATE_HZ + t[0] - track.t_s[0]
    cuts = np.concatenate([t[:1], cuts + rng.normal(0.0, time_s, len(cuts)), t[-1:]])
    state = (np.arange(len(cuts) - 1) % 2).astype(np.int8)
    sigma = np.concatenate([[0.0], np.full(len(k), time_s), [0.0]])
    return trajectory, ToolStates(cuts[:-1], cuts[1:], state, np.ones(len(state)), sigma[:-1], sigma[1:])


def _slow(rng: np.random.Generator, n: int, columns: int, sigma: float, time_s: float) -> FloatArray:
    """(n, columns) a Gauss-Markov process of first order at the scans' rate."""
    keep = np.exp(-1.0 / (SCANS_HZ * time_s))
    step = rng.normal(0.0, sigma * np.sqrt(1.0 - keep**2), (n, columns))
    step[0] = rng.normal(0.0, sigma, columns)
    return np.asarray(lfilter([1.0], [1.0, -keep], step, axis=0), np.float64)


def layer_bytes(work: FieldWork) -> dict[str, int]:
    """How much of `field.gpkg` each layer takes (indexes with it), pages and all; `everything else` is the rest."""
    none = np.zeros(0)
    poses = ScanPoses(
        scan=none.astype(np.int64),
        t_s=none,
        xyz_m=np.zeros((0, 3)),
        quaternion=np.zeros((0, 4)),
        speed_mps=none,
        motion=none.astype(np.int8),
        fix=none.astype(np.int8),
        sigma=np.zeros((0, 6)),
        heading_from=none.astype(np.str_),
        points=none.astype(np.int64),
    )
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, "field.gpkg")
        write_field(file, poses, map_frame(Crs(map="EPSG:6677")).crs, work)
        with closing(sqlite3.connect(file)) as database:
            database.execute("CREATE VIRTUAL TABLE temp.pages USING dbstat(main)")
            rows = database.execute("SELECT name, sum(pgsize) FROM temp.pages GROUP BY name").fetchall()
        sizes = dict(rows)
        sizes["everything else"] = file.stat().st_size - sum(sizes.values())
    return sizes


if __name__ == "__main__":
    sys.exit(main())
