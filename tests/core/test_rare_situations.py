"""Errors and warnings of situations that no other test brings about."""

from __future__ import annotations

import os
import sqlite3
import struct
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import laspy
import msgspec
import numpy as np
import pytest
import pyubx2
from pyproj import CRS

import furrowmap
from furrowmap import CleanSettings, SurfaceSettings, clean, surface
from furrowmap.cli.main import command_line
from furrowmap.core.accuracy.evaluation import evaluate
from furrowmap.core.accuracy.receiver_logs import evaluate_logs
from furrowmap.core.geodesy.crs_change import crs_change
from furrowmap.core.geodesy.projection import map_frame
from furrowmap.core.implement.external_states import compare_states, external_states
from furrowmap.core.pipeline.notices import placement_notices, refuse_empty, session_notices
from furrowmap.core.pointclouds.joined_clouds import no_points_error, open_clouds
from furrowmap.core.pointclouds.placed_scans import Placement
from furrowmap.core.readers.isoxml.log import TaskDataLog
from furrowmap.core.readers.las.cloud import open_cloud
from furrowmap.core.readers.poses.csv import PoseCsv
from furrowmap.core.readers.poses.sbet import Sbet
from furrowmap.core.readers.reader import ReadOptions, Recognised
from furrowmap.core.readers.rtklib.pos import RtklibPos
from furrowmap.core.readers.sbf.log import SbfLog
from furrowmap.core.readers.source import look
from furrowmap.core.readers.surveyed_points import read_points
from furrowmap.core.readers.ubx.log import UbxLog
from furrowmap.core.runtime.errors import FurrowmapError
from furrowmap.core.runtime.write_errors import writing
from furrowmap.core.session.session_file import parse_session
from furrowmap.core.simulator.scenario import demo_scenario, load_scenario
from furrowmap.core.simulator.simulate import simulate
from furrowmap.core.trajectory.from_gnss import trajectory_from_gnss
from furrowmap.core.trajectory.from_poses import trajectory_from_poses
from furrowmap.core.trajectory.located import Located
from furrowmap.core.values.gnss import Fix, GnssTrack
from furrowmap.core.values.session import Crs
from furrowmap.core.values.tool_states import ToolStates
from furrowmap.results import read_raster
from tests.core.readers.isoxml.time_logs import Record, header, task_data
from tests.core.readers.test_sbet import records
from tests.core.readers.test_sbf import pvt
from tests.fuzz.positions import ubx

HEADER = "time_unix_s,e_m,n_m,h_m,roll_deg,pitch_deg,heading_deg"
OPTIONS = ReadOptions(week=2422)
SESSION = """furrowmap = 1
name = "field"
[recording]
lidar = ["a.pcap"]
gnss = ["a.nmea"]
[crs]
map = "EPSG:6677"
[antenna]
xyz_m = [1.85, 0.0, 1.62]
"""


def code_of(act: Any) -> str:
    """The code of the error that something ends in."""
    with pytest.raises(FurrowmapError) as refused:
        act()
    assert all(refused.value.lines)
    return refused.value.code


def codes(notices: Any) -> set[str]:
    return {notice.code for notice in notices}


def track(n: int = 100, step_s: float = 0.1, **columns: Any) -> GnssTrack:
    """A drive to the north at 1 m/s."""
    t_s = 1.78e9 + step_s * np.arange(n)
    usual = {
        "lon_deg": np.full(n, 140.0),
        "lat_deg": 36.87 + np.arange(n) * step_s / 111_000.0,
        "height_m": np.full(n, 80.0),
        "fix": np.full(n, Fix.FIXED),
    }
    return GnssTrack.build(t_s, source="log", **(usual | columns))


def csv(folder: Path, *rows: str, head: str = HEADER, name: str = "trajectory.csv") -> Path:
    path = folder / name
    path.write_text("\n".join([head, *rows, ""]), encoding="utf-8")
    return path


def row(k: int, place: str = "100.5,200.5,30.25") -> str:
    return f"{1781141019.8 + 0.01 * k:.2f},{place},1.5,-0.5,90.0"


def test_a_scenario__that_cannot_be_read_or_simulated(tmp_path: Path) -> None:
    assert code_of(lambda: load_scenario(tmp_path)) == "scenario-unreadable"
    scenario = demo_scenario()
    huge = msgspec.structs.replace(scenario.field, size_e_m=1e5, size_n_m=1e5)
    large = msgspec.structs.replace(scenario, field=huge)
    assert code_of(lambda: simulate(large, tmp_path / "a")) == "scenario-too-large"
    for crs in ("EPSG:4326", "EPSG:0", "no CRS"):
        place = msgspec.structs.replace(scenario.place, crs=crs)
        moved = msgspec.structs.replace(scenario, place=place)
        assert code_of(lambda moved=moved: simulate(moved, tmp_path / "b")) == "scenario-crs"


def test_a_command__that_does_not_exist(capsys: pytest.CaptureFixture[str]) -> None:
    assert command_line(["inspekt", "--json"]) == 2
    said = capsys.readouterr()
    assert "furrowmap inspect" in said.out + said.err


def test_a_cloud__given_twice_or_cut_while_it_is_read(tmp_path: Path) -> None:
    points = laspy.LasData(laspy.LasHeader(point_format=6, version="1.4"))
    points.x, points.y, points.z = np.random.default_rng(1).uniform(0.0, 10.0, (3, 5000))
    path = tmp_path / "a.las"
    points.write(path)
    assert code_of(lambda: open_clouds([path, tmp_path / "." / "a.las"])) == "cloud-twice"
    batches = open_cloud(path).batches(batch_points=1000)
    next(batches)
    os.truncate(path, path.stat().st_size // 2)
    assert code_of(lambda: list(batches)) == "file-changed"


def test_a_file__that_may_not_be_opened() -> None:
    if os.geteuid() != 0:
        pytest.skip("needs root, to become somebody who may not")
    with tempfile.TemporaryDirectory(dir="/tmp") as folder:
        Path(folder).chmod(0o755)
        closed = Path(folder, "closed")
        closed.mkdir()
        for path in (Path(folder, "log.nmea"), closed / "log.nmea"):
            path.write_text("$GNGGA")
            path.chmod(0)
        closed.chmod(0)
        os.seteuid(65534)
        try:
            for path in (Path(folder, "log.nmea"), closed / "log.nmea"):
                assert code_of(lambda path=path: look(path)) == "unreadable"
        finally:
            os.seteuid(0)


def test_positions__whose_use_is_doubtful_or_refused() -> None:
    frame = map_frame(Crs(map="EPSG:6677"))
    course = trajectory_from_gnss(track(heading_deg=np.full(100, 2.0)), frame, (0.0, 0.0, 1.0), None)
    assert "antennas-heading-off" in codes(course.notices)
    wild = np.random.default_rng(2).normal(0.0, 2.0, 300) / 111_000.0
    unsteady = track(300, lat_deg=36.87 + np.arange(300) / 1_110_000.0 + wild, sigma_e_m=np.full(300, 0.01))
    assert code_of(lambda: trajectory_from_gnss(unsteady, frame, (0.0, 0.0, 1.0), None)) == "gnss-unsteady"


def test_a_path__that_does_not_fit_a_wheeled_vehicle() -> None:
    """Positions of an antenna that sways by decimetres from side to side."""
    n = 400
    sway = 0.15 * np.sin(2.0 * np.pi * 0.9 * np.arange(n) * 0.1) / 89_000.0
    found = trajectory_from_gnss(track(n, lon_deg=140.0 + sway), map_frame(Crs(map="EPSG:6677")), (0.0, 0.0, 1.0), None)
    assert "gnss-outliers" in codes(found.notices)


def test_trajectories__of_two_kinds_or_of_no_known_time(tmp_path: Path) -> None:
    one = csv(tmp_path, row(0), row(1), row(2))
    degrees = HEADER.replace("e_m,n_m", "lon_deg,lat_deg")
    other = csv(tmp_path, row(3, "140.0,36.0,30.0"), row(4, "140.0,36.0,30.0"), head=degrees, name="b.csv")
    assert code_of(lambda: PoseCsv([one, other], OPTIONS).poses()) == "mixed-trajectories"
    table = records(10)
    table[:, 0] += 3e7
    early = tmp_path / "early.sbet"
    early.write_bytes(table.astype("<f8").tobytes())
    assert code_of(lambda: Sbet([early], ReadOptions()).poses()) == "unknown-time-scale"
    table[4, 1] = 99.0
    early.write_bytes(table.astype("<f8").tobytes())
    assert code_of(lambda: Sbet([early], ReadOptions()).poses()) == "damaged-record"
    lone = PoseCsv([one], OPTIONS).poses()
    empty = replace(
        lone,
        t_s=lone.t_s[:1], position=lone.position[:1], roll_deg=lone.roll_deg[:1], pitch_deg=lone.pitch_deg[:1],
        heading_deg=lone.heading_deg[:1], sigma=lone.sigma[:1],
    )  # fmt: skip
    frame = map_frame(Crs(map="EPSG:6677"))
    assert code_of(lambda: trajectory_from_poses(empty, frame)) == "trajectory-empty"
    assert code_of(lambda: evaluate_logs(one, str(one))) == "trajectory-projected"


def test_a_solution__written_from_its_end(tmp_path: Path) -> None:
    head = "%  GPST                  latitude(deg) longitude(deg)  height(m)   Q  ns\n"
    rows = [f"2026/06/11 08:04:{59 - k:02d}.000   43.05{k:07d}  141.34{k:07d}  84.6  1  20\n" for k in range(20)]
    path = tmp_path / "solution.pos"
    path.write_text(head + "".join(rows))
    reader = RtklibPos([path], ReadOptions())
    assert len(reader.track()) == 20
    assert "written-backward" in codes(reader.notices)


def test_a_reference__that_is_too_coarse_and_covers_little() -> None:
    t = 0.1 * np.arange(2000)
    bent = {"lat_deg": 36.87 + 3e-5 * np.sin(0.9 * t), "lon_deg": 140.0 + 3e-5 * np.cos(0.9 * t)}
    test = track(2000, **bent)
    few = replace(track(2000, **bent)[np.arange(0, 600, 15)], source="reference")
    assert {"interpolation-coarse", "half-compared"} <= codes(evaluate(test, few, max_gap_s=5.0).notices)


def test_task_data__with_doubtful_parts(tmp_path: Path) -> None:
    place = {"A": 430500000, "B": 1413400000, "D": 4}
    rows = [Record(1000 * k, 16967, place | {"A": 430500000 + 90 * k}, {0: 1}) for k in (0, 1, 2, 9, 4, 5, 10)]
    head = header([(141, "DET-1")])
    body = (
        '<TSK A="TSK1" G="4"><TLG A="TLG00001"/><TLG A="TLG00002"/><TLG A="TLG00003"/></TSK>'
        '<PFD A="PFD1" C="a"/><PFD A="PFD1" C="b"/>'
    )
    logs = {"TLG00001": (head, b"".join(r.pack() for r in rows)), "TLG00002": (head, b"")}
    path = task_data(tmp_path / "TASKDATA", body, logs)
    reader = TaskDataLog([path], ReadOptions())
    assert len(reader.track()) == 5
    lost = next(notice.text for notice in reader.notices if notice.code == "time-log-lost")
    assert "missing file TLG00003." in lost
    assert {"time-backwards", "time-log-empty", "id-twice"} <= codes(reader.notices)
    assert code_of(lambda: TaskDataLog([path], ReadOptions(task="TSK9")).track()) == "no-such-task"


def test_states__without_a_time_in_common() -> None:
    def states(begin_s: float) -> ToolStates:
        nan = np.full(1, np.nan)
        return ToolStates(np.array([begin_s]), np.array([begin_s + 5.0]), np.array([1], np.int8), np.ones(1), nan, nan)

    assert codes(compare_states(states(0.0), states(100.0)).notices(replaced=False)) == {"states-not-compared"}


def test_a_crs__on_a_planet_of_its_own() -> None:
    moon = CRS.from_proj4("+proj=tmerc +lon_0=140 +a=1737400 +b=1737400 +units=m")
    found = code_of(lambda: crs_change(CRS("EPSG:6677"), moon, (0.0, 0.0, 1.0, 1.0)))
    assert found == "crs-change-unknown"


def test_a_run__of_which_little_is_left() -> None:
    session = parse_session(SESSION)
    course = trajectory_from_gnss(track(), map_frame(session.crs), (0.0, 0.0, 1.0), None).trajectory
    nothing = Placement.without_scans(course)
    standing = replace(nothing, scans_standing=3, points_read=300, points=0, points_standing=300)
    assert code_of(lambda: refuse_empty(standing, course, session)) == "only-standing"
    assert "points-without-pose" in codes(placement_notices(replace(standing, points_without_pose=30)))
    with_imu = parse_session(SESSION + '[imu]\nfiles = ["imu.csv"]\n')
    found = session_notices(with_imu, Located(course, "file", {}, ()), matched=True)
    assert {"gnss-unused", "imu-unused"} <= codes(found)


def test_points__of_a_cloud_that_nothing_is_left_of(tmp_path: Path) -> None:
    points = laspy.LasData(laspy.LasHeader(point_format=6, version="1.4"))
    points.x, points.y, points.z = np.random.default_rng(1).uniform(0.0, 10.0, (3, 500))
    points.write(tmp_path / "a.las")
    clouds = open_clouds([tmp_path / "a.las"], CRS("EPSG:6677"))
    assert no_points_error(clouds, (50.0, 50.0, 60.0, 60.0)).code == "no-points-left"


def test_a_bag__of_a_folder_without_its_files(tmp_path: Path) -> None:
    (tmp_path / "metadata.yaml").write_text("rosbag2_bagfile_information:\n  version: 5\n  relative_file_paths: []\n")
    assert code_of(lambda: Recognised.by_content(tmp_path).inspect()) == "bag-folder-empty"


def test_sbf__with_fixes_in_two_dimensions(tmp_path: Path) -> None:
    path = tmp_path / "log.sbf"
    path.write_bytes(b"".join(pvt(1000 * k, mode=128 + 1) for k in range(8)))
    reader = SbfLog([path], ReadOptions())
    assert len(reader.track()) == 8
    assert "positions-2d" in codes(reader.notices)


def test_ubx__with_precise_positions_of_other_times(tmp_path: Path) -> None:
    place = (360_000_500, 1_413_400_000, 430_500_000, 84_600, 55_500, 0, 0, 0, 0, 9, 9)
    alone = struct.pack("<BHBIiiiibbbbII", 0, 0, 0, *place)
    frame = pyubx2.UBXMessage(b"\x01", b"\x14", pyubx2.GET, payload=alone).serialize()
    path = tmp_path / "log.ubx"
    path.write_bytes(ubx() + frame)
    reader = UbxLog([path], ReadOptions())
    assert len(reader.track()) == 10
    assert "positions-without-fix" in codes(reader.notices)


def test_states__that_are_all_unknown(tmp_path: Path) -> None:
    path = csv(tmp_path, "2026-06-11T08:00:00Z,unknown", "2026-06-11T08:10:00Z,unknown", head="time,state")
    session = parse_session(SESSION + "[implement]\nwidth_m = 1.7\nxy_m = [-1.4, 0.0]\n")
    course = trajectory_from_gnss(track(), map_frame(session.crs), (0.0, 0.0, 1.0), None).trajectory
    assert code_of(lambda: external_states([path], session.implement, None, course)) == "no-states"


def test_surveyed_points__without_all_coordinates(tmp_path: Path) -> None:
    path = csv(tmp_path, "A,16600.0,96500.0,80.0", "B,16601.0,,80.0", head="name,e_m,n_m,h_m", name="points.csv")
    found = read_points(path, CRS("EPSG:6677"))
    assert "points-incomplete" in codes(found.notices)


def test_clouds__whose_points_lack_times_returns_or_classes(tmp_path: Path) -> None:
    header = laspy.LasHeader(point_format=0, version="1.2")
    header.add_extra_dims([laspy.ExtraBytesParams(name="scan", type=np.uint8)])
    points = laspy.LasData(header)
    points.x, points.y, points.z = np.random.default_rng(1).uniform(0.0, 10.0, (3, 500))
    points.write(tmp_path / "a.las")
    report = clean([tmp_path / "a.las"], tmp_path / "b.copc.laz", CleanSettings(crs="EPSG:6677"))
    assert {"times-none", "returns-zero", "dimensions-left-out"} <= {warning["code"] for warning in report["warnings"]}
    settings = SurfaceSettings(ground="class", crs="EPSG:6677")
    assert code_of(lambda: surface([tmp_path / "a.las"], tmp_path / "out", settings)) == "no-ground-class"


def test_results__that_are_not_there_or_may_not_be_replaced(tmp_path: Path) -> None:
    (tmp_path / "session.toml").write_text("")
    assert code_of(lambda: furrowmap.simulate("demo", tmp_path)) == "exists"
    picture = tmp_path / "dsm.tif"
    picture.write_text("no raster")
    assert code_of(lambda: read_raster(picture)) == "raster-unreadable"


def test_a_product__that_a_library_cannot_write(tmp_path: Path) -> None:
    def write() -> None:
        with writing(tmp_path / "field.gpkg"):
            sqlite3.connect(":memory:").execute("no SQL")

    assert code_of(write) == "not-written"
