"""Refusals of what seldom comes: each says what is wrong, and none is left to a library's own error."""

from __future__ import annotations

import json
import sqlite3
import sys
import zipfile
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import shapely
from pyproj import CRS

import furrowmap
from furrowmap.cli.command_options import value_of
from furrowmap.core.accuracy.receiver_logs import evaluate_logs
from furrowmap.core.adjustment.banded import NormalEquations
from furrowmap.core.coverage.task_work import task_works
from furrowmap.core.crops.trial_tables import read_treatments
from furrowmap.core.geodesy.projection import read_parameters
from furrowmap.core.images.board import expect_opencv
from furrowmap.core.implement.external_states import external_states
from furrowmap.core.implement.saved import load_implement
from furrowmap.core.pipeline.notices import refuse_empty
from furrowmap.core.pointclouds.placed_scans import Placement
from furrowmap.core.readers import text_table
from furrowmap.core.readers.areas.area import read_area
from furrowmap.core.readers.boundary_file import read_fields
from furrowmap.core.readers.image_pixels import expect_pillow
from furrowmap.core.readers.text_table import MAX_SHEET_BYTES, read_table
from furrowmap.core.readers.vector_file import VectorLayer
from furrowmap.core.runtime.errors import InputError, RefusedError, UsageError
from furrowmap.core.runtime.options import Option
from furrowmap.core.session.session_file import parse_session
from furrowmap.core.trajectory.inertial_checks import TurnedMounting, turned_mounting
from furrowmap.core.values.rotation import Mounting
from furrowmap.core.values.trajectory import trajectory_from_attitude
from furrowmap.exporters.exchange.vectors import FORMATS, write_vectors
from furrowmap.exporters.farm import farm_geopackage as geopackage
from furrowmap.exporters.files.provenance import Origin
from tests.core.readers.isoxml.time_logs import Record, header, task_data
from tests.core.readers.test_nmea import sentence
from tests.core.test_refusals import par, refusal

MAP = CRS.from_epsg(6677)
KML = '<?xml version="1.0"?><kml xmlns="http://www.opengis.net/kml/2.2"><Document><Placemark>{}</Placemark></Document></kml>'
RING = "<LinearRing><coordinates>{}</coordinates></LinearRing>"


@pytest.mark.parametrize(
    ("corners", "words"),
    [
        ("139,36 139.1,36", "a ring of 2 corners"),
        ("139,36 139.1,36 nan,36.1 139,36", "not finite"),
        ("139,36 139.1,north 139,36.1", "'139.1,north' is no longitude and latitude"),
        ("139,36 139.1 139,36.1", "'139.1' is no longitude and latitude"),
    ],
)
def test_kml__with_rings_that_are_none(corners: str, words: str, tmp_path: Path) -> None:
    path = tmp_path / "field.kml"
    path.write_text(KML.format(f"<Polygon><outerBoundaryIs>{RING.format(corners)}</outerBoundaryIs></Polygon>"))
    with refusal("boundary-unreadable", words):
        read_fields(path)


def test_kml__without_an_outer_ring(tmp_path: Path) -> None:
    path = tmp_path / "field.kml"
    path.write_text(KML.format("<Polygon></Polygon>"))
    with refusal("boundary-unreadable", "no outer boundary"):
        read_fields(path)


def zipped(path: Path, files: dict[str, bytes]) -> Path:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in files.items():
            archive.writestr(name, content)
    return path


@pytest.mark.parametrize(
    ("files", "words"),
    [
        ({"a.shp": b"no Shapefile"}, "its layer layer.shp is neither a Shapefile nor KML"),
        ({"a.shp": b"", "b.kml": b""}, "it holds 2 Shapefiles and KML files: a.shp, b.kml, not one"),
        ({f"{k}.txt": b"" for k in range(4)}, "it has 4 files"),
    ],
)
def test_archives__without_one_layer(
    files: dict[str, bytes], words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(text_table, "MAX_FILES", 3)
    with refusal("within-unreadable", words):
        read_area(zipped(tmp_path / "area.zip", files), MAP)


def test_archives__that_unpack_to_far_more_than_their_size(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("furrowmap.core.runtime.memory.FREE_BYTES", 1000)
    with pytest.raises(RefusedError) as refused:
        read_area(zipped(tmp_path / "area.zip", {"a.shp": bytes(3_000_000)}), MAP)
    assert "--allow-large" in refused.value.remedy


def test_sheets__that_are_too_large_or_empty(tmp_path: Path) -> None:
    large, empty = tmp_path / "large.xls", tmp_path / "empty.xlsx"
    with large.open("wb") as file:
        file.write(b"\xd0\xcf\x11\xe0")
        file.truncate(MAX_SHEET_BYTES + 1)
    pd.DataFrame().to_excel(empty, index=False)
    for path, words in ((large, "20,000,001 bytes is too large"), (empty, "its first sheet is empty")):
        with refusal("treatments-unreadable", words):
            read_treatments(path)


def test_an_interruption__while_a_sheet_is_read_is_no_damage(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    pytest.importorskip("python_calamine")
    pd.DataFrame({"plot": [1]}).to_excel(tmp_path / "a.xlsx", index=False)
    monkeypatch.setattr(json, "loads", interrupted)
    with pytest.raises(KeyboardInterrupt):
        read_table(tmp_path / "a.xlsx", pytest.fail)


def test_normal_equations__without_a_solution() -> None:
    equations = NormalEquations(3, 2)
    for diagonal in ([0.0, 0.0, 0.0], [4.0, -1.0, 4.0], [4.0, np.nan, 4.0]):
        equations.band[0] = diagonal
        with pytest.raises(np.linalg.LinAlgError, match=r"not positive definite in row|not finite"):
            equations.solve()
    equations.band[0], equations.band[1, 0] = 1.0, 2.0
    with pytest.raises(np.linalg.LinAlgError, match="not positive definite in row 2"):
        equations.solve()
    equations.band[1], equations.right[:] = 0.0, [1.0, np.inf, 1.0]
    with pytest.raises(np.linalg.LinAlgError, match="not finite"):
        equations.solve()
    with pytest.raises(np.linalg.LinAlgError, match="have no solution"):
        equations.solve_damped(np.ones(3, np.bool_))


def test_parameters__for_meshes_that_do_not_exist(tmp_path: Path) -> None:
    path = par(tmp_path, 2, "MeshCode   dB(sec)  dL(sec)", "99999999   1.0  1.0")
    with refusal("parameters-unreadable", "."):
        read_parameters(path)


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"form": 99}, "format version 99"),
        ({"columns": np.zeros(7)}, "do not fit each other"),
        ({"odds": np.zeros((2, 2))}, "do not fit each other"),
    ],
)
def test_implements__of_another_form(changed: dict[str, object], words: str, tmp_path: Path) -> None:
    arrays: dict[str, object] = {
        "form": 1, "turn": np.zeros(4), "grid": np.array([0.0, 0.0, 3.0, 3.0]), "levels": np.zeros(5),
        "usual": np.zeros(3), "odds": np.zeros((3, 3)), "columns": np.zeros(3), "still_m": np.zeros((2, 3)),
    }  # fmt: skip
    from furrowmap.core.implement import saved

    arrays |= {
        "form": saved.FILE_FORM,
        "columns": np.zeros(saved.IMAGE_COLUMNS),
        "still_m": np.zeros((2, saved.IMAGE_COLUMNS)),
    }
    np.savez(tmp_path / "implement.npz", **(arrays | changed))  # type: ignore[arg-type]
    with refusal("implement-unreadable", words):
        load_implement(tmp_path / "implement.npz")


def test_tasks__without_positions(tmp_path: Path) -> None:
    with refusal("no-positions", r"none of its 1 task has a time log with positions"):
        task_works(task_data(tmp_path / "TASKDATA", '<TSK A="TSK1" B="run" G="4"/>', {}))


def test_tasks__near_a_pole_need_a_stated_crs(tmp_path: Path) -> None:
    records = [Record(36_000_000 + 1000 * k, 15_000, {"A": 890_000_000 + 100 * k, "B": 0, "D": 1}) for k in range(9)]
    logs = {"TLG00001": (header([(141, "DET-1")]), b"".join(record.pack() for record in records))}
    body = '<TSK A="TSK1" B="run" G="4"><TLG A="TLG00001" C="1"/></TSK>'
    with refusal("crs-unknown", "too near to a pole"):
        task_works(task_data(tmp_path / "TASKDATA", body, logs), width_m=3.0)


def test_layers__for_geoparquet_need_pyarrow(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    layers = {"field": VectorLayer(np.array([shapely.Point(1, 2)]), {"a": np.array([1])}, CRS(MAP))}
    for name in [name for name in sys.modules if name.split(".")[0] == "pyarrow"]:
        monkeypatch.setitem(sys.modules, name, None)
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with refusal("extra-missing", "package pyarrow is not installed"):
        write_vectors(FORMATS["geoparquet"], tmp_path / "out", layers, Origin("a test"))


@pytest.mark.parametrize(
    ("package", "expect", "name"),
    [("cv2", expect_opencv, "OpenCV"), ("PIL", expect_pillow, "Pillow")],
)
def test_packages__that_are_not_installed_are_named(
    package: str, expect: Callable[[], None], name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, package, None)
    with refusal("extra-missing", f"{name}.* is not installed"):
        expect()


def test_a_farm_map__that_another_program_has_locked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(geopackage, "BUSY_S", 0.01)
    path = tmp_path / "farm.gpkg"
    with closing(sqlite3.connect(path, isolation_level=None)) as other:
        other.execute("CREATE TABLE a (b)")
        other.execute("BEGIN EXCLUSIVE")
        with pytest.raises(RefusedError, match="locked") as refused:
            geopackage.check_farm_map(path)
    assert str(path) in refused.value.what


@pytest.mark.parametrize("results", [["a"], ["a", "b"]])
@pytest.mark.parametrize(("to", "arguments"), [("stac", {"layers": ["passes"]}), ("stac", {"crs": "EPSG:4326"})])
def test_export__of_what_cannot_be_combined(results: list[str], to: str, arguments: dict[str, object]) -> None:
    with pytest.raises(UsageError, match=f"--to {to} and --(layer|dst-crs) cannot be combined"):
        furrowmap.export(results, to, **arguments)  # type: ignore[arg-type]


def test_export__of_several_results_into_one_file() -> None:
    with pytest.raises(UsageError, match="takes one result folder, not 2") as refused:
        furrowmap.export(["a", "b"], "geojson")
    assert "one by one" in refused.value.remedy


@pytest.mark.parametrize("text", ["-1,2", "1,inf", "1", "1,2,3", "wide,3", "1,nan"])
def test_options__of_two_widths(text: str) -> None:
    option = Option("--net", "ENDS,SIDES")
    assert value_of(option, "0.5,0") == (0.5, 0.0)
    assert value_of(option, None) is None
    assert furrowmap.ParcelSettings().net_inset_m == (0.0, 0.0)
    with pytest.raises(UsageError, match="--net"):
        value_of(option, text)


@pytest.mark.parametrize("text", ["256", "-1", "2.5", "2,x", ""])
def test_options__of_classes(text: str) -> None:
    option = Option("--classes", "N,N")
    assert value_of(option, "2,255") == {2, 255}
    assert value_of(option, None) is None
    assert furrowmap.ParcelSettings().classes is None
    with pytest.raises(UsageError, match="--classes"):
        value_of(option, text)


@pytest.mark.parametrize(
    ("roll_deg", "pitch_deg"), [(180.0, 0.0), (90.0, 0.0), (-90.0, 0.0), (0.0, 90.0), (0.0, 180.0)]
)
def test_an_imu__by_which_a_standing_vehicle_is_not_upright(roll_deg: float, pitch_deg: float) -> None:
    t_s, mounting = np.arange(0.0, 10.0), Mounting((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))

    def checked(roll: float, pitch: float) -> TurnedMounting | None:
        still = trajectory_from_attitude(t_s, np.zeros((10, 3)), roll, pitch, 30.0, max_gap_s=2.0)
        return turned_mounting(still, mounting, "imu.csv", on_wheels=True)

    assert checked(10.0, -10.0) is None
    with pytest.raises(InputError, match="on its side or upside down") as refused:
        checked(roll_deg, pitch_deg)
    assert refused.value.code == "imu-turned"
    assert "would set it upright" in refused.value.remedy


SESSION = """\
furrowmap = 1
[recording]
lidar = ["empty.pcap"]
gnss = ["gnss.nmea"]
[crs]
map = "EPSG:6677"
[lidar]
xyz_m = [0.0, 0.0, 2.0]
rpy_deg = [0.0, 0.0, 0.0]
[antenna]
xyz_m = [0.0, 0.0, 2.5]
[implement]
width_m = 3.0
xy_m = [-1.0, 0.0]
"""


def test_recordings__without_returns_and_states_of_another_kind(tmp_path: Path) -> None:
    session = parse_session(SESSION)
    still = trajectory_from_attitude(np.arange(0.0, 10.0), np.zeros((10, 3)), 0.0, 0.0, 30.0, max_gap_s=2.0)
    with refusal("no-points", r"empty\.pcap: no laser returns"):
        refuse_empty(Placement.without_scans(still), still, session)
    log = tmp_path / "gnss.nmea"
    log.write_bytes(2 * sentence("GNGGA,120000.00,3530.0,N,13900.0,E,4,12,0.8,100.0,M,40.0,M,,"))
    with refusal("wrong-kind-of-file", "which gives no tool states"):
        external_states([log], session.implement, None, still)


def test_evaluation__of_one_position_beside_a_log(tmp_path: Path) -> None:
    def log(name: str, *seconds: int) -> Path:
        lines = (
            sentence(f"GNRMC,1200{s:02d}.00,A,3530.0,N,13900.0,E,0.1,90.0,230526,,,R")
            + sentence(f"GNGGA,1200{s:02d}.00,3530.0,N,13900.0,E,4,12,0.8,100.0,M,40.0,M,,")
            for s in seconds
        )
        (tmp_path / name).write_bytes(b"".join(lines))
        return tmp_path / name

    found = evaluate_logs(log("one.nmea", 5), str(log("reference.nmea", 3, 4, 5, 6, 7)))
    assert found.fix.tolist() == [4]
