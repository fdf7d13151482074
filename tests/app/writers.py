"""Everything that writes files, each with two sources whose products differ."""

from __future__ import annotations

import hashlib
import json
import shutil
import sqlite3
import time
from collections.abc import Callable, Mapping
from contextlib import closing
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import laspy
import msgspec
import numpy as np
import pyogrio
import pyproj
import rasterio

import furrowmap
from furrowmap.core.runtime.errors import RefusedError
from furrowmap.core.simulator.scenario import demo_scenario
from furrowmap.core.simulator.simulate import simulate
from furrowmap.core.surfaces.grid import Grid
from furrowmap.exporters.farm.surface_mosaic import write_mosaic
from furrowmap.exporters.files.provenance import Origin
from furrowmap.exporters.files.staging import recover
from furrowmap.exporters.rasters.cog import Band, cog_output
from furrowmap.settings import SurfaceSettings
from furrowmap.workflows.calibrate.calibrate import write_calibration
from furrowmap.workflows.gnss.evaluate import evaluate_gnss
from furrowmap.workflows.share.export import export
from tests.app.crops.test_response import doses, table
from tests.app.tie.test_tie import write_result as write_date
from tests.exporters.farm.result_folders import write_result
from tests.fuzz.texts import worked

LONGEST_WAIT_S = 10.0
_SECOND = """seed = {seed}
[field]
size_e_m = 12.0
size_n_m = 12.0
[drive]
passes = 1
pass_m = [0.5]
accel_mps2 = 1.5
stand_start_s = 0.2
stand_end_s = 0.2
lead_in_m = 0.1
"""
"""A scenario of about a second."""
UTM33 = pyproj.CRS.from_epsg(32633)


def hashes(target: Path) -> dict[str, str]:
    """The digest of each file by its name; hidden ones are not products."""
    if not target.is_dir():
        return {target.name: hashlib.sha256(_bytes(target)).hexdigest()}
    files = {path.relative_to(target).as_posix(): path for path in target.rglob("*") if path.is_file()}
    return {name: hashlib.sha256(_bytes(files[name])).hexdigest() for name in sorted(files) if name[0] != "."}


def _bytes(path: Path) -> bytes:
    """What is in a file; of a GeoPackage, whose styles state when they were written, the features."""
    if path.suffix != ".gpkg":
        return path.read_bytes()
    with closing(sqlite3.connect(f"file:{path}?mode=ro", uri=True)) as database:
        assert database.execute("PRAGMA integrity_check").fetchone() == ("ok",)
        names = database.execute("SELECT table_name FROM gpkg_contents WHERE data_type = 'features'").fetchall()
        rows = [database.execute(f'SELECT * FROM "{name}"').fetchall() for (name,) in sorted(names)]
    return repr(rows).encode()


def recordings(target: Path) -> dict[str, str]:
    """The recording that each product of a run comes from, where it states one: products state how long a run took."""
    stated = {path.name: _recording(path) for path in sorted(target.iterdir()) if path.is_file()}
    return {name: text for name, text in stated.items() if text}


def _recording(path: Path) -> str:
    if path.suffix == ".tif":
        with rasterio.open(path) as raster:
            return str(raster.tags()["INPUT_1"])
    if path.suffix == ".gpkg":
        return str(pyogrio.read_info(path, layer="trajectory")["dataset_metadata"]["INPUT_1"])
    if path.name == "report.json":
        return "recording.pcap.gz sha256:" + json.loads(path.read_text())["inputs"][0]["sha256"]
    if path.suffix == ".laz":
        with laspy.CopcReader.open(path) as reader:
            words = next(vlr for vlr in reader.header.vlrs if vlr.record_id == 3).record_data_bytes().decode()
        return next(line.split(": ", 1)[1] for line in words.splitlines() if line.startswith("INPUT_1"))
    return ""


def sessions(target: Path) -> dict[str, str]:
    """The sessions of a farm map, which also states when they were added."""
    with closing(sqlite3.connect(f"file:{target}?mode=ro", uri=True)) as database:
        assert database.execute("PRAGMA integrity_check").fetchone() == ("ok",)
        rows = database.execute("SELECT name, worked_area_m2 FROM sessions").fetchall()
        passes = database.execute("SELECT count(*) FROM passes").fetchone()[0]
    return {str(name): f"{area} {passes}" for name, area in rows}


def _cloud(folder: Path, number: int, side_m: float = 20.0) -> Path:
    chance = np.random.default_rng(number)
    header = laspy.LasHeader(version="1.4", point_format=6)
    header.scales, header.offsets = np.full(3, 0.001), np.array([500_000.0, 5_300_000.0, 0.0])
    header.add_crs(UTM33)
    las = laspy.LasData(header)
    las.x, las.y, las.z = (chance.uniform(0, 1, (3000, 3)) * (side_m, side_m, 1) + (500_000, 5_300_000, 100)).T
    las.write(folder / f"{number}.las")
    return folder / f"{number}.las"


def _session(folder: Path, number: int) -> Path:
    scenario = demo_scenario()
    drive = msgspec.structs.replace(scenario.drive, pass_m=(3.0,), passes=1)
    simulated = simulate(msgspec.structs.replace(scenario, seed=number, drive=drive), folder / str(number))
    return simulated.recording.parent / "session.toml"


def _misstated(folder: Path, number: int) -> Path:
    """A session whose scanner is mounted otherwise than it states."""
    scenario = demo_scenario()
    lidar = msgspec.structs.replace(scenario.lidar, true_rpy_deg=(0.0, 30.0 + 2.0 * number, 90.0))
    return simulate(msgspec.structs.replace(scenario, lidar=lidar), folder / str(number)).session


@cache
def _calibration(session: Path) -> furrowmap.Calibration:
    return furrowmap.calibrate(session)


def _calibrate(session: Path, out: Path) -> None:
    if not out.exists():
        shutil.copy(session, out)
    write_calibration(out, _calibration(session))


def _propose(log: Path, out: Path) -> None:
    """A session beside its recording, whose name it states."""
    shutil.copy(log, out.parent)
    furrowmap.propose_session([out.with_name(log.name)], out, overwrite=True)


def _scenario(folder: Path, number: int) -> Path:
    path = folder / f"{number}.toml"
    path.write_text(_SECOND.format(seed=number))
    return path


def _tasks(folder: Path, number: int) -> Path:
    (folder / str(number)).mkdir()
    worked(folder / str(number), 1500 + 100 * number)
    return folder / str(number) / "TASKDATA"


def _result(folder: Path, number: int) -> Path:
    made = write_result(folder / str(number), name=f"Field {number}", day=number)
    report = json.loads((made / "report.json").read_bytes())
    report["session"]["implement"]["xy_m"] = [-1.45, 0.0]
    report["figures"] |= {"distance_m": 76.0, "hours": dict.fromkeys(("working_s", "turning_s", "idle_s"), 20.0)}
    report["figures"] |= {"worked_area_ellipsoid_m2": 75.5, "worked_length_m": 44.0}
    (made / "report.json").write_text(json.dumps(report))
    return made


def _same_session(folder: Path, number: int) -> Path:
    return write_result(folder / str(number), area_m2=float(number))


def _surface(folder: Path, number: int) -> Path:
    grid = Grid(0.5, 1_000_000, 10_600_000, (300, 300))
    with cog_output(folder / f"{number}.tif", grid, UTM33, [Band("height")], Origin("surface")) as put:
        put(grid, [np.random.default_rng(number).uniform(0, 1, grid.shape).astype(np.float32)])
    return folder / f"{number}.tif"


def _log(folder: Path, number: int) -> Path:
    log = _session(folder, number).with_name("gnss.nmea")
    return log.rename(log.with_name(f"{number}.nmea"))


def _give(drive: Path) -> Path:
    """The drive of a source as that of a folder with one name: a batch tells sources apart by theirs."""
    given = drive.parent / "given"
    shutil.rmtree(given, ignore_errors=True)
    shutil.copytree(drive, given / "drive")
    return given


def _batch(drive: Path, out: Path) -> None:
    """A batch, whose sessions fail alone; OSError with the words of the first that did."""
    found = furrowmap.batch([drive.parent / "given"], out, furrowmap.BatchSettings(workers=1))
    for row in found.sessions:
        if row.outcome.failure is not None:
            raise OSError(*row.outcome.failure.lines)


def _drive(folder: Path, number: int) -> Path:
    return _session(folder, number).parent


def settle(folder: Path) -> None:
    """What the next writer does first; workers of a killed one end with it, a moment later."""
    ends_s = time.monotonic() + LONGEST_WAIT_S
    while True:
        try:
            return recover(folder)
        except RefusedError:
            if time.monotonic() > ends_s:
                raise
            time.sleep(0.05)


def _results_of_batch(target: Path) -> dict[str, str]:
    """The recordings that the results come from; a batch may end with tables of the results before."""
    found = {}
    for folder in sorted(path for path in target.glob("[!.]*") if path.is_dir()):
        settle(folder)
        found |= {f"{folder.name}/{name}": recording for name, recording in recordings(folder).items()}
    return found


def _dates(folder: Path, number: int) -> Path:
    """Results of two days."""
    for day in (1, 2):
        write_date(folder / str(number) / f"day{day}", day, raised_m=0.1 * number)
    return folder / str(number)


def _rasters(target: Path) -> dict[str, str]:
    """The rasters of several results; records and catalogues state where these are, and when they were merged."""
    return {name: digest for name, digest in hashes(target).items() if name.endswith(".tif")}


def _trial(folder: Path, number: int) -> Path:
    """A table of heights, and one of doses beside it."""
    (folder / str(number)).mkdir()
    doses(folder / str(number) / "doses.csv")
    return table(folder / str(number) / "heights.csv", number)


def _farm(folder: Path, number: int) -> Path:
    target = folder / f"{number}.gpkg"
    furrowmap.add_to_farm_map(target, [_result(folder, number)])
    return target


def _surveyed(folder: Path, number: int) -> Path:
    cloud = _cloud(folder, number, 4.0)
    cloud.with_suffix(".csv").write_text("name,e_m,n_m,h_m\n" + "".join(
        f"{k},{500_000.6 + 0.4 * k},{5_300_002},{100.5 + 0.01 * number}\n" for k in range(8)
    ))  # fmt: skip
    return cloud


@dataclass(frozen=True)
class Writer:
    """Something that writes files.

    Attributes:
        make: the source of a number in a folder, from which other products follow than from that of another number.
        write: writes the product of a source, in place of an earlier one.
        target: name of the file or folder that is written.
        content: what must be old or new.
        begin: what can be done once for a source, because it changes no file.
    """

    make: Callable[[Path, int], Path]
    write: Callable[[Path, Path], object]
    target: str
    content: Callable[[Path], dict[str, str]] = hashes
    begin: Callable[[Path], object] = str


def _exporter(to: str, target: str) -> Writer:
    return Writer(_result, lambda source, out: export([source], to, out, overwrite=True), target)


WRITERS: Mapping[str, Writer] = {
    "surface": Writer(
        _cloud,
        lambda cloud, out: furrowmap.surface([cloud], out, SurfaceSettings(cell_m=0.5), overwrite=True),
        "surfaces",
    ),
    "cloud": Writer(_cloud, lambda cloud, out: furrowmap.clean([cloud], out, overwrite=True), "cloud.copc.laz"),
    "check": Writer(
        _surveyed,
        lambda cloud, out: furrowmap.check(cloud, cloud.with_suffix(".csv"), table=out, overwrite=True),
        "table.csv",
    ),
    "csv": _exporter("csv", "exported"),
    "sbet": _exporter("sbet", "exported.sbet"),
    "tum": _exporter("tum", "exported.tum"),
    "poses": _exporter("poses", "exported.csv"),
    "share": Writer(_result, lambda result, out: furrowmap.share(result, out, overwrite=True), "shared"),
    "response": Writer(
        _trial,
        lambda heights, out: furrowmap.response([heights], heights.with_name("doses.csv"), out, overwrite=True),
        "response",
        content=lambda folder: {k: v for k, v in hashes(folder).items() if k != "trial.xlsx"},  # it states the time
    ),
    "traffic": Writer(_farm, lambda farm, out: furrowmap.farm_traffic(farm, out, overwrite=True), "traffic.tif"),
    "shapefile": _exporter("shapefile", "exported"),
    "geoparquet": _exporter("geoparquet", "exported"),
    "gpkg": _exporter("gpkg", "exported.gpkg"),
    "kml": _exporter("kml", "exported.kml"),
    "stac": _exporter("stac", "catalogue"),
    "geojson": _exporter("geojson", "exported"),
    "flatgeobuf": _exporter("flatgeobuf", "exported"),
    "isoxml": _exporter("isoxml", "TASKDATA"),
    "isoxml-zip": _exporter("isoxml", "tasks.zip"),
    "fields": Writer(_tasks, lambda tasks, out: furrowmap.fields(tasks, out, overwrite=True), "fields.gpkg"),
    "init": Writer(_log, _propose, "session.toml"),
    "calibrate": Writer(_misstated, _calibrate, "session.toml", begin=_calibration),
    "simulate": Writer(_scenario, lambda scenario, out: furrowmap.simulate(scenario, out, overwrite=True), "simulated"),
    "farm": Writer(
        _same_session, lambda result, out: furrowmap.add_to_farm_map(out, [result]), "farm.gpkg", content=sessions
    ),
    "mosaic": Writer(_surface, lambda surface, out: write_mosaic([surface], out), "mosaic.tif"),
    "virtual": Writer(_surface, lambda surface, out: write_mosaic([surface], out), "mosaic.vrt"),
    "gnss": Writer(_log, lambda log, out: evaluate_gnss({"log": log}, log, out, overwrite=True), "evaluation"),
    "preview": Writer(
        _session,
        lambda session, out: furrowmap.preview(session, out),
        "preview",
        content=lambda folder: {k: v for k, v in hashes(folder).items() if k != "preview.json"},
    ),
    "batch": Writer(
        _drive,
        _batch,
        "results",
        content=_results_of_batch,
        begin=_give,
    ),
    "season": Writer(
        _dates,
        lambda dates, out: furrowmap.season(
            [dates], out, furrowmap.SeasonSettings(workers=1, content=("mosaics",)), overwrite=True
        ),
        "season",
        content=_rasters,
    ),
    "run": Writer(
        _session, lambda session, out: furrowmap.run(session, out, overwrite=True), "result", content=recordings
    ),
}
