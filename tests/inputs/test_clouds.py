"""Every kind of point cloud in every place that takes clouds: heights in metres, in the CRS of the map, or refused."""

from __future__ import annotations

import gzip
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import laspy
import numpy as np
import pytest
import trimesh
from laspy.vlrs.vlrlist import VLRList
from pyproj import CRS

from furrowmap.core.accuracy.product_check import check_product
from furrowmap.core.pointclouds.joined_clouds import open_clouds
from furrowmap.core.readers.chosen_survey import SurveyOptions
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import FurrowmapError
from furrowmap.exporters.cloud.copc_file import CopcFormat, las_wkt
from furrowmap.exporters.cloud.point_batches import PointBatch
from furrowmap.exporters.cloud.writer import CopcWriter
from furrowmap.settings import soil_file
from tests.core.readers.las.e57_files import POSE, e57

MAP = CRS.from_epsg(26918)
EAST, NORTH = 580_000.0, 4_500_000.0
X, Y = (part.ravel() for part in np.meshgrid(EAST + 0.125 * np.arange(64), NORTH + 0.125 * np.arange(64)))
Z = 100.0 + 0.05 * (X - EAST)
PLACES_M = np.array([[EAST + 2.0, NORTH + 3.0], [EAST + 5.0, NORTH + 6.0]])
FOOT, US_FOOT = 0.3048, 1200 / 3937


def las(path: Path, crs: str | None = "EPSG:26918", unit_m: float = 1.0, **form: Any) -> Path:
    header = laspy.LasHeader(version=form.get("version", "1.4"), point_format=form.get("point_format", 6))
    header.scales, header.offsets = np.full(3, 0.0001), np.array([EAST, NORTH, 0.0])
    if crs is not None:
        header.add_crs(CRS.from_user_input(crs), keep_compatibility=False)
    if "wkt" in form:
        header.vlrs.append(laspy.VLR("LASF_Projection", 2112, "", form["wkt"].encode() + b"\0"))
        header.global_encoding.wkt = True
    found = laspy.LasData(header)
    found.x, found.y, found.z = X, Y, Z / unit_m
    found.return_number[:] = found.number_of_returns[:] = 1
    found.write(path)
    return path


FEET_BY_ESRI = (
    'VERTCS["NAVD_1988_Foot_US",VDATUM["North_American_Vertical_Datum_1988"],PARAMETER["Vertical_Shift",0.0],'
    'PARAMETER["Direction",1.0],UNIT["Foot_US",0.3048006096012192]]'
)


def keys(path: Path, unit_m: float = US_FOOT, **kinds: int) -> Path:
    """LAS 1.2 with GeoTIFF keys: the map, and the vertical CRS and unit."""
    rows = {"projected": 3072, "vertical": 4096, "unit": 4099}
    entries = [(1024, 0, 1, 1), *((rows[name], 0, 1, value) for name, value in kinds.items())]
    data = np.array([1, 1, 0, len(entries), *(value for entry in entries for value in entry)], "<u2").tobytes()
    header = laspy.LasHeader(version="1.2", point_format=1)
    header.scales, header.offsets = np.full(3, 0.0001), np.array([EAST, NORTH, 0.0])
    header.vlrs.append(laspy.VLR("LASF_Projection", 34735, "", data))
    found = laspy.LasData(header)
    found.x, found.y, found.z = X, Y, Z / unit_m
    found.write(path)
    return path


def ply(path: Path) -> Path:
    data = np.column_stack([X, Y, Z])
    head = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(X)}\n"
    head += "".join(f"property double {axis}\n" for axis in "xyz") + "end_header\n"
    path.write_bytes(head.encode() + data.astype("<f8").tobytes())
    return path


def pcd(path: Path) -> Path:
    head = f"VERSION .7\nFIELDS x y z\nSIZE 8 8 8\nTYPE F F F\nCOUNT 1 1 1\nWIDTH {len(X)}\nHEIGHT 1\n"
    head += f"VIEWPOINT 0 0 0 1 0 0 0\nPOINTS {len(X)}\nDATA binary\n"
    path.write_bytes(head.encode() + np.column_stack([X, Y, Z]).astype("<f8").tobytes())
    return path


def copc(path: Path) -> Path:
    kind = CopcFormat(las_wkt(MAP), (EAST, NORTH, 0.0), scale_m=0.0001)
    with CopcWriter(path, kind, node_points=300) as writer:
        writer.append(PointBatch(np.column_stack([X - EAST, Y - NORTH, Z]), np.zeros(len(X))))
    return path


def e57_scan(path: Path) -> Path:
    """One scan with its pose: the corner of the plane."""
    pose = POSE.replace(">0.6<", ">1<").replace(">0.8<", ">0<")
    pose = pose.replace(">10<", f">{EAST}<").replace(
        '<y type="Float"/><z type="Float">-3<', f'<y type="Float">{NORTH}</y><z type="Float">0<'
    )
    zeros = np.zeros(len(X), np.int64)
    rows = {"x": X - EAST, "y": Y - NORTH, "z": Z, "invalid": zeros, "intensity": zeros}
    path.write_bytes(e57(rows, pose=pose))
    return path


def behind(folder: Path) -> Path:
    """The CRS in an extended record, behind the points."""
    cloud = laspy.read(las(folder / "none.las", None))
    cloud.header.global_encoding.wkt = True
    record = laspy.VLR("LASF_Projection", 2112, "", MAP.to_wkt("WKT1_GDAL").encode() + b"\0")
    cloud.evlrs = VLRList([record])
    cloud.write(folder / "a.las")
    return folder / "a.las"


def linked(folder: Path) -> Path:
    las(folder / "target.laz")
    (folder / "link.laz").symlink_to("target.laz")
    return folder / "link.laz"


Made = Callable[[Path], Path]
PROPERTIES: Mapping[str, Made] = {
    "LAS 1.2 with GeoTIFF keys": lambda folder: las(folder / "a.las", version="1.2", point_format=1),
    "LAS 1.4 with WKT": lambda folder: las(folder / "a.las"),
    "LAZ": lambda folder: las(folder / "a.laz"),
    "LAZ under another name": lambda folder: las(folder / "a.laz").rename(folder / "a.dat"),
    "COPC": lambda folder: copc(folder / "a.copc.laz"),
    "E57": lambda folder: e57_scan(folder / "a.e57"),
    "PLY": lambda folder: ply(folder / "a.ply"),
    "PCD": lambda folder: pcd(folder / "a.pcd"),
    "compound CRS with heights in metres": lambda folder: las(folder / "a.laz", "EPSG:26918+5703"),
    "compound CRS with heights in US survey feet": lambda folder: las(folder / "a.laz", "EPSG:26918+6360", US_FOOT),
    "compound CRS with heights in feet": lambda folder: las(folder / "a.laz", "EPSG:26918+8228", FOOT),
    "vertical unit in key 4099 beside an EPSG code": lambda folder: keys(
        folder / "a.las", projected=26918, vertical=5703, unit=9003
    ),
    "vertical unit in key 4099 alone": lambda folder: keys(folder / "a.las", projected=26918, unit=9003),
    "WKT in an extended record": lambda folder: behind(folder),
    "WKT by Esri, that of the heights behind that of the map": lambda folder: las(
        folder / "a.las", None, US_FOOT, wkt=f"{MAP.to_wkt('WKT1_ESRI')},{FEET_BY_ESRI}"
    ),
    "heights in millimetres by key 4099": lambda folder: keys(folder / "a.las", 0.001, projected=26918, unit=1025),
    "heights of -9999 and 99999 for none": lambda folder: with_none(folder),
    "symbolic link": linked,
}
REFUSED: Mapping[str, Made] = {
    "gzip": lambda folder: compressed(folder),
    "no CRS": lambda folder: las(folder / "a.laz", None),
    "degrees": lambda folder: las(folder / "a.laz", "EPSG:4269"),
    "depths, which count downwards": lambda folder: las(folder / "a.laz", "EPSG:26918+5715", -1.0),
    "a mesh in another format": lambda folder: mesh(folder),
}
WITH_VERTICAL = ("compound", "4099 beside")


def with_none(folder: Path) -> Path:
    """A quarter of the points around one of the places has no height."""
    cloud = laspy.read(las(folder / "a.las"))
    z = np.array(cloud.z)
    around = np.flatnonzero(np.hypot(X - PLACES_M[0, 0], Y - PLACES_M[0, 1]) < 0.3)
    z[around[::4]] = -9999.0
    z[around[1]] = 99999.0
    cloud.z = z
    cloud.write(folder / "b.laz")
    return folder / "b.laz"


def compressed(folder: Path) -> Path:
    path = folder / "a.las.gz"
    path.write_bytes(gzip.compress(las(folder / "a.las").read_bytes()))
    return path


def mesh(folder: Path) -> Path:
    trimesh.creation.box().export(folder / "a.stl")
    return folder / "a.stl"


def stated_crs(path: Path) -> CRS | None:
    """Of PLY, PCD and E57, which state none."""
    return MAP if path.suffix in (".ply", ".pcd", ".e57") else None


def by_clouds(path: Path) -> FloatArray:
    clouds = open_clouds([path], stated_crs(path))
    xyz = np.concatenate([batch.xyz_m for batch in clouds.batches()])
    near = [np.hypot(*(xyz[:, :2] - place).T) < 0.3 for place in PLACES_M]
    assert clouds.crs.is_compound == (clouds.files[0].crs is not None and clouds.files[0].crs.is_compound)
    return np.array([np.median(xyz[one, 2]) for one in near])


def by_check(path: Path) -> FloatArray:
    points = path.with_name("points.csv")
    rows = [f"P{k},{x},{y},{100.0 + 0.05 * (x - EAST)}\n" for k, (x, y) in enumerate(PLACES_M.tolist())]
    points.write_text("name,e_m,n_m,h_m\n" + "".join(rows))
    found = check_product(path, points, SurveyOptions(stated_crs(path)))
    return np.array([point.found_m[2] for point in found.points])


def by_soil(path: Path) -> FloatArray:
    found = soil_file(path)
    assert found is not None
    return by_clouds(found)


PLACES: Mapping[str, Callable[[Path], FloatArray]] = {"CLOUD": by_clouds, "check": by_check, "parcels --soil": by_soil}


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("stated", PROPERTIES)
def test_heights__are_metres_whatever_the_file(stated: str, place: str, tmp_path: Path) -> None:
    found = PLACES[place](PROPERTIES[stated](tmp_path))
    np.testing.assert_allclose(found, 100.0 + 0.05 * (PLACES_M[:, 0] - EAST), atol=0.01)


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("stated", REFUSED)
def test_what_cannot_be_honoured__is_refused_in_three_lines(stated: str, place: str, tmp_path: Path) -> None:
    with pytest.raises(FurrowmapError) as refused:
        PLACES[place](REFUSED[stated](tmp_path))
    assert len(str(refused.value).splitlines()) == 3


@pytest.mark.parametrize("stated", [name for name in PROPERTIES if any(word in name for word in WITH_VERTICAL)])
def test_vertical_crs__is_kept_in_metres(stated: str, tmp_path: Path) -> None:
    clouds = open_clouds([PROPERTIES[stated](tmp_path)])
    assert clouds.crs.is_compound
    assert clouds.crs.sub_crs_list[1].name == "NAVD88 height"
    assert clouds.crs.sub_crs_list[1].axis_info[0].unit_conversion_factor == 1.0
