"""Sessions, boundaries, parameters of transformations, and task data to the ground worked."""

from __future__ import annotations

import datetime as dt
import io
import json
import zipfile
from pathlib import Path

import geopandas
import numpy as np
import openpyxl
import shapely

from furrowmap import fields
from furrowmap.core.coverage.field_boundary import field_boundary
from furrowmap.core.crops.parcel_areas import read_parcels
from furrowmap.core.crops.trial_tables import read_treatments
from furrowmap.core.geodesy.projection import map_frame, read_parameters
from furrowmap.core.readers.antex import antenna_model
from furrowmap.core.readers.mount_csv import read_mount
from furrowmap.core.readers.nmea.log import NmeaLog
from furrowmap.core.readers.reader import ReadOptions
from furrowmap.core.session.opened import open_session
from furrowmap.core.trajectory.from_gnss import trajectory_from_gnss
from furrowmap.core.values.session import Crs
from tests.core.geodesy.test_coordinates import QUARTER
from tests.core.readers.isoxml.time_logs import Record, header, task_data
from tests.core.readers.test_antex import SATELLITE, UNDER_SNOW, ZEPHYR, antex
from tests.core.readers.test_boundary import RING, agopengps_folder
from tests.fuzz.mutations import Files
from tests.fuzz.positions import STATES, mend_nmea, nmea, section_seeds
from tests.fuzz.reading import EACH_WAY
from tests.fuzz.trials import Entry

FIELD = shapely.Polygon([(141.33, 43.05), (141.34, 43.05), (141.34, 43.06), (141.33, 43.06)])
FRAME = map_frame(Crs(map="EPSG:32654"))
SESSION = b"""furrowmap = 1
name = "North field, tilling"

[recording]
gnss = ["gnss.nmea"]
lidar_minus_gnss_s = 0.0
date = "2026-06-11"

[crs]
map = "EPSG:6680"
heights = "ellipsoidal"
coordinates = "itrf2020@2026.4"

[antenna]
xyz_m = [1.85, 0.0, 1.62]

[implement]
kind = "rotary tiller"
width_m = 1.70
states = ["states.csv"]
xy_m = [-1.45, 0.0]
working_depth_m = 0.12

[field]
boundary = "boundary.geojson"
"""


def boundaries(folder: Path) -> list[Files]:
    """The same field in each format, and in a projected CRS."""
    table = geopandas.GeoDataFrame(geometry=[FIELD], crs=4326)
    files: list[Files] = []
    for suffix, driver in (("geojson", "GeoJSON"), ("gpkg", "GPKG"), ("fgb", "FlatGeobuf"), ("shp", "ESRI Shapefile")):
        place = folder / suffix
        place.mkdir()
        (table.to_crs(6680) if suffix == "gpkg" else table).to_file(place / f"field.{suffix}", driver=driver)
        parts = sorted(place.iterdir(), key=lambda path: path.suffix != f".{suffix}")
        files.append({path.name: path.read_bytes() for path in parts})
    return files


def read_field(path: Path) -> None:
    field_boundary(path, FRAME, None, np.zeros((3, 2)))


def parcels(folder: Path) -> list[Files]:
    """The field as the only parcel: a table of its corners, KML, a zipped Shapefile, a GeoPackage."""
    table = geopandas.GeoDataFrame({"id": [7], "block": ["A"]}, geometry=[FIELD], crs=4326)
    table.to_file(folder / "p.kml", driver="LIBKML")
    table.to_file(folder / "p.shp")
    table.to_file(folder / "p.gpkg")
    with zipfile.ZipFile(folder / "p.zip", "w", zipfile.ZIP_DEFLATED) as archive:
        for part in sorted(folder.glob("p.*[xfpj]")):
            archive.write(part, part.name)
    corners = "".join(f"7,A,{x},{y}\n" for x, y in FIELD.exterior.coords[:-1])
    return [
        {"p.csv": f"id,block,lon_deg,lat_deg\n{corners}".encode()},
        *({name: (folder / name).read_bytes()} for name in ("p.kml", "p.zip", "p.gpkg")),
    ]


def treatments(folder: Path) -> list[Files]:
    """Doses by date, as a table and as a spreadsheet."""
    rows = [["id", "2017-03-16", "2017-04-20", "variety"], *([k, 50, 25.5 * k, "Benchmark"] for k in range(1, 6))]
    book = openpyxl.Workbook()
    for row in rows:
        book.active.append(row)
    book.save(folder / "t.xlsx")
    text = "\n".join(";".join(str(cell) for cell in row) for row in rows)
    return [{"t.csv": text.encode()}, {"t.xlsx": (folder / "t.xlsx").read_bytes()}]


def parameters(folder: Path) -> list[Files]:
    """A file of SemiDynaEXE, one of TKY2JGD, and one of POS2JGD, of some nodes around a place each."""
    year = ["SemiDyna2026.par", *[""] * 14, "MeshCode dB(sec)  dL(sec) dH(m)"]
    nodes = [f"{code}  -0.04{k:03d}   0.09{k:03d}   0.01{k:03d}" for k, code in enumerate(_codes(5))]
    datum = ["JGD2000-TokyoDatum Ver.2.1.2", "MeshCode   dB(sec)   dL(sec)"]
    whole = [f"{code}  12.{k:05d}  -8.{k:05d}" for k, code in enumerate(_codes(1))]
    heads = ([*year, *nodes], [*datum, *whole], [*QUARTER.splitlines()[:18], *nodes])
    return [{"SemiDyna2026.par": "\r\n".join([*lines, ""]).encode("cp932")} for lines in heads]


def _codes(unit: int) -> list[str]:
    """Mesh codes of JIS X 0410 around 43.06° N 141.33° E, in steps of 30" and 45" times `unit`."""
    south, west = int(43.06 * 120 / unit) * unit, int((141.33 - 100.0) * 80 / unit) * unit
    places = [(south + unit * k, west + unit * j) for k in range(-1, 3) for j in range(-1, 3)]
    return [f"{r // 80:02d}{c // 80:02d}{r % 80 // 10}{c % 80 // 10}{r % 10}{c % 10}" for r, c in places]


def read_par(path: Path) -> None:
    here = np.array([141.33]), np.array([43.06]), np.array([80.0])
    read_parameters(path).to_map(*here)


def antennas(folder: Path) -> list[Files]:
    """Calibrations of a satellite and of two antennas."""
    return [{"igs20.atx": antex(SATELLITE, UNDER_SNOW, ZEPHYR).encode()}]


def mounts(folder: Path) -> list[Files]:
    """The attitude of a mount in UTC and in seconds of the GPS week."""
    rows = "".join(f"{k / 10:.1f},{np.sin(k):.3f},{np.cos(k):.3f},0.5\n" for k in range(30))
    utc = "".join(f"17795292{row}" for row in (f"{10 + k}.5,1.0,2.0,3.0\n" for k in range(30)))
    return [
        {"mount.csv": b"time_gps_s,roll_deg,pitch_deg,yaw_deg\n" + rows.encode()},
        {"mount.csv": b"time_unix_s;yaw_deg;roll_deg;pitch_deg\n" + utc.replace(",", ";").encode()},
    ]


def sessions(folder: Path) -> list[Files]:
    others = {
        "gnss.nmea": nmea(),
        "states.csv": STATES,
        "boundary.geojson": json.dumps(shapely.geometry.mapping(FIELD)).encode(),
    }
    return [{"session.toml": SESSION, **others}]


def read_session(path: Path) -> None:
    opened = open_session(path)
    opened.positions().track()  # type: ignore[attr-defined]


def worked(folder: Path, width_mm: int = 1700) -> list[Files]:
    """Task data of three passes, as a folder."""
    place = np.array([43.05, 141.34])
    rows, values = [], {}
    for k in range(120):
        place += np.array([1e-5 * (1 - 2 * (k // 40 % 2)), 2e-5 * (k % 40 == 39)])
        values = {0: int(k % 40 < 30), 1: width_mm}
        degrees = {"A": int(place[0] * 1e7), "B": int(place[1] * 1e7), "D": 4}
        rows.append(Record(29_000_000 + 1000 * k, 16967, degrees, values))
    body = (
        '<TSK A="TSK1" G="4" E="PFD1"><TLG A="TLG00001"/></TSK><DVC A="DVC1"><DET A="DET-1" B="1" C="1" E="0" F="0"/>'
        '</DVC><PFD A="PFD1" C="north" D="10000"><PLN A="1"><LSG A="1"><PNT A="2" C="43.049" D="141.339"/>'
        '<PNT A="2" C="43.049" D="141.342"/><PNT A="2" C="43.052" D="141.342"/></LSG></PLN></PFD>'
    )
    log = (header([(141, "DET-1"), (67, "DET-1")]), b"".join(row.pack() for row in rows))
    made = task_data(folder / "TASKDATA", body, {"TLG00001": log})
    return [{path.name: path.read_bytes() for path in sorted(made.iterdir())}]


def archives(folder: Path) -> list[Files]:
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in worked(folder)[0].items():
            archive.writestr(f"TASKDATA/{name}", data)
    return [{"tasks.zip": packed.getvalue()}]


def drive(path: Path) -> None:
    """From a receiver's log to the initial trajectory."""
    trajectory_from_gnss(NmeaLog([path], ReadOptions(date="2026-06-11")).track(), FRAME, (1.85, 0.0, 1.62), None)


def agopengps(folder: Path) -> list[Files]:
    place = agopengps_folder(folder / "North", "$Boundary\n" + RING + RING.replace("0.000", ".000"))
    return [{path.name: path.read_bytes() for path in sorted(place.iterdir())}]


TEXTS = (
    Entry("boundary", boundaries, read_field, trials=60),
    Entry("agopengps", agopengps, lambda path: read_field(path.parent), trials=60),
    Entry("parcels", parcels, lambda path: read_parcels(path, FRAME.crs, (5.0, 1.0))[0], trials=60),
    Entry("treatments", treatments, lambda path: read_treatments(path, dt.date(2017, 5, 23)), trials=60),
    Entry("parameters", parameters, read_par),
    Entry("antennas", antennas, lambda path: antenna_model(path, "TRM57971.00"), trials=60),
    Entry("mount", mounts, lambda path: read_mount(path, 1.78e9), trials=60),
    Entry("session", sessions, read_session, trials=60),
    Entry("task-data-zip", archives, EACH_WAY),
    Entry("fields", worked, lambda path: fields(path.parent), trials=50),
    Entry("fields-sections", section_seeds, lambda path: fields(path.parent), trials=50),
    Entry("drive", lambda folder: [{"gnss.nmea": nmea(40)}], drive, mend_nmea, trials=60),
)
