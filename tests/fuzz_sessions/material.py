"""Small valid files of every kind that a session may name: simulated, or by the generators of the readers' tests."""

from __future__ import annotations

import io
import json
import re
import shutil
import struct
import tomllib
import zipfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import geopandas
import laspy
import numpy as np
import openpyxl
import pyproj
import pyubx2
import rasterio
import shapely
from PIL import Image

import furrowmap
from furrowmap.core.implement.near_scans import IMAGE_COLUMNS
from furrowmap.core.implement.saved import save_implement
from furrowmap.core.readers.nmea.log import NmeaLog
from furrowmap.core.readers.reader import ReadOptions
from furrowmap.core.values.gnss import GnssTrack
from tests.core.implement.test_tool_history import TILLER
from tests.core.readers import hesai_packets
from tests.core.readers.image_bags import filmed
from tests.core.readers.inertial_bags import turning_imu
from tests.core.readers.isoxml.time_logs import Record, header, task_data
from tests.core.readers.las.e57_files import POSE, e57, some_rows
from tests.core.readers.las.test_tables import ROWS, pcd, ply
from tests.core.readers.small_bags import ROS1, mixed, write_bag1, write_bag2
from tests.core.readers.test_antex import SATELLITE, ZEPHYR, antex
from tests.core.readers.test_boundary import RING, agopengps_folder
from tests.core.readers.test_gsof import epoch, transmission
from tests.core.readers.test_novatel import BINARY, TEXT
from tests.core.readers.test_ouster import recorded
from tests.core.readers.test_sbet import records
from tests.core.readers.test_sbf import pvt
from tests.core.readers.vectornav_logs import common, grouped
from tests.core.readers.velodyne_packets import frames, position_packet, rmc, turning, write_pcap

DRIVE: Final = """
title = "One short pass"
seed = 5
t0 = "2026-06-11T14:59:58.000+00:00"
[field]
size_e_m = 14.0
size_n_m = 10.0
[drive]
passes = 1
pass_m = [0.8]
start_xy_m = [6.0, 5.0]
speed_work_mps = 1.3
accel_mps2 = 3.0
stand_start_s = 0.2
stand_end_s = 0.1
lead_in_m = 0.2
radius_m = 1.0
"""
FLIGHT: Final = """
title = "Two short strips"
seed = 7
t0 = "2026-05-23T09:41:12.000+00:00"
[place]
lon_lat_deg = [11.3885, 55.328]
height_m = 70.0
geoid_m = 36.621
crs = "EPSG:25832"
[field]
size_e_m = 30.0
size_n_m = 26.0
[flight]
strips = 2
strip_m = 5.0
spacing_m = 4.0
cross_strips = 0
height_m = 8.0
speed_mps = 4.0
hover_start_s = 8.0
hover_end_s = 2.0
[line]
rate_hz = 5.0
beams = 61
[imu]
rate_hz = 100
[mount]
rate_hz = 20
"""
MOST_CAPTURE_BYTES: Final = 600_000
"""Of a capture in a session: half a second of packets."""

Files = Mapping[str, bytes]


@dataclass(frozen=True)
class Material:
    """A file, or a folder of files, that a key of a session may name.

    Attributes:
        name: what a session calls it: the path of its file or folder.
        files: content by path, relative to the session's folder.
        keys: the keys that take such a file, as in `recording.lidar`.
    """

    name: str
    files: Files
    keys: frozenset[str]


@dataclass(frozen=True)
class Stock:
    """What sessions are made of.

    Attributes:
        material: all files and folders.
        bases: valid sessions as tables, by name, whose files are among the material.
        results: products of valid sessions by name, relative to a folder of results.
    """

    material: tuple[Material, ...]
    bases: Mapping[str, Mapping[str, Any]]
    results: Mapping[str, Files]

    def of(self, key: str) -> list[Material]:
        """What a key takes; everything for a key that is new."""
        return [one for one in self.material if key in one.keys] or list(self.material)

    def named(self, name: str) -> Material | None:
        """The material that a session calls so."""
        return next((one for one in self.material if one.name == name), None)


def make_stock(folder: Path) -> Stock:
    """Make all of it, in an empty folder that may be used."""
    made: list[Material] = []
    bases: dict[str, dict[str, Any]] = {}
    for name, scenario in (("drive", DRIVE), ("flight", FLIGHT)):
        (folder / f"{name}.toml").write_text(scenario)
        simulated = furrowmap.simulate(folder / f"{name}.toml", folder / name)
        if name == "drive":
            _cut_capture(simulated.folder / "recording.pcap")
        bases[name] = tomllib.loads(simulated.session.read_text())
        made += _renamed(simulated.folder, name, bases[name])
    track = NmeaLog([folder / "drive" / "gnss.nmea"], ReadOptions()).track()
    makers = (_positions(track), _captures(folder), _bags(folder), _inertial(), _vectors(folder, track))
    for each in (*makers, _tables(folder, track), _clouds(folder, track), _images(), _tasks(folder)):
        made += [Material(name, files, frozenset(keys)) for name, files, keys in each]
    bases |= _further_bases(bases)
    return Stock(tuple(made), bases, dict(_results(folder, made, bases)))


def _cut_capture(path: Path) -> None:
    """Leave the first packets of a capture."""
    data = path.read_bytes()
    at = 24
    while at < min(len(data), MOST_CAPTURE_BYTES):
        at += 16 + int.from_bytes(data[at + 8 : at + 12], "little")
    path.write_bytes(data[:at])


def _renamed(folder: Path, name: str, session: dict[str, Any]) -> Iterator[Material]:
    """The files of a simulated session under names of their own, which the session is changed to."""
    keys = {
        "recording.pcap": ("recording.lidar", "lidar.files"),
        "scans.csv": ("recording.lidar", "lidar.files"),
        "gnss.nmea": ("recording.gnss",),
        "imu.csv": ("imu.files",),
        "mount.csv": ("mount.attitude",),
        "boundary.geojson": ("field.boundary", "field.within", "parcels.file"),
        "truth/trajectory.csv": ("trajectory.files",),
    }
    text = json.dumps(session)
    for file, takes in keys.items():
        if (folder / file).is_file():
            new = f"{name}_{Path(file).name}"
            text = text.replace(f'"{file}"', f'"{new}"')
            yield Material(new, {new: (folder / file).read_bytes()}, frozenset(takes))
    session.clear()
    session.update(json.loads(text))


def _further_bases(bases: Mapping[str, Mapping[str, Any]]) -> Mapping[str, dict[str, Any]]:
    """Valid sessions beside those of the simulator, with the same files."""
    drive = dict(bases["drive"])
    flight = dict(bases["flight"])
    implement = drive["implement"]
    tool = {key: implement[key] for key in ("width_m", "xy_m")}
    return {
        "states": drive
        | {"recording": {"gnss": ["drive_gnss.nmea"]}, "implement": tool | {"states": ["states.csv"]}},
        "posed": {key: drive[key] for key in ("furrowmap", "name", "crs", "lidar", "implement")}
        | {"recording": {"lidar": drive["recording"]["lidar"]}, "trajectory": {"files": ["drive_trajectory.csv"]}},
        "two tools": drive
        | {"implement": [tool | {"name": "rear"}, {"width_m": 1.5, "xy_m": [2.5, 0.0], "name": "front"}]},
        "trial": flight
        | {"parcels": {"file": "parcels.csv", "treatments": "treatments.csv"}, "features": {"ground": "smrf"}},
        "filmed": flight
        | {"camera": {"table": "images.csv", "files": ["images/*.jpg"], "width": 24, "height": 16, "fx": 20.0,
                      "fy": 20.0, "cx": 12.0, "cy": 8.0, "xyz_m": [0.0, 0.0, 0.0], "rpy_deg": [180.0, 0.0, 0.0]}},
        "ahrs": {key: flight[key] for key in ("furrowmap", "recording", "crs", "lidar", "antenna")}
        | {"attitude": {"roll_pitch": "ahrs.csv", "heading": "ahrs.csv", "north": "true"}},
    }  # fmt: skip


def _results(folder: Path, made: list[Material], bases: Mapping[str, Mapping[str, Any]]) -> Iterator[tuple[str, Files]]:
    """The products of previews, and of the run of a drive: what may lie in a folder of results before."""
    place = folder / "valid"
    for one in made:
        for name, data in one.files.items():
            (place / name).parent.mkdir(parents=True, exist_ok=True)
            (place / name).write_bytes(data)
    for name, base in bases.items():
        (place / "session.toml").write_text(toml_of(base))
        for kind, work in (("preview", furrowmap.preview), ("run", furrowmap.run)):
            if kind == "preview" or name == "states":
                out = folder / f"{name} {kind}"
                work(place / "session.toml", out)
                yield f"{name} {kind}", {path.name: path.read_bytes() for path in out.iterdir() if path.is_file()}
    shutil.rmtree(place)


def toml_of(data: Mapping[str, Any]) -> str:
    """A session's text. Values that TOML does not have are written as Python prints them."""
    plain = [f"{_key(key)} = {_value(value)}" for key, value in data.items() if not _is_table(value)]
    tables = []
    for key, value in data.items():
        if _is_table(value):
            several = isinstance(value, list)
            head = f"[[{_key(key)}]]" if several else f"[{_key(key)}]"
            for one in value if several else [value]:
                tables += ["", head, *(f"{_key(name)} = {_value(each)}" for name, each in one.items())]
    return "\n".join([*plain, *tables, ""])


def _is_table(value: object) -> bool:
    if isinstance(value, list):
        return bool(value) and all(isinstance(one, dict) for one in value)
    return isinstance(value, dict)


def _key(key: str) -> str:
    return key if re.fullmatch(r"[A-Za-z0-9_-]+", key) else _value(key)


def _value(value: object) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return json.dumps(value).replace("\x7f", "\\u007f") if value.isascii() else _quoted(value)
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_value, value))}]"
    if isinstance(value, dict):
        return "{" + ", ".join(f"{_key(key)} = {_value(each)}" for key, each in value.items()) + "}"
    return str(value)


def _quoted(value: str) -> str:
    return '"' + "".join(c if c.isprintable() and c not in '"\\' else f"\\U{ord(c):08x}" for c in value) + '"'


Made = Iterator[tuple[str, Files, tuple[str, ...]]]


def _positions(track: GnssTrack) -> Made:
    """The drive by other receivers, and short logs of others."""
    rows = []
    packets = []
    for k, t_s in enumerate(track.t_s):
        at = np.datetime64(round(1000 * float(t_s)), "ms").item()
        rows.append(
            f"{at:%Y/%m/%d %H:%M:%S}.{at.microsecond // 1000:03} {track.lat_deg[k]:.9f} {track.lon_deg[k]:.9f}"
            f" {track.height_m[k]:.4f} 1 20 0.01 0.01 0.02"
        )
        payload = bytearray(92)
        date = (at.year, at.month, at.day, at.hour, at.minute, at.second)
        week_ms = round(1000 * (float(t_s) - 315_964_800.0 + 18.0)) % 604_800_000
        struct.pack_into("<IHBBBBBBIi", payload, 0, week_ms, *date, 7, 20, 1000 * at.microsecond)
        degrees = (round(1e7 * track.lon_deg[k]), round(1e7 * track.lat_deg[k]))
        heights = (round(1e3 * track.height_m[k]), round(1e3 * track.height_m[k]))
        struct.pack_into("<BBBBiiiiII", payload, 20, 3, 0x83, 0, 20, *degrees, *heights, 14, 20)
        packets.append(pyubx2.UBXMessage(b"\x01", b"\x07", pyubx2.GET, payload=bytes(payload)).serialize())
    head = "%  UTC                   latitude(deg) longitude(deg)  height(m)   Q  ns   sdn(m)   sde(m)   sdu(m)\n"
    logs = {
        "gnss.pos": (head + "\n".join(rows) + "\n").encode(),
        "gnss.ubx": b"".join(packets),
        "gnss.sbf": b"".join(pvt(1000 * k) for k in range(12)),
        "gnss.gsof": b"".join(b"".join(transmission(epoch(k), k)) for k in range(8)),
        "gnss.novatel": BINARY + TEXT,
    }
    for name, data in logs.items():
        yield name, {name: data}, ("recording.gnss",)
    yield "mission.sbet", {"mission.sbet": records(40).astype("<f8").tobytes()}, ("trajectory.files",)


def _captures(folder: Path) -> Made:
    """Captures of other scanners, of other times."""
    keys = ("recording.lidar", "lidar.files")
    kinds = {
        "vlp16.pcap": [position_packet(1000.0, rmc()), *turning(30)],
        "xt32.pcap": [*hesai_packets.turning("PandarXT-32", 24), hesai_packets.gps_packet(1000.0, rmc())],
    }
    for name, packets in kinds.items():
        yield name, {name: write_pcap(folder / name, frames(packets)).read_bytes()}, keys
    ouster = recorded(folder, 0.1, return_mode="strongest")
    said = ouster.with_suffix(".json")
    yield "ouster.pcap", {"ouster.pcap": ouster.read_bytes(), "ouster.json": said.read_bytes()}, keys
    sweeps = [f"{194530.8 + k / 1000:.4f},{k % 20 - 10},{4 + k % 3},{k}" for k in range(60)]
    yield "line.csv", {"line.csv": "\n".join(["time_gps_s,angle_deg,range_m,intensity", *sweeps, ""]).encode()}, keys


def _bags(folder: Path) -> Made:
    """Bags with scans and positions, with an IMU, and with images."""
    keys = ("recording.lidar", "recording.gnss", "lidar.files")
    yield "mixed.bag", {"mixed.bag": write_bag1(folder / "m.bag", mixed(ROS1, clouds=2, points=32)).read_bytes()}, keys
    bag = write_bag2(folder / "ros2", mixed(clouds=2, points=32))
    yield "ros2", {f"ros2/{path.name}": path.read_bytes() for path in bag.iterdir()}, keys
    imu = write_bag1(folder / "imu.bag", turning_imu(12, ROS1)).read_bytes()
    yield "imu.bag", {"imu.bag": imu}, ("imu.files", "attitude.roll_pitch", "attitude.heading")
    (film,) = write_bag2(folder / "film", filmed("jpeg")).glob("*.mcap")
    yield "film.mcap", {"film.mcap": film.read_bytes()}, ("camera.files",)


def _inertial() -> Made:
    """Attitudes of the flight's time, and binary messages of an IMU."""
    rows = [f"{1779529272.0 + k / 20:.3f},{0.1 * k % 3:.2f},-0.5,{3 * k % 360}" for k in range(160)]
    text = "\n".join(["time_unix_s,roll_deg,pitch_deg,heading_true_deg", *rows, ""])
    yield "ahrs.csv", {"ahrs.csv": text.encode()}, ("attitude.roll_pitch", "attitude.heading")
    yield "vn.bin", {"vn.bin": b"".join(common(k) + grouped(k) for k in range(12))}, ("imu.files",)


def _vectors(folder: Path, track: GnssTrack) -> Made:
    """Polygons around the drive, in each format."""
    keys = ("field.boundary", "field.within", "parcels.file")
    x = float(track.lon_deg.mean())
    y = float(track.lat_deg.mean())
    square = shapely.box(x - 5e-5, y - 5e-5, x + 5e-5, y + 5e-5)
    table = geopandas.GeoDataFrame({"id": [7], "block": ["A"]}, geometry=[square], crs=4326)
    kinds = {"gpkg": "GPKG", "fgb": "FlatGeobuf", "kml": "LIBKML", "shp": "ESRI Shapefile"}
    for suffix, driver in kinds.items():
        place = folder / f"vector {suffix}"
        place.mkdir()
        table.to_file(place / f"field.{suffix}", driver=driver)
        yield f"field.{suffix}", {path.name: path.read_bytes() for path in sorted(place.iterdir())}, keys
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w") as archive:
        for path in (folder / "vector shp").iterdir():
            archive.write(path, path.name)
    yield "field.zip", {"field.zip": packed.getvalue()}, keys
    place = agopengps_folder(folder / "North", "$Boundary\n" + RING)
    yield "North", {f"North/{path.name}": path.read_bytes() for path in place.iterdir()}, keys


def _tables(folder: Path, track: GnssTrack) -> Made:
    """Tables of people: parcels, treatments, states of the tool, surveyed points, parameters of a datum."""
    flight = [(11.38849, 55.32799), (11.38855, 55.32799), (11.38855, 55.32803), (11.38849, 55.32803)]
    corners = "".join(f"7,A,{x},{y}\n" for x, y in flight)
    yield (
        "parcels.csv",
        {"parcels.csv": f"id,block,lon_deg,lat_deg\n{corners}".encode()},
        ("parcels.file", "field.within"),
    )
    doses = "id;2017-03-16;2017-04-20;variety\n7;50;25.5;Benchmark\n"
    yield "treatments.csv", {"treatments.csv": doses.encode()}, ("parcels.treatments",)
    book = openpyxl.Workbook()
    out = io.BytesIO()
    for row in (["id", "2017-03-16", "variety"], [7, 50, "Benchmark"]):
        book.active.append(row)
    book.save(out)
    yield "treatments.xlsx", {"treatments.xlsx": out.getvalue()}, ("parcels.treatments",)
    states = "time,state\n2026-06-11T14:59:58Z,up\n2026-06-11T14:59:58.9Z,down\n2026-06-11T14:59:59.6Z,up\n"
    yield "states.csv", {"states.csv": states.encode()}, ("implement.states",)
    places = zip(track.lon_deg[::8], track.lat_deg[::8], track.height_m[::8], strict=True)
    surveyed = "".join(f"P{k},{x},{y},{z - 1.6}\n" for k, (x, y, z) in enumerate(places))
    keys = ("field.check_points", "field.control_points", "camera.control_points")
    yield "points.csv", {"points.csv": f"name,lon_deg,lat_deg,h_m\n{surveyed}".encode()}, keys
    pixels = "image,name,x,y\n0001.jpg,P0,3.5,4.5\n"
    yield "pixels.csv", {"pixels.csv": pixels.encode()}, ("camera.control_pixels",)
    codes = "".join(f"{code} -0.04{k:03d} 0.09{k:03d} 0.01{k:03d}\r\n" for k, code in enumerate((53394547, 53394548)))
    shifts = "SemiDyna2026.par\r\n" + 14 * "\r\n" + "MeshCode dB(sec) dL(sec) dH(m)\r\n" + codes
    place = folder / "implement.npz"
    columns = np.ones(IMAGE_COLUMNS, bool)
    region = TILLER.region._replace(columns=columns, still_m=np.ones((2, IMAGE_COLUMNS), np.float32))
    save_implement(place, replace(TILLER, region=region))
    yield "implement.npz", {"implement.npz": place.read_bytes()}, ("implement.learned",)
    yield "igs20.atx", {"igs20.atx": antex(SATELLITE, ZEPHYR).encode()}, ("antenna.antex",)
    yield "SemiDyna2026.par", {"SemiDyna2026.par": shifts.encode()}, ("crs.parameters",)


def _clouds(folder: Path, track: GnssTrack) -> Made:
    """Clouds, a surface, which no recording is."""
    chance = np.random.default_rng(1)
    head = laspy.LasHeader(version="1.4", point_format=6)
    head.scales = np.full(3, 0.001)
    head.offsets = np.array([16_600.0, 96_500.0, 200.0])
    head.add_crs(pyproj.CRS("EPSG:6677"))
    cloud = laspy.LasData(head)
    cloud.x = 16_600.0 + chance.uniform(0, 9, 300)
    cloud.y = 96_500.0 + chance.uniform(0, 9, 300)
    cloud.z = 270.0 + 0.02 * chance.standard_normal(300)
    cloud.classification = np.full(300, 2, np.uint8)
    for name in ("cloud.las", "cloud.laz"):
        out = io.BytesIO()
        cloud.write(out, do_compress=name.endswith("z"))
        yield name, {name: out.getvalue()}, ("parcels.soil",)
    for name, data in {"cloud.ply": ply(ROWS), "cloud.pcd": pcd(ROWS)}.items():
        yield name, {name: data}, ("parcels.soil",)
    yield "cloud.e57", {"cloud.e57": e57(some_rows(150), pose=POSE)}, ("parcels.soil",)
    profile = {"driver": "GTiff", "width": 40, "height": 30, "count": 1, "dtype": "float32", "crs": "EPSG:6677"}
    place = rasterio.Affine(0.5, 0, 16_600, 0, -0.5, 96_520)
    with rasterio.open(folder / "soil.tif", "w", **profile, transform=place, nodata=-9999.0) as raster:
        raster.write(270.0 + np.zeros((1, 30, 40), np.float32))
    yield "soil.tif", {"soil.tif": (folder / "soil.tif").read_bytes()}, ("parcels.soil", "crs.geoid_grid")


def _images() -> Made:
    """Images with times in a table and in themselves."""
    photos = {}
    exif = Image.Exif()
    exif.get_ifd(0x8769).update({0x9003: "2026:05:23 11:41:12", 0x9291: "25", 0x9011: "+02:00"})
    for k in range(3):
        out = io.BytesIO()
        Image.linear_gradient("L").resize((24, 16)).convert("RGB").save(out, "JPEG", exif=exif)
        photos[f"images/{k:04}.jpg"] = out.getvalue()
    rows = "".join(f"{name.removeprefix('images/')},{1779529273.0 + k}\n" for k, name in enumerate(photos))
    yield "images.csv", photos | {"images.csv": f"file,time_unix_s\n{rows}".encode()}, ("camera.table",)
    yield "images/*.jpg", photos, ("camera.files",)


def _tasks(folder: Path) -> Made:
    """Task data of a drive, as a folder and as an archive."""
    rows = [
        Record(53_998_000 + 100 * k, 16967, {"A": 368_600_000 + 90 * k, "B": 1_400_190_000, "D": 4}, {0: int(k > 5)})
        for k in range(25)
    ]
    body = (
        '<TSK A="TSK1" G="4"><TLG A="TLG00001"/></TSK><DVC A="DVC1"><DET A="DET-1" B="1" C="1" E="0" F="0"/></DVC>'
        '<PFD A="PFD1" C="north" D="10000"><PLN A="1"><LSG A="1"><PNT A="2" C="36.85" D="140.01"/>'
        '<PNT A="2" C="36.85" D="140.02"/><PNT A="2" C="36.86" D="140.02"/></LSG></PLN></PFD>'
    )
    log = (header([(141, "DET-1")]), b"".join(row.pack() for row in rows))
    made = task_data(folder / "TASKDATA", body, {"TLG00001": log})
    files = {path.name: path.read_bytes() for path in sorted(made.iterdir())}
    keys = ("recording.gnss", "implement.states", "field.boundary", "field.within")
    yield "TASKDATA", {f"TASKDATA/{name}": data for name, data in files.items()}, keys
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w") as archive:
        for name, data in files.items():
            archive.writestr(f"TASKDATA/{name}", data)
    yield "tasks.zip", {"tasks.zip": packed.getvalue()}, keys
