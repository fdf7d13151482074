"""Asking an Ouster for its metadata: whatever answers, it is asked itself, within a bounded time and size."""

from __future__ import annotations

import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest

from furrowmap.workflows.record.ouster_metadata import MAX_ASKED, MetadataAsker, sensor_metadata
from furrowmap.workflows.record.small_files import SmallFiles

Answer = Callable[[socket.socket], None]


@contextmanager
def sensor(answer: Answer) -> Iterator[tuple[int, list[bytes]]]:
    """A server that answers each connection so; yields its port and the requests."""
    requests = list[bytes]()

    def serve(server: socket.socket) -> None:
        with suppress(OSError):
            while True:
                connection, _ = server.accept()
                with connection, suppress(OSError):
                    requests.append(connection.recv(4096))
                    answer(connection)

    with socket.create_server(("127.0.0.1", 0)) as server:
        thread = threading.Thread(target=serve, args=(server,), daemon=True)
        thread.start()
        yield server.getsockname()[1], requests
        server.shutdown(socket.SHUT_RDWR)


def says(*pieces: bytes, pause_s: float = 0.0) -> Answer:
    def answer(connection: socket.socket) -> None:
        for piece in pieces:
            connection.sendall(piece)
            time.sleep(pause_s)

    return answer


@pytest.fixture
def metadata(shared_data: Path) -> bytes:
    return (shared_data / "other_lidars" / "ouster" / "OS-0-32-U1_v2.2.0_1024x10.json").read_bytes()


@pytest.mark.parametrize("ends", ["closed", "kept open", "in chunks"])
def test_metadata__is_that_of_the_sensor(ends: str, metadata: bytes, monkeypatch: pytest.MonkeyPatch) -> None:
    """Not that of a proxy of the environment, which a sensor in the cab is never behind."""
    monkeypatch.setenv("http_proxy", "http://127.0.0.1:9")
    head = b"HTTP/1.1 200 OK\r\nContent-Type: application/json\r\n"
    if ends == "in chunks":
        half = len(metadata) // 2
        chunks = [b"%x\r\n%b\r\n" % (len(part), part) for part in (metadata[:half], metadata[half:])]
        body = head + b"Transfer-Encoding: chunked\r\n\r\n" + b"".join(chunks) + b"0\r\n\r\n"
    else:
        body = head + b"content-length: %d\r\n\r\n" % len(metadata) + metadata
    begun_s = time.monotonic()
    with sensor(says(body, pause_s=20.0 if ends == "kept open" else 0.0)) as (port, requests):
        assert sensor_metadata("127.0.0.1", port) == metadata.decode()
    assert time.monotonic() - begun_s < 4.0
    assert requests[0].startswith(b"GET /api/v1/sensor/metadata HTTP/1.1\r\nHost: 127.0.0.1\r\n")


def endless(connection: socket.socket) -> None:
    while True:
        connection.sendall(bytes(1 << 16))


def slow(connection: socket.socket) -> None:
    connection.sendall(b"HTTP/1.1 200 OK\r\n")
    while True:
        connection.sendall(b"a: b\r\n")
        time.sleep(0.05)


HOSTILE: dict[str, Answer] = {
    "nothing": says(),
    "no HTTP": says(b"SSH-2.0-OpenSSH_9.2\r\n"),
    "a status that is none": says(b"HTTP/1.1 two hundred\r\n\r\n"),
    "a version that is none": says(b"HTTP/9\r\n\r\n{}"),
    "a line without end": says(b"HTTP/1.1 200 OK\r\n" + b"a" * 100_000),
    "a thousand lines": says(b"HTTP/1.1 200 OK\r\n" + b"a: b\r\n" * 1000 + b"\r\n{}"),
    "a length that is none": says(b"HTTP/1.1 200 OK\r\nContent-Length: -5\r\n\r\n{}"),
    "less than its length": says(b"HTTP/1.1 200 OK\r\nContent-Length: 500\r\n\r\n{}"),
    "broken chunks": says(b"HTTP/1.1 200 OK\r\nTransfer-Encoding: chunked\r\n\r\nzz\r\n{}"),
    "no text": says(b"HTTP/1.1 200 OK\r\n\r\n\xff\xfe\0"),
    "no JSON": says(b"HTTP/1.1 200 OK\r\n\r\n<html>"),
    "deep JSON": says(b"HTTP/1.1 200 OK\r\n\r\n" + b"[" * 200_000),
    "other JSON": says(b'HTTP/1.1 200 OK\r\n\r\n{"prod_line": {}, "beam_altitude_angles": [1e999]}'),
    "an error": says(b"HTTP/1.1 500 No\r\n\r\n{}"),
    "endless": endless,
    "slow": slow,
}


@pytest.mark.parametrize("kind", HOSTILE)
def test_promise_26__answer_that_is_no_metadata_is_none_within_its_time(kind: str) -> None:
    begun_s = time.monotonic()
    with sensor(HOSTILE[kind]) as (port, _):
        assert sensor_metadata("127.0.0.1", port, 1.0) == ""
    assert time.monotonic() - begun_s < 4.0


def test_metadata__sensor_that_does_not_answer_has_none() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
    assert sensor_metadata("127.0.0.1", port) == ""


@pytest.mark.parametrize("status", [301, 302, 307, 308])
def test_metadata__redirection_is_not_followed(status: int, metadata: bytes) -> None:
    with sensor(says(b"HTTP/1.1 200 OK\r\n\r\n" + metadata)) as (other, elsewhere):
        moved = b"HTTP/1.1 %d Moved\r\nLocation: http://127.0.0.1:%d/\r\nContent-Length: 0\r\n\r\n" % (status, other)
        with sensor(says(moved)) as (port, _):
            assert sensor_metadata("127.0.0.1", port) == ""
    assert elsewhere == []


def test_asker__asks_few_and_nobody_outside(tmp_path: Path) -> None:
    """Whoever forges the sender of packets must not let this machine ask others."""
    small = SmallFiles(tmp_path)
    asker = MetadataAsker(small)
    try:
        asker.ask("198.41.0.4", "lidar-198.41.0.4")
        assert asker.asked == ()
        for number in range(2 * MAX_ASKED):
            asker.ask(f"127.0.9.{number}", f"lidar-127.0.9.{number}")
        assert asker.asked == tuple(f"lidar-127.0.9.{number}" for number in range(MAX_ASKED))
        time.sleep(1.0)
        assert asker.thread.ends == 0
    finally:
        asker.stop()
