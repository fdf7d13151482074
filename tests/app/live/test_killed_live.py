"""A live session killed at any moment leaves the recording as it was and a log of whole lines, and the next begins."""

from __future__ import annotations

import datetime as dt
import gzip
import json
import signal
import struct
import sys
import time
from collections.abc import Iterator
from heapq import merge
from pathlib import Path
from random import Random
from threading import Event, Thread, Timer
from typing import Any

import msgspec
import pytest

import furrowmap
from furrowmap.core.live.difference import LIVE_LOG, LOGGED
from furrowmap.core.simulator.scenario import demo_scenario
from furrowmap.core.simulator.simulate import simulate
from tests.app.killing import KILLS, Mortal
from tests.replay import sentences

CAPTURE = "lidar-192.168.1.201-0001.pcap"
LOG = "gnss-0001.log"
PCAP_HEAD_BYTES = 24
PCAP_RECORD = struct.Struct("<IIII")
LONGEST_S = 4.0
SPEED = 2.0
"""By which the recorder of the test is faster than one."""
pytestmark = pytest.mark.skipif(sys.platform == "win32" or not KILLS, reason="a part of make kills")


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder as the recorder leaves it; it is from tomorrow, as what is late is not shown."""
    scenario = demo_scenario()
    drive = msgspec.structs.replace(scenario.drive, pass_m=(5.0,), passes=1)
    tomorrow = dt.datetime.now(dt.UTC) + dt.timedelta(days=1)
    made = simulate(
        msgspec.structs.replace(scenario, t0=tomorrow.isoformat(), drive=drive), tmp_path_factory.mktemp("live") / "day"
    )
    folder = made.session.parent
    text = made.session.read_text(encoding="utf-8")
    (folder / CAPTURE).write_bytes(gzip.decompress(made.recording.read_bytes()))
    made.recording.unlink()
    (folder / "gnss.nmea").rename(folder / LOG)
    text = text.replace(made.recording.name, CAPTURE).replace("gnss.nmea", LOG)
    made.session.write_text(text, encoding="utf-8")
    return folder


def files(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file() and path.name[0] != "."}


def logged(folder: Path) -> list[dict[str, Any]]:
    """The lines that are whole."""
    *lines, _ = (folder / LIVE_LOG).read_text(encoding="utf-8").split("\n")
    return [json.loads(line) for line in lines]


def records(capture: bytes) -> Iterator[tuple[float, str, bytes]]:
    """The records of a capture of nanoseconds, with their times and the file that they come into."""
    at = PCAP_HEAD_BYTES
    while at < len(capture):
        whole_s, ns, size, _ = PCAP_RECORD.unpack_from(capture, at)
        end = at + PCAP_RECORD.size + size
        yield whole_s + 1e-9 * ns, CAPTURE, capture[at:end]
        at = end


def begin_again(folder: Path) -> list[tuple[float, str, bytes]]:
    """Let capture and log have their first second alone; what comes after it, in the order of time."""
    capture = (folder / CAPTURE).read_bytes()
    received = list(records(capture))
    midnight_s = received[0][0] // 86_400 * 86_400
    positions = [(t_s, LOG, line) for t_s, _, line in sentences(folder / LOG, midnight_s, 0)]
    came = list(merge(received, positions))
    first = [one for one in came if one[0] < came[0][0] + 1.0]
    for name, head in ((CAPTURE, capture[:PCAP_HEAD_BYTES]), (LOG, b"")):
        (folder / name).write_bytes(head + b"".join(content for _, into, content in first if into == name))
    return came[len(first) :]


def go_on(folder: Path, coming: list[tuple[float, str, bytes]], go: Event, stop: Event) -> None:
    """Append to capture and log as a recorder does, as soon as the live session has begun."""
    go.wait()
    begun_s = time.monotonic()
    with (folder / CAPTURE).open("ab", buffering=0) as packets, (folder / LOG).open("ab", buffering=0) as log:
        for t_s, name, content in coming:
            if stop.wait(max((t_s - coming[0][0]) / SPEED - (time.monotonic() - begun_s), 0.0)):
                return
            (packets if name == CAPTURE else log).write(content)


def test_promise_20__killed_live_session_changes_nothing_else_and_leaves_whole_lines(
    recording: Path, program: Mortal
) -> None:
    chance = Random(5)
    (recording / LIVE_LOG).write_text('{"crs":"of an earlier session"}\n', encoding="utf-8")
    before = files(recording)
    line = ["live", str(recording), "--host", "127.0.0.1", "--port", "0", "--nmea-port", "0"]
    lines: list[int] = []
    for _ in range(KILLS or 3):
        said = program.runs(line, recording, seconds=chance.uniform(0.01, LONGEST_S))
        assert said["status"] == -signal.SIGALRM, said
        after = files(recording)
        assert after.keys() == before.keys()
        assert all(after[name] == content for name, content in before.items() if name != LIVE_LOG)
        head, *rows = logged(recording)
        assert set(head) == {"crs"}
        assert all(set(row) == set(LOGGED) for row in rows)
        lines.append(len(rows))
    go, stop, posed = Event(), Event(), 0

    def hear(scan: dict[str, Any]) -> None:
        nonlocal posed
        go.set()
        posed += "e_m" in scan
        if posed > 5:
            stop.set()

    longest = Timer(120.0, stop.set)
    recorder = Thread(target=go_on, args=(recording, begin_again(recording), go, stop), daemon=True)
    recorder.start()
    longest.start()
    furrowmap.live(recording, port=None, nmea_port=None, stop=stop, on_scan=hear)
    longest.cancel()
    stop.set()
    go.set()
    recorder.join()
    assert posed > 5
    head, *rows = logged(recording)
    assert head["crs"].startswith("EPSG:")
    assert rows
    assert not [path for path in recording.iterdir() if path.name.startswith(".")]
    sys.stderr.write(f"live: {len(lines)} kills, up to {max(lines)} lines\n")
