"""Commands as they are typed: polygons, points and logs with each property are what the plain file is."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import geopandas as gpd
import laspy
import numpy as np
import pytest
import rasterio
from rasterio.transform import from_origin

from furrowmap.cli.main import command_line
from furrowmap.core.readers.boundary_file import read_fields
from furrowmap.core.session.opened import open_session
from tests.inputs.test_logs import ALL as LOGS
from tests.inputs.test_logs import EPOCHS, FORMATS, log
from tests.inputs.test_matrix import KINDS
from tests.inputs.test_points import PROPERTIES as POINTS
from tests.inputs.test_points import surface
from tests.inputs.test_polygons import EAST, MAP, NORTH, PROPERTIES, RING, agopengps

POLYGONS = next(kind for kind in KINDS if kind["title"] == "Polygons")
TAKEN = [name for names in POLYGONS["places"].values() for name in names if " " in name]
SLOW = {"run --within", "batch --boundaries", "parcels PARCELS", "parcels --net", "growth PARCELS", "growth --net"}
"""They need a drive, or take long; test_polygons.py tries the functions that they call."""
REST: dict[str, list[str]] = {
    "surface": ["--cell", "1"], "features": ["--voxel", "0.5"], "canopy": [], "cloud": [], "check": [],
}  # fmt: skip


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A cloud and a surface of a plane around a field, points on it, and the field as a folder and as a GeoPackage."""
    folder = tmp_path_factory.mktemp("site")
    east, north = EAST + np.arange(-9.9, 110.0, 0.2), NORTH + np.arange(-9.9, 60.0, 0.2)  # none on an edge
    x, y = (part.ravel() for part in np.meshgrid(east, north))
    header = laspy.LasHeader(version="1.4", point_format=6)
    header.scales, header.offsets = np.full(3, 0.001), np.array([EAST, NORTH, 0.0])
    header.add_crs(MAP)
    cloud = laspy.LasData(header)
    cloud.x, cloud.y, cloud.z = x, y, 100.0 + 0.01 * (x - EAST)
    cloud.return_number[:] = cloud.number_of_returns[:] = 1
    cloud.write(folder / "first.laz")
    profile = {"driver": "GTiff", "width": 240, "height": 140, "count": 1, "dtype": "float32", "crs": "EPSG:25832"}
    heights = np.tile(100.0 + 0.01 * (0.5 * np.arange(240) - 9.75), (140, 1)).astype("float32")
    with rasterio.open(
        folder / "dsm.tif", "w", transform=from_origin(EAST - 10.0, NORTH + 60.0, 0.5, 0.5), **profile
    ) as raster:
        raster.write(heights, 1)
    rows = [f"P{k},{EAST + 5.0 + 3.0 * k},{NORTH + 5.0},{100.05 + 0.03 * k}\n" for k in range(3)]
    (folder / "points.csv").write_text("name,e_m,n_m,h_m\n" + "".join(rows))
    agopengps(folder)
    gpd.GeoDataFrame({"name": ["A1"]}, geometry=[RING], crs=MAP).to_file(folder / "A1.gpkg", engine="pyogrio")
    return folder


def words(site: Path, place: str, polygons: Path, out: Path) -> list[str]:
    """The command with polygons in one of its places."""
    command, option = place.split(" ")
    clouds = [site / ("dsm.tif" if command == "check" else "first.laz")]
    typed: list[str | Path] = [command, *clouds]
    if command == "check":
        typed.append(site / "points.csv")
    typed += [option, polygons]
    if command != "check":
        typed += ["-o", out / ("out.copc.laz" if command == "cloud" else "out")]
    return [str(word) for word in [*typed, *REST[command], "--json"]]


def answer(typed: list[str], capsys: pytest.CaptureFixture[str]) -> Any:
    status = command_line(typed)
    printed = capsys.readouterr()
    assert status == 0, printed.err
    return json.loads(printed.out)


def numbers(found: Any, name: str = "") -> dict[str, float]:
    """The numbers in an answer, by their names."""
    if isinstance(found, dict):
        return {key: value for k, one in found.items() for key, value in numbers(one, f"{name}.{k}").items()}
    if isinstance(found, list):
        return {key: value for k, one in enumerate(found) for key, value in numbers(one, f"{name}.{k}").items()}
    return {name: float(found)} if isinstance(found, int | float) and not isinstance(found, bool) else {}


@pytest.mark.parametrize("place", [name for name in TAKEN if name not in SLOW])
def test_a_field_folder__is_what_a_geopackage_is(
    place: str, site: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    by_folder = numbers(answer(words(site, place, site / "A1", tmp_path / "a"), capsys))
    by_file = numbers(answer(words(site, place, site / "A1.gpkg", tmp_path / "b"), capsys))
    varying = ("elapsed", "duration", "seconds", "size", "bytes")
    same = {key: value for key, value in by_folder.items() if not any(word in key for word in varying)}
    assert same
    assert same == pytest.approx({key: by_file[key] for key in same}, rel=1e-3, abs=2e-3)


ELSEWHERE = {name for name in PROPERTIES if "180°" in name}
"""On another map than that of the cloud."""
TURNS = [name for name in TAKEN if name not in SLOW]
TYPED = [(name, TURNS[k % len(TURNS)]) for k, name in enumerate(PROPERTIES) if name not in ELSEWHERE]
VARYING = ("elapsed", "duration", "seconds", "size", "bytes")


def told(typed: list[str], capsys: pytest.CaptureFixture[str]) -> dict[str, float]:
    found = numbers({key: value for key, value in answer(typed, capsys).items() if key != "warnings"})
    return {key: value for key, value in found.items() if not any(word in key for word in VARYING)}


@pytest.mark.parametrize(("stated", "place"), TYPED)
def test_polygons__of_each_kind_are_what_a_geopackage_is(
    stated: str, place: str, site: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Each property with one of the commands in turn."""
    (tmp_path / "given").mkdir()
    make, shapes = PROPERTIES[stated]
    plain = tmp_path / "plain.gpkg"
    names = ["A1", "B2"][: len(shapes)]
    gpd.GeoDataFrame({"name": names}, geometry=list(shapes), crs=MAP).to_file(plain, engine="pyogrio")
    found = told(words(site, place, make(tmp_path / "given"), tmp_path / "a"), capsys)
    key = (place, *(shape.wkt for shape in shapes))
    if key not in PLAIN:
        PLAIN[key] = told(words(site, place, plain, tmp_path / "b"), capsys)
    assert found
    assert found == pytest.approx({name: PLAIN[key][name] for name in found}, rel=1e-3, abs=2e-3)


PLAIN: dict[tuple[str, ...], dict[str, float]] = {}
"""The numbers of GeoPackages, by place and shapes, of which many files are written."""


@pytest.mark.parametrize("stated", POINTS)
def test_points__of_each_kind_are_what_a_table_is(
    stated: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    dsm = surface(tmp_path)
    (tmp_path / "given").mkdir()
    (tmp_path / "plain").mkdir()
    given = POINTS[stated](tmp_path / "given")
    plain = POINTS["table"](tmp_path / "plain")
    found, same = (told(["check", str(dsm), str(path), "--json"], capsys) for path in (given, plain))
    assert found
    assert found == pytest.approx(same, rel=1e-3, abs=2e-3)


@pytest.mark.parametrize("stated", LOGS)
def test_logs__of_each_kind_are_what_the_plain_one_is(
    stated: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    given = log(tmp_path, stated)
    plain = tmp_path / "plain"
    plain.write_text(FORMATS[stated.split(": ")[0]](), newline="")
    (one,) = answer(["inspect", str(given), "--json"], capsys)["files"]
    (same,) = answer(["inspect", str(plain), "--json"], capsys)["files"]
    assert one["facts"]["epochs"] == same["facts"]["epochs"] == EPOCHS
    assert one["facts"]["place"] == same["facts"]["place"]
    out = tmp_path / "out"
    typed = ["gnss", "evaluate", str(given), "--reference", str(plain), "-o", str(out), "--json"]
    assert command_line(typed) == 0
    capsys.readouterr()


def test_sample__a_session_takes_a_field_folder(shared_data: Path) -> None:
    opened = open_session(shared_data / "foreign/02-agopengps-folder-in-session/session.toml")
    assert opened.inputs.boundary is not None
    (field,) = read_fields(opened.inputs.boundary)[0]
    assert field.names == ("North",)
    assert field.outline.area > 0.0
