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
from tests.inputs import test_points as points_of
from tests.inputs import test_polygons as polygons
from tests.inputs.test_commands import numbers
from tests.inputs.test_logs import sentence
from tests.inputs.test_tables import PLACES as TABLES
from tests.inputs.texts import PROPERTIES as WAYS
from tests.inputs.texts import written
from tests.one_pass import make_one_pass

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


COSTLY = ("surface CLOUD", "canopy CLOUD", "parcels --soil", "parcels CLOUD", "features CLOUD")
"""They take a fifth of a second each: in turn, the others all. All open clouds in the way of test_clouds.py."""
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
        found = [(one["code"], "a.laz states no CRS" in one["text"]) for one in warnings]
        assert found == [("crs-of-local", True), ("parcels-without-sigma", False)]  # the parcel is small
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


@pytest.mark.parametrize("way", list(WAYS)[::3])
def test_trials__are_analysed_as_the_plain_one_however_their_tables_are_written(
    way: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Every third way: what both tables hold does not depend on any (tests/inputs/test_tables.py)."""
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
IN_TURN = [(name, list(OF_PARCELS)[k % len(OF_PARCELS)]) for k, name in enumerate(ON_THE_MAP[::2])]
"""Every second kind: test_polygons.py reads parcels and net parcels of all kinds."""


@pytest.mark.parametrize(("stated", "command"), IN_TURN)
def test_parcels__of_each_kind_give_what_a_geopackage_gives(
    stated: str, command: str, crops: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "given").mkdir()
    make, shapes = polygons.PROPERTIES[stated]
    path = make(tmp_path / "given")
    key = (command, *(shape.wkt for shape in shapes))
    ids = [str(one.id) for one in polygons.read_parcels(path, polygons.MAP)[0]]
    plain = tmp_path / "plain.gpkg"
    gpd.GeoDataFrame({"id": ids}, geometry=list(shapes), crs=polygons.MAP).to_file(plain, engine="pyogrio")
    found = answer(capsys, *OF_PARCELS[command](crops, path, plain, tmp_path / "a"))
    if key not in PLAIN_PARCELS:
        PLAIN_PARCELS[key] = answer(capsys, *OF_PARCELS[command](crops, plain, plain, tmp_path / "b"))
    assert found
    assert found == pytest.approx({name: PLAIN_PARCELS[key][name] for name in found}, rel=1e-3, abs=2e-3)


PLAIN_PARCELS: dict[tuple[str, ...], dict[str, float]] = {}
"""The numbers of GeoPackages, by command and shapes."""


@pytest.fixture(scope="module")
def result_of_points(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A result whose surface is the plane of the points."""
    folder = write_result(tmp_path_factory.mktemp("points"), crs=points_of.MAP)
    points_of.surface(folder)
    return folder


@pytest.mark.parametrize("stated", points_of.PROPERTIES)
def test_tie__moves_onto_points_of_each_kind_as_onto_a_table(
    stated: str, result_of_points: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "given").mkdir()
    given = points_of.PROPERTIES[stated](tmp_path / "given")
    found = answer(capsys, "tie", result_of_points, "-o", tmp_path / "a", "--reference", given)
    if "tie" not in PLAIN:
        table = points_of.table(tmp_path)
        PLAIN["tie"] = answer(capsys, "tie", result_of_points, "-o", tmp_path / "b", "--reference", table)
    assert PLAIN["tie"][".ties.0.cells"] == 5.0
    assert found == pytest.approx(PLAIN["tie"], rel=1e-3, abs=2e-3)


@pytest.mark.parametrize("stated", points_of.REFUSED)
def test_tie__refuses_points_that_cannot_be_honoured(
    stated: str, result_of_points: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "given").mkdir()
    given = points_of.REFUSED[stated](tmp_path / "given")
    assert refusal(capsys, "tie", result_of_points, "-o", tmp_path / "a", "--reference", given)


@pytest.fixture(scope="module")
def card(made_once: Callable[..., Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A session whose drive of five seconds is moved into the first field: the first second of its scans."""
    drive = made_once("one_pass", make_one_pass) / "drive"
    folder = tmp_path_factory.mktemp("card")
    there = polygons.TO_DEGREES.transform(polygons.EAST + 70.0, polygons.NORTH + 10.0)
    lines = (drive / "gnss.nmea").read_text().splitlines()
    (folder / "gnss.nmea").write_text("".join(moved_sentence(line, there) for line in lines))
    (folder / "recording.pcap").write_bytes((drive / "recording.pcap").read_bytes()[:1_500_000])
    session = (drive / "session.toml").read_text().replace("EPSG:6677", "EPSG:25832").split("[field]")[0]
    (folder / "session.toml").write_text(session)
    return folder


ONE_PASS_DEG = (140.0201, 36.8701)


def moved_sentence(line: str, there: tuple[float, float]) -> str:
    """A sentence of the pass with its position moved: the pass begins `there`, at longitude and latitude."""
    cells = line[1:].split("*")[0].split(",")
    at = {"GNGGA": 2, "GNRMC": 3}.get(cells[0])
    for k, axis, digits in ((0, 1, 2), (2, 0, 3)) if at is not None and cells[at] else ():
        degrees, minutes = divmod(float(cells[at + k]), 100.0)
        moved = degrees + minutes / 60.0 + there[axis] - ONE_PASS_DEG[axis]
        cells[at + k] = f"{int(moved):0{digits}d}{60.0 * (moved % 1.0):011.8f}"
    return sentence(",".join(cells))


@pytest.mark.parametrize("stated", ON_THE_MAP[::3])
def test_run__maps_the_ground_in_polygons_of_each_kind_as_in_a_geopackage(
    stated: str, card: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A preview, which takes the ground as a run does; every third kind."""
    (tmp_path / "given").mkdir()
    make, shapes = polygons.PROPERTIES[stated]
    within = make(tmp_path / "given")
    found = answer(capsys, "run", card, "-o", tmp_path / "a", "--preview", "--within", within)
    key = ("run --within", *(shape.wkt for shape in shapes))
    if key not in PLAIN_PARCELS:
        plain = tmp_path / "plain.gpkg"
        gpd.GeoDataFrame(geometry=list(shapes), crs=polygons.MAP).to_file(plain, engine="pyogrio")
        PLAIN_PARCELS[key] = answer(capsys, "run", card, "-o", tmp_path / "b", "--preview", "--within", plain)
    same = {name: value for name, value in PLAIN_PARCELS[key].items() if not name.startswith(".timings")}
    assert found[".figures.dsm_area_m2"] > 100.0
    assert {name: found[name] for name in same} == pytest.approx(same, rel=1e-3, abs=2e-3)


@pytest.mark.parametrize("stated", polygons.REFUSED)
def test_run__refuses_polygons_that_cannot_be_honoured(
    stated: str, card: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "given").mkdir()
    given = polygons.REFUSED[stated](tmp_path / "given")
    assert refusal(capsys, "run", card, "-o", tmp_path / "a", "--preview", "--within", given)


@pytest.fixture(scope="module")
def season(card: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Recordings without a session: a drive through both fields and, half a metre outside, along them."""
    folder = tmp_path_factory.mktemp("season")
    (folder / "cards" / "one").mkdir(parents=True)
    (folder / "cards" / "one" / "recording.pcap").write_bytes((card / "recording.pcap").read_bytes()[:300_000])
    corners = np.array([[-0.5, -3.0], [-0.5, 50.5], [100.5, 50.5], [100.5, 45.0], [5.0, 45.0], [5.0, 10.0],
                        [140.0, 10.0], [140.0, 40.5], [150.5, 40.5], [150.5, -3.0]])  # fmt: skip
    way = shapely.segmentize(shapely.LineString(corners + np.array([polygons.EAST, polygons.NORTH])), 0.5)
    lines = []
    for k, (lon, lat) in enumerate(zip(*polygons.TO_DEGREES.transform(*np.array(way.coords).T), strict=True)):
        at = f"09{k // 60:02d}{k % 60:02d}.00"
        place = f"{int(lat)}{60.0 * (lat % 1.0):011.8f},N,{int(lon):03d}{60.0 * (lon % 1.0):011.8f},E"
        lines.append(sentence(f"GNZDA,{at},12,05,2026,00,00"))
        lines.append(sentence(f"GNGGA,{at},{place},4,12,0.6,55.0,M,45.0,M,1.0,0001"))
    (folder / "cards" / "one" / "gnss.nmea").write_text("".join(lines))
    machine = (card / "session.toml").read_text().split("[antenna]")[1]
    (folder / "machine.toml").write_text(f"furrowmap_machine = 1\n[antenna]{machine}")
    return folder


def planned(season: Path, boundaries: Path, out: Path) -> list[object]:
    machine = season / "machine.toml"
    words = ("--machine", machine, "--boundaries", boundaries, "--dry-run")
    return ["batch", season / "cards", "-o", out, *words]


@pytest.mark.parametrize("stated", ON_THE_MAP)
def test_batch__enters_the_fields_of_each_kind_of_file(
    stated: str, season: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "given").mkdir()
    make, shapes = polygons.PROPERTIES[stated]
    status = command_line([*map(str, planned(season, make(tmp_path / "given"), tmp_path / "out")), "--json"])
    found = json.loads(capsys.readouterr().out)
    assert status == 0
    assert found["failed"] == []
    assert len(found["run"]) == len(shapes)


@pytest.mark.parametrize("stated", polygons.REFUSED)
def test_batch__refuses_polygons_that_cannot_be_honoured(
    stated: str, season: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "given").mkdir()
    typed = planned(season, polygons.REFUSED[stated](tmp_path / "given"), tmp_path / "out")
    assert command_line([*map(str, typed), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert (found["run"], [len(one["lines"]) for one in found["failed"]]) == ([], [3])


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
