"""What a run does where the recording and the positions do not make a cloud."""

from __future__ import annotations

import functools
import gzip
import operator
import re
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from furrowmap.core.geodesy.projection import MapFrame
from furrowmap.core.pipeline.run import run
from furrowmap.core.pipeline.run_result import RunResult
from furrowmap.core.pointclouds.placed_scans import PlacedScan
from furrowmap.core.runtime.errors import Cancelled, InputError
from furrowmap.core.session.opened import open_session

SESSION = """furrowmap = 1
[recording]
lidar = ["capture.pcap"]
gnss = ["gnss.nmea"]
[crs]
map = "EPSG:6677"
"""


class Counting:
    points = 0

    def __call__(
        self, frame: MapFrame, origin_m: tuple[float, float, float], frames: object
    ) -> Callable[[PlacedScan], None]:
        return self.add

    def add(self, placed: PlacedScan) -> None:
        self.points += len(placed.scan.t_s)


def session_in(shared_data: Path, folder: Path) -> Path:
    """Two seconds of a tractor's scans with its whole GNSS log."""
    with gzip.open(shared_data / "tractor_loop" / "recording.pcap.gz") as stream:
        (folder / "capture.pcap").write_bytes(stream.read(24 + 1264 * 1500))
    shutil.copy(shared_data / "tractor_loop" / "gnss.nmea", folder)
    (folder / "session.toml").write_text(SESSION)
    return folder / "session.toml"


@pytest.fixture
def session(shared_data: Path, tmp_path: Path) -> Path:
    """A session that a test may change."""
    return session_in(shared_data, tmp_path)


@pytest.fixture(scope="module")
def unchanged(shared_data: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[RunResult, int]:
    """The run of the session as it is, and how many points it gave."""
    sink = Counting()
    return run(open_session(session_in(shared_data, tmp_path_factory.mktemp("unchanged"))), sink), sink.points


def shifted_nmea(log: bytes, seconds: int) -> bytes:
    """The log with every time of day later by whole seconds, which stay within the minute's hour."""

    def later(sentence: re.Match[bytes]) -> bytes:
        h, m, s = int(sentence[2][:2]), int(sentence[2][2:4]), int(sentence[2][4:6]) + seconds
        body = sentence[1] + b"%02d%02d%02d" % (h, m + s // 60, s % 60) + sentence[3]
        return b"$%s*%02X" % (body, functools.reduce(operator.xor, body))

    return re.sub(rb"\$(\w{2}(?:GGA|RMC|GST),)(\d{6})([^*]*)\*..", later, log)


def test_a_session_places_all_points(unchanged: tuple[RunResult, int]) -> None:
    found, points = unchanged
    assert found.placement.points == found.placement.points_read == points > 200_000
    assert {notice.code for notice in found.notices} >= {"antenna-unknown", "mounting-identity"}


def test_clocks_without_overlap_are_an_error_with_both_spans_and_the_offset(session: Path) -> None:
    session.write_text(SESSION.replace("[crs]", "lidar_minus_gnss_s = 32400.0\n[crs]"))
    with pytest.raises(InputError, match="do not overlap in time") as caught:
        run(open_session(session), Counting())
    assert "lidar_minus_gnss_s = 0.0" in caught.value.remedy
    assert "32400" in caught.value.what
    assert caught.value.what.endswith("do not overlap in time.")


def test_a_log_in_gps_time_is_found_out_and_its_cure_works(session: Path) -> None:
    log = session.with_name("gnss.nmea")
    log.write_bytes(shifted_nmea(log.read_bytes(), 18))
    with pytest.raises(InputError) as caught:
        run(open_session(session), Counting())
    assert "lidar_minus_gnss_s = -18.0" in caught.value.remedy
    session.write_text(SESSION.replace("[crs]", "lidar_minus_gnss_s = -18.0\n[crs]"))
    assert run(open_session(session), Counting()).placement.points_without_pose == 0


def test_scans_in_a_gap_of_the_positions_are_told_as_such(session: Path) -> None:
    log = session.with_name("gnss.nmea")
    lines = log.read_bytes().splitlines(keepends=True)
    log.write_bytes(b"".join(line for line in lines if not b",012341" <= line[6:13] <= b",012345"))
    with pytest.raises(InputError, match="have a gap"):
        run(open_session(session), Counting())


def test_files_in_the_wrong_order_are_refused(session: Path, unchanged: tuple[RunResult, int]) -> None:
    capture = session.with_name("capture.pcap")
    whole = capture.read_bytes()
    half = 24 + 1264 * 750
    capture.with_name("first.pcap").write_bytes(whole[:half])
    capture.with_name("second.pcap").write_bytes(whole[:24] + whole[half:])
    session.write_text(SESSION.replace('"capture.pcap"', '"first.pcap", "second.pcap"'))
    right = run(open_session(session), Counting())
    assert right.placement.points == unchanged[0].placement.points
    session.write_text(SESSION.replace('"capture.pcap"', '"second.pcap", "first.pcap"'))
    with pytest.raises(InputError, match="Scan") as caught:
        run(open_session(session), Counting())
    assert caught.value.code == "scans-not-in-order"


def test_a_stated_clock_offset_moves_the_scans(session: Path, unchanged: tuple[RunResult, int]) -> None:
    as_recorded, _ = unchanged
    session.write_text(SESSION.replace("[crs]", "lidar_minus_gnss_s = -20.0\n[crs]"))
    shifted = run(open_session(session), Counting())
    assert shifted.placement.poses.t_s[0] - as_recorded.placement.poses.t_s[0] == pytest.approx(20.0, abs=1e-6)
    moved = shifted.placement.poses.xyz_m[0] - as_recorded.placement.poses.xyz_m[0]
    assert abs(moved[:2]).max() > 5


def test_standing_scans_are_left_out_on_request(session: Path) -> None:
    session.write_text(SESSION + "[run]\nstanding = false\n")
    sink = Counting()
    found = run(open_session(session), sink)
    assert found.placement.scans_standing > 0
    assert found.placement.points_standing + sink.points == found.placement.points_read
    assert "standing-left-out" in {notice.code for notice in found.notices}


@pytest.mark.parametrize(
    ("old", "new", "code"),
    [
        ('"gnss.nmea"', '"capture.pcap"', "wrong-kind-of-file"),
        ('"capture.pcap"', '"gnss.nmea"', "wrong-kind-of-file"),
        ('"gnss.nmea"', '"missing.nmea"', "session-file-missing"),
        ('"gnss.nmea"', '"../../gnss.nmea"', "session-path-outside"),
    ],
)
def test_a_wrong_file_is_named_before_any_work(session: Path, old: str, new: str, code: str) -> None:
    session.write_text(SESSION.replace(old, new))
    with pytest.raises(InputError) as caught:
        run(open_session(session), Counting())
    assert caught.value.code == code
    assert all(caught.value.lines)


def test_a_listener_can_end_the_work(session: Path) -> None:
    def impatient(stage: str, share: float) -> None:
        if share > 0.2:
            raise Cancelled

    with pytest.raises(Cancelled):
        run(open_session(session), Counting(), impatient)
