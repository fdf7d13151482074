"""Every command of the command line that writes files, with what it reads: for tests of what goes wrong in writing."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import geopandas as gpd
import numpy as np
import shapely
from pyproj import CRS

import furrowmap
from furrowmap.core.surfaces.grid import Grid
from furrowmap.exporters.files.provenance import Origin
from furrowmap.exporters.rasters.cog import HEIGHT_BAND
from tests.app.clouds.coloured_scene import write_scene
from tests.app.crops.test_growth import CRS as CROPS_CRS
from tests.app.crops.test_growth import DAYS, EAST, NORTH, PLOTS, write_flight
from tests.app.crops.test_response import doses, table
from tests.app.tie.test_tie import write_result as write_date
from tests.app.writers import WRITERS
from tests.exporters.farm.result_folders import write_result
from tests.exporters.rasters.written_cogs import write_cog

JAPAN = CRS.from_epsg(6677)
Materials = Mapping[str, Path]


def _nothing(_: Materials, __: Path) -> None:
    """Nothing has to be there before."""


@dataclass(frozen=True)
class Case:
    """A command that writes files.

    Attributes:
        words: of the command line; `{out}` is the folder for its products, other names are those of :func:`materials`.
        again: words with which it replaces what it wrote before.
        before: puts into the folder what the command changes.
        repeats: whether it can be run again on what it has changed.
    """

    words: str
    again: str = "--overwrite"
    before: Callable[[Materials, Path], None] = _nothing
    repeats: bool = True


def materials(folder: Path, simulated: furrowmap.Simulated, result: furrowmap.Result) -> dict[str, Path]:
    """What the commands read."""
    made = {"drive": simulated.folder, "session": simulated.session, "result": result.path}
    made["gnss"] = simulated.folder / "gnss.nmea"
    made["scenario"] = simulated.folder.parent / "scenario.toml"
    for name in ("surface", "check", "fields"):
        (folder / name).mkdir()
        made[name] = WRITERS[name].make(folder / name, 1)
    made["survey"] = made["check"].with_suffix(".csv")
    made["scene"] = write_scene(_made(folder / "scene"))
    made |= _crops(_made(folder / "crops"))
    made["parcel_table"] = table(folder / "parcels.csv", 1)
    made["doses"] = doses(folder / "treatments.csv")
    for number, name in enumerate(("north", "south")):
        made[name] = write_result(folder / name, name=name, recording=f"{number}" * 64, day=7 * number)
        grid = Grid(0.5, 33_200 + 2 * number, 193_000, (4, 4))
        write_cog(made[name] / "dsm.tif", grid, JAPAN, [HEIGHT_BAND], [np.full((4, 4), 250.0 + number)], Origin("dsm"))
        made[f"date{number}"] = write_date(folder / "dates" / name, number)
    made["dates"] = folder / "dates"
    made["farm"] = folder / "farm.gpkg"
    furrowmap.add_to_farm_map(made["farm"], [made["north"], made["south"]])
    return made


def _made(folder: Path) -> Path:
    folder.mkdir()
    return folder


def _crops(folder: Path) -> dict[str, Path]:
    flights = {f"flight{number}": write_flight(folder / f"{DAYS[number]}.laz", number) for number in (0, 1)}
    shapes = [shapely.transform(shape, lambda en: en + np.array([EAST, NORTH])) for shape in PLOTS.values()]
    parcels = gpd.GeoDataFrame({"id": list(PLOTS)}, geometry=shapes, crs=CROPS_CRS)
    parcels.to_file(folder / "parcels.gpkg")
    return flights | {"parcels": folder / "parcels.gpkg"}


def _machine(made: Materials, out: Path) -> None:
    furrowmap.save_machine(made["session"], out / "tractor.toml")


def _log(made: Materials, out: Path) -> None:
    shutil.copy(made["gnss"], out)


def _result(made: Materials, out: Path) -> None:
    shutil.copytree(made["result"], out, dirs_exist_ok=True)


def _farm(made: Materials, out: Path) -> None:
    shutil.copy(made["farm"], out)


_PLOTS = "--crs EPSG:6677 --corner 0,0 --azimuth 90 --rows 3 --columns 4 --length 5 --width 1.5"
CASES: Mapping[str, Case] = {
    "init": Case("init {out}/gnss.nmea -o {out}/session.toml", before=_log),
    "run": Case("run {session} -o {out}/result"),
    "run --preview": Case("run {session} --preview -o {out}/preview", again=""),
    "batch": Case("batch {drive} -o {out}/results --workers 1"),
    "season": Case("season {dates} -o {out}/season --workers 1 --content mosaics"),
    "surface": Case("surface {surface} -o {out}/surfaces --cell 0.5"),
    "cloud": Case("cloud {surface} -o {out}/cloud.copc.laz"),
    "colour": Case("colour {scene}/cloud.laz {scene}/session.toml -o {out}/coloured.copc.laz"),
    "features": Case("features {flight0} -o {out}/features"),
    "parcels": Case("parcels {flight0} {parcels} -o {out}/parcels --net-inset 0.5,0.1"),
    "growth": Case("growth {flight0} {flight1} {parcels} -o {out}/growth --net-inset 0.5,0.1"),
    "canopy": Case("canopy {flight0} --cell 2 -o {out}/canopy"),
    "tie": Case("tie {date0} {date1} -o {out}/tied"),
    "fields": Case("fields {fields} -o {out}/fields.gpkg"),
    "plots": Case(f"plots {_PLOTS} -o {{out}}/plots.gpkg"),
    "plots .geojson": Case(f"plots {_PLOTS} -o {{out}}/plots.geojson"),
    "response": Case("response {parcel_table} --treatments {doses} -o {out}/response"),
    "export stac": Case("export {result} --to stac -o {out}/stac"),
    **{
        f"export {to}": Case(f"export {{result}} --to {to} -o {{out}}/exported{end}")
        for to, end in {
            "gpkg": ".gpkg",
            "geoparquet": "",
            "flatgeobuf": "",
            "geojson": "",
            "shapefile": "",
            "kml": ".kml",
            "csv": "",
            "sbet": ".sbet",
            "tum": ".tum",
            "poses": ".csv",
            "isoxml": "",
        }.items()
    },
    "export isoxml .zip": Case("export {result} --to isoxml -o {out}/tasks.zip"),
    "report": Case("report {out} --units acre", again="", before=_result),
    "share": Case("share {result} -o {out}/page"),
    "share --qfield": Case("share {result} --qfield -o {out}/project"),
    "farm add": Case("farm add {north} {south} {out}/farm.gpkg", again=""),
    "farm remove": Case("farm remove {out}/farm.gpkg south", again="", before=_farm, repeats=False),
    "farm history": Case("farm history {farm} north -o {out}/north.html"),
    "farm history .csv": Case("farm history {farm} north -o {out}/north.csv"),
    "farm traffic": Case("farm traffic {farm} -o {out}/traffic.tif"),
    "farm mosaic": Case("farm mosaic {north} {south} -o {out}/mosaic.tif"),
    "farm mosaic .vrt": Case("farm mosaic {north} {south} -o {out}/mosaic.vrt"),
    "calibrate --machine": Case("calibrate {session} --machine {out}/tractor.toml", again="", before=_machine),
    "machine save": Case("machine save {session} {out}/tractor.toml"),
    "frames --svg": Case("frames {session} --svg {out}/frames.svg", again=""),
    "gnss evaluate": Case("gnss evaluate {gnss} --reference 35,139,10 -o {out}/evaluation"),
    "check --table": Case("check {check} {survey} --table {out}/table.csv"),
    "simulate": Case("simulate {scenario} -o {out}/simulated"),
    "notebooks": Case("notebooks {out}/notebooks", again="", repeats=False),
    "qgis install": Case("qgis install --plugins-folder {out}/plugins", again=""),
    "qgis zip": Case("qgis zip -o {out}/plugin.zip", again="", repeats=False),
}
"""By command, with what else of it is chosen."""
WITHOUT_FILES: Mapping[str, str] = {
    "inspect": "prints",
    "crs": "prints",
    "explain": "prints",
    "farm fields": "prints",
    "farm list": "prints",
    "machine list": "prints",
    "worker": "runs the other commands",
    "warm-up": "writes into the cache of kernels alone",
    "record": "waits for sensors; tests/app/record/test_record.py fills its disk",
    "live": "waits for a recorder; a log that it cannot write is left out",
    "gnss solve": "is written by another program, RTKLIB",
}
"""Commands that are no case, and why."""
