"""What matching says about a drive: gaps whose sides do not meet, parts that nothing holds."""

from __future__ import annotations

import io
import shutil
from collections.abc import Callable
from pathlib import Path

import dpkt
import numpy as np

from furrowmap.core.adjustment.session_match import matched_to_ground
from furrowmap.core.session.opened import open_session
from furrowmap.core.trajectory.located import locate
from tests.core.conftest import Recording
from tests.fuzz.positions import mend_nmea


def copied(recording: Recording, folder: Path) -> Path:
    """The session of the drive, whose files may be changed."""
    shutil.copytree(recording.opened.file.parent, folder, ignore=shutil.ignore_patterns("truth"))
    return folder / "session.toml"


def notices(session_file: Path) -> set[str]:
    """The codes of what a run would say."""
    opened = open_session(session_file)
    located = locate(opened.positions(), opened.session, opened.frame)
    lidar = opened.lidar(float(np.mean(located.trajectory.span_s)))
    found, _ = matched_to_ground(located, lidar, opened.session)
    return {notice.code for notice in found.notices}


def edit_positions(log: Path, edit: Callable[[float, bytes], bytes]) -> None:
    """Edit the sentences of a log, given the seconds since its first one; an empty one is left out."""
    lines = log.read_bytes().splitlines(keepends=True)
    seconds = [_second_of_day(line) for line in lines]
    first = min(s for s in seconds if s is not None)
    log.write_bytes(
        mend_nmea(
            b"".join(edit(s - first, line) if s is not None else line for s, line in zip(seconds, lines, strict=True))
        )
    )


def _second_of_day(line: bytes) -> float | None:
    words = line.split(b",")
    if not words[0].endswith((b"GGA", b"RMC", b"GST")):
        return None
    return 3600.0 * int(words[1][:2]) + 60.0 * int(words[1][2:4]) + float(words[1][4:])


def without_scans(capture: Path, *windows: tuple[float, float]) -> None:
    """Leave out the packets in windows of seconds since the first one."""
    data = dpkt.pcap.Reader(io.BytesIO(capture.read_bytes()))
    records = list(data)
    out = io.BytesIO()
    writer = dpkt.pcap.Writer(out)
    for stamp_s, packet in records:
        since_s = float(stamp_s) - float(records[0][0])
        if not any(begin <= since_s < end for begin, end in windows):
            writer.writepkt(packet, stamp_s)
    capture.write_bytes(out.getvalue())


def test_a_gap__whose_sides_do_not_meet_is_not_bridged(straight: Recording, tmp_path: Path) -> None:
    session = copied(straight, tmp_path / "gap")

    def jumped(t_s: float, line: bytes) -> bytes:
        """No positions for three seconds; behind them they lie 1.8 m farther north."""
        if 4.0 < t_s < 7.0:
            return b""
        words = line.split(b",")
        column = 2 if words[0].endswith(b"GGA") else 3 if words[0].endswith(b"RMC") else 0
        if t_s >= 7.0 and column:
            words[column] = b"%010.5f" % (float(words[column]) + 0.00097)
        return b",".join(words)

    edit_positions(session.with_name("gnss.nmea"), jumped)
    assert "gap-not-bridged" in notices(session)


def test_scans__that_no_position_holds_keep_the_trajectory_of_gnss(straight: Recording, tmp_path: Path) -> None:
    """The scanner pauses for so long that wheels and inertia do not reach across, and then has no positions."""
    session = copied(straight, tmp_path / "loose")
    without_scans(next(session.parent.glob("*.pcap")), (2.5, 8.0), (9.3, 99.0))
    edit_positions(session.with_name("gnss.nmea"), lambda t_s, line: b"" if 2.4 < t_s < 9.4 else line)
    assert "matching-unsolved" in notices(session)
