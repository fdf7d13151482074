"""Readers of a live page that hang, that are many, or that are foreign pages keep nobody else out."""

from __future__ import annotations

import ctypes
import json
import socket
import sys
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager, suppress
from functools import partial
from http.client import HTTPConnection
from pathlib import Path
from threading import Event

import pytest

import furrowmap
from furrowmap.core.readers.arrived_scans import ScanStream
from furrowmap.core.runtime.errors import Notice
from furrowmap.core.runtime.supervised import SupervisedThread
from furrowmap.core.session.opened import open_session
from furrowmap.core.values.scan import Scan
from furrowmap.core.values.session import Recording
from furrowmap.workflows.live import server as served
from furrowmap.workflows.live.feeds import FolderFeed, recorder_status
from furrowmap.workflows.live.hosts import OwnHosts
from furrowmap.workflows.live.live import LiveLog, thread_fault
from furrowmap.workflows.live.mqtt import MqttOutlet
from furrowmap.workflows.live.reader_places import Places
from furrowmap.workflows.live.server import Hub, PageServer, event, serve_lines
from furrowmap.workflows.record.udp_packets import PCAP_HEAD
from tests.app.obstacles import OBSTACLES, obstacle

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="the addresses of the loopback are those of Linux")

STREAM = b"GET /events HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n"


@contextmanager
def page(hub: Hub, host: str = "0.0.0.0", names: tuple[str, ...] = ()) -> Iterator[int]:
    server = PageServer(host, 0, hub, "", None, names)
    yield int(server.server_address[1])
    server.shutdown()
    server.server_close()


def connected(port: int, source: str, says: bytes = b"") -> socket.socket:
    connection = socket.socket()
    connection.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    connection.bind((source, 0))
    connection.settimeout(20.0)
    connection.connect(("127.0.0.1", port))
    connection.sendall(says)
    return connection


def answered(port: int, source: str = "127.0.0.1") -> bool:
    """Whether a reader gets the stream."""
    try:
        with connected(port, source, STREAM) as reader:
            return reader.recv(100).startswith(b"HTTP/1.1 200")
    except OSError:
        return False


def gets_lines(hub: Hub, port: int) -> bool:
    """Whether a reader gets what a hub publishes."""

    def received(reader: socket.socket) -> bool:
        hub.publish(lambda: b"line")
        with suppress(TimeoutError):
            return reader.recv(100).startswith(b"line")
        return False

    try:
        with connected(port, "127.0.0.1") as reader:
            reader.settimeout(0.1)
            return holds(partial(received, reader), 2.0)
    except OSError:
        return False


def holds(condition: Callable[[], bool], within_s: float = 30.0) -> bool:
    ends_s = time.monotonic() + within_s
    while time.monotonic() < ends_s:
        if condition():
            return True
        time.sleep(0.1)
    return False


@pytest.mark.parametrize("addresses", [1, 5])
def test_promise_26__connections_that_never_read_keep_nobody_out(addresses: int) -> None:
    """60 of one address, and as many of each of five: another one is served at once."""
    with page(Hub(lambda: event("picture", "x" * 50_000))) as port, ExitStack() as stack:
        for number in range(60 * addresses):
            try:
                stack.enter_context(connected(port, f"127.0.1.{1 + number % addresses}", STREAM))
            except OSError:
                continue
        assert all(answered(port, f"127.0.2.{number}") for number in range(1, 6))
        assert answered(port)


def test_promise_26__slow_requests_keep_nobody_out(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(served, "REQUEST_S", 1.0)
    with page(Hub()) as port, ExitStack() as stack:
        slow = [
            stack.enter_context(connected(port, f"127.0.1.{1 + number % 8}", b"GET / HTTP/1.1\r\nHost:"))
            for number in range(400)
        ]
        begun_s = time.monotonic()
        assert holds(lambda: answered(port))
        ended = [each for each in slow if is_ended(each)]
        sys.stderr.write(f"served after {time.monotonic() - begun_s:.1f} s, {len(ended)} of 400 slow ones ended\n")
        assert holds(lambda: all(is_ended(each) for each in slow))


def is_ended(connection: socket.socket) -> bool:
    """Whether the server has ended a connection to which bytes still trickle."""
    try:
        connection.sendall(b"a")
        connection.settimeout(0.01)
        return connection.recv(1000) == b""
    except TimeoutError:
        return False
    except OSError:
        return True


def test_reader__that_takes_nothing_loses_its_place(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(served, "WRITE_S", 1.0)
    hub = Hub()
    with page(hub) as port, connected(port, "127.0.0.1", STREAM):
        assert holds(lambda: hub.readers == 1)
        for _ in range(100):
            hub.publish(lambda: event("pose", "x" * 50_000))
            time.sleep(0.01)
        assert holds(lambda: hub.readers == 0 and len(hub.places) == 0)


def gives_place_back(ends: str) -> bool:
    """Whether a connection to an outlet that sends nothing gives its place back once it has ended."""
    hub = Hub()
    server = serve_lines("127.0.0.1", 0, hub)
    reader = connected(int(server.server_address[1]), "127.0.0.1")
    assert holds(lambda: hub.readers == 1)
    if ends == "half closed":
        reader.shutdown(socket.SHUT_WR)
    elif ends == "reset":
        reader.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, b"\1\0\0\0\0\0\0\0")
        reader.close()
    else:
        reader.close()
    is_back = holds(lambda: hub.readers == 0 and len(hub.places) == 0, 10.0)
    reader.close()
    server.shutdown()
    server.server_close()
    return is_back


def test_outlet__connection_that_was_closed_gives_its_place_back() -> None:
    """All at the same time: an outlet looks each two seconds."""
    ends = ("closed", "half closed", "reset")
    with ThreadPoolExecutor() as pool:
        assert dict(zip(ends, pool.map(gives_place_back, ends), strict=True)) == dict.fromkeys(ends, True)


def test_outlet__many_connections_of_an_address_keep_others_in() -> None:
    hub = Hub()
    server = serve_lines("127.0.0.1", 0, hub)
    port = int(server.server_address[1])
    with ExitStack() as stack:
        for _ in range(100):
            stack.enter_context(connected(port, "127.0.1.1", b"what an NMEA receiver is never told"))
        reader = stack.enter_context(connected(port, "127.0.0.1"))
        assert holds(lambda: "127.0.0.1" in {each.place.address for each in hub._readers})
        hub.publish(lambda: b"$GPGGA\r\n")
        assert reader.recv(100) == b"$GPGGA\r\n"
    server.shutdown()
    server.server_close()


def test_places__are_shared_among_addresses() -> None:
    closed = list[str]()
    places = Places(6, 4)
    taken = [places.take("a", lambda: closed.append("a")) for _ in range(5)]
    assert [each is not None for each in taken] == [True] * 4 + [False]
    assert all(places.take("b", lambda: closed.append("b")) for _ in range(2))
    assert places.take("c", lambda: None) is not None
    assert closed == ["a"]
    assert len(places) == 6
    assert places.take("d", lambda: None) is not None
    assert closed == ["a", "a"]
    assert places.take("c", lambda: None) is None, "nobody has two more"
    hanging = places.take("a", lambda: None)
    assert hanging is None
    later = next(each for each in taken[2:] if each is not None)
    later.expect(-1.0)
    places.close_overdue()
    assert closed == ["a", "a", "a"]
    later.expect_nothing()
    places.leave(later)
    assert len(places) == 5


def status_of(port: int, request: bytes) -> int:
    """The status of the answer; 0 where there is none."""
    with connected(port, "127.0.0.1", request) as reader:
        try:
            answer = reader.recv(200)
        except OSError:
            return 0
        return int(answer.split(b" ")[1]) if answer else 0


@pytest.mark.parametrize(
    ("lines", "status"),
    [
        (("Host: 127.0.0.1",), 200),
        (("Host: localhost:8080",), 200),
        (("Host: LOCALHOST.",), 200),
        (("Host: [::1]:8080",), 200),
        (("Host: 192.168.1.10:8080",), 421),
        (("Host: evil.example",), 421),
        (("Host: 127.0.0.1.evil.example",), 421),
        (("Host: 127.0.0.1@evil.example",), 421),
        (("Host: evil.example", "Host: 127.0.0.1"), 421),
        (("Host:",), 421),
        ((), 421),
        (("Host: tractor.example",), 200),
        (("Host: 127.0.0.1", "Origin: http://evil.example"), 403),
        (("Host: 127.0.0.1", "Origin: null"), 403),
        (("Host: 127.0.0.1", "Origin: http://127.0.0.1"), 200),
        (("Host: 127.0.0.1", "Content-Length: 5"), 413),
        (("Host: 127.0.0.1", "Transfer-Encoding: chunked"), 413),
        (("Host: 127.0.0.1", "A: " + "a" * 20_000), 0),
        (("Host: 127.0.0.1", *(f"A{number}: a" for number in range(90))), 200),
        (("Host: 127.0.0.1", *(f"A{number}: a" for number in range(200))), 431),
    ],
    ids=str,
)
def test_promise_26__page_is_asked_for_by_names_of_this_computer_only(lines: tuple[str, ...], status: int) -> None:
    """A page of another site whose name leads here (DNS rebinding) reads nothing; served at the loopback."""
    with page(Hub(), "127.0.0.1", ("tractor.example",)) as port:
        request = "\r\n".join(("GET / HTTP/1.1", *lines, "", ""))
        assert status_of(port, request.encode("ascii")) == status


def test_page__of_another_site_opens_no_stream() -> None:
    with page(Hub()) as port:
        for path, status in (("/", 200), ("/events", 403), ("/live.js", 403)):
            asked = f"GET {path} HTTP/1.1\r\nHost: 192.168.1.10\r\nSec-Fetch-Site: cross-site\r\n\r\n"
            assert status_of(port, asked.encode("ascii")) == status
        assert status_of(port, b"GET /" + b"a" * 70_000 + b" HTTP/1.1\r\n\r\n") in (0, 414)
        reader = HTTPConnection("127.0.0.1", port, timeout=20)
        reader.request("GET", "/")
        answer = reader.getresponse()
        answer.read()
        assert answer.getheader("Cross-Origin-Resource-Policy") == "same-origin"
        assert answer.getheader("Access-Control-Allow-Origin") is None
        reader.close()


def test_hosts__in_the_network_are_the_name_and_the_addresses_of_the_computer() -> None:
    own = OwnHosts.of("0.0.0.0", ["Cab.Example."])
    name = socket.gethostname()
    for header in (name, f"{name}:8080", f"{name.partition('.')[0]}.local", "10.0.0.7:80", "[fe80::1]", "cab.example"):
        assert own.include(header)
    for header in (f"{name}.evil.example", "", ":80", "[::1", "a b", "host:80:80", "[evil]:80"):
        assert not own.include(header)


@pytest.mark.parametrize("kind", OBSTACLES)
def test_promise_26__live_log_is_written_through_nothing(kind: str, tmp_path: Path) -> None:
    with obstacle(tmp_path / "live.jsonl", kind) as unchanged:
        log = LiveLog(tmp_path / "live.jsonl")
        log.begin({"crs": "EPSG:6677"})
        log.append({"t_s": 1.0})
        unchanged()
        if log.fault is None:
            lines = (tmp_path / "live.jsonl").read_text(encoding="utf-8").splitlines()
            assert list(map(json.loads, lines)) == [{"crs": "EPSG:6677"}, {"t_s": 1.0}]
        else:
            assert log.fault.code == "live-log"


@pytest.mark.parametrize("content", ["", "[]", "5", '{"warnings": 5}', '{"warnings": [5, {"code": 1}]}', "[" * 100_000])
def test_status__of_something_else_is_none(content: str, tmp_path: Path) -> None:
    (tmp_path / "status.json").write_text(content, encoding="utf-8")
    assert recorder_status(tmp_path).get("warnings", []) == []


@pytest.mark.parametrize("kind", OBSTACLES)
def test_status__is_read_from_a_file_only(kind: str, tmp_path: Path) -> None:
    with obstacle(tmp_path / "status.json", kind):
        assert recorder_status(tmp_path) == {}


class Killed(BaseException):
    """What no handler of a thread expects."""


def kill(thread: SupervisedThread) -> None:
    """Raise an exception in a thread, at whatever it is just doing; not in another one that got its identifier."""
    if thread.is_working:
        ctypes.pythonapi.PyThreadState_SetAsyncExc(ctypes.c_ulong(thread.ident or 0), ctypes.py_object(Killed))


def killed(thread: SupervisedThread, times: int) -> bool:
    """Whether a thread was ended so many times, by one exception each; it is kept alive, as by a live session.

    An exception that comes to a thread as it ends is lost, and there is another one.
    """
    for _ in range(10):
        kill(thread)
        if holds(partial(has_ended, thread, times), 2.0):
            return True
    return False


def has_ended(thread: SupervisedThread, times: int) -> bool:
    return kept_alive(thread) and thread.ends >= times


def kept_alive(thread: SupervisedThread) -> bool:
    """Start a thread again where it ended, as a live session does each second."""
    thread.ensure()
    return True


# An exception that is raised in a thread may come to it in somebody's __del__, or as a request's thread begins.
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_promise_26__servers_whose_threads_are_killed_serve_again() -> None:
    lines = Hub()
    for server, works in (
        (PageServer("127.0.0.1", 0, Hub(), ""), answered),
        (serve_lines("127.0.0.1", 0, lines), partial(gets_lines, lines)),
    ):
        port = int(server.server_address[1])
        assert holds(lambda works=works, port=port: works(port))  # type: ignore[misc]
        for ends in range(1, 4):
            assert killed(server.thread, ends)
            assert "Killed" in server.thread.cause
            fault = thread_fault(server.thread)
            assert fault is not None
            assert fault.code == "live-thread"
            # A second exception of `killed` may come late, and end the thread itself.
            assert holds(lambda server=server, works=works, port=port: kept_alive(server.thread) and works(port))  # type: ignore[misc]
        server.shutdown()
        server.server_close()


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_promise_26__feed_whose_threads_are_killed_goes_on_where_it_was(
    simulated: furrowmap.Simulated, tmp_path: Path
) -> None:
    """Copies of captures, and links at their names, are not followed."""
    own = "lidar-192.168.1.201"
    (tmp_path / f"{own}-0001.pcap").write_bytes(PCAP_HEAD)
    (tmp_path / f"{own}-0001 (copy).pcap").write_bytes(b"no capture")
    (tmp_path / f"{own}-0003.pcap").symlink_to(tmp_path / "none")
    (tmp_path / "gnss-0001.log").write_bytes(b"0,")
    recording = Recording(lidar=(f"{own}-0001.pcap",), gnss=("gnss-0001.log",))
    feed = FolderFeed(tmp_path, recording, ScanStream(tmp_path / f"{own}-0001.pcap", "VLP-16"), Event())
    log = b""
    scans = list[Scan]()
    written = 0
    for piece in feed.pieces():
        log += piece.data if isinstance(piece.data, bytes) else b""
        scans += piece.data if isinstance(piece.data, list) else []
        if written < 6 and log.endswith(b"%d," % written):
            written += 1
            for thread in feed.threads:
                kill(thread)
            with (tmp_path / "gnss-0001.log").open("ab") as file:
                file.write(b"%d," % written)
            if written == 3:
                (tmp_path / f"{own}-0002.pcap").write_bytes((simulated.folder / "recording.pcap").read_bytes())
        if log.endswith(b"6,") and len(scans) > 40:
            (tmp_path / "status.json").write_text('{"state": "ended"}', encoding="utf-8")
    assert log == b"0,1,2,3,4,5,6,"
    assert all(thread.ends for thread in feed.threads)
    of_file = list(open_session(simulated.session).lidar(0.0).scans())
    assert [len(scan) for scan in scans] == [len(scan) for scan in of_file][: len(scans)]


def test_mqtt__packet_that_states_256_mb_ends_the_connection() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        server.settimeout(20.0)
        outlet = MqttOutlet(f"mqtt://127.0.0.1:{server.getsockname()[1]}")
        broker, _ = server.accept()
        with broker:
            broker.settimeout(20.0)
            broker.recv(1000)
            broker.sendall(b"\x20\x02\0\0" + b"\x30\xff\xff\xff\x7f" + bytes(1000))
            with suppress(ConnectionError):
                while broker.recv(1000):  # it says that it is online, until it reads what it is sent
                    pass
        outlet.close()


NO_BROKERS = (
    b"\x20\x00",
    b"\x20\x01\0",
    b"\x30\xff\xff\xff\xff\xff",
    b"\x30\x02\0\x50",
    b"HTTP/1.1 400 No\r\n\r\n",
    b"\xff" * 100,
)


def told_of_broker(answer: bytes) -> Notice | None:
    """What an outlet says of a server that answers so, after it was asked twice."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        server.settimeout(20.0)
        outlet = MqttOutlet(f"mqtt://127.0.0.1:{server.getsockname()[1]}")
        for _ in range(2):
            broker, _ = server.accept()
            with broker:
                broker.recv(1000)
                broker.sendall(answer)
                time.sleep(0.2)
        fault = outlet.fault
        outlet.close()
        return fault


def test_mqtt__broker_that_is_none_is_named_and_asked_again() -> None:
    """All at the same time: an outlet asks again after a second."""
    with ThreadPoolExecutor(len(NO_BROKERS)) as pool:
        faults = dict(zip(NO_BROKERS, pool.map(told_of_broker, NO_BROKERS), strict=True))
    assert {answer: fault and fault.code for answer, fault in faults.items()} == dict.fromkeys(NO_BROKERS, "live-mqtt")
