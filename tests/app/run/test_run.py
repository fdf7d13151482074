"""The folder of a run: whose products it holds, and what its files tell."""

from __future__ import annotations

import datetime as dt
import gzip
import json
import os
import shutil
from html import unescape
from pathlib import Path
from zoneinfo import ZoneInfo

import laspy
import numpy as np
import pyogrio
import pytest
import rasterio
from pyproj import CRS

import furrowmap
from furrowmap.core.runtime.errors import RefusedError
from furrowmap.core.session.session_file import load_session
from furrowmap.exporters.cloud.copc_file import las_wkt
from furrowmap.workflows.run.run import SPACE

SCANS_S = 1_453_364_282.341
"""The capture's first return by its GPS time."""
GPS_EPOCH_S, LEAP_S = 315_964_800, 17  # leap seconds in January 2016
DRIVE_COLUMNS = "time_unix_s,e_m,n_m,h_m,roll_deg,pitch_deg,heading_deg\n"
SESSION = """furrowmap = 1
[recording]
lidar = ["recording.pcap"]
[crs]
map = "EPSG:6677"
[trajectory]
files = ["drive.csv"]
"""


@pytest.fixture
def session(shared_data: Path, tmp_path: Path) -> Path:
    """A VLP-16's 0.4 s on a straight drive at 1 m/s eastward."""
    folder = tmp_path / "drive"
    folder.mkdir()
    shutil.copy(shared_data / "velodyne" / "vlp16_single_gps.pcap", folder / "recording.pcap")
    rows = "".join(f"{SCANS_S - 1 + i * 0.1:.3f},{16_650 + i * 0.1:.3f},96560,271,0,0,90\n" for i in range(31))
    (folder / "drive.csv").write_text(DRIVE_COLUMNS + rows)
    (folder / "session.toml").write_text(SESSION)
    return folder / "session.toml"


@pytest.mark.parametrize(
    "addition",
    ["[lidar]\nxyz_m = [0.0, 0.0, 2.1]\n", "[run]\nstanding = false\n", '[field]\nboundary = "boundary.geojson"\n'],
    ids=["mounting", "standing", "boundary"],
)
def test_run__replaces_those_of_the_same_recording_run_otherwise(
    session: Path, shared_data: Path, tmp_path: Path, addition: str
) -> None:
    furrowmap.run(session, tmp_path / "result")
    session.write_text(SESSION + addition)
    shutil.copyfile(shared_data / "tractor_loop" / "boundary.geojson", session.with_name("boundary.geojson"))
    table, key, *_ = addition.replace("[", "").replace("]", "").split()
    assert key in furrowmap.run(session, tmp_path / "result").report["session"][table]


def test_run__replaces_those_of_the_same_recording_with_another_trajectory_and_name(
    session: Path, tmp_path: Path
) -> None:
    before = furrowmap.run(session, tmp_path / "result").report
    drive = session.with_name("drive.csv")
    drive.write_text(drive.read_text().replace(",271,", ",272,"))
    renamed = session.rename(session.with_name("renamed.toml"))
    renamed.write_text(SESSION.replace("[recording]", 'name = "renamed"\n[recording]', 1))
    after = furrowmap.run(renamed, tmp_path / "result").report
    assert after["session"]["name"] != before["session"]["name"]
    assert [a == b for a, b in zip(after["inputs"], before["inputs"], strict=True)] == [True, False]


def test_run__keeps_those_of_another_recording_of_the_same_name(session: Path, tmp_path: Path) -> None:
    before = furrowmap.run(session, tmp_path / "result").report
    capture = session.with_name("recording.pcap")
    capture.write_bytes(capture.read_bytes()[: -(16 + 42 + 1206)])
    cloud = (tmp_path / "result" / "cloud.copc.laz").read_bytes()
    with pytest.raises(RefusedError, match="another recording"):
        furrowmap.run(session, tmp_path / "result")
    assert (tmp_path / "result" / "cloud.copc.laz").read_bytes() == cloud
    after = furrowmap.run(session, tmp_path / "result", overwrite=True).report
    assert [a == b for a, b in zip(after["inputs"], before["inputs"], strict=True)] == [False, True]


@pytest.mark.parametrize("again", [False, True])
def test_run__hashes_the_inputs_once_and_says_so(session: Path, tmp_path: Path, again: bool) -> None:
    if again:
        furrowmap.run(session, tmp_path / "result")
    told: list[tuple[str, float]] = []
    furrowmap.run(session, tmp_path / "result", progress=lambda stage, share: told.append((stage, share)))
    assert [share for stage, share in told if stage == "hashing inputs"].count(1.0) == 1


def test_products__tell_inside_where_they_come_from(session: Path, tmp_path: Path) -> None:
    result = tmp_path / "result"
    session.write_text(SESSION.replace("[recording]", 'name = "Acker ä"\n[recording]', 1))
    report = furrowmap.run(session, result).report
    with laspy.open(result / "cloud.copc.laz") as cloud:
        (words,) = [vlr.record_data for vlr in cloud.header.vlrs if vlr.record_id == 3 and vlr.user_id == "LASF_Spec"]
    with rasterio.open(result / "dsm.tif") as dsm:
        raster = dsm.tags()
    in_cloud = dict(line.split(": ", 1) for line in words.decode().splitlines())
    in_layers = pyogrio.read_info(result / "field.gpkg", layer="trajectory")["dataset_metadata"]
    for told in (in_cloud, in_layers, raster):
        assert told["SESSION"] == "Acker ä"
        assert told["COORDINATES"] == "as-recorded"
        assert (told["TIME_START"], told["TIME_END"]) == (report["figures"]["start"], report["figures"]["end"])
        assert told["MEASURED_EPOCH"] == "2016.056"
        assert [told[f"INPUT_{number}"] for number in (1, 2)] == [
            f"{file['name']} sha256:{file['sha256']}" for file in report["inputs"]
        ]
    assert in_cloud["SOFTWARE"] == in_layers["SOFTWARE"] == raster["TIFFTAG_SOFTWARE"]


@pytest.mark.parametrize(("stated", "zone"), [(None, "Asia/Tokyo"), ("America/Chicago", "America/Chicago")])
def test_times__are_those_of_the_place_or_of_the_setting(
    session: Path, tmp_path: Path, stated: str | None, zone: str
) -> None:
    session.write_text(SESSION + (f'[field]\ntime_zone = "{stated}"\n' if stated else ""))
    result = furrowmap.run(session, tmp_path / "result")
    figures = result.report["figures"]
    begin = dt.datetime.fromisoformat(figures["start"]).astimezone(ZoneInfo(zone))
    assert figures["time_zone"] == zone
    assert dt.datetime.fromisoformat(figures["start_local"]) == begin
    assert figures["start_local"] == begin.isoformat(timespec="milliseconds")
    page = (result.path / "report.html").read_text(encoding="utf-8")
    assert f"{begin:%Y-%m-%d}, {begin:%H:%M:%S} to" in page
    assert f"({zone}, UTC{begin:%z}"[:-2] in page


def test_report__tells_the_clouds_bounds_and_times(session: Path, tmp_path: Path) -> None:
    session.write_text(SESSION.replace("[crs]", "lidar_minus_gnss_s = 0.5\n[crs]"))
    figures = furrowmap.run(session, tmp_path / "result").report["figures"]
    cloud = laspy.read(tmp_path / "result" / "cloud.copc.laz")
    np.testing.assert_allclose(figures["bounds_m"], [cloud.xyz.min(0), cloud.xyz.max(0)], atol=1e-9)
    for name, gps_s in (("start", cloud.gps_time.min()), ("end", cloud.gps_time.max())):
        told_s = dt.datetime.fromisoformat(figures[name]).timestamp()
        assert told_s == pytest.approx(gps_s + 1e9 + GPS_EPOCH_S - LEAP_S, abs=0.001)
    assert figures["distance_m"] == pytest.approx(0.387, abs=0.005)


def test_page__shows_any_name_as_text(session: Path, tmp_path: Path) -> None:
    name = '<script>alert($title)</script> & "圃場"'
    session.write_text(SESSION.replace("[recording]", f"name = '{name}'\n[recording]", 1))
    furrowmap.run(session, tmp_path / "result")
    page = (tmp_path / "result" / "report.html").read_text(encoding="utf-8")
    assert "<script" not in page
    heading = page.partition("<h1>")[2].partition("</h1>")[0]
    assert '"' not in heading
    assert unescape(heading) == name


def test_report__tells_sigmas_that_were_measured_from_those_assumed(shared_data: Path, tmp_path: Path) -> None:
    with gzip.open(shared_data / "tractor_loop" / "recording.pcap.gz") as stream:
        (tmp_path / "recording.pcap").write_bytes(stream.read(24 + 1264 * 300))
    shutil.copy(shared_data / "tractor_loop" / "gnss.nmea", tmp_path)
    (tmp_path / "session.toml").write_text(
        SESSION[: SESSION.index("[trajectory]")].replace("[crs]", 'gnss = ["gnss.nmea"]\n[crs]')
        + "[antenna]\nxyz_m = [1.85, 0.0, 1.62]\n[lidar]\nxyz_m = [-0.55, 0.0, 2.35]\nrpy_deg = [0.8, 40.6, 179.3]\n"
    )
    accuracy = furrowmap.run(tmp_path / "session.toml", tmp_path / "result").report["accuracy"]
    assert accuracy.pop("assumed") == ["sigma_roll_deg", "sigma_pitch_deg"]
    assert accuracy.pop("unstated") == []
    assert accuracy.pop("unconfirmed") == ["antenna.xyz_m", "lidar.xyz_m", "lidar.rpy_deg"]
    assert accuracy.pop("matching") is None
    assert accuracy.pop("swaths") is None
    assert not (tmp_path / "result" / "swaths.tif").exists()
    assert accuracy["sigma_roll_deg"] == {"median": 1.0, "p95": 1.0}
    for name, told in accuracy.items():
        assert all(value > 0 for value in told.values()), name


def test_report__leaves_sigmas_open_that_a_trajectory_file_does_not_state(session: Path, tmp_path: Path) -> None:
    accuracy = furrowmap.run(session, tmp_path / "result").report["accuracy"]
    assert accuracy.pop("assumed") == []
    assert accuracy.pop("unstated") == ["lidar.xyz_m", "lidar.rpy_deg"]
    assert accuracy.pop("unconfirmed") == []
    assert accuracy.pop("matching") is None
    assert accuracy.pop("swaths") is None
    assert {value for told in accuracy.values() for value in told.values()} == {None}


def test_session_toml__beside_the_original_runs_to_the_same_cloud(session: Path, tmp_path: Path) -> None:
    result = tmp_path / "some where" / "result"
    report = furrowmap.run(session, result).report
    assert report["session_file"] == "../../drive/session.toml"
    assert (result / report["session_file"]).samefile(session)
    head = (result / "session.toml").read_text(encoding="utf-8").splitlines()[:3]
    assert head[1] == "#   ../../drive/session.toml"
    assert all(line.startswith("#") for line in head)
    again = session.with_name("understood.toml")
    shutil.copy(result / "session.toml", again)
    repeated = furrowmap.run(again, tmp_path / "again").report
    assert repeated["session"] == report["session"]
    assert (tmp_path / "again" / "cloud.copc.laz").read_bytes() == (result / "cloud.copc.laz").read_bytes()


@pytest.mark.skipif(os.name == "nt", reason="Windows knows no such file names")
def test_session_toml__cannot_be_added_to_by_the_name_of_the_original(session: Path, tmp_path: Path) -> None:
    odd = session.rename(session.with_name("a\n[run]\nstanding = false\udcff.toml"))
    furrowmap.run(odd, tmp_path / "result")
    assert load_session(tmp_path / "result" / "session.toml").run.standing is True


@pytest.mark.parametrize(
    "crs", ["EPSG:6677+6695", CRS("EPSG:6677").to_3d().to_wkt()], ids=["with a vertical CRS", "with heights"]
)
def test_cloud__states_the_horizontal_crs_of_one_with_heights(session: Path, tmp_path: Path, crs: str) -> None:
    session.write_text(SESSION.replace('"EPSG:6677"', json.dumps(crs)))
    furrowmap.run(session, tmp_path / "result")
    with laspy.open(tmp_path / "result" / "cloud.copc.laz") as cloud:
        assert cloud.header.parse_crs().to_epsg(min_confidence=20) == 6677


def test_las_wkt__is_wkt_1_or_where_that_lacks_the_projection_wkt_2() -> None:
    assert las_wkt(CRS("EPSG:6677")).startswith("PROJCS[")
    # Krovak's modified projection has no name in WKT 1.
    assert CRS.from_wkt(las_wkt(CRS("EPSG:5516"))) == CRS("EPSG:5516")


def test_promise_19__run_does_not_start_without_the_space_that_it_needs(
    session: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    size = (session.parent / "recording.pcap").stat().st_size
    usage = shutil.disk_usage(tmp_path)
    monkeypatch.setattr(shutil, "disk_usage", lambda _: usage._replace(free=SPACE * size - 1))
    with pytest.raises(RefusedError, match="needs at least") as raised:
        furrowmap.run(session, tmp_path / "new" / "result")
    assert raised.value.code == "disk-space"
    assert not (tmp_path / "new").exists()
    monkeypatch.setattr(shutil, "disk_usage", lambda _: usage._replace(free=SPACE * size))
    assert furrowmap.run(session, tmp_path / "new" / "result").report["figures"]["points"]
