"""A proposed session is one that loads, names its files, and says what is missing."""

from __future__ import annotations

import itertools
import shutil
import tomllib
from functools import reduce
from operator import xor
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st

from furrowmap.core.readers.reader import GivesScans, ReadOptions, open_recording
from furrowmap.core.runtime.errors import InputError
from furrowmap.core.session.examination import Examined
from furrowmap.core.session.opened import resolve
from furrowmap.core.session.proposal import FILL_IN, Proposal, common_folder, propose_session
from furrowmap.core.session.session_file import load_session, parse_session
from furrowmap.core.session.trial_files import TrialFiles
from furrowmap.core.values.rotation import mounting_rotation
from furrowmap.core.values.session import Session


def sentence(body: str) -> str:
    return f"${body}*{reduce(xor, body.encode()):02X}\r\n"


def nmea(path: Path, *, dated: bool = True) -> Path:
    """Twenty seconds near Otawara around 2016-01-21T08:18:02Z."""
    text = ""
    for second in range(53, 73):
        clock = f"08{17 + second // 60}{second % 60:02d}.00"
        if dated:
            text += sentence(f"GPRMC,{clock},A,3652.2000,N,14001.2000,E,0.0,0.0,210116,,,A")
        text += sentence(f"GPGGA,{clock},3652.2000,N,14001.2000,E,4,12,0.8,240.0,M,40.0,M,,")
    path.write_text(text, newline="")
    return path


@pytest.fixture
def capture(shared_data: Path, tmp_path: Path) -> Path:
    path = tmp_path / "field" / "recording.pcap"
    path.parent.mkdir()
    path.write_bytes((shared_data / "velodyne" / "vlp16_single_gps.pcap").read_bytes())
    return path


def proposed(folder: Path, *paths: Path) -> tuple[Proposal, Session]:
    proposal = propose_session([Examined.read(path) for path in paths], folder)
    (folder / "session.toml").write_text(proposal.text, encoding="utf-8")
    return proposal, load_session(folder / "session.toml")


def codes(proposal: Proposal) -> set[str]:
    return {notice.code for notice in proposal.missing}


def test_lidar_and_gnss__everything_they_tell_is_stated(capture: Path, tmp_path: Path) -> None:
    log = nmea(tmp_path / "gnss.nmea")
    proposal, session = proposed(tmp_path, log, capture)
    assert session.recording.lidar == ("field/recording.pcap",)
    assert session.recording.gnss == ("gnss.nmea",)
    assert session.crs.map == "EPSG:6677"
    assert session.lidar.model == "VLP-16"
    assert session.name == tmp_path.name
    assert [resolve(tmp_path / "session.toml", name) for name in session.recording.lidar] == [capture]
    assert codes(proposal) == {"no-mounting", "no-antenna", "no-implement"}
    assert {"recording", "time-overlap", "crs"} <= {notice.code for notice in proposal.found}


def test_commented_keys__load_as_they_stand_once_the_hash_signs_are_gone(capture: Path, tmp_path: Path) -> None:
    proposal, _ = proposed(tmp_path, capture, nmea(tmp_path / "gnss.nmea"))
    keys = ("[antenna]", "[implement]", "xyz_m", "rpy_deg", "kind", "width_m", "xy_m", "working_depth_m")
    filled = "\n".join(
        line.removeprefix("# ") if line.removeprefix("# ").startswith(keys) else line
        for line in proposal.text.splitlines()
    )
    session = parse_session(filled)
    assert session.antenna is not None
    assert session.implement is not None
    assert session.lidar.rpy_deg == (0.0, 40.0, 180.0)


def test_log_without_dates__is_given_the_scanners_day(capture: Path, tmp_path: Path) -> None:
    _, session = proposed(tmp_path, capture, nmea(tmp_path / "gnss.nmea", dated=False))
    assert session.recording.date == "2016-01-21"
    assert session.crs.map == "EPSG:6677"


def test_log_without_dates_alone__has_a_place_but_no_day(tmp_path: Path) -> None:
    proposal, session = proposed(tmp_path, nmea(tmp_path / "gnss.nmea", dated=False))
    assert session.recording.date is None
    assert "# date = " in proposal.text
    assert session.crs.map == "EPSG:6677"


def test_lidar_alone__loads_and_says_what_is_missing(capture: Path, tmp_path: Path) -> None:
    proposal, session = proposed(tmp_path, capture)
    assert (session.recording.gnss, session.crs.map) == ((FILL_IN,), FILL_IN)
    assert {"no-positions", "no-crs"} <= codes(proposal)


def test_trajectory__replaces_gnss(capture: Path, tmp_path: Path) -> None:
    path = tmp_path / "poses.csv"
    rows = "".join(f"{1453364280 + i},20.95,52.3,110,0,0,90\n" for i in range(5))
    path.write_text("time_unix_s,lon_deg,lat_deg,h_m,roll_deg,pitch_deg,heading_deg\n" + rows)
    proposal, session = proposed(tmp_path, capture, path)
    assert session.trajectory is not None
    assert session.trajectory.files == ("poses.csv",)
    assert session.recording.gnss == ()
    assert session.crs.map == "EPSG:2180"
    assert "no-antenna" not in codes(proposal)


@pytest.mark.parametrize(("shift_m", "crs"), [(0.0, "EPSG:32634"), (5e4, FILL_IN)])
def test_trajectory_in_the_map__is_placed_by_its_longitudes_and_latitudes(
    shift_m: float, crs: str, tmp_path: Path
) -> None:
    # 52.3 N 21 E lies on UTM 34's central meridian, where easting is 500 km by definition.
    path = tmp_path / "poses.csv"
    rows = "".join(f"{1453364280 + i},{5e5 + shift_m},5794291,110,0,0,90,52.3,21\n" for i in range(5))
    path.write_text("time_unix_s,e_m,n_m,h_m,roll_deg,pitch_deg,heading_deg,lat_deg,lon_deg\n" + rows)
    proposal, session = proposed(tmp_path, path)
    assert session.crs.map == crs
    assert ("no-place" in codes(proposal)) == (crs == FILL_IN)


def test_recordings_apart__are_told_with_the_offset_that_would_fit(capture: Path, tmp_path: Path) -> None:
    log = nmea(tmp_path / "gnss.nmea")
    log.write_text("".join(sentence(line[1:-3].replace(",08", ",17")) for line in log.read_text().splitlines()))
    proposal, session = proposed(tmp_path, capture, log)
    (text,) = (notice.text for notice in proposal.missing if notice.code == "time-overlap")
    assert "lidar_minus_gnss_s = -32400.0" in text
    assert session.recording.lidar_minus_gnss_s == 0.0


@settings(max_examples=40, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.text(st.characters(exclude_characters="/\0", exclude_categories=["Cs"]), min_size=1, max_size=40))
def test_promise_22__any_file_name_comes_back_from_the_session(tmp_path: Path, name: str) -> None:
    assume(name not in (".", ".."))
    log = nmea(tmp_path / name)
    text = propose_session([Examined.read(log)], tmp_path).text
    log.unlink()
    assert parse_session(text).recording.gnss == (name,)


def test_name_that_is_no_text__is_refused(tmp_path: Path) -> None:
    log = nmea(tmp_path / "gnss\udcff.nmea")
    with pytest.raises(InputError, match="UTF-8"):
        propose_session([Examined.read(log)], tmp_path)


@pytest.mark.parametrize("bag", ["leo_rover_points.bag", "leo_rover_points_db3", "leo_rover_points_mcap"])
def test_bag__is_named_for_its_scans_and_for_its_positions(bag: str, shared_data: Path, tmp_path: Path) -> None:
    original = shared_data / "rosbag" / bag
    (shutil.copytree if original.is_dir() else shutil.copyfile)(original, tmp_path / bag)
    proposal, session = proposed(tmp_path, tmp_path / bag)
    assert session.recording.lidar == session.recording.gnss
    assert session.recording.lidar == (bag,)
    said = {line.split(" = ")[0]: before for before, line in itertools.pairwise(proposal.text.splitlines())}
    assert (said["lidar"].endswith("(recorder)"), said["gnss"].endswith("(gnss)")) == (True, True)
    assert resolve(tmp_path / "session.toml", bag) == (tmp_path / bag).resolve()
    assert session.crs.map == "EPSG:2180"
    assert codes(proposal) == {"no-mounting", "no-antenna", "no-implement"}


def test_bag_without_scans__is_named_for_its_positions_and_its_imu(shared_data: Path) -> None:
    folder = shared_data / "rosbag"
    text = propose_session([Examined.read(folder / "husky_imu_odom_fix.bag")], folder).text
    session = parse_session(text)
    assert (session.recording.lidar, session.recording.gnss) == ((), ("husky_imu_odom_fix.bag",))
    assert session.imu is not None
    assert session.imu.files == ("husky_imu_odom_fix.bag",)


def test_finished_cloud__is_no_recording(shared_data: Path, capture: Path) -> None:
    cloud = Examined.read(shared_data / "las" / "good" / "las12_pf3_autzen_trim.laz")
    with pytest.raises(InputError) as refused:
        propose_session([cloud], cloud.path.parent)
    assert refused.value.code == "no-recording"
    assert "furrowmap surface" in "\n".join(refused.value.lines)
    shutil.copyfile(cloud.path, capture.with_name("cloud.laz"))
    proposal, session = proposed(capture.parent, capture, capture.with_name("cloud.laz"))
    assert session.recording.lidar == (capture.name,)
    assert "recording-unused" in codes(proposal)


def test_recording_outside__is_refused(capture: Path, tmp_path: Path) -> None:
    (tmp_path / "elsewhere").mkdir()
    with pytest.raises(InputError, match="outside"):
        propose_session([Examined.read(capture)], tmp_path / "elsewhere")


def test_common_folder__is_the_nearest_that_holds_all(tmp_path: Path) -> None:
    (tmp_path / "a" / "b").mkdir(parents=True)
    assert common_folder([tmp_path / "a" / "x.pcap"]) == tmp_path / "a"
    assert common_folder([tmp_path / "a" / "x.pcap", tmp_path / "a" / "b" / "y.nmea"]) == tmp_path / "a"
    with pytest.raises(InputError, match="no folder in common"):
        common_folder([Path("/dev/x.pcap"), Path("/proc/y.nmea")])


def test_task_data__make_a_session_without_a_scanner(shared_data: Path, tmp_path: Path) -> None:
    shutil.copyfile(shared_data / "isoxml/field_days/tillage_two_fields_holes.zip", tmp_path / "day.zip")
    proposal = propose_session([Examined.read(tmp_path / "day.zip")], tmp_path)
    session = parse_session(proposal.text)
    assert session.recording.lidar == ()
    assert session.recording.gnss == ("day.zip",)
    assert session.implement is not None
    assert (session.implement.states, session.implement.width_m) == (("day.zip",), 10.0)
    assert session.crs.map == "EPSG:25832"
    assert '# task = "TSK2"   # FieldWithHoles' in proposal.text
    assert {notice.code for notice in proposal.missing} == {"no-antenna", "no-implement"}


def test_imu__is_named_with_its_mounting_left_to_fill_in(shared_data: Path) -> None:
    folder = shared_data / "uav_wheat"
    recordings = [Examined.read(folder / name) for name in ("imu.csv", "gnss.nmea")]
    proposal = propose_session(recordings, folder)
    session = parse_session(proposal.text)
    assert session.imu is not None
    assert session.imu.files == ("imu.csv",)
    assert session.recording.lidar == ()
    assert "no-imu-mounting" in [notice.code for notice in proposal.missing]
    assert not [notice for notice in proposal.missing if notice.code in ("no-lidar", "recording-unused")]


def test_flight__is_proposed_with_angles_that_a_run_refines(shared_data: Path) -> None:
    """Against the mounting that the flight was simulated with; 3° is what a run finds by the strips."""
    folder = shared_data / "uav_wheat"
    beside = TrialFiles.among(sorted(folder.iterdir()))
    recordings = [Examined.read(folder / name) for name in ("recording.pcap.gz", "imu.csv", "gnss.nmea")]
    proposal = propose_session(recordings, folder, beside=beside)
    session = parse_session(proposal.text)
    assert session.lidar.rpy_deg is not None
    truth = tomllib.loads((folder / "truth" / "mounting_truth.toml").read_text())["lidar"]["rpy_deg"]
    off = mounting_rotation(*session.lidar.rpy_deg) @ mounting_rotation(*truth).T
    assert np.degrees(np.arccos((np.trace(off) - 1.0) / 2.0)) < 3.0
    assert session.imu is not None
    assert (session.imu.rpy_deg, session.antenna and session.antenna.xyz_m) == ((180.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    assert session.camera is not None
    assert (session.camera.table, session.camera.is_known) == ("images.csv", False)
    assert session.parcels is not None
    assert (session.parcels.file, session.parcels.treatments) == ("parcels.geojson", "treatments.csv")
    assert session.crs.map == "EPSG:25832"
    for word in ("axle", "tiller", "[implement]", "[field]"):
        assert word not in proposal.text
    without_camera = proposal.text.partition("[camera]")[0] + proposal.text.partition("[parcels]")[2]
    assert without_camera.count(FILL_IN) == 4  # numbers to measure
    assert codes(proposal) == {"no-mounting", "no-imu-mounting", "camera-uncalibrated"}


def test_logs_of_the_same_time__the_first_is_used(shared_data: Path) -> None:
    folder = shared_data / "uav_wheat"
    names = ("imu.csv", "gnss.nmea", "gnss_outage.nmea", "ahrs_imu.csv")
    proposal = propose_session([Examined.read(folder / name) for name in names], folder)
    session = parse_session(proposal.text)
    assert session.recording.gnss == ("gnss.nmea",)
    assert "gnss_outage.nmea" in next(n.text for n in proposal.missing if n.code == "recording-unused")
    assert session.attitude is None  # of no use beside an IMU
    assert '# roll_pitch = "ahrs_imu.csv"' in proposal.text


def test_attitudes_without_an_imu__are_of_a_flight(shared_data: Path) -> None:
    folder = shared_data / "uav_wheat"
    names = ("recording.pcap.gz", "gnss.nmea", "ahrs_imu.csv")
    proposal = propose_session([Examined.read(folder / name) for name in names], folder)
    session = parse_session(proposal.text)
    assert session.attitude is not None
    assert session.antenna is not None
    assert session.antenna.xyz_m == (0.0, 0.0, 0.0)
    assert [word for word in ("axle", "tiller", "[implement]") if word in proposal.text] == []


def test_ouster_without_product_line__gets_no_model(shared_data: Path, tmp_path: Path) -> None:
    """Its metadata, of firmware before 1.14, name none, and every session with one was refused."""
    folder = shared_data / "foreign" / "22-ouster-init-model-Ouster"
    if not folder.is_dir():
        pytest.skip("the sample inputs of other software are not beside this checkout")
    for path in folder.iterdir():
        shutil.copy(path, tmp_path)
    proposal, session = proposed(tmp_path, tmp_path / "ouster_example.pcap", tmp_path / "gnss.nmea")
    assert "model =" not in proposal.text
    assert session.lidar.model is None
    for stated in (None, "Ouster", "OS1-64"):
        reader = open_recording([tmp_path / "ouster_example.pcap"], ReadOptions(model=stated))
        assert isinstance(reader, GivesScans)
        assert len(next(reader.scans()))
