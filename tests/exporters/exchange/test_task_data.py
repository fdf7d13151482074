"""Task data that another reader, and our own, take back: coordinates, states, totals."""

from __future__ import annotations

import json
import os
import shutil
import struct
from dataclasses import replace
from pathlib import Path

import geopandas as gpd
import numpy as np
import pytest
import shapely
from isoxml.converter.shapely_geom import ShapelyConverterV4
from isoxml.util.isoxml_io import isoxml_from_path

from furrowmap.core.coverage.task_work import task_works
from furrowmap.core.geodesy.projection import map_frame
from furrowmap.core.runtime.errors import InputError
from furrowmap.core.runtime.json_text import json_text
from furrowmap.core.values.session import Crs
from furrowmap.exporters.exchange.task_data import write_task_data
from furrowmap.exporters.files.result_folder import open_result
from furrowmap.exporters.vectors.geopackage import write_field
from tests.core.implement.drives_with_tool import FRAME
from tests.exporters.vectors.worked_field import TILLER, worked_field

DEGREE_M = 111_200.0


@pytest.fixture(scope="module")
def products(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The products of a run on a field in closed form, as far as task data are made of them."""
    folder = tmp_path_factory.mktemp("products")
    poses, work = worked_field()
    assert work.ground is not None
    ground = replace(work.ground, boundary=None, unworked=())
    write_field(folder / "field.gpkg", poses, FRAME.crs, replace(work, boundary=None, ground=ground))
    figures, hours = work.ground.figures, work.ground.figures.hours
    report = {
        "furrowmap": "0.1.0",
        "session_file": "session.toml",
        "session": {
            "name": "圃場 & <field>",
            "crs": {"map": "EPSG:6677", "heights": "ellipsoidal", "coordinates": "as-recorded"},
            "lidar": {},
            "field": {"boundary": None},
            "implement": {"width_m": TILLER.width_m, "xy_m": list(TILLER.xy_m), "kind": "tiller"},
        },
        "coordinates": {"frame": "JGD2011", "epoch": None},
        "inputs": [],
        "figures": {
            "start": "2025-06-15T15:06:40.000Z",
            "end": "2025-06-15T15:08:00.000Z",
            "points": 0,
            "bounds_m": [[0, 0, 0], [1, 1, 1]],
            "worked_area_ellipsoid_m2": figures.worked.ellipsoid_m2,
            "worked_length_m": figures.length_m,
            "distance_m": 76.0,
            "hours": {"working_s": hours.working_s, "turning_s": hours.turning_s, "idle_s": hours.idle_s},
        },
        "products": ["field.gpkg", "report.json"],
    }
    (folder / "report.json").write_text(json_text(report), encoding="utf-8")
    return folder


@pytest.fixture(scope="module")
def written(products: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    target = tmp_path_factory.mktemp("out") / "TASKDATA"
    notices = write_task_data(open_result(products), target)
    assert "boundary-from-work" in {notice.code for notice in notices}
    return target


def test_another_reader__finds_the_field_the_task_and_its_totals(products: Path, written: Path) -> None:
    content, binaries = isoxml_from_path(written)
    (field,), (task,) = content.partfields, content.tasks
    figures = json.loads((products / "report.json").read_text(encoding="utf-8"))["figures"]
    assert (field.designator, task.designator) == ("圃場 & <field>",) * 2
    assert task.partfield_id_ref == field.id
    totals = {
        int.from_bytes(value.process_data_ddi, "big"): value.process_data_value
        for value in task.times[0].data_log_values
    }
    assert totals == {
        116: round(figures["worked_area_ellipsoid_m2"]),
        117: round(1000.0 * figures["worked_length_m"]),
        118: round(1000.0 * (76.0 - figures["worked_length_m"])),
        119: round(figures["hours"]["working_s"]),
        120: round(figures["hours"]["turning_s"] + figures["hours"]["idle_s"]),
    }
    assert [log.filename for log in task.time_logs] == list(binaries) == ["TLG00001"]
    (device,) = content.devices
    described = {data.object_id for data in device.process_data}
    (tool,) = (element for element in device.elements if element.id == "DET-2")
    assert {reference.device_object_id for reference in tool.device_object_references} == described


def test_another_reader__finds_the_boundary_in_its_place(products: Path, written: Path) -> None:
    content, _ = isoxml_from_path(written)
    converter = ShapelyConverterV4()
    outline = shapely.union_all([converter.to_shapely_polygon(polygon) for polygon in content.partfields[0].polygons])
    coverage = gpd.read_file(products / "field.gpkg", layer="coverage").to_crs("EPSG:4326").union_all()
    assert shapely.covers(shapely.buffer(outline, 0.06 / DEGREE_M), coverage)
    closed = shapely.buffer(shapely.buffer(coverage, 1.3 / DEGREE_M), -1.1 / DEGREE_M)
    assert shapely.covers(closed, outline)


def test_records__are_where_the_tool_was(products: Path, written: Path) -> None:
    """Decoded with nothing of ours: a record every scan, at the middle of the tool's line, to the last digit stored."""
    data, at, rows, state = (written / "TLG00001.bin").read_bytes(), 0, [], None
    while at < len(data):
        ms, day, lat, lon, up, status, gps_ms, gps_day, count = struct.unpack_from("<IHiiiBIHB", data, at)
        at += struct.calcsize("<IHiiiBIHB")
        for _ in range(count):
            channel, value = struct.unpack_from("<Bi", data, at)
            at += 5
            if channel == 0:
                state = value
            else:
                assert value == 1700
        assert (gps_ms, gps_day) == (ms, day)
        rows.append((315_532_800 + 86_400 * day + ms / 1000.0, lon / 1e7, lat / 1e7, up / 1000.0, status, state))
    table = np.array(rows, np.float64)
    poses = gpd.read_file(products / "field.gpkg", layer="trajectory")
    heading = np.radians(poses["heading_deg"])
    frame = map_frame(Crs(map="EPSG:6677"))
    e = poses.geometry.x + TILLER.xy_m[0] * np.sin(heading)
    n = poses.geometry.y + TILLER.xy_m[0] * np.cos(heading)
    lon, lat = frame.to_lon_lat(e.to_numpy(), n.to_numpy())
    here = np.searchsorted(table[:, 0], poses["t_s"].to_numpy() - 6e-4)
    assert table[here, 0] == pytest.approx(poses["t_s"].to_numpy(), abs=6e-4)
    off_m = DEGREE_M * np.hypot(table[here, 2] - lat, (table[here, 1] - lon) * np.cos(np.radians(36)))
    assert off_m.max() < 0.015  # 1e-7° is 1.1 cm
    assert table[here, 3] == pytest.approx(poses.geometry.z.to_numpy(), abs=6e-4)
    words = poses["implement"].map({"down": 1, "up": 0, "unknown": 3}).to_numpy()
    assert np.mean(table[here, 5] == words) > 0.995  # transitions fall between scans
    assert set(table[:, 4].astype(int)) == {4, 5}


def test_our_own_reader__gives_the_same_ground(products: Path, written: Path) -> None:
    (work,) = task_works(written, crs="EPSG:6677").works
    assert work.notices == ()
    assert work.work.ground is not None
    coverage = gpd.read_file(products / "field.gpkg", layer="coverage").union_all()
    found = work.work.ground.coverage
    assert found.intersection(coverage).area / found.union(coverage).area > 0.985
    passes = gpd.read_file(products / "field.gpkg", layer="passes")
    begins = [p.times.begin_s for p in work.work.ground.passes]
    assert begins == pytest.approx([t.timestamp() for t in passes["start"]], abs=1e-3)
    assert work.task.local_minus_utc_s == 0.0
    assert work.implement.width_m == pytest.approx(1.7)


def test_archive__holds_the_same_in_a_folder(products: Path, written: Path, tmp_path: Path) -> None:
    write_task_data(open_result(products), tmp_path / "task.zip")
    shutil.unpack_archive(tmp_path / "task.zip", tmp_path / "out")
    same = {path.name: path.read_bytes() for path in written.iterdir()}
    assert {path.name: path.read_bytes() for path in (tmp_path / "out" / "TASKDATA").iterdir()} == same


def test_a_stated_boundary__is_the_fields(products: Path, tmp_path: Path) -> None:
    folder = tmp_path / "result"
    shutil.copytree(products, folder)
    ring = shapely.Polygon([(139.0, 36.0), (139.002, 36.0), (139.002, 36.001), (139.0, 36.001)], [
        [(139.0005, 36.0003), (139.001, 36.0003), (139.001, 36.0006)],
    ])  # fmt: skip
    boundary = gpd.GeoDataFrame(geometry=[shapely.MultiPolygon([ring])], crs="EPSG:4326").to_crs("EPSG:6677")
    boundary.to_file(folder / "field.gpkg", layer="boundary", engine="pyogrio")
    assert {notice.code for notice in write_task_data(open_result(folder), tmp_path / "out")} == {
        "crs-change-loose"
    }  # of the way
    content, _ = isoxml_from_path(tmp_path / "out")
    (polygon,) = content.partfields[0].polygons
    assert shapely.equals_exact(ShapelyConverterV4().to_shapely_polygon(polygon), ring, 1e-8)
    assert content.partfields[0].area == pytest.approx(20_000 - 750, rel=0.02)


@pytest.mark.parametrize("stated", ["boundary.geojson", "../../../etc/passwd", "/dev/zero", "a\0b"])
def test_promise_23__no_file_that_the_report_names_is_opened(products: Path, tmp_path: Path, stated: str) -> None:
    folder = tmp_path / "session" / "result"
    shutil.copytree(products, folder)
    os.mkfifo(folder.parent / "boundary.geojson")  # to open it would not end
    report = json.loads((folder / "report.json").read_text(encoding="utf-8"))
    report["session"]["field"]["boundary"] = stated
    report["session_file"] = "../session.toml"
    report["inputs"] += [{"name": stated, "bytes": 42, "sha256": "0" * 64}]
    (folder / "report.json").write_text(json.dumps(report), encoding="utf-8")
    notices = write_task_data(open_result(folder), tmp_path / "out")
    assert "boundary-from-work" in {notice.code for notice in notices}


def test_a_run_that_knows_no_tool__has_no_task_data(products: Path, tmp_path: Path) -> None:
    folder = tmp_path / "result"
    shutil.copytree(products, folder)
    report = json.loads((folder / "report.json").read_text(encoding="utf-8"))
    report["session"]["implement"] = None
    (folder / "report.json").write_text(json.dumps(report), encoding="utf-8")
    with pytest.raises(InputError) as error:
        write_task_data(open_result(folder), tmp_path / "out")
    assert error.value.code == "no-ground"
    assert not (tmp_path / "out").exists()
