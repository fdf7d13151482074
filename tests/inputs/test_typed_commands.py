"""Clouds, rasters, tables and parcels as they are typed, in every command that takes them: the plain file's answer."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path
from typing import Any

import geopandas as gpd
import numpy as np
import pytest
import rasterio
import shapely

from furrowmap.cli.main import command_line
from furrowmap.exporters.files.file_records import file_records, joint_record
from tests.app.crops import test_response as responses
from tests.core.readers import test_raster_heights as rasters
from tests.exporters.farm.result_folders import write_result
from tests.inputs import test_clouds as clouds
from tests.inputs import test_polygons as polygons
from tests.inputs.test_commands import numbers
from tests.inputs.test_tables import PLACES as TABLES
from tests.inputs.texts import PROPERTIES as WAYS
from tests.inputs.texts import written

VARYING = ("elapsed", "duration", "seconds", "size", "bytes", "warnings")
VARYING += ("by_class", "range_m", "height_cv", "sigma")  # of a plane: shares of what rounding leaves
FEWER_POINTS = ("points", "returns", "n_", "density", "share", "area", "cover", "voxels", "rows", "columns")
"""Numbers that differ where some points have no height."""


def answer(capsys: pytest.CaptureFixture[str], *typed: object) -> dict[str, float]:
    status = command_line([*map(str, typed), "--json"])
    printed = capsys.readouterr()
    assert status == 0, printed.err
    found = numbers({key: value for key, value in json.loads(printed.out).items() if key != "warnings"})
    return {key: value for key, value in found.items() if not any(word in key for word in VARYING)}


def refusal(capsys: pytest.CaptureFixture[str], *typed: object) -> str:
    status = command_line([*map(str, typed), "--json"])
    printed = capsys.readouterr()
    assert status in (2, 3, 4), printed.out
    return str(json.loads(printed.out)["error"]["code"])


def points(folder: Path) -> Path:
    path = folder / "points.csv"
    rows = [f"P{k},{x},{y},{100.0 + 0.05 * (x - clouds.EAST)}\n" for k, (x, y) in enumerate(clouds.PLACES_M.tolist())]
    path.write_text("name,e_m,n_m,h_m\n" + "".join(rows))
    return path


def plots(folder: Path) -> Path:
    path = folder / "plots.gpkg"
    if not path.exists():
        box = shapely.box(clouds.EAST + 2.0, clouds.NORTH + 2.0, clouds.EAST + 6.0, clouds.NORTH + 6.0)
        gpd.GeoDataFrame({"id": ["A1"]}, geometry=[box], crs=clouds.MAP).to_file(path, engine="pyogrio")
    return path


def crop(folder: Path) -> Path:
    """Plants of half a metre on the plane, in the plot."""
    cloud = clouds.laspy.read(clouds.las(folder / "bare.las"))
    inside = np.maximum(np.abs(clouds.X - clouds.EAST - 4.0), np.abs(clouds.Y - clouds.NORTH - 4.0)) < 2.0
    z = np.array(cloud.z)
    z[inside] += 0.5
    cloud.z = z
    cloud.write(folder / "crop.laz")
    return folder / "crop.laz"


OF_CLOUDS: Mapping[str, Callable[[Path, Path], list[object]]] = {
    "cloud CLOUD": lambda path, out: ["cloud", path, "-o", out / "out.copc.laz"],
    "surface CLOUD": lambda path, out: ["surface", path, "-o", out / "surface", "--cell", 1],
    "features CLOUD": lambda path, out: ["features", path, "-o", out / "features", "--voxel", 1],
    "canopy CLOUD": lambda path, out: ["canopy", path, "-o", out / "canopy", "--cell", 2],
    "parcels CLOUD": lambda path, out: ["parcels", path, plots(out), "-o", out / "parcels"],
    "parcels --soil": lambda path, out: ["parcels", crop(out), plots(out), "--soil", path, "-o", out / "over"],
    "check CLOUD_OR_DSM": lambda path, out: ["check", path, points(out)],
}  # fmt: skip


def with_crs(typed: list[object], path: Path) -> list[object]:
    return [*typed, "--crs", "EPSG:26918"] if clouds.stated_crs(path) is not None else typed


@pytest.fixture(scope="module")
def plain_clouds(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str, pytest.CaptureFixture[str]], Any]:
    """The answer of each command to a plain cloud, asked once."""
    folder = tmp_path_factory.mktemp("plain")
    path = clouds.las(folder / "plain.laz")

    @cache
    def asked(command: str, capsys: pytest.CaptureFixture[str]) -> dict[str, float]:
        (folder / command).mkdir()
        return answer(capsys, *OF_CLOUDS[command](path, folder / command))

    known: dict[str, dict[str, float]] = {}

    def found(command: str, capsys: pytest.CaptureFixture[str]) -> dict[str, float]:
        if command not in known:
            known[command] = asked(command, capsys)
        return known[command]

    return found


COSTLY = ("surface CLOUD", "canopy CLOUD", "parcels --soil")
"""They take a fifth of a second each: in turn, the others all."""
CLOUD_CELLS = [
    (stated, command)
    for k, stated in enumerate(clouds.PROPERTIES)
    for command in OF_CLOUDS
    if command not in COSTLY or command == COSTLY[k % len(COSTLY)]
]


@pytest.mark.parametrize(("stated", "command"), CLOUD_CELLS)
def test_clouds__of_each_kind_give_what_a_plain_one_gives(
    stated: str, command: str, plain_clouds: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "given").mkdir()
    path = clouds.PROPERTIES[stated](tmp_path / "given")
    found = answer(capsys, *with_crs(OF_CLOUDS[command](path, tmp_path), path))
    same = plain_clouds(command, capsys)
    if "none" in stated:
        found = {key: value for key, value in found.items() if not any(word in key for word in FEWER_POINTS)}
    assert found
    assert found.keys() <= same.keys()
    assert found == pytest.approx({key: same[key] for key in found}, rel=2e-3, abs=2e-2)


@pytest.mark.parametrize("command", OF_CLOUDS)
@pytest.mark.parametrize("stated", clouds.REFUSED)
def test_clouds__that_cannot_be_honoured_are_refused(
    stated: str, command: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "given").mkdir()
    if (command, stated) == ("parcels --soil", "no CRS"):  # it is that of the cloud of the crop, with a notice
        typed = OF_CLOUDS[command](clouds.REFUSED[stated](tmp_path / "given"), tmp_path)
        assert command_line([*map(str, typed), "--json"]) == 0
        warnings = json.loads(capsys.readouterr().out)["warnings"]
        assert [(one["code"], "a.laz states no CRS" in one["text"]) for one in warnings] == [("crs-of-local", True)]
        return
    assert refusal(capsys, *OF_CLOUDS[command](clouds.REFUSED[stated](tmp_path / "given"), tmp_path))


RASTERS: dict[str, dict[str, Any]] = {
    **rasters.SCALES,
    **{f"unit of the band: {name}": {"unit": name, "unit_m": unit} for name, unit in rasters.UNITS.items()},
    **{f"vertical CRS: {name}": {"crs": name, "unit_m": unit} for name, unit in rasters.COMPOUND.items()},
    **{f"no height: {name}": stated for name, stated in rasters.NO_HEIGHTS.items()},
}


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_result(tmp_path_factory.mktemp("result"), crs=rasters.MAP)


@pytest.mark.parametrize("stated", RASTERS)
def test_rasters__of_each_kind_are_the_plane_in_every_command(
    stated: str, result: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = rasters.write(result / "dsm.tif", **RASTERS[stated])
    at = rasters.PLACES
    table = tmp_path / "points.csv"
    rows = [f"p{k},{x:.3f},{y:.3f},{rasters.plane_m(x, y):.4f}\n" for k, (x, y) in enumerate(at.tolist())]
    table.write_text("name,e_m,n_m,h_m\n" + "".join(rows))
    checked = answer(capsys, "check", path, table)
    assert checked[".accuracy.vertical.n"] == len(at)
    assert checked[".accuracy.vertical.greatest_m"] < 0.012
    answer(capsys, "farm", "mosaic", result, "-o", tmp_path / "mosaic.tif", "--cell", rasters.CELL_M)
    with rasterio.open(tmp_path / "mosaic.tif") as raster:
        cells = [raster.index(x, y) for x, y in at.tolist()]
        middles = np.array([raster.xy(*cell) for cell in cells])
        heights = raster.read(1, masked=True).astype(np.float64).filled(np.nan)
    np.testing.assert_allclose([heights[cell] for cell in cells], rasters.plane_m(*middles.T), atol=0.012)


TYPED_TABLES: Mapping[str, tuple[str, str]] = {
    "[trajectory] files": ("pose-csv", "poses"),
    "[imu] files": ("imu-csv", "samples"),
    "[attitude] roll_pitch": ("attitude-csv", "attitudes"),
    "[implement] states": ("states-csv", "states"),
    "[recording] lidar": ("line-csv", "scans"),
}


PLAIN: dict[str, dict[str, float]] = {}
"""The numbers of the tables that are written plainly, by their places."""


def inspected(path: Path, reader: str, capsys: pytest.CaptureFixture[str]) -> dict[str, float]:
    status = command_line(["inspect", str(path), "--json"])
    printed = capsys.readouterr()
    assert status == 0, printed.err
    (one,) = json.loads(printed.out)["files"]
    assert one["format"] == reader
    return {key: value for key, value in numbers(one["facts"]).items() if "column" not in key}


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("place", TYPED_TABLES)
def test_logs_in_csv__are_inspected_as_the_plain_one_however_they_are_written(
    place: str, way: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    cells, _ = TABLES[place]
    found = inspected(written(tmp_path / "table.csv", cells, way), TYPED_TABLES[place][0], capsys)
    if place not in PLAIN:
        PLAIN[place] = inspected(written(tmp_path / "plain.csv", cells, "commas"), TYPED_TABLES[place][0], capsys)
    assert found
    assert found == pytest.approx(PLAIN[place])


@pytest.mark.parametrize("way", WAYS)
def test_trials__are_analysed_as_the_plain_one_however_their_tables_are_written(
    way: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    plain = [responses.table(tmp_path / "heights.csv", 1), responses.doses(tmp_path / "doses.csv")]
    cells = [[line.split(",") for line in path.read_text(encoding="utf-8").splitlines()] for path in plain]
    given = [written(tmp_path / f"{k}.csv", table, way) for k, table in enumerate(cells)]
    if "response" not in PLAIN:
        PLAIN["response"] = answer(capsys, "response", plain[0], "--treatments", plain[1], "-o", tmp_path / "plain")
    found = answer(capsys, "response", given[0], "--treatments", given[1], "-o", tmp_path / "out")
    assert len(found) > 20
    assert found == pytest.approx({key: PLAIN["response"][key] for key in found})


@pytest.fixture(scope="module")
def crops(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A flight over the plots of the polygons, of plants half a metre high on every second metre."""
    folder = tmp_path_factory.mktemp("crops")
    x, y = np.meshgrid(polygons.EAST + 0.25 + np.arange(-8.0, 158.0), polygons.NORTH + 0.25 + np.arange(-8.0, 58.0))
    planted = shapely.contains_xy(shapely.union_all([polygons.A, polygons.B]), x, y)
    z = 100.0 + np.where(planted & ((np.floor(x) + np.floor(y)) % 2 == 0), 0.5, 0.0)
    header = clouds.laspy.LasHeader(version="1.4", point_format=6)
    header.scales, header.offsets = np.full(3, 0.001), np.array([polygons.EAST, polygons.NORTH, 0.0])
    header.add_crs(polygons.MAP)
    cloud = clouds.laspy.LasData(header)
    cloud.x, cloud.y, cloud.z = x.ravel(), y.ravel(), z.ravel()
    cloud.return_number[:] = cloud.number_of_returns[:] = 1
    cloud.write(folder / "crop.laz")
    return folder / "crop.laz"


OF_PARCELS: Mapping[str, Callable[[Path, Path, Path, Path], list[object]]] = {
    "parcels PARCELS": lambda flight, path, _, out: ["parcels", flight, path, "-o", out],
    "parcels --net": lambda flight, path, gross, out: ["parcels", flight, gross, "--net", path, "-o", out],
}
ON_THE_MAP = [name for name in polygons.PROPERTIES if "180°" not in name]
IN_TURN = [(name, list(OF_PARCELS)[k % len(OF_PARCELS)]) for k, name in enumerate(ON_THE_MAP)]


@pytest.mark.parametrize(("stated", "command"), IN_TURN)
def test_parcels__of_each_kind_give_what_a_geopackage_gives(
    stated: str, command: str, crops: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "given").mkdir()
    make, shapes = polygons.PROPERTIES[stated]
    path = make(tmp_path / "given")
    key = (command, *(shape.wkt for shape in shapes))
    ids = [str(one.id) for one in polygons.read_parcels(path, polygons.MAP)]
    plain = tmp_path / "plain.gpkg"
    gpd.GeoDataFrame({"id": ids}, geometry=list(shapes), crs=polygons.MAP).to_file(plain, engine="pyogrio")
    found = answer(capsys, *OF_PARCELS[command](crops, path, plain, tmp_path / "a"))
    if key not in PLAIN_PARCELS:
        PLAIN_PARCELS[key] = answer(capsys, *OF_PARCELS[command](crops, plain, plain, tmp_path / "b"))
    assert found
    assert found == pytest.approx({name: PLAIN_PARCELS[key][name] for name in found}, rel=1e-3, abs=2e-3)


PLAIN_PARCELS: dict[tuple[str, ...], dict[str, float]] = {}
"""The numbers of GeoPackages, by command and shapes."""


def test_records__of_folders_are_of_all_that_is_read_of_them(tmp_path: Path) -> None:
    """Of task data in a subfolder too: a run is repeated where they change."""
    card = polygons.task_data(tmp_path)
    (card / "notes").mkdir()
    (card / "notes" / "a.txt").touch()
    (record,) = file_records([card], tmp_path)
    assert record.name == "card/TASKDATA/TASKDATA.XML"
    field = polygons.agopengps(tmp_path)
    records = file_records([field], tmp_path)
    assert [one.name for one in records] == ["A1/Boundary.txt", "A1/Field.txt"]
    joint = joint_record(field, records)
    assert (joint.name, joint.bytes) == ("A1", sum(one.bytes for one in records))
    (field / "Field.txt").write_text("changed")
    assert joint_record(field, file_records([field], tmp_path)).sha256 != joint.sha256
