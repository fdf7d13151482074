"""What others send, and what lies in the folder, takes nothing from the scanner and the receiver."""

from __future__ import annotations

import json
import os
import resource
import socket
import struct
import sys
import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest

import furrowmap
from furrowmap.core.readers.ouster.metadata import packet_bytes
from furrowmap.core.session.session_file import load_session
from furrowmap.workflows.record.recording_files import Storage
from furrowmap.workflows.record.senders import MAX_SCANNERS, MAX_UNKNOWN, MAX_UNKNOWN_BYTES, Senders
from furrowmap.workflows.record.series import Series, numbered_files
from furrowmap.workflows.record.small_files import SmallFiles
from tests.app.obstacles import OBSTACLES, obstacle
from tests.replay import replay

from .senders import free_ports, numbered, payloads, velodyne_packet

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="the addresses of the loopback are those of Linux")

PACKETS = 200
GGA = b"$GPGGA,010203.00,3652.2000,N,14001.2000,E,4,12,0.8,270.0,M,37.0,M,1.0,0000*"


def record_while(
    folder: Path, ports: tuple[int, int, int], work: Callable[[], object], **options: Any
) -> furrowmap.Recorded:
    """A recording that lasts while work is done."""
    worker = threading.Thread(target=work)

    def told(_: object) -> None:
        if worker.ident is None:
            worker.start()
        elif not worker.is_alive():
            raise KeyboardInterrupt

    return furrowmap.record(folder, gnss=[f"udp://:{ports[2]}"], ports=[[ports[0]]], told=told, **options)


def scan(port: int, source: str = "127.0.0.1") -> None:
    replay(((k * 2e-3, port, velodyne_packet(k)) for k in range(PACKETS)), source=source)


def sentence(lon: bytes = b"14001.2000") -> bytes:
    body = b"GPGGA,010203.00,3652.2000,N,%b,E,4,12,0.8,270.0,M,37.0,M,1.0,0000" % lon
    checksum = 0
    for byte in body:
        checksum ^= byte
    return b"$%b*%02X\r\n" % (body, checksum)


STRAY = (
    *("lidar-127.0.0.1-0001 (copy).pcap", "lidar-127.0.0.1-99999999999999999999.pcap", "lidar-127.0.0.1-.pcap"),
    *("lidar-127.0.0.1-0001.pcap", "lidar-127.0.0.1-0002.pcap", "lidar-127.0.0.1-\u0661\u0662\u0663\u0664.pcap"),
    *("lidar-127.0.0.1-999999.pcap", "lidar-127.0.0.1-00x1.pcap", "gnss-0001 (1).log", "gnss-0001.log"),
    *("gnss-99999999999999999999.log", "lidar-127.0.0.1.json", ".status.json"),
)
SMALL = ("record.log", "status.json", "session.toml")


@pytest.mark.parametrize("kind", ["file", *OBSTACLES])
def test_promise_26__what_lies_in_the_folder_ends_neither_start_nor_recording(kind: str, tmp_path: Path) -> None:
    ports = free_ports()
    folder = tmp_path / "rec"
    folder.mkdir()
    checks = list[Callable[[], None]]()
    with ExitStack() as stack:
        for name in STRAY if kind == "file" else (*STRAY, *SMALL):
            if kind == "file":
                (folder / name).write_bytes(b"a file of the user\n")
            else:
                checks.append(stack.enter_context(obstacle(folder / name, kind)))
        before = {path.name for path in folder.iterdir()}
        found = record_while(folder, ports, lambda: (scan(ports[0]), time.sleep(0.5)))
        for unchanged in checks:
            unchanged()
        own = [path for path in folder.iterdir() if path.name not in before and path.suffix == ".pcap"]
        assert len(own) == 1
        own[0].rename(tmp_path / "own-0001.pcap")
    assert numbered(payloads(tmp_path, "own")) == list(range(PACKETS))
    assert found.is_complete
    assert [each["packets"] for each in found.status["scanners"]] == [PACKETS]
    small = {warning["text"].split(" ")[0] for warning in found.status["warnings"] if "small" in warning["code"]}
    assert small <= {*SMALL}
    assert kind == "file" or "record.log" in small, "what is appended to must be a file of its own"
    if kind in ("symbolic link", "hard link"):
        assert "record-session-kept" in {warning["code"] for warning in found.status["warnings"]}
    if kind in ("file", "dangling link"):
        assert load_session(folder / "session.toml").recording.lidar == (own[0].name,)
        assert json.loads((folder / "status.json").read_text(encoding="utf-8"))["state"] == "ended"


def test_files__are_in_the_order_of_their_numbers(tmp_path: Path) -> None:
    for number in (2, 10_000, 9_999, 1):
        (tmp_path / f"lidar-a-{number:04d}.pcap").touch()
    assert list(numbered_files(tmp_path, "lidar-a", ".pcap")) == [1, 2, 9_999, 10_000]
    assert numbered_files(tmp_path / "none", "lidar-a", ".pcap") == {}


@pytest.mark.parametrize("others", ["unknown", "scanners"])
def test_promise_26__foreign_senders_do_not_take_the_place_of_the_scanner(others: str, tmp_path: Path) -> None:
    """300 addresses send before it and meanwhile; where they send packets of scanners, the machine states its own."""
    ports = free_ports()
    machine = tmp_path / "tractor.toml"
    source = 'source = "127.0.0.1"' if others == "scanners" else ""
    machine.write_text(f'furrowmap_machine = 1\n[lidar]\nmodel = "VLP-16"\n{source}\n', encoding="utf-8")

    def flood() -> None:
        content = b"of no scanner" if others == "unknown" else velodyne_packet(10**6)
        for number in range(300):
            replay(iter([(0.0, ports[0], content)] * 3), source=f"127.1.{number // 200}.{1 + number % 200}")

    def work() -> None:
        flood()
        beside = threading.Thread(target=flood)
        beside.start()
        scan(ports[0])
        beside.join()
        time.sleep(1.2)

    found = record_while(tmp_path / "rec", ports, work, machine=machine)
    assert numbered(payloads(tmp_path / "rec", "lidar-127.0.0.1")) == list(range(PACKETS))
    recorded = {path.name.rpartition("-")[0] for path in (tmp_path / "rec").glob("*.pcap")}
    assert len(recorded) == 1 + (MAX_UNKNOWN if others == "unknown" else MAX_SCANNERS)
    files = load_session(found.session).recording.lidar
    assert files == ("lidar-127.0.0.1-0001.pcap",)
    assert found.status["ignored"]["packets"] > 1500
    log = (tmp_path / "rec" / "record.log").read_text(encoding="utf-8")
    assert "record-senders" in log
    assert "record-no-packets" not in log
    assert ("record-many-scanners" in log) == (others == "scanners")


def test_senders__unknown_ones_have_a_bounded_part_of_the_disk_and_lose_their_place_when_silent(
    tmp_path: Path,
) -> None:
    senders = Senders([], lambda address, _: Series(tmp_path, f"lidar-{address}", ".pcap"))
    payload = memoryview(bytes(60_000))
    admitted = 0
    while senders.admitted(("10.0.0.1", 5), 0, payload) is not None:
        admitted += len(payload)
    assert MAX_UNKNOWN_BYTES - len(payload) < admitted <= MAX_UNKNOWN_BYTES
    assert senders.ignored == 1
    # From now on nothing of unknown senders is recorded, but a scanner is, also one that was taken for another sender.
    assert senders.admitted(("10.0.0.1", 5), 0, memoryview(velodyne_packet(0))) is not None
    assert senders.admitted(("10.0.0.2", 5), 0, memoryview(velodyne_packet(0))) is not None
    assert senders.admitted(("10.0.0.3", 5), 0, payload) is None


def test_senders__silent_one_gives_its_place_to_another(tmp_path: Path) -> None:
    senders = Senders([], lambda address, _: Series(tmp_path, f"lidar-{address}", ".pcap"))
    for number in range(MAX_UNKNOWN):
        assert senders.admitted((f"10.0.0.{number}", 5), 0, memoryview(b"other")) is not None
    assert senders.admitted(("10.0.1.0", 5), 0, memoryview(b"other")) is None
    senders.known["10.0.0.3", 0].last_s -= 60.0
    assert senders.admitted(("10.0.1.0", 5), 0, memoryview(b"other")) is not None
    assert ("10.0.0.3", 0) not in senders.known


def test_promise_26__flood_of_one_source_takes_no_memory_of_another(tmp_path: Path) -> None:
    """While the disk takes nothing, a receiver sends more than has place; what the scanner sends waits all the same."""
    storage = Storage(tmp_path, SmallFiles(tmp_path))
    flooded = Series(tmp_path, "gnss", ".log", most_waiting_bytes=16 << 20)
    scanner = Series(tmp_path, "lidar-a", ".pcap", b"head", most_waiting_bytes=256 << 20)
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (0, hard))
    try:
        for _ in range(600):
            storage.put(flooded, (bytes(1 << 16), time.monotonic()))
        for number in range(100):
            storage.put(scanner, (struct.pack("<I", number), time.monotonic()))
        time.sleep(0.3)
        assert storage.fault
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    storage.drain()
    storage.close()
    written = b"".join(path.read_bytes() for path in sorted(tmp_path.glob("lidar-a-*.pcap")))
    assert written == b"head" + b"".join(struct.pack("<I", number) for number in range(100))
    assert (scanner.discarded_bytes, flooded.discarded_bytes) == (0, (600 << 16) - (16 << 20))


HOSTILE = (
    *(b"", bytes(1), bytes(65_507), b"\xff\xee" + bytes(1204), b"\xee\xff" + bytes(1078), b"\x55\xaa" * 700),
    *(
        struct.pack("<HH", 1, 7) + b"\xff" * (packet_bytes("RNG19_RFL8_SIG16_NIR16", columns, 16) - 4)
        for columns in (16, 128)
    ),
)


def test_promise_26__hostile_packets_and_positions_are_recorded_and_end_nothing(tmp_path: Path) -> None:
    """Also a position far outside the Earth, in a valid sentence: no zone of a map has it."""
    ports = free_ports()
    sources = {f"127.0.0.{7 + number}": hostile for number, hostile in enumerate(HOSTILE)}

    def work() -> None:
        for _ in range(20):
            for source, hostile in sources.items():
                replay(iter([(0.0, ports[0], hostile)] * 5), source=source)
            replay(iter([(0.0, ports[2], sentence(b"%d00.0000" % 50_000) * 5)]))
            time.sleep(0.05)
        scan(ports[0])
        time.sleep(0.5)

    found = record_while(tmp_path / "rec", ports, work)
    assert numbered(payloads(tmp_path / "rec", "lidar-127.0.0.1")) == list(range(PACKETS))
    for source, hostile in sources.items():
        assert payloads(tmp_path / "rec", f"lidar-{source}") == [hostile] * 100, len(hostile)
    assert not any(thread["ends"] for thread in found.status["threads"])
    assert (tmp_path / "rec" / "gnss-0001.log").read_bytes() == sentence(b"%d00.0000" % 50_000) * 100


def test_no_packets__power_and_cable_are_named_only_where_nothing_arrives(tmp_path: Path) -> None:
    ports = {"nothing": free_ports(), "others": free_ports()}
    works: dict[str, Callable[[], object]] = {
        "nothing": lambda: time.sleep(3.0),
        "others": lambda: replay((k * 0.1, ports["others"][0], b"of no scanner") for k in range(30)),
    }
    with ThreadPoolExecutor() as pool:
        list(pool.map(lambda name: record_while(tmp_path / name, ports[name], works[name]), works))
    said = {name: (tmp_path / name / "record.log").read_text(encoding="utf-8") for name in works}
    assert "Check power, cable and network" in said["nothing"]
    assert "Check power, cable and network" not in said["others"]
    assert "record-unknown-packets" in said["others"]


def test_told__terminal_that_is_gone_does_not_end_the_recording(tmp_path: Path) -> None:
    ports = free_ports()

    def told(_: object) -> None:
        raise BrokenPipeError

    found = furrowmap.record(tmp_path / "rec", gnss=[], ports=[[ports[0]]], told=told, duration_s=1.3)
    assert found.is_complete
    assert "screen could not be" in (tmp_path / "rec" / "record.log").read_text(encoding="utf-8")


def test_session__that_hangs_whoever_reads_it_is_left_alone(tmp_path: Path) -> None:
    folder = tmp_path / "rec"
    folder.mkdir()
    os.mkfifo(folder / "session.toml")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as port:
        port.bind(("", 0))
        free = port.getsockname()[1]
    found = furrowmap.record(folder, gnss=[], ports=[[free]], duration_s=1.3)
    assert "record-small-file" in {warning["code"] for warning in found.status["warnings"]}
