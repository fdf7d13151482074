"""Sources of GNSS receivers: what is accepted can be opened, and everything else is refused at the start."""

from __future__ import annotations

import os
import socket
import sys
import threading
import time
from pathlib import Path

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

import furrowmap
from furrowmap.core.runtime.errors import InputError, UsageError
from furrowmap.core.session.session_file import load_session
from furrowmap.workflows.record.gnss_source import GnssSource
from furrowmap.workflows.record.receivers import GnssReceiver
from furrowmap.workflows.record.recording_files import Storage
from furrowmap.workflows.record.senders import Senders
from furrowmap.workflows.record.series import Series
from furrowmap.workflows.record.small_files import SmallFiles
from furrowmap.workflows.record.udp_packets import ScannerNetwork
from furrowmap.workflows.record.watch import Watch
from tests.replay import replay

from .senders import free_ports

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="serial devices need Linux or macOS")

NO_SOURCES = (
    *("tcp://:5017", "udp://:99999", "http://host:1", "/dev/ttyUSB0:12345", "/dev/ttyUSB0:0", "tcp://host:0"),
    *("tcp://host:65536", "tcp://host", "tcp://192.168.1..30:5017", "tcp://192.168.1.300:5017", "tcp://1.2.3:5017"),
    *("tcp://.host:5017", "tcp://-host:5017", f"tcp://{'a' * 64}.de:5017", f"tcp://{'a.' * 130}de:5017"),
    *(
        "tcp://[::1:5017",
        "tcp://[::g]:5017",
        "tcp://::1:5017",
        "tcp://host\0:5017",
        "/dev/tty\0:9600",
        "",
        ":",
        ":9600",
    ),
    *("tcp://\u3002\u3002:5017", "tcp://\ud800:5017", "tcp://ho st:5017", "/dev/ttyUSB0:" + "9" * 5000),
    *("tcp://host:\u0665\u0660\u0661\u0667", "udp://[fe80::1%]:5", "tcp://user@host:5017", "/dev/tty\nUSB0"),
)
SOURCES = (
    *("tcp://192.168.1.30:5017", "tcp://receiver.local:1", "tcp://receiver.local.:65535", "tcp://[::1]:5017"),
    *("tcp://b\u00fccher.example:5017", "udp://:15017", "udp://192.168.1.30:15017", "udp://[fe80::1%eth0]:15017"),
    *("/dev/ttyNONE", "/dev/ttyNONE:460800", "tcp://host:5017/"),
)


@pytest.mark.parametrize("text", NO_SOURCES)
def test_promise_26__source_that_cannot_be_opened_is_refused_at_the_start(text: str, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="no source"):
        furrowmap.record(tmp_path / "rec", gnss=[text])
    assert not (tmp_path / "rec").exists()


@pytest.mark.parametrize("port", [0, -1, 65_536, 99_999, 1 << 70])
def test_port__that_is_none_is_refused_at_the_start(port: int, tmp_path: Path) -> None:
    machine = tmp_path / "tractor.toml"
    machine.write_text(f"furrowmap_machine = 1\n[record]\nports = [{port}]\n", encoding="utf-8")
    for stated in ({"ports": [[port]]}, {"machine": machine}):
        with pytest.raises((UsageError, InputError), match=r"not UDP ports|tractor\.toml"):
            furrowmap.record(tmp_path / "rec", gnss=[], **stated)  # type: ignore[arg-type]
    assert not (tmp_path / "rec").exists()


@pytest.mark.parametrize("kind", ["folder", "file", "fifo", "below a file"])
def test_source__that_is_no_device_is_refused(kind: str, tmp_path: Path) -> None:
    path = tmp_path / "ttyGNSS"
    if kind == "folder":
        path.mkdir()
    elif kind == "fifo":
        os.mkfifo(path)
    else:
        path.touch()
    with pytest.raises(UsageError, match="no source"):
        GnssSource.parse(str(path / "device" if kind == "below a file" else path))


@pytest.mark.parametrize("text", SOURCES)
def test_source__that_may_be_plugged_in_later_is_accepted(text: str) -> None:
    assert GnssSource.parse(text).number > 0


@given(st.builds("{}://{}:{}".format, st.sampled_from(["tcp", "udp"]), st.text(max_size=30), st.integers(-1, 70_000)))
@example("tcp://a.b\u00ad.c:1")
def test_source__accepted_one_is_never_refused_by_the_resolver(text: str) -> None:
    """The resolver encodes names by IDNA first, and raises a UnicodeError where it cannot."""
    try:
        source = GnssSource.parse(text)
    except UsageError:
        return
    source.name.encode("idna")
    assert "\0" not in source.name
    assert 0 < source.number < 1 << 16


def sentence(second: int, lon: str = "14001.2000") -> bytes:
    body = b"GPGGA,0102%02d.00,3652.2000,N,%b,E,4,12,0.8,270.0,M,37.0,M,1.0,0000" % (second, lon.encode())
    checksum = 0
    for byte in body:
        checksum ^= byte
    return b"$%b*%02X\r\n" % (body, checksum)


@pytest.mark.skipif(sys.platform != "linux", reason="the addresses of the loopback are those of Linux")
@pytest.mark.parametrize("host", ["", "127.0.0.2"])
def test_promise_26__positions_of_several_senders_are_not_mixed(host: str, tmp_path: Path) -> None:
    """A foreign sender comes first and sends no positions, another comes later and sends some of elsewhere."""
    port = free_ports()[0]

    def work() -> None:
        for second in range(40):
            replay(iter([(0.0, port, b"foreign bytes, no positions\r\n")]), source="127.0.0.9")
            replay(iter([(0.0, port, sentence(second))]), source="127.0.0.2")
            if second > 20:
                replay(iter([(0.0, port, sentence(second, "00100.0000"))]), source="127.0.0.3")
            time.sleep(0.05)

    worker = threading.Thread(target=work)

    def told(_: object) -> None:
        if worker.ident is None:
            worker.start()
        elif not worker.is_alive():
            raise KeyboardInterrupt

    found = furrowmap.record(tmp_path / "rec", gnss=[f"udp://{host}:{port}"], ports=[[free_ports()[1]]], told=told)
    names = load_session(found.session).recording.gnss
    log = b"".join((tmp_path / "rec" / name).read_bytes() for name in names)
    assert log == b"".join(sentence(second) for second in range(40))
    status = found.status["gnss"][0]
    assert status["sender"] == "127.0.0.2"
    assert status["foreign_messages"] >= 19
    assert "record-gnss-senders" in (tmp_path / "rec" / "record.log").read_text()


def test_server__that_floods_is_read_no_faster_than_a_receiver_sends(tmp_path: Path) -> None:
    small = SmallFiles(tmp_path)
    storage = Storage(tmp_path, small)
    scans = Series(tmp_path, "lidar", ".pcap")
    with socket.create_server(("127.0.0.1", 0)) as server:
        receiver = GnssReceiver(
            f"tcp://127.0.0.1:{server.getsockname()[1]}", storage, lambda _: Series(tmp_path, "gnss", ".log")
        )
        connection, _ = server.accept()
        ends_s = time.monotonic() + 1.5
        connection.settimeout(0.1)

        def flood() -> None:
            while time.monotonic() < ends_s:
                try:
                    connection.sendall(bytes(1 << 16))
                except TimeoutError:
                    continue

        thread = threading.Thread(target=flood)
        thread.start()
        thread.join()
        watch = Watch(ScannerNetwork([], storage, Senders([], lambda *_: scans)), [receiver], storage, [])
        assert "record-gnss-flood" in {notice.code for notice in watch.look().warnings.values()}
        watch.network.stop()
        receiver.stop()
        connection.close()
    storage.drain()
    storage.close()
    size = (tmp_path / "gnss-0001.log").stat().st_size
    assert 1 << 20 < size < 8 << 20, "4 s at once, and a megabyte a second"
