"""A season in the farm map against the simulator's truth, and a mosaic of 1,000 sessions in bounded memory.

The season: three simulated drives over the same field, each by its own driver, with poses as matched scans leave them;
their figures and polygons go through `farm add`, the table of seasons and the traffic raster are compared with the
simulator's own sweeps and path. The mosaic: the `dsm.tif` of a run (`python benchmarks/farm_season.py RESULT`), copied
to 1,000 places side by side, merged to cells of 10 cm.
"""

from __future__ import annotations

import json
import math
import resource
import shutil
import sys
import tempfile
from dataclasses import replace
from pathlib import Path
from time import perf_counter
from typing import Final

import numpy as np
import rasterio
import shapely
from rasterio.enums import MergeAlg
from rasterio.features import rasterize

import furrowmap
from benchmarks.worked_hectare import CORNER_M, DRIVE, NOISE, TOOL, driven
from furrowmap.core.coverage.field_work import Depth, FieldWork, tool_paths
from furrowmap.core.coverage.worked_ground import worked_ground
from furrowmap.core.geodesy.projection import map_frame
from furrowmap.core.simulator.drive import DRIVE_RATE_HZ, SimulatedTrack, drive_path, plan_path
from furrowmap.core.simulator.soil_over_time import find_sweeps
from furrowmap.core.simulator.truth import swept
from furrowmap.core.values.clock import iso_utc
from furrowmap.core.values.session import Crs, Implement
from furrowmap.core.values.trajectory import ScanPoses
from furrowmap.exporters.farm.surface_mosaic import write_mosaic
from furrowmap.exporters.vectors.geopackage import write_field

WHEELS: Final = furrowmap.Wheels(1.42, 0.38)
DAYS: Final = (0, 40, 90)
SESSIONS: Final = 1000
SPACING_M: Final = 32.0
FRAME: Final = map_frame(Crs(map="EPSG:6677"))


def main(result: Path | None) -> int:
    with tempfile.TemporaryDirectory() as folder:
        if result is None:
            season(Path(folder))
        else:
            mosaic(Path(folder), result)
    return 0


def season(root: Path) -> None:
    """The table of a season and the traffic raster against the truth."""
    rng = np.random.default_rng(30)
    tracks = [drive_path(plan_path(DRIVE, rng), DRIVE, TOOL, rng) for _ in DAYS]
    folders = [write_run(root / f"{day}", track, day, rng) for track, day in zip(tracks, DAYS, strict=True)]
    begin = perf_counter()
    furrowmap.add_to_farm_map(root / "farm.gpkg", folders)
    added_s = perf_counter() - begin
    (row,) = furrowmap.farm_memory(root / "farm.gpkg").seasons
    truth = [[shapely.transform(swept(s, TOOL.width_m), moved) for s in find_sweeps(t, TOOL.xy_m)] for t in tracks]
    once = [shapely.union_all(passes) for passes in truth]
    all_passes = [shape for passes in truth for shape in passes]
    worked, total = sum(ground.area for ground in once), sum(shape.area for shape in all_passes)
    hours = sum(worked_hours(track) for track in tracks)
    expected = {
        "ground_m2": shapely.union_all(once).area,
        "worked_area_m2": worked,
        "swept_area_m2": total,
        "hours": hours,
        "work_rate_ha_h": worked / 1e4 / hours,
    }
    print(f"{len(all_passes)} passes on {len(DAYS)} days, added in {added_s:.1f} s\n")
    print("| figure | farm map | truth | difference |\n| --- | ---: | ---: | ---: |")
    for name, value in expected.items():
        print(f"| {name} | {row[name]:,.2f} | {value:,.2f} | {row[name] / value - 1:+.3%} |")
    overlap = row["overlap_area_m2"] - (total - worked)
    told = f"{row['overlap_area_m2']:,.2f} | {total - worked:,.2f}"
    print(f"| overlap_area_m2 | {told} | {overlap / worked:+.3%} of the field |")
    assert row["times_worked"] == len(DAYS)
    settings = furrowmap.TrafficSettings(season=row["season"], wheels=WHEELS)
    begin = perf_counter()
    made = furrowmap.farm_traffic(root / "farm.gpkg", root / "traffic.tif", settings)
    took_s = perf_counter() - begin
    with rasterio.open(made.path) as raster:
        times, _, wheels = raster.read()
        at = raster.transform
    cell_m2 = made.cell_m**2
    true_times = np.zeros(times.shape, np.uint16)
    rasterize(((shape, 1) for shape in all_passes), out=true_times, transform=at, merge_alg=MergeAlg.add)
    driven_m2 = sum(length_m(track) for track in tracks) * 2 * WHEELS.tyre_width_m
    for name, found, value in (("times worked", times, total), ("passages of wheels", wheels, driven_m2)):
        counted = float(found.sum()) * cell_m2
        print(f"| raster, {name} × area | {counted:,.1f} | {value:,.1f} | {counted / value - 1:+.3%} |")
    differing = (times != true_times).sum() / (true_times > 0).sum()
    print(f"\n{differing:.2%} of the worked cells of {made.cell_m:g} m have another count; raster in {took_s:.1f} s")


def moved(xy: np.ndarray) -> np.ndarray:
    return xy + CORNER_M


def length_m(track: SimulatedTrack) -> float:
    """Driven between the first and the last scan; standing adds nothing."""
    return float(np.abs(track.speed_mps).sum() / DRIVE_RATE_HZ)


def worked_hours(track: SimulatedTrack) -> float:
    """From the first time that the tool is down to the last."""
    down = np.flatnonzero(track.tool_m < TOOL.working_depth_m)
    return float(track.t_s[down[-1]] - track.t_s[down[0]]) / 3600.0


def write_run(folder: Path, track: SimulatedTrack, day: int, rng: np.random.Generator) -> Path:
    """The products of a run that a farm map reads."""
    trajectory, states = driven(track, NOISE["matched scans"], rng)
    stated = Implement(width_m=TOOL.width_m, xy_m=TOOL.xy_m, working_depth_m=TOOL.working_depth_m)
    ground = worked_ground(trajectory, states, stated, FRAME)
    depths = tuple(Depth(0.12, 0.01, 0.02) for _ in ground.passes)
    work = FieldWork(ground=ground, depths=depths, paths=tuple(tool_paths(trajectory, states, stated)))
    t_s = trajectory.t_s + 86_400.0 * day
    poses = replace(ScanPoses.at_knots(trajectory), t_s=t_s)
    folder.mkdir()
    write_field(folder / "field.gpkg", poses, FRAME.crs, work)
    figures = ground.figures
    report = {
        "furrowmap": "0",
        "session": {
            "name": f"day {day}",
            "crs": {"map": "EPSG:6677", "heights": "ellipsoidal", "coordinates": "as-recorded"},
            "lidar": {},
            "implement": {"kind": "rotary tiller", "width_m": TOOL.width_m},
        },
        "inputs": [{"name": "recording", "sha256": f"{day:064x}"}],
        "figures": {
            "start": iso_utc(float(t_s[0])),
            "end": iso_utc(float(t_s[-1])),
            "points": 0,
            "bounds_m": [trajectory.xyz_m.min(axis=0).tolist(), trajectory.xyz_m.max(axis=0).tolist()],
            "worked_area_m2": figures.worked.grid_m2,
            "overlap_area_m2": figures.overlap.grid_m2,
            "missed_area_m2": figures.missed.grid_m2,
            "swept_area_m2": figures.swept_m2,
            "passes": figures.passes,
            "hours": {"field_s": figures.hours.field_s},
        },
        "coordinates": {"frame": "JGD2011", "epoch": None},
        "products": ["field.gpkg", "report.json"],
    }
    (folder / "report.json").write_text(json.dumps(report), encoding="utf-8")
    return folder


def mosaic(root: Path, result: Path) -> None:
    """The surface of a run at 1,000 places as one raster."""
    side = math.ceil(math.sqrt(SESSIONS))
    paths = []
    for k in range(SESSIONS):
        path = root / f"{k}.tif"
        shutil.copyfile(result / "dsm.tif", path)
        with rasterio.open(path, "r+", IGNORE_COG_LAYOUT_BREAK="YES") as raster:
            at = raster.transform
            east, north = (round(SPACING_M / at.a) * at.a * step for step in divmod(k, side))
            raster.transform = rasterio.Affine(at.a, 0.0, at.c + east, 0.0, at.e, at.f + north)
        paths.append(path)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    begin = perf_counter()
    made = write_mosaic(paths, root / "mosaic.tif", cell_m=0.1)
    took_s = perf_counter() - begin
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    size = (root / "mosaic.tif").stat().st_size / 1e6
    hectares = made.columns * made.rows * made.cell_m**2 / 1e4
    print(f"\n{made.surfaces} surfaces, {hectares:.0f} ha at {made.cell_m:g} m: {took_s:.0f} s, peak {peak:,.0f} MB "
          f"({before:,.0f} MB before), {size:,.0f} MB on disk")  # fmt: skip


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]) if len(sys.argv) > 1 else None))
