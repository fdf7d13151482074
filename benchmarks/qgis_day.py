"""How long QGIS takes to open a day's result: 100 ha worked in 10 h, a cloud of 10 million points, surfaces of 10 cm.

The day is made up once and kept in the user's cache folder: straight passes of a tool 9 m wide at 3 m/s by `furrowmap
run` from a trajectory of 10 poses a second; beside its products a cloud along the way and rasters over all of the land.
The folder is then dropped on the plugin's dock in the desktop QGIS of the tests, several times in one session of it.
"""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from pyproj import CRS

import furrowmap
from furrowmap.core.surfaces.grid import Grid
from furrowmap.exporters.cloud.copc_file import CopcFormat, las_wkt
from furrowmap.exporters.cloud.point_batches import PointBatch
from furrowmap.exporters.cloud.writer import CopcWriter
from furrowmap.exporters.files.provenance import Origin
from furrowmap.exporters.files.result_folder import style_of
from furrowmap.exporters.rasters.cog import HEIGHT_BAND, Band, cog_output
from furrowmap.workflows.share.qgis_plugin import write_plugin_zip

CHECKOUT = Path(__file__).resolve().parents[1]
DAY = Path.home() / ".cache" / "furrowmap" / "benchmarks" / "qgis_day"
SIDE_M, WIDTH_M, SPEED_MPS, TURN_S = 1000.0, 9.0, 3.0, 20.0
CORNER_M = (16_000.0, 96_000.0, 270.0)
BEGIN_S = 1_781_049_600.0
"""2026-06-10, midnight UTC: nine in the morning in Japan."""
POINTS = 10_000_000
CELL_M = 0.1
SESSION = """furrowmap = 1
name = "A day's work"
[recording]
lidar = []
[crs]
map = "EPSG:6677"
[implement]
width_m = 9.0
xy_m = [-2.0, 0.0]
states = ["states.csv"]
[trajectory]
files = ["drive.csv"]
"""


def main() -> int:
    result = DAY / "result"
    if not (result / "report.json").is_file():
        make_day(result)
    figures = json.loads((result / "report.json").read_text(encoding="utf-8"))["figures"]
    print(f"{figures['worked_area_m2'] / 1e4:.1f} ha in {figures['passes']} passes, {POINTS:,} points; ", end="")
    print(f"{sum(path.stat().st_size for path in result.iterdir()) / 1e6:,.0f} MB")
    with TemporaryDirectory() as scratch:
        plugins = Path(scratch) / "plugins"
        write_plugin_zip(Path(f"{scratch}/zip"))
        with zipfile.ZipFile(f"{scratch}/zip") as archive:
            archive.extractall(plugins)
        shutil.copytree(result, f"{scratch}/day")  # the root of QGIS sees the folder for temporary files
        script = CHECKOUT / "benchmarks" / "in_qgis" / "time_drop.py"
        command = [
            CHECKOUT / "scripts" / "in_qgis_root.sh",
            "scripts/qgis_desktop.sh",
            plugins,
            script,
            f"{scratch}/day",
        ]
        told = subprocess.run(command, cwd=CHECKOUT, capture_output=True, text=True, check=True).stdout
    for line in told.splitlines():
        if line.startswith("{"):
            seconds = json.loads(line)
            print(", ".join(f"{name} {value:.2f} s" for name, value in seconds.items()))
    return 0


def make_day(folder: Path) -> None:
    """Make the products up."""
    DAY.mkdir(parents=True, exist_ok=True)
    t_s, en_m, heading_deg, passes_s = drive()
    rows = np.column_stack([t_s, en_m, np.full(len(t_s), CORNER_M[2]), np.zeros((len(t_s), 2)), heading_deg])
    np.savetxt(
        DAY / "drive.csv",
        rows,
        "%.2f,%.3f,%.3f,%.3f,%.1f,%.1f,%.2f",
        header="time_unix_s,e_m,n_m,h_m,roll_deg,pitch_deg,heading_deg",
        comments="",
    )
    states = "".join(f"{begin:.2f},down\n{end:.2f},up\n" for begin, end in passes_s)
    (DAY / "states.csv").write_text(f"t_s,state\n{t_s[0]:.2f},up\n{states}")
    (DAY / "session.toml").write_text(SESSION)
    furrowmap.run(DAY / "session.toml", folder, overwrite=True)
    write_cloud(folder / "cloud.copc.laz", t_s, en_m)
    styles = CHECKOUT / "exporters" / "styles"
    for name, band in (("dsm", HEIGHT_BAND), ("dsm_before", HEIGHT_BAND), ("change", Band("change"))):
        write_raster(folder / f"{name}.tif", band)
        style = "change" if name == "change" else "dsm"
        shutil.copyfile(styles / f"{style}.qml", folder / style_of(f"{name}.tif"))


def drive() -> tuple[np.ndarray, np.ndarray, np.ndarray, list[tuple[float, float]]]:
    """Times, places and headings ten times a second, and when the tool was down: passes side by side, turns between."""
    begin_s, length_s, places, passes_s = BEGIN_S, SIDE_M / SPEED_MPS, [], []
    for number in range(int(SIDE_M / WIDTH_M)):
        t_s = begin_s + np.arange(0.0, length_s + TURN_S, 0.1)
        share = np.minimum((t_s - begin_s) / length_s, 1.0)
        turn = np.clip((t_s - begin_s - length_s) / TURN_S, 0.0, 1.0)
        forth = number % 2 == 0
        along = share if forth else 1.0 - share
        e_m = CORNER_M[0] + SIDE_M * along + (1 if forth else -1) * 8.0 * np.sin(np.pi * turn)
        n_m = CORNER_M[1] + WIDTH_M * (number + 0.5 - 0.5 * np.cos(np.pi * turn) + 0.5)
        heading = np.mod(90.0 - 180.0 * turn if forth else 270.0 + 180.0 * turn, 360.0)
        places.append(np.column_stack([t_s, e_m, n_m, heading]))
        passes_s.append((begin_s + 1.0, begin_s + length_s - 1.0))
        begin_s = float(t_s[-1]) + 0.1
    all_m = np.concatenate(places)
    return all_m[:, 0], all_m[:, 1:3], all_m[:, 3], passes_s


def write_cloud(path: Path, t_s: np.ndarray, en_m: np.ndarray) -> None:
    """Points up to 10 m beside the way, of ground and of what stands on it."""
    rng = np.random.default_rng(16)
    wkt = las_wkt(CRS("EPSG:6677"))
    with CopcWriter(path, CopcFormat(wkt, CORNER_M)) as writer:
        for k in np.array_split(np.sort(rng.integers(len(t_s), size=POINTS)), 50):
            xyz_m = np.column_stack([en_m[k] - CORNER_M[:2] + rng.normal(0.0, 4.0, (len(k), 2)), np.zeros(len(k))])
            other = rng.random(len(k)) < 0.1
            xyz_m[:, 2] = relief_m(xyz_m[:, 0], xyz_m[:, 1]) + other * rng.random(len(k))
            writer.append(PointBatch(xyz_m, t_s[k], classification=np.where(other, 1, 2).astype(np.uint8)))
        writer.close()


def write_raster(path: Path, band: Band) -> None:
    """Over all of the land, tile by tile."""
    cells = int(SIDE_M / CELL_M)
    west, north = round(CORNER_M[0] / CELL_M), round((CORNER_M[1] + SIDE_M) / CELL_M)
    origin = Origin("A day's work")
    with cog_output(path, Grid(CELL_M, west, north, (cells, cells)), CRS("EPSG:6677"), (band,), origin) as write:
        for row in range(0, cells, 500):
            e_m = CELL_M * np.arange(cells)[None, :]
            n_m = SIDE_M - CELL_M * np.arange(row, row + 500)[:, None]
            height_m = relief_m(e_m, n_m) + (CORNER_M[2] if band is HEIGHT_BAND else 0.0)
            write(Grid(CELL_M, west, north - row, (500, cells)), [height_m.astype(np.float32)])


def relief_m(e_m: np.ndarray, n_m: np.ndarray) -> np.ndarray:
    """Ridges of some centimetres on a slope that is hardly one."""
    ridges: np.ndarray = 0.04 * np.sin(2 * np.pi * n_m / 0.75) + 0.3 * np.sin(e_m / 90.0) * np.cos(n_m / 70.0)
    return ridges


if __name__ == "__main__":
    sys.exit(main())
