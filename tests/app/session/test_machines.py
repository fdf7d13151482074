"""Profiles of machines: typed once, copied into sessions, corrected by calibration."""

from __future__ import annotations

import datetime as dt
import json
import math
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import furrowmap
from furrowmap.cli.main import command_line
from furrowmap.core.runtime.errors import InputError, RefusedError, UsageError
from furrowmap.core.session.machine_file import LearnedMounting, learned, load_machine, machine_text, parse_machine
from furrowmap.core.session.opened import resolve
from furrowmap.core.session.session_file import load_session
from furrowmap.core.values.machine import (
    NOT_SHOWN_DEG,
    Calibrated,
    Machine,
    MachineCamera,
    MachineImplement,
    MachineImu,
    MachineRecord,
)
from furrowmap.core.values.rotation import Mounting
from furrowmap.core.values.session import Antenna, Lidar

PLACES = st.tuples(*[st.floats(-15, 15)] * 3)
ANGLES = st.tuples(*[st.floats(-360, 360)] * 3)
MACHINES = st.builds(
    Machine,
    name=st.text(),
    antenna=st.none() | st.builds(Antenna, xyz_m=PLACES),
    lidar=st.none() | st.builds(Lidar, xyz_m=st.none() | PLACES, rpy_deg=st.none() | ANGLES),
    imu=st.none() | st.builds(MachineImu, xyz_m=PLACES, rpy_deg=ANGLES, kind=st.none() | st.just("VN-200")),
    camera=st.none() | st.builds(MachineCamera, xyz_m=PLACES, rpy_deg=ANGLES),
    implement=st.none()
    | st.builds(
        MachineImplement, width_m=st.floats(0.1, 12), xy_m=st.tuples(*[st.floats(-15, 15)] * 2), kind=st.text()
    ),
    calibrated=st.none() | st.builds(Calibrated, date=st.dates(), rpy_sigma_deg=st.tuples(*[st.floats(0, 180)] * 3)),
)


@pytest.fixture(autouse=True)
def machines(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    folder = tmp_path / "machines"
    monkeypatch.setenv("FURROWMAP_MACHINES", str(folder))
    return folder


@pytest.fixture
def drive(shared_data: Path) -> Path:
    return shared_data / "tractor_loop"


@given(MACHINES)
@settings(max_examples=25)
def test_profile__is_read_as_it_was_written(machine: Machine) -> None:
    assert parse_machine(machine_text(machine)) == machine


def test_saved_machine__gives_the_next_session_all_its_places(
    drive: Path, machines: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert command_line(["machine", "save", str(drive / "session.toml"), "Tractor 1, tiller"]) == 0
    assert (machines / "Tractor 1, tiller.toml").is_file()
    assert command_line(["machine", "list"]) == 0
    assert "Tractor 1, tiller  antenna, lidar, implement" in capsys.readouterr().out
    (tmp_path / "gnss.nmea").write_bytes((drive / "gnss.nmea").read_bytes()[:20_000])
    answer = ["init", str(tmp_path / "gnss.nmea"), "--machine", "Tractor 1, tiller", "--json"]
    assert command_line(answer) == 0
    missing = {notice["code"] for notice in json.loads(capsys.readouterr().out)["missing"]}
    assert missing == {"no-lidar"}
    made, stated = load_session(tmp_path / "session.toml"), load_session(drive / "session.toml")
    assert (made.antenna, made.implement) == (stated.antenna, stated.implement)
    assert made.lidar.mounting == stated.lidar.mounting
    assert not made.unstated


def test_profile_as_a_file__is_passed_on(drive: Path, tmp_path: Path) -> None:
    file = tmp_path / "shared" / "tractor.toml"
    saved = furrowmap.save_machine(drive / "session.toml", file)
    assert (saved.path, saved.name) == (file, "tractor")
    assert furrowmap.known_machines() == []
    (tmp_path / "gnss.nmea").write_bytes((drive / "gnss.nmea").read_bytes()[:20_000])
    made = furrowmap.propose_session([tmp_path / "gnss.nmea"], machine=file)
    assert load_session(made.path).antenna == load_session(drive / "session.toml").antenna


def session_with_tools(drive: Path, folder: Path, *tools: str) -> Path:
    """The session of the drive with other tools, and files of what was learned of them."""
    text = (drive / "session.toml").read_text(encoding="utf-8").partition("[implement]")[0]
    folder.mkdir()
    for name in ("recording.pcap.gz", "gnss.nmea"):
        (folder / name).symlink_to(drive / name)
    for name in ("implement.npz", "roller.npz"):
        (folder / name).write_bytes(name.encode())
    (folder / "session.toml").write_text("\n".join([text, *tools]), encoding="utf-8")
    return folder / "session.toml"


def test_learned_implement__goes_with_the_profile_into_the_next_session(
    drive: Path, machines: Path, tmp_path: Path
) -> None:
    tool = '[implement]\nwidth_m = 1.7\nxy_m = [-1.6, 0.0]\nkind = "rotary tiller"\n'
    stated = session_with_tools(drive, tmp_path / "monday", tool + 'learned = "implement.npz"\n')
    saved = furrowmap.save_machine(stated, "Tractor 1, tiller")
    assert (machines / "Tractor 1, tiller.npz").read_bytes() == b"implement.npz"
    with saved.path.open("a", encoding="utf-8") as profile:
        profile.write("\n[record]\nports = [2368]\n")
    again = session_with_tools(drive, tmp_path / "tuesday", tool)
    furrowmap.save_machine(again, "Tractor 1, tiller", overwrite=True)
    machine = load_machine(saved.path)
    assert machine.implement is not None
    assert machine.implement.learned == "Tractor 1, tiller.npz", "a session without one does not lose it"
    assert machine.record == MachineRecord(ports=(2368,))
    (tmp_path / "gnss.nmea").write_bytes((drive / "gnss.nmea").read_bytes()[:20_000])
    made = furrowmap.propose_session([tmp_path / "gnss.nmea"], machine="Tractor 1, tiller")
    (implement,) = load_session(made.path).implements
    assert resolve(made.path, str(implement.learned)).read_bytes() == b"implement.npz"
    (machines / "Tractor 1, tiller.npz").unlink()
    made = furrowmap.propose_session([tmp_path / "gnss.nmea"], machine="Tractor 1, tiller", overwrite=True)
    assert "machine-no-learned" in [notice.code for notice in made.missing]
    (implement,) = load_session(made.path).implements
    assert implement.learned is None
    (stated.parent / "implement.npz").unlink()
    with pytest.raises(InputError, match=r"'implement\.npz' does not exist"):
        furrowmap.save_machine(stated, "Tractor 2")
    (stated.parent / "implement.npz").mkdir()
    with pytest.raises(InputError, match=r"implement\.npz"):
        furrowmap.save_machine(stated, "Tractor 2")
    assert not (machines / "Tractor 2.toml").exists()


def test_learned_implements__of_several_are_told_apart_by_their_names(
    drive: Path, machines: Path, tmp_path: Path
) -> None:
    place = "[[implement]]\nwidth_m = 2.0\nxy_m = [{}, 0.0]\nname = {!r}\nlearned = {!r}\n"
    tools = [place.format(-1.6, "tiller", "implement.npz"), place.format(2.5, "roller 1/2", "roller.npz")]
    furrowmap.save_machine(session_with_tools(drive, tmp_path / "monday", *tools), "T1")
    assert (machines / "T1, tiller.npz").read_bytes() == b"implement.npz"
    assert (machines / "T1, roller 1_2.npz").read_bytes() == b"roller.npz"
    (tmp_path / "gnss.nmea").write_bytes((drive / "gnss.nmea").read_bytes()[:20_000])
    made = furrowmap.propose_session([tmp_path / "gnss.nmea"], machine="T1")
    found = [resolve(made.path, str(tool.learned)).read_bytes() for tool in load_session(made.path).implements]
    assert found == [b"implement.npz", b"roller.npz"]


def test_profile_of_other_parts__is_copied_where_they_were_recorded(tmp_path: Path) -> None:
    camera = MachineCamera(xyz_m=(0.1, 0.2, 0.3), rpy_deg=(180.0, 0.0, -90.0))
    imu = MachineImu(xyz_m=(0.0, 0.0, -0.3), rpy_deg=(180.0, 0.0, 0.0), kind="tactical")
    day = Calibrated(date=dt.date(2026, 6, 11), rpy_sigma_deg=(0.06, 0.05, NOT_SHOWN_DEG))
    lidar = Lidar(xyz_m=(-0.6, 0.0, 2.4), rpy_deg=(0.8, 40.6, 179.3))
    (tmp_path / "uav.toml").write_text(machine_text(Machine(lidar=lidar, imu=imu, camera=camera, calibrated=day)))
    rows = "".join(f"{1781141020 + k / 100:.2f},0,0,0.1,0,0,9.81\n" for k in range(200))
    (tmp_path / "imu.csv").write_text(
        "time_unix_s,gyro_x_dps,gyro_y_dps,gyro_z_dps,force_x_mps2,force_y_mps2,force_z_mps2\n" + rows
    )
    made = furrowmap.propose_session([tmp_path / "imu.csv"], machine=tmp_path / "uav.toml")
    session, text = load_session(made.path), made.path.read_text(encoding="utf-8")
    assert session.imu is not None
    assert (session.imu.xyz_m, session.imu.kind) == (imu.xyz_m, "tactical")
    assert "# [camera]\n" in text
    assert "# rpy_deg = [180.0, 0.0, -90.0]" in text


def test_learned_mounting__replaces_the_angles_and_says_when_and_how_well() -> None:
    machine = Machine(name="T", lidar=Lidar(xyz_m=(0.0, 0.0, 2.0), rpy_deg=(0.0, 40.0, 180.0)))
    shown = LearnedMounting(Mounting((0.0, 0.0, 2.0), (0.5, 40.5, 180.0)), (0.06, 0.05, math.inf), dt.date(2026, 6, 11))
    after = parse_machine(machine_text(learned(machine, shown)))
    assert after.lidar == Lidar(xyz_m=(0.0, 0.0, 2.0), rpy_deg=(0.5, 40.5, 180.0))
    assert after.calibrated == Calibrated(date=dt.date(2026, 6, 11), rpy_sigma_deg=(0.06, 0.05, NOT_SHOWN_DEG))


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("furrowmap = 1\n", "furrowmap_machine = 1"),
        ("furrowmap_machine = 1\n[antenna", "not valid TOML"),
        ("furrowmap_machine = 1\n[antenna]\nxyz = [1, 2, 3]\n", "xyz"),
        ("furrowmap_machine = 1\n[antenna]\nxyz_m = [1850, 0, 1620]\n", "more than 15 m"),
        ("furrowmap_machine = 1\n[antenna]\nxyz_m = [nan, 0, 1.6]\n", "finite"),
    ],
)
def test_profile__that_is_none_is_refused_with_the_reason(text: str, told: str) -> None:
    with pytest.raises(InputError, match=r"machine\.toml") as refused:
        parse_machine(text)
    assert refused.value.code == "machine-value"
    assert told in refused.value.what


def test_machines__that_are_not_there_or_would_be_lost_are_refused(drive: Path, machines: Path, tmp_path: Path) -> None:
    session = drive / "session.toml"
    with pytest.raises(InputError, match="no saved machine") as unknown:
        furrowmap.calibrate(session, machine="T1")
    assert unknown.value.code == "no-machine"
    furrowmap.save_machine(session, "T1")
    with pytest.raises(InputError, match="no saved machine") as other:
        furrowmap.propose_session([drive / "gnss.nmea"], tmp_path / "s.toml", machine="T2")
    assert "T1" in other.value.remedy
    with pytest.raises(RefusedError, match="exists"):
        furrowmap.save_machine(session, "T1")
    assert furrowmap.save_machine(session, "T1", overwrite=True).machine is not None
    with pytest.raises(UsageError, match="name of a machine"):
        furrowmap.save_machine(session, "a/b")
    (tmp_path / "empty.toml").write_text('furrowmap = 1\n[recording]\nlidar = ["a"]\ngnss = ["b"]\n[crs]\nmap = "x"\n')
    with pytest.raises(InputError, match="states no place") as empty:
        furrowmap.save_machine(tmp_path / "empty.toml", "T3")
    assert empty.value.code == "machine-empty"
    (machines / "T4.toml").write_bytes(b"\xff")
    assert [(each.name, each.machine is None) for each in furrowmap.known_machines()] == [("T1", False), ("T4", True)]
    with pytest.raises(InputError, match="UTF-8") as unreadable:
        load_machine(machines / "T4.toml")
    assert unreadable.value.code == "machine-unreadable"


def test_folder_of_recordings__is_what_is_in_it(
    drive: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "drive 1"
    folder.mkdir()
    with pytest.raises(InputError, match="it is empty") as empty:
        furrowmap.propose_session([folder])
    assert empty.value.code == "no-recording"
    (folder / "notes.txt").write_text("rain")
    with pytest.raises(InputError, match=r"notes\.txt"):
        furrowmap.propose_session([folder])
    (folder / "gnss.nmea").write_bytes((drive / "gnss.nmea").read_bytes()[:20_000])
    (folder / "boundary.geojson").write_bytes((drive / "boundary.geojson").read_bytes())
    assert command_line(["init", str(folder), "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert Path(answer["session"]) == folder / "session.toml"
    assert load_session(folder / "session.toml").recording.gnss == ("gnss.nmea",)
    unused = [notice["text"] for notice in answer["missing"] if notice["code"] == "recording-unused"]
    assert [text.split()[0] for text in unused] == ["notes.txt"]
