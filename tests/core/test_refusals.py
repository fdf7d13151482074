"""Inputs that must be refused where they are looked at first: what follows would fail later, or be wrong."""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import Any

import geopandas
import pytest
import shapely
from pyproj import CRS

from furrowmap.core.checking import surveyed_points
from furrowmap.core.checking.surveyed_points import read_points
from furrowmap.core.geodesy import parameter_file
from furrowmap.core.geodesy.crs_change import crs_of
from furrowmap.core.geodesy.height_system import height_system
from furrowmap.core.geodesy.parameter_file import read_parameters
from furrowmap.core.readers import boundary, vector_file
from furrowmap.core.readers.isoxml import files
from furrowmap.core.readers.isoxml.log import TaskDataLog
from furrowmap.core.readers.reader import ReadOptions
from furrowmap.core.readers.rosbag.bags import RosBag2
from furrowmap.core.readers.rosbag.storage import ByteStream, Damage
from furrowmap.core.values.errors import FurrowmapError
from furrowmap.exporters.farm.connection import public_name
from tests.core.readers.isoxml.time_logs import Record, header, task_data


def refusal(code: str, words: str) -> Any:
    """An error with this code that says this."""
    return pytest.raises(FurrowmapError, match=words, check=lambda error: bool(error.code == code))


@pytest.mark.parametrize(
    "shapes", [[shapely.box(0, 0, 1, 1)], [shapely.Point(1, 2, 3), shapely.LineString([(0, 0), (1, 1)])]]
)
def test_survey__of_other_geometries_than_points(shapes: list[shapely.Geometry], tmp_path: Path) -> None:
    path = tmp_path / "points.gpkg"
    geopandas.GeoDataFrame({"name": ["a", "b"][: len(shapes)]}, geometry=shapes, crs="EPSG:6677").to_file(path)
    with refusal("points-unreadable", "other geometries than points"):
        read_points(path, CRS(6677))


def test_bag__of_which_only_the_metadata_are_there(tmp_path: Path) -> None:
    (tmp_path / "metadata.yaml").write_text("rosbag2_bagfile_information:\n  relative_file_paths: [gone_0.db3]\n")
    with refusal("bag-folder-empty", r"no \.db3 or \.mcap file"):
        RosBag2([tmp_path], ReadOptions()).track()


@pytest.mark.parametrize("records", [[], [Record(36_000_000, 15_000, {"A": 0, "B": 0, "D": 0})]])
def test_task_data__whose_time_logs_have_no_positions(records: list[Record], tmp_path: Path) -> None:
    logs = {"TLG00001": (header([(141, "DET-1")]), b"".join(record.pack() for record in records))}
    body = '<TSK A="TSK1" B="run" G="4"><TLG A="TLG00001" C="1"/></TSK>'
    with refusal("no-positions", "no positions in the time logs"):
        TaskDataLog([task_data(tmp_path / "TASKDATA", body, logs)], ReadOptions()).track()


def test_bag__a_record_larger_than_any_message(tmp_path: Path) -> None:
    (tmp_path / "bag").write_bytes(bytes(100))
    with pytest.raises(Damage, match="a record of 536870913 bytes is declared at byte 0"):
        ByteStream(tmp_path / "bag").take((1 << 29) + 1)


COLUMNS = "MeshCode   dB(sec)  dL(sec)"


def par(folder: Path, head: int, columns: str, *rows: str) -> Path:
    """A parameter file with a header of `head` lines, the last of which names the columns."""
    path = folder / "a.par"
    path.write_text("\n".join([*["x"] * (head - 1), columns, *rows, ""]), encoding="ascii")
    return path


@pytest.mark.parametrize(
    ("head", "columns", "rows", "words"),
    [
        (3, COLUMNS, ("54401205   0.10000   0.20000",), "header of 2 or 16 lines"),
        (2, COLUMNS, (), "header of 2 or 16 lines"),
        (2, COLUMNS, ("54401205   0.10000  61.00000",), "larger than any"),
        (16, COLUMNS, ("54401205   0.10000   0.20000", "54401206 x"), r"line 18 \('54401206 x'\)"),
    ],
)
def test_parameters__that_are_none(head: int, columns: str, rows: tuple[str, ...], words: str, tmp_path: Path) -> None:
    with refusal("parameters-unreadable", words):
        read_parameters(par(tmp_path, head, columns, *rows))


@pytest.mark.parametrize(
    ("columns", "row", "kind"),
    [(COLUMNS, "54401205   0.10000   0.20000", "PatchJGD"), ("MeshCode   dH(m)", "54401205   0.30000", "PatchJGD_H")],
)
def test_parameters__of_an_earthquake_are_told_by_their_columns(
    columns: str, row: str, kind: str, tmp_path: Path
) -> None:
    found = read_parameters(par(tmp_path, 16, columns, row))
    assert (found.format, found.codes.tolist(), found.days) == (kind, [54401205], None)


def test_files__too_large_for_what_they_are(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The bounds are lowered, so that the files are small; the rule is the same."""
    for module in (parameter_file, surveyed_points, vector_file):
        monkeypatch.setattr(module, "LARGEST_BYTES", 60)
    with refusal("parameters-unreadable", "it has [0-9,]+ bytes"):
        read_parameters(par(tmp_path, 16, COLUMNS, "54401205   0.10000   0.20000"))
    (tmp_path / "points.csv").write_text("name,e_m,n_m,h_m\n" + "a,1,2,3\n" * 9)
    with refusal("points-unreadable", "too many for a survey"):
        read_points(tmp_path / "points.csv", CRS(6677))
    (tmp_path / "field.geojson").write_text("{" + " " * 99 + "}")
    with refusal("boundary-unreadable", "too large for the boundary of a field"):
        boundary.read_boundary(tmp_path / "field.geojson")


def test_boundary__without_a_crs(tmp_path: Path) -> None:
    geopandas.GeoDataFrame(geometry=[shapely.box(0, 0, 1, 1)]).to_file(tmp_path / "a.shp")
    with refusal("boundary-unreadable", "it states no CRS"):
        boundary.read_boundary(tmp_path / "a.shp")


def test_survey__in_no_known_encoding_and_without_a_whole_point(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_bytes(b"name,e_m,n_m,h_m\n\x81 \xff,1,2,3\n")
    with refusal("points-unreadable", "neither UTF-8 nor"):
        read_points(tmp_path / "a.csv", CRS(6677))
    (tmp_path / "a.csv").write_text("name,e_m,n_m,h_m\na,1,2,\nb,,2,3\nc,1,,3\n")
    with refusal("points-unreadable", "no point with easting, northing and height"):
        read_points(tmp_path / "a.csv", CRS(6677))


def test_crs__of_heights_alone() -> None:
    with refusal("crs-unknown", "is not a horizontal CRS, but a Vertical CRS"):
        crs_of("EPSG:5703")


def test_geoid__whose_path_proj_cannot_read(tmp_path: Path) -> None:
    (tmp_path / "a,b.tif").touch()
    with refusal("geoid-unreadable", "comma or a quotation mark"):
        height_system("EGM2008", CRS(6677), tmp_path / "a,b.tif")


def test_task_data__of_too_many_or_too_large_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with zipfile.ZipFile(tmp_path / "a.zip", "w") as archive:
        for name in ("TASKDATA.XML", "a", "b", "c"):
            archive.writestr(name, "<ISO11783_TaskData/>")
    monkeypatch.setattr(files, "MOST_FILES", 3)
    with pytest.raises(FurrowmapError, match="it has 4 files"):
        files.open_task_files(tmp_path / "a.zip")
    (tmp_path / "TASKDATA.XML").write_text("<ISO11783_TaskData/>" + " " * 99)
    assert files.is_task_data(tmp_path / "TASKDATA.XML")
    monkeypatch.setattr(files, "LARGEST_BYTES", 60)
    with refusal("task-data-unreadable", "more than any task data"):
        files.open_task_files(tmp_path / "TASKDATA.XML").read("TASKDATA.XML")


def test_farm_map__of_a_service_is_called_by_its_name_alone() -> None:
    assert public_name("service=farm password=secret") == "service=farm"
    assert public_name("postgresql://me:secret@server:5433/farm") == "postgresql://me@server:5433/farm"
