"""Everything that writes files, each with two sources whose products differ."""

from __future__ import annotations

import hashlib
import json
import sqlite3
from collections.abc import Callable, Mapping
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

import laspy
import msgspec
import numpy as np
import pyogrio
import pyproj
import rasterio

import furrowmap
from furrowmap.core.pointclouds.surface_settings import SurfaceSettings
from furrowmap.core.simulator.scenario_file import demo_scenario
from furrowmap.core.simulator.simulate import simulate
from furrowmap.core.surfaces.grid import Grid
from furrowmap.exporters.farm.mosaic import write_mosaic
from furrowmap.exporters.files.provenance import Origin
from furrowmap.exporters.rasters.cog import Band, cog_output
from furrowmap.workflows.evaluate_gnss import evaluate_log
from furrowmap.workflows.export import export
from tests.exporters.farm.result_folders import write_result

UTM33 = pyproj.CRS.from_epsg(32633)


def hashes(target: Path) -> dict[str, str]:
    """The digest of each file by its name; hidden ones are not products."""
    paths = sorted(target.iterdir()) if target.is_dir() else [target]
    paths = [path for path in paths if path.is_file() and not path.name.startswith(".")]
    return {path.name: hashlib.sha256(_bytes(path)).hexdigest() for path in paths}


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


def _result(folder: Path, number: int) -> Path:
    return write_result(folder / str(number), name=f"Field {number}", day=number)


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
    """

    make: Callable[[Path, int], Path]
    write: Callable[[Path, Path], object]
    target: str
    content: Callable[[Path], dict[str, str]] = hashes


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
    "shapefile": _exporter("shapefile", "exported"),
    "geoparquet": _exporter("geoparquet", "exported"),
    "gpkg": _exporter("gpkg", "exported.gpkg"),
    "kml": _exporter("kml", "exported.kml"),
    "stac": _exporter("stac", "catalogue"),
    "farm": Writer(
        _same_session, lambda result, out: furrowmap.add_to_farm_map(out, [result]), "farm.gpkg", content=sessions
    ),
    "mosaic": Writer(_surface, lambda surface, out: write_mosaic([surface], out), "mosaic.tif"),
    "virtual": Writer(_surface, lambda surface, out: write_mosaic([surface], out), "mosaic.vrt"),
    "gnss": Writer(_log, lambda log, out: evaluate_log(log, log, out, overwrite=True), "evaluation"),
    "preview": Writer(
        _session,
        lambda session, out: furrowmap.preview(session, out),
        "preview",
        content=lambda folder: {k: v for k, v in hashes(folder).items() if k != "preview.json"},
    ),
    "run": Writer(
        _session, lambda session, out: furrowmap.run(session, out, overwrite=True), "result", content=recordings
    ),
}
