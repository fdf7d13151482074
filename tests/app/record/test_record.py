"""`furrowmap record` with real sockets, terminals and disks: what was sent is in the files, and faults are named."""

from __future__ import annotations

import json
import os
import resource
import signal
import socket
import struct
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from functools import partial, reduce
from itertools import islice
from operator import xor
from pathlib import Path
from urllib.request import urlopen

import pytest

import furrowmap
from furrowmap.core.readers.ouster.metadata import packet_bytes
from furrowmap.core.runtime.errors import Notice, RefusedError
from furrowmap.core.session.session_file import load_session
from furrowmap.workflows.record.receivers import GnssReceiver
from furrowmap.workflows.record.record import Told, open_ports
from furrowmap.workflows.record.recording_files import Storage
from furrowmap.workflows.record.senders import Senders
from furrowmap.workflows.record.series import Series
from furrowmap.workflows.record.small_files import SmallFiles
from furrowmap.workflows.record.udp_packets import USUAL_PORTS, Port, ScannerNetwork
from furrowmap.workflows.record.watch import Watch
from tests.replay import packets, replay, sentences

from .senders import free_ports, payloads

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="the addresses of the loopback are those of Linux")


@pytest.fixture
def ports() -> tuple[int, int, int]:
    """Free UDP ports: data, positions, GNSS."""
    return free_ports()


def recorded(
    folder: Path,
    ports: tuple[int, int, int],
    work: Callable[[], object],
    gnss: str | None = None,
    heard: list[Told] | None = None,
    **options: object,
) -> tuple[furrowmap.Recorded, list[Told]]:
    """A recording during which `work` is done, and what it reported, which goes to `heard` meanwhile."""
    heard = [] if heard is None else heard
    worker = threading.Thread(target=work)

    def told(moment: Told) -> None:
        heard.append(moment)
        if len(heard) == 1:
            worker.start()
        elif not worker.is_alive():
            raise KeyboardInterrupt  # as the user does

    source = gnss if gnss is not None else f"udp://127.0.0.1:{ports[2]}"
    found = furrowmap.record(folder, gnss=[source] if source else [], ports=[ports[:2]], **{"told": told, **options})
    return found, heard


def codes(heard: list[Told], kind: str = "begun") -> list[str]:
    return [notice.code for told in heard for notice in getattr(told, kind)]


def waited_for(holds: Callable[[], bool]) -> None:
    """Return when something holds, or after half a minute."""
    until_s = time.monotonic() + 30.0
    while not holds() and time.monotonic() < until_s:
        time.sleep(0.05)


def new_log(folder: Path, name: str, address: str) -> Series:
    return Series(folder, f"gnss{name}{address}", ".log")


def test_promise_26__hanging_reader_loses_nothing_of_two_scanners_and_a_receiver(
    shared_data: Path, tmp_path: Path, ports: tuple[int, int, int]
) -> None:
    """A reader of the status that hangs does not stop it. The capture rolls, and the session names all files."""
    loop = shared_data / "tractor_loop"
    sent = list(islice(packets(loop / "recording.pcap.gz", {2368: ports[0], 8308: ports[1]}), 2000))
    log = list(islice(sentences(loop / "gnss.nmea", sent[0][0] // 86_400 * 86_400, ports[2]), 80))

    def work() -> None:
        for k in range(3):
            replay(iter(sent[k * 500 : k * 500 + 500]))
            replay(iter(sent[k * 500 : k * 500 + 250]), source="127.0.0.2")
            replay(iter(log[k * 20 : k * 20 + 20]))

    hung: list[float] = []

    def told_once(_: Told) -> None:
        if not hung:
            worker.start()
            hung.append(time.monotonic())
            worker.join()  # looks at nothing while all is sent
        else:
            raise KeyboardInterrupt

    worker = threading.Thread(target=work)
    found, _ = recorded(tmp_path / "rec", ports, work, roll_s=0.5, told=told_once)
    folder = tmp_path / "rec"
    second = [event for k in range(3) for event in sent[k * 500 : k * 500 + 250]]
    for address, events in (("127.0.0.1", sent[:1500]), ("127.0.0.2", second)):
        there = payloads(folder, f"lidar-{address}")
        for port in ports[:2]:  # each port is read in its turn
            expected = [content for _, to, content in events if to == port]
            assert [each for each in there if len(each) == len(expected[0])] == expected
    assert (folder / "gnss-0001.log").read_bytes() == b"".join(line for _, _, line in log[:60])
    session = load_session(found.session)
    assert session.recording.lidar == tuple(sorted(path.name for path in folder.glob("lidar-127.0.0.1-*.pcap")))
    assert len(session.recording.lidar) > 1
    assert (session.recording.gnss, session.crs.map) == (("gnss-0001.log",), "EPSG:6677")
    assert [lidar.files for lidar in session.further_lidars] == [
        tuple(sorted(path.name for path in folder.glob("lidar-127.0.0.2-*.pcap")))
    ]
    status = json.loads((folder / "status.json").read_text())
    assert status["state"] == "ended"
    assert [(each["address"], each["packets"], each["maker"]) for each in status["scanners"]] == [
        ("127.0.0.1", 1500, "Velodyne"),
        ("127.0.0.2", 750, "Velodyne"),
    ]
    assert status["disk"]["most_unsynced_s"] > 0.0
    assert {socket_["dropped"] for socket_ in status["sockets"]} == {0}
    assert "granted" in (folder / "record.log").read_text()


def power_cut(folder: Path, ports: tuple[int, int, int], after_s: float) -> tuple[float, list[int]]:
    """Kill a recording of numbered packets; the time of the kill, and the numbers in its captures."""
    program = "import sys, furrowmap; furrowmap.record(sys.argv[1], ports=[[int(sys.argv[2])]], roll_s=0.7)"
    with subprocess.Popen([sys.executable, "-c", program, folder, str(ports[0])]) as process:
        status = folder / "status.json"  # that of an earlier recording may lie there
        while not (status.exists() and json.loads(status.read_text(encoding="utf-8"))["pid"] == process.pid):
            assert process.poll() is None
            time.sleep(0.05)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
            begun_s, sent = time.monotonic(), 0
            while time.monotonic() - begun_s < after_s:
                sender.sendto(struct.pack("<I", sent) + bytes(1200), ("127.0.0.1", ports[0]))
                sent += 1
                time.sleep(0.001)
        process.kill()
    return sent, [struct.unpack_from("<I", each)[0] for each in payloads(folder, "lidar-127.0.0.1")]


def test_promise_26__power_cut_loses_a_second_at_most(tmp_path: Path, ports: tuple[int, int, int]) -> None:
    sent, found = power_cut(tmp_path / "rec", ports, 2.0)
    assert found == list(range(len(found)))
    assert len(found) > sent / 2, "a second of two"
    # The next recording into the folder goes on behind it.
    _, more = power_cut(tmp_path / "rec", ports, 1.0)
    assert more[: len(found)] == found
    assert more[len(found) :] == list(range(len(more) - len(found)))
    names = sorted(path.name for path in (tmp_path / "rec").glob("*.pcap"))
    assert [name[-9:-5] for name in names] == [f"{k + 1:04d}" for k in range(len(names))]


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A disk of 3 MB."""
    folder = tmp_path / "card"
    folder.mkdir()
    mounted = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", "size=3m", "tmpfs", folder], check=False, capture_output=True
    )
    if mounted.returncode:
        pytest.skip("only root may mount a disk")
    yield folder
    subprocess.run(["umount", "-l", folder], check=True)


def test_promise_26__full_disk_is_named_and_nothing_is_lost_when_space_returns(
    small_disk: Path, ports: tuple[int, int, int]
) -> None:
    sent = [struct.pack("<I", k) + bytes(1200) for k in range(2000)]

    heard: list[Told] = []

    def work() -> None:
        (small_disk / "ballast").write_bytes(bytes(3 << 19))
        replay((k * 5e-4, ports[0], each) for k, each in enumerate(sent))
        waited_for(lambda: "waiting-for-space" in {told.status.values["state"] for told in heard})
        (small_disk / "ballast").unlink()
        waited_for(lambda: "record-disk" in codes(heard, "ended"))

    recorded(small_disk / "rec", ports, work, gnss="", heard=heard)
    assert payloads(small_disk / "rec", "lidar-127.0.0.1") == sent
    assert "record-disk" in codes(heard)
    assert "record-disk" in codes(heard, "ended")
    assert "waiting-for-space" in {told.status.values["state"] for told in heard}
    assert "record-disk" in (small_disk / "rec" / "record.log").read_text()


def test_promise_26__full_disk_at_the_end_leaves_what_was_written_whole(
    small_disk: Path, ports: tuple[int, int, int]
) -> None:
    sent = [struct.pack("<I", k) + bytes(1200) for k in range(3000)]
    found, heard = recorded(
        small_disk / "rec", ports, lambda: replay((k * 3e-4, ports[0], each) for k, each in enumerate(sent)), gnss=""
    )
    there = payloads(small_disk / "rec", "lidar-127.0.0.1")
    assert there == sorted({*there} & {*sent}, key=sent.index)
    lost_bytes = (len(sent) - len(there)) * (16 + 42 + 1204)
    assert found.status["disk"]["discarded_bytes"] == lost_bytes > 0
    assert {"record-disk", "record-discarded"} <= {*codes(heard), *(w["code"] for w in found.status["warnings"])}


def test_promise_26__file_that_takes_no_more_is_followed_by_another(tmp_path: Path) -> None:
    """As on a card with FAT32, which has no file over 4 GB."""
    storage = Storage(tmp_path, SmallFiles(tmp_path))
    series = Series(tmp_path, "lidar-a", ".pcap", b"head")
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (250_000, hard))
    try:
        for k in range(4):
            storage.put(series, (bytes([k]) * 100_000, time.monotonic()))
        time.sleep(1.5)  # the third block is tried again after a second
        storage.drain()
        storage.close()
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    written = [path.read_bytes() for path in sorted(tmp_path.glob("*.pcap"))]
    assert written == [b"head" + b"".join(bytes([k]) * 100_000 for k in pair) for pair in ((0, 1), (2, 3))]


def test_promise_26__faults_are_named_within_three_seconds_and_end(
    shared_data: Path, tmp_path: Path, ports: tuple[int, int, int]
) -> None:
    """The cable of the scanner is out for a while, the receiver comes late, has no fix, and is unplugged."""
    loop = shared_data / "tractor_loop"
    sent = list(islice(packets(loop / "recording.pcap.gz", {2368: ports[0], 8308: ports[1]}), 3800))
    sent = [event for k, event in enumerate(sent) if not 200 <= k < 230]  # lost on the way
    without_fix = b"".join(_sentence(b"GNGGA,0123%02d.00,,,,,0,00,99.9,,,,,," % k) for k in range(20))
    with_fix = b"".join((loop / "gnss.nmea").read_bytes().splitlines(keepends=True)[:40])
    device = tmp_path / "ttyGNSS"
    heard: list[Told] = []
    silent_s: list[float] = []

    def work() -> None:
        scanner = threading.Thread(target=lambda: replay(iter(sent)))
        scanner.start()
        for content in (without_fix, with_fix):
            controller, terminal = os.openpty()
            device.symlink_to(os.ttyname(terminal))
            time.sleep(1.2)
            os.write(controller, content)
            time.sleep(1.2)
            os.close(terminal)
            os.close(controller)
            device.unlink()
        scanner.join()
        silent_s.append(time.monotonic())
        waited_for(lambda: "record-silent" in codes(heard))
        silent_s.append(time.monotonic())

    recorded(tmp_path / "rec", ports, work, gnss=str(device), heard=heard)
    assert silent_s[1] - silent_s[0] < 3.5
    begun, ended = codes(heard), codes(heard, "ended")
    assert {"record-gnss-fault", "record-no-fix", "record-clock", "record-lost", "record-silent"} <= {*begun}
    assert {"record-gnss-fault", "record-no-fix", "record-clock"} <= {*ended}
    assert heard[-1].status.values["scanners"][0]["lost"] == 30
    assert (tmp_path / "rec" / "gnss-0001.log").read_bytes() == without_fix + with_fix
    log = (tmp_path / "rec" / "record.log").read_text()
    assert all(code in log for code in begun)


def _sentence(content: bytes) -> bytes:
    return b"$%b*%02X\r\n" % (content, reduce(xor, content))


def page_answers() -> bool:
    try:
        with urlopen("http://127.0.0.1:8080/", timeout=5.0) as answer:
            return b"<canvas" in answer.read()
    except OSError:
        return False


def test_live__shows_its_page_while_it_is_recorded(
    shared_data: Path, tmp_path: Path, ports: tuple[int, int, int]
) -> None:
    """One command, from a profile with the implement as it was learned: its session has what live needs."""
    if page_answers():
        pytest.skip("another page is at port 8080")
    session = tmp_path / "session.toml"
    text = (shared_data / "tractor_loop" / "session.toml").read_text(encoding="utf-8")
    session.write_text(text.replace("width_m", 'learned = "implement.npz"\nwidth_m'), encoding="utf-8")
    (tmp_path / "implement.npz").write_bytes(b"learned")
    furrowmap.save_machine(session, tmp_path / "tractor.toml")
    words = f"--machine {tmp_path}/tractor.toml --live --gnss udp://127.0.0.1:{ports[2]} --ports {ports[0]}".split()
    command = [sys.executable, "-m", "furrowmap", "record", "-o", str(tmp_path / "rec"), *words]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as recorder:
        seen = any(page_answers() or time.sleep(0.2) for _ in range(300) if recorder.poll() is None)
        while not (tmp_path / "rec" / "session.toml").exists() and recorder.poll() is None:
            time.sleep(0.2)
        recorder.send_signal(signal.SIGINT)
        answer, told = recorder.communicate(timeout=60)
    assert seen, told
    assert recorder.returncode == 0, told
    assert "Next: furrowmap run" not in answer
    assert "No packets of a scanner were recorded" in told
    assert "No positions were recorded" in told
    said = told.replace(Notice("live-works-on").text, "")  # if the page took more than two seconds
    assert "page" not in said.lower(), "the page's process ends without a word"
    assert "Cancelled" not in told, "the page's process ends well, as the recording does"
    assert not page_answers()
    text = (tmp_path / "rec" / "session.toml").read_text(encoding="utf-8")
    assert 'learned = "tractor.npz"' in text
    assert (tmp_path / "rec" / "tractor.npz").read_bytes() == b"learned"


def test_watch__names_what_is_wrong(tmp_path: Path, ports: tuple[int, int, int]) -> None:
    data = b"\xff\xee" + bytes(1198) + struct.pack("<IBB", 0, 0x37, 0x22)
    size = packet_bytes("RNG19_RFL8_SIG16_NIR16", 16, 16)
    ouster = struct.pack("<HH", 1, 7) + bytes(size - 4)
    livox = struct.pack("<BH", 0, 50) + bytes(47)  # SDK2: version, length, and a point
    unlocked = bytes(202) + b"\1" + bytes(3) + b"$GPRMC" + bytes(300)
    port = Port.open(ports[0])
    with pytest.raises(RefusedError, match="cannot be opened"):
        Port.open(ports[0])
    port.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 2000)
    replay((0.0, ports[0], data) for _ in range(100))  # before anything is read
    storage = Storage(tmp_path, SmallFiles(tmp_path))
    senders = Senders([], lambda address, _: Series(tmp_path, f"lidar-{address}", ".pcap", b"head"))
    network = ScannerNetwork([port], storage, senders)
    receivers = [
        GnssReceiver(f"udp://127.0.0.1:{number}", storage, partial(new_log, tmp_path, str(number)))
        for number in ports[1:]
    ]
    watch = Watch(network, receivers, storage, [Notice("record-no-gnss")])
    try:
        time.sleep(0.1)
        replay((0.0, ports[0], each) for each in (data, unlocked))
        for k in range(2, 21):
            # Among the first eight, which have a place; the port's buffer is small, so this one is sent ten times.
            for packet in [livox] * 10 if k == 3 else [ouster]:
                replay(iter([(0.0, ports[0], packet)]), source=f"127.0.0.{k}")
                time.sleep(0.02)
        replay((0.0, ports[1], bytes(range(128, 256)) * 8) for _ in range(8))
        time.sleep(0.3)
        watch._clock_s -= 5.0  # the clock of five seconds ago
        found = watch.look().warnings
        for _ in range(20):
            storage._oldest_s = time.monotonic() - 1e6  # a disk that flushes nothing; the flusher may come in between
            found |= watch.look().warnings
        receivers[1]._begun_s -= 60.0
        storage.discarded_bytes += 1
        found |= watch.look().warnings
    finally:
        for part in (network, *receivers):
            part.stop()
        storage.drain()
        storage.close()
    assert {name.split(" ")[0].removeprefix("record-") for name in found} == {
        *("no-gnss", "dropped", "pps", "senders", "no-metadata", "gnss-unknown", "gnss-silent", "clock-jump"),
        *("disk-slow", "discarded", "unread", "many-scanners"),
    }
    jump = next(notice for name, notice in found.items() if "clock-jump" in name)
    # The two clocks are read one after the other, and a busy machine takes some milliseconds between them.
    assert dict(jump.values)["jump_s"] == pytest.approx(5.0, abs=0.1)


def test_buffer__that_is_small_is_named(ports: tuple[int, int, int], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("furrowmap.workflows.record.record.BUFFER_BYTES", 1 << 40)  # more than any system grants
    (port,), notices = open_ports([ports[:1]])
    port.socket.close()
    assert [notice.code for notice in notices] == ["record-buffer"]


def test_server__that_ends_the_connection_is_asked_again(tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        storage = Storage(tmp_path, SmallFiles(tmp_path))
        source = f"tcp://127.0.0.1:{server.getsockname()[1]}"
        receiver = GnssReceiver(source, storage, partial(new_log, tmp_path, ""))
        for content in (b"first", b"second"):
            connection, _ = server.accept()
            connection.sendall(content)
            connection.close()
        server.settimeout(3.0)
        server.accept()[0].close()
        receiver.stop()
        storage.drain()
        storage.close()
    assert (tmp_path / "gnss-0001.log").read_bytes() == b"firstsecond"


def test_ports__are_those_of_the_makers_manuals() -> None:
    """VLP-16 user manual (data, positions); Pandar (data, GPS); Ouster (lidar, IMU); Livox Mid-360 (points, IMU on the
    host's side); RoboSense RS-LiDAR-16 (MSOP, DIFOP)."""
    manuals = {"Velodyne": {2368, 8308}, "Hesai": {2368, 10110}, "Ouster": {7502, 7503}}
    manuals |= {"Livox": {56301, 56401}, "RoboSense": {6699, 7788}}
    assert set(USUAL_PORTS) == set().union(*manuals.values())
