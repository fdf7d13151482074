"""The commands from end to end, on small recordings, as a user runs them."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import laspy
import pyogrio
import pytest

from furrowmap.cli.main import command_line
from furrowmap.core.session.session_file import load_session

FURROWMAP = Path(sys.executable).with_name("furrowmap")
SCANS_S = 1_453_364_282.341  # the capture's first return by its GPS time
POINTS = 73_486


@pytest.fixture
def capture(shared_data: Path, tmp_path: Path) -> Path:
    path = tmp_path / "recording.pcap"
    shutil.copyfile(shared_data / "velodyne" / "vlp16_single_gps.pcap", path)
    return path


@pytest.fixture
def session(capture: Path) -> Path:
    """The capture on a straight drive at 1 m/s, by a trajectory from a file."""
    rows = "".join(f"{SCANS_S - 1 + i * 0.1:.3f},{16_650 + i * 0.1:.3f},96560,271,0,0,90\n" for i in range(31))
    path = capture.parent
    (path / "drive.csv").write_text("time_unix_s,e_m,n_m,h_m,roll_deg,pitch_deg,heading_deg\n" + rows)
    (path / "session.toml").write_text(
        'furrowmap = 1\nname = "straight"\n[recording]\nlidar = ["recording.pcap"]\n[crs]\nmap = "EPSG:6677"\n'
        '[trajectory]\nfiles = ["drive.csv"]\n'
    )
    return path / "session.toml"


def call(capsys: pytest.CaptureFixture[str], *arguments: str | Path) -> tuple[int, str, str]:
    status = command_line([str(word) for word in arguments])
    captured = capsys.readouterr()
    return status, captured.out, captured.err


def test_inspect__tells_facts_and_clocks(capture: Path, capsys: pytest.CaptureFixture[str]) -> None:
    status, out, _ = call(capsys, "inspect", capture)
    assert status == 0
    lines = {" ".join(line.split()) for line in out.splitlines()}
    assert {"model VLP-16", "points 73,486"} <= lines
    assert any(line.startswith("clock sensor-gps 2016-01-21T08:18:02.341Z") for line in lines)


def test_inspect__shows_the_others_where_one_is_refused(
    capture: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "notes.txt").write_text("nothing to map")
    status, out, err = call(capsys, "inspect", tmp_path / "notes.txt", capture, "--json")
    assert status == 3
    assert len([line for line in err.splitlines() if not line.startswith("Compiling")]) == 3
    refused, read = json.loads(out)["files"]
    assert refused["error"]["code"] == "unknown-format"
    assert (read["format"], read["facts"]["points"]) == ("velodyne-pcap", POINTS)
    assert {"sensor-gps", "recorder"} <= {clock["clock"] for clock in read["clocks"]}


def test_inspect__sets_files_against_each_other_in_time(session: Path, capsys: pytest.CaptureFixture[str]) -> None:
    files = (session.with_name("recording.pcap"), session.with_name("drive.csv"))
    status, out, _ = call(capsys, "inspect", *files, "--json")
    assert status == 0
    (match,) = json.loads(out)["time_matches"]
    assert match["shared_s"] == pytest.approx(0.387, abs=0.002)
    assert call(capsys, "inspect", *files)[1].splitlines()[-1] == match["text"]


def test_init__writes_a_session_that_loads_beside_the_recordings(
    session: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    files = (session.with_name("recording.pcap"), session.with_name("drive.csv"))
    status, _, err = call(capsys, "init", *files)
    assert status == 4
    assert "--overwrite" in err
    assert load_session(session).name == "straight"
    status, out, _ = call(capsys, "init", *files, "--overwrite")
    assert status == 0
    assert out.startswith(f"Wrote {session}")
    assert "Mounting of the scanner" in out
    assert load_session(session).recording.lidar == ("recording.pcap",)


def test_init__answers_as_json(capture: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    status, out, _ = call(capsys, "init", capture, "-o", tmp_path / "mine.toml", "--json", "-q")
    answer = json.loads(out)
    assert (status, answer["session"]) == (0, str(tmp_path / "mine.toml"))
    assert {"no-positions", "no-crs"} <= {notice["code"] for notice in answer["missing"]}
    load_session(tmp_path / "mine.toml")


def test_run__writes_the_products_beside_the_session(session: Path, capsys: pytest.CaptureFixture[str]) -> None:
    status, out, err = call(capsys, "run", session)
    folder = session.parent / "session_result"
    assert status == 0
    assert sorted(path.name for path in folder.iterdir()) == [
        "cloud.copc.laz",
        "dsm.qml",
        "dsm.tif",
        "field.gpkg",
        "item.json",
        "report.html",
        "report.json",
        "session.toml",
    ]
    lines = {" ".join(line.split()) for line in out.splitlines()}
    assert {"cloud 73,486 points", f"Open {folder / 'report.html'}"} <= lines
    assert "warning: The session does not state the mounting of the scanner" in err
    with laspy.open(folder / "cloud.copc.laz") as cloud:
        assert cloud.header.point_count == POINTS
    assert pyogrio.read_info(folder / "field.gpkg", layer="trajectory")["features"] == 5


def test_run__answers_with_the_folder_and_the_report(
    session: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    status, out, _ = call(capsys, "run", session, "-o", tmp_path / "result", "--json", "--quiet")
    assert status == 0
    answer = json.loads(out)
    assert answer.pop("folder") == str(tmp_path / "result")
    assert answer == json.loads((tmp_path / "result" / "report.json").read_text(encoding="utf-8"))


def test_run__keeps_the_products_of_another_recording(
    session: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    result = tmp_path / "result"
    assert call(capsys, "run", session, "-o", result)[0] == 0
    session.write_text(session.read_text().replace("straight", "another"))
    (capture,) = session.parent.glob("*.pcap")
    capture.write_bytes(capture.read_bytes()[:-1264])  # its last packet, with the capture's header of it
    assert call(capsys, "run", session, "-o", result)[0] == 4
    assert json.loads((result / "report.json").read_text())["session"]["name"] == "straight"
    assert call(capsys, "run", session, "-o", result, "--overwrite")[0] == 0
    assert json.loads((result / "report.json").read_text())["session"]["name"] == "another"


def test_run__leaves_the_users_own_session_file_alone(session: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = session.read_text()
    status, _, err = call(capsys, "run", session, "-o", session.parent, "--overwrite")
    assert (status, session.read_text()) == (4, before)
    assert "-o" in err


@pytest.mark.slow
def test_simulate__writes_a_recording_that_runs(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scenario = tmp_path / "short.toml"
    scenario.write_text(
        'name = "short"\nseed = 5\n[field]\nsize_e_m = 20.0\nsize_n_m = 16.0\n'
        "[drive]\npasses = 1\npass_m = [3.2]\nstand_start_s = 0.4\nstand_end_s = 0.3\nlead_in_m = 0.4\n"
        "[lidar]\nstart_s = 0.3\n"
    )
    drive = tmp_path / "drive"
    status, out, _ = call(capsys, "simulate", scenario, "-o", drive, "--json")
    answer = json.loads(out)
    assert (status, answer["session"]) == (0, str(drive / "session.toml"))
    status, out, _ = call(capsys, "run", drive / "session.toml", "--json")
    assert status == 0
    assert json.loads(out)["figures"]["points_read"] == answer["figures"]["lidar"]["points"]


def test_simulate__keeps_what_is_in_the_folder(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "recording.pcap").write_text("a real one")
    status, _, err = call(capsys, "simulate", "demo", "-o", tmp_path)
    assert (status, (tmp_path / "recording.pcap").read_text()) == (4, "a real one")
    assert "--overwrite" in err


def test_simulate__tells_a_fault_in_the_scenario(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "bad.toml").write_text("[drive]\npases = 2\n")
    status, _, err = call(capsys, "simulate", tmp_path / "bad.toml", "-o", tmp_path / "out")
    assert status == 3
    assert "passes" in err
    assert not (tmp_path / "out").exists()


@pytest.mark.skipif(os.name == "nt", reason="signals of POSIX")
@pytest.mark.parametrize("request_to_end", [signal.SIGINT, signal.SIGTERM], ids=["Ctrl-C", "SIGTERM"])
def test_run__interrupted_leaves_nothing(request_to_end: signal.Signals, shared_data: Path, tmp_path: Path) -> None:
    result = tmp_path / "result"
    session = shared_data / "tractor_fishtail" / "session.toml"
    process = subprocess.Popen(
        [FURROWMAP, "run", session, "-o", result], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    until = time.monotonic() + 60
    while not result.exists() and time.monotonic() < until:
        time.sleep(0.01)
    time.sleep(0.3)
    process.send_signal(request_to_end)
    out, err = process.communicate(timeout=30)
    assert (process.returncode, out) == (130, "")
    assert next(line for line in err.splitlines() if not line.startswith("Compiling")) == "Cancelled."
    assert not result.exists()
