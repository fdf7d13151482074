"""What matching says about a drive: gaps whose sides do not meet, parts that nothing holds."""

from __future__ import annotations

import io
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import dpkt
import numpy as np

from furrowmap.core.matching.session_match import match_session
from furrowmap.core.session.opened import open_session
from furrowmap.core.trajectory.located import Located, locate
from furrowmap.core.values.gnss import Positions
from tests.core.conftest import Recording
from tests.fuzz.positions import mend_nmea


def copied(recording: Recording, folder: Path) -> Path:
    """The session of the drive, whose files may be changed."""
    shutil.copytree(recording.opened.file.parent, folder, ignore=shutil.ignore_patterns("truth"))
    return folder / "session.toml"


def matched(session_file: Path, edit: Callable[[Positions], Positions] = lambda same: same) -> tuple[Located, Located]:
    """What GNSS alone and what a run makes of a session, whose positions may be edited as no log of theirs can be."""
    opened = open_session(session_file)
    located = locate(opened.positions(), opened.session, opened.frame)
    assert located.antenna is not None
    located = replace(located, antenna=edit(located.antenna))
    lidar = opened.lidar(float(np.mean(located.trajectory.span_s)))
    found = match_session(located, lidar, opened.session)
    return located, replace(located, trajectory=found.trajectory, notices=found.notices)


def codes(located: Located) -> set[str]:
    return {notice.code for notice in located.notices}


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
    assert "gap-not-bridged" in codes(matched(session)[1])


def test_scans__that_no_position_holds_have_sigmas_as_large_as_their_errors(
    straight: Recording, tmp_path: Path
) -> None:
    """The scanner pauses for so long that wheels and inertia do not reach across, and then has no positions.

    Whether the adjustment has a solution then depends on the rounding errors of a machine.
    """
    session = copied(straight, tmp_path / "loose")
    without_scans(next(session.parent.glob("*.pcap")), (2.5, 8.0), (9.3, 99.0))
    edit_positions(session.with_name("gnss.nmea"), lambda t_s, line: b"" if 2.4 < t_s < 9.4 else line)
    by_gnss, found = matched(session)
    if "matching-unsolved" in codes(found):
        assert found.trajectory is by_gnss.trajectory
    error_m = found.trajectory.xyz_m - straight.truth.at(found.trajectory.t_s).xyz_m
    known = np.isfinite(error_m).all(axis=1)
    assert known.mean() > 0.9
    assert (np.abs(error_m) < 4.0 * found.trajectory.sigma[:, :3])[known].all()
    assert (found.trajectory.sigma[:, 5] > 90.0).all(), "the antenna moved by two decimetres"


def test_scans__with_pauses_in_a_gap_of_positions_are_left_out(straight: Recording, tmp_path: Path) -> None:
    """Matched, the scans between the two pauses lay decimetres off, with standard deviations of 5 cm."""
    session = copied(straight, tmp_path / "island")
    without_scans(next(session.parent.glob("*.pcap")), (4.2, 5.4), (7.2, 8.4))
    edit_positions(session.with_name("gnss.nmea"), lambda t_s, line: b"" if 3.9 < t_s < 8.6 else line)
    found = matched(session)[1]
    assert "scans-not-held" in codes(found)
    island = np.abs(found.trajectory.t_s - straight.truth.span_s[0] - 6.8) < 0.5
    assert (found.trajectory.sigma[island, 0] > 0.2).all(), "the motion prior alone"
    error_m = found.trajectory.xyz_m - straight.truth.at(found.trajectory.t_s).xyz_m
    known = np.isfinite(error_m).all(axis=1)
    assert known.mean() > 0.9
    assert (np.abs(error_m) < 4.0 * found.trajectory.sigma[:, :3])[known].all()


def test_one_position_before_a_gap__is_no_error(straight: Recording, tmp_path: Path) -> None:
    """Its speed is not known."""
    session = copied(straight, tmp_path / "lone")
    edit_positions(session.with_name("gnss.nmea"), lambda t_s, line: b"" if 2.05 < t_s < 6.0 else line)
    edit_positions(session.with_name("gnss.nmea"), lambda t_s, line: b"" if t_s < 1.95 else line)
    found = matched(session)[1]
    assert "scans-not-held" in codes(found)
    assert found.trajectory.t_s[0] > straight.truth.span_s[0] + 5.0


def test_positions_without_a_sigma__leave_the_trajectory_of_gnss(straight: Recording) -> None:
    """Nothing that holds the scans is a number: the normal equations have no solution."""
    by_gnss, found = matched(straight.opened.file, lambda log: replace(log, white_m=np.full_like(log.white_m, np.nan)))
    assert "matching-unsolved" in codes(found)
    assert found.trajectory is by_gnss.trajectory
