"""Inputs that must be refused where they are looked at first: what follows would fail later, or be wrong."""

from __future__ import annotations

import struct
import zipfile
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import Any

import geopandas
import numpy as np
import pytest
import shapely
from pyproj import CRS

from furrowmap.core.accuracy.receiver_logs import evaluate_logs
from furrowmap.core.geodesy import projection
from furrowmap.core.geodesy.crs_change import crs_of
from furrowmap.core.geodesy.projection import height_system, read_parameters
from furrowmap.core.readers import boundary_file as boundary
from furrowmap.core.readers import reader, states_csv, surveyed_points, vector_file
from furrowmap.core.readers.isoxml import content, time_log
from furrowmap.core.readers.isoxml.log import TaskDataLog
from furrowmap.core.readers.poses.pose_file import RawPoses
from furrowmap.core.readers.reader import GROUP, ReadOptions, readers
from furrowmap.core.readers.rosbag.bags import BagFiles, RosBag2
from furrowmap.core.readers.states_csv import StatesCsv
from furrowmap.core.readers.surveyed_points import read_points
from furrowmap.core.runtime.errors import FurrowmapError
from furrowmap.core.session.opened import open_session
from furrowmap.exporters.farm.postgis import public_name
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
    path = tmp_path / "a.mcap"
    path.write_bytes(b"\x89MCAP0\r\n" + struct.pack("<BQ", 1, (1 << 29) + 1) + bytes(100))
    files = BagFiles([path])
    assert not list(files.messages())
    (notice,) = files.notices
    assert "a record of 536870913 bytes is declared at byte 17" in notice.text


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
    monkeypatch.setattr(projection, "MAX_PARAMETER_BYTES", 60)
    monkeypatch.setattr(surveyed_points, "MAX_SURVEY_BYTES", 60)
    monkeypatch.setattr(vector_file, "MAX_VECTOR_BYTES", 60)
    with refusal("parameters-unreadable", "it has [0-9,]+ bytes"):
        read_parameters(par(tmp_path, 16, COLUMNS, "54401205   0.10000   0.20000"))
    (tmp_path / "points.csv").write_text("name,e_m,n_m,h_m\n" + "a,1,2,3\n" * 9)
    with refusal("points-unreadable", "too many for a survey"):
        read_points(tmp_path / "points.csv", CRS(6677))
    (tmp_path / "field.geojson").write_text("{" + " " * 99 + "}")
    with refusal("boundary-unreadable", "too large for the boundary of a field"):
        boundary.read_fields(tmp_path / "field.geojson")


def test_boundary__without_a_crs(tmp_path: Path) -> None:
    geopandas.GeoDataFrame(geometry=[shapely.box(0, 0, 1, 1)]).to_file(tmp_path / "a.shp")
    with refusal("polygons-no-crs", "states no CRS"):
        boundary.read_fields(tmp_path / "a.shp")


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
    monkeypatch.setattr(content, "MAX_ARCHIVE_FILES", 3)
    with pytest.raises(FurrowmapError, match="it has 4 files"):
        content.open_task_sets(tmp_path / "a.zip")[0]
    (tmp_path / "TASKDATA.XML").write_text("<ISO11783_TaskData/>" + " " * 99)
    assert content.is_task_data(tmp_path / "TASKDATA.XML")
    monkeypatch.setattr(content, "MAX_FILE_BYTES", 60)
    with refusal("task-data-unreadable", "more than any task data"):
        content.open_task_sets(tmp_path / "TASKDATA.XML")[0].read("TASKDATA.XML")


def test_farm_map__of_a_service_is_called_by_its_name_alone() -> None:
    assert public_name("service=farm password=secret") == "service=farm"
    assert public_name("postgresql://me:secret@server:5433/farm") == "postgresql://me@server:5433/farm"


def test_parameters__in_a_folder_or_of_numbers_that_are_none(tmp_path: Path) -> None:
    with refusal("parameters-unreadable", "cannot be read|Is a directory|Permission denied"):
        read_parameters(tmp_path)
    with refusal("parameters-unreadable", "No such file"):
        read_parameters(tmp_path / "gone.par")


def test_survey__in_a_geopackage_that_is_damaged(tmp_path: Path) -> None:
    (tmp_path / "points.gpkg").write_bytes(b"SQLite format 3\0" + bytes(200))
    with refusal("points-unreadable", "points.gpkg cannot be read"):
        read_points(tmp_path / "points.gpkg", CRS(6677))


def test_survey__in_a_geopackage_is_not_in_degrees_by_its_columns(tmp_path: Path) -> None:
    shapes = [shapely.Point(1, 2, 3), shapely.Point(4, 5, 6), shapely.Point(7, 8, 9)]
    geopandas.GeoDataFrame({"name": ["a", "b", "c"]}, geometry=shapes, crs="EPSG:6677").to_file(tmp_path / "a.gpkg")
    found = read_points(tmp_path / "a.gpkg", CRS(6677))
    assert (found.name, found.xyz_m.tolist()) == (("a", "b", "c"), [[1, 2, 3], [4, 5, 6], [7, 8, 9]])
    (tmp_path / "a.gpkg").rename(tmp_path / "a.csv")
    assert not surveyed_points.in_degrees(tmp_path / "a.csv")
    (tmp_path / "b.csv").write_text("name,lon_deg,lat_deg,h_m\na,139.8,36,3\n")
    assert surveyed_points.in_degrees(tmp_path / "b.csv")


@pytest.mark.parametrize("text", ["EPSG:999999", "no such", "", "+proj=nothing"])
def test_crs__that_proj_does_not_know(text: str) -> None:
    with refusal("crs-unknown", "PROJ does not know the CRS"):
        crs_of(text)


def test_time_log__of_more_values_than_can_be_numbered() -> None:
    most = time_log.MAX_CHANNELS
    assert len(time_log.read_header(header([(141, "DET-1")] * most), "TLG00001").channels) == most
    with refusal("time-log-header", rf"TLG00001\.xml: {most + 1} values; at most {most} can be numbered"):
        time_log.read_header(header([(141, "DET-1")] * (most + 1)), "TLG00001")


def test_task_data__in_an_archive_that_is_none(tmp_path: Path) -> None:
    (tmp_path / "a.zip").write_bytes(b"PK\x03\x04" + bytes(100))
    with refusal("task-data-unreadable", "a.zip: File is not a zip file"):
        content.open_task_sets(tmp_path / "a.zip")[0]
    (tmp_path / "field.kml").write_text("<kml></kml>")
    with refusal("task-data-missing", r"field\.kml is neither a folder with a TASKDATA\.XML nor a zip archive"):
        content.open_task_sets(tmp_path / "field.kml")


def poses(lon: list[float], seconds: list[float] | None = None, scale: str = "unix") -> RawPoses:
    """A file of poses on a parallel, one a second."""
    values = np.zeros((len(lon), 12))
    values[:, 0], values[:, 1] = lon, 10.0
    t_s = np.array(seconds) if seconds is not None else 1.78e9 + np.arange(len(lon))
    return RawPoses(t_s, scale, "", values, projected=False, true_north=True, name="poses.csv")


def test_poses__elsewhere_are_left_out_but_not_half_of_them() -> None:
    track, notices = poses([140.0] * 20 + [20.0] * 19).track(ReadOptions())
    assert len(track) == 20
    assert [notice.code for notice in notices] == ["positions-elsewhere"]
    with refusal("positions-impossible", r"poses\.csv: \d+ of 39 poses are impossible or far from the others"):
        poses([9.0 * k for k in range(39)]).track(ReadOptions())


def test_poses__of_an_unknown_week_are_reported_and_other_faults_are_errors() -> None:
    week = poses([140.0] * 20, [345_600.0 + k for k in range(20)], scale="gps")
    facts, clocks, notices = week.facts(ReadOptions())
    assert facts["seconds_of_week"] == [345_600.0, 345_619.0]
    assert clocks == ()
    assert [notice.code for notice in notices] == ["no-gps-week"]
    with refusal("time-disorder", "19 of 20 poses are out of time order"):
        poses([140.0] * 20, [1.78e9 - k for k in range(20)]).facts(ReadOptions())


def test_states__of_a_file_too_large_or_of_numbers_that_are_none(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "states.csv"
    path.write_text("t_s,state,sigma_s,confidence\n100,down,x,1\n")
    with refusal("states-unreadable", "line 2: sigma_s is 'x'"):
        StatesCsv([path], ReadOptions()).states()
    path.write_text("t_s,state,sigma_s,confidence\n100,down,0.1,7\n200,up,,-1\n300,down,,\n400,up,,\n")
    found = StatesCsv([path], ReadOptions()).states()
    assert found.confidence.tolist() == [1.0, 0.0, 1.0, 1.0]  # shares are between 0 and 1
    assert found.begin_sigma_s[0] == 0.1
    assert np.isnan(found.begin_sigma_s[1:]).all()
    monkeypatch.setattr(states_csv, "MAX_STATES_BYTES", 60)
    with refusal("states-unreadable", "more than 60 bytes"):
        StatesCsv([path], ReadOptions()).states()


def test_evaluation__of_a_file_without_positions(tmp_path: Path) -> None:
    path = tmp_path / "states.csv"
    path.write_text("t_s,state\n100,down\n200,up\n")
    with refusal("no-positions", "holds no positions of a receiver"):
        evaluate_logs(path, "35.0,139.0,60.0")


def test_session__that_names_a_file_of_another_kind(tmp_path: Path) -> None:
    (tmp_path / "states.csv").write_text("t_s,state\n100,down\n200,up\n")
    text = 'furrowmap = 1\n[recording]\nlidar = ["states.csv"]\ngnss = ["states.csv"]\n[crs]\nmap = "EPSG:6677"\n'
    (tmp_path / "session.toml").write_text(text)
    with refusal("wrong-kind-of-file", "holds no"):
        open_session(tmp_path / "session.toml").positions()


def test_reader__of_another_package_that_cannot_be_imported_is_skipped_and_one_of_ours_is_not(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def entries(*names: str) -> Any:
        made = [EntryPoint(name, f"{name}.gone:Reader", GROUP) for name in names]
        return lambda group: [*known, *made]

    known = list(entry_points(group=GROUP))
    readers.cache_clear()
    try:
        monkeypatch.setattr(reader.importlib.metadata, "entry_points", entries("stranger"))
        assert len(readers()) == len(known)
        assert "the reader stranger (stranger.gone:Reader) cannot be imported" in caplog.text
        readers.cache_clear()
        monkeypatch.setattr(reader.importlib.metadata, "entry_points", entries("furrowmap"))
        with pytest.raises(ImportError):
            readers()
    finally:
        monkeypatch.undo()
        readers.cache_clear()
