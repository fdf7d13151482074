"""The page and the outlets of a live session, as readers in the network see them."""

from __future__ import annotations

import base64
import json
import socket
import time
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from http.client import HTTPConnection, HTTPResponse
from pathlib import Path
from threading import Event
from typing import TYPE_CHECKING, Any

import numpy as np
import pynmeagps
import pytest

import furrowmap
from furrowmap.cli.main import command_line
from furrowmap.core.coverage.worked_cells import TILE_CELLS, WORKED, WorkedCells
from furrowmap.core.geodesy.projection import map_frame
from furrowmap.core.live.drive import LivePose
from furrowmap.core.readers.arrived_scans import ScanStream
from furrowmap.core.runtime.errors import InputError, Notice
from furrowmap.core.runtime.languages.texts import LANGUAGES, texts_of
from furrowmap.core.session.opened import open_session
from furrowmap.core.session.proposal import recorded_session
from furrowmap.core.simulator.capture import frame_head
from furrowmap.core.values.gnss import Fix
from furrowmap.core.values.machine import Machine
from furrowmap.core.values.scan import Scan
from furrowmap.core.values.session import Crs, Recording
from furrowmap.workflows.live.feeds import FolderFeed
from furrowmap.workflows.live.live import Outlets, by_language
from furrowmap.workflows.live.nmea import sentences
from furrowmap.workflows.live.server import QUEUED_MESSAGES, Hub, PageServer, Pictures, event, serve_lines
from furrowmap.workflows.record.udp_packets import PCAP_HEAD, PCAP_RECORD

if TYPE_CHECKING:
    from playwright.sync_api import Browser


def events(answer: HTTPResponse) -> Iterator[tuple[str, Any]]:
    """The events of a stream, by name, but for those that keep the connection open."""
    name = ""
    for line in answer:
        field, _, value = line.decode().strip().partition(": ")
        if field == "event":
            name = value
        elif field == "data" and name != "alive":
            yield name, json.loads(value)


@contextmanager
def page(hub: Hub) -> Iterator[HTTPConnection]:
    server = PageServer("127.0.0.1", 0, hub, "")
    reader = HTTPConnection("127.0.0.1", server.server_address[1], timeout=20)
    yield reader
    reader.close()
    server.shutdown()
    server.server_close()


def ten_hectares() -> WorkedCells:
    """Passes of 6 m, turned against the cells, over 10 ha."""
    cells, ahead = WorkedCells(6.0), np.array([np.cos(0.3), np.sin(0.3)])
    left = np.array([-ahead[1], ahead[0]])
    for number in range(50):
        lines = [a * ahead + (6.0 * number + side) * left for a in (0.0, 333.0) for side in (-3.0, 3.0)]
        cells.add_line(np.array(lines[:2]), np.array(lines[2:]), 400.0 * number)
    return cells


def test_stream__begins_with_a_small_whole_picture_and_goes_on_with_what_changes() -> None:
    cells, pictures = ten_hectares(), Pictures()
    hub = Hub(pictures.whole)
    hub.publish(lambda: pictures.changes(cells, set(cells.tiles())))
    assert cells.area_m2(WORKED) == pytest.approx(99_900.0, rel=0.001)
    assert len(pictures.whole()) < 200_000
    with page(hub) as reader:
        reader.request("GET", "/events")
        stream = events(reader.getresponse())
        name, picture = next(stream)
        drawn = np.frombuffer(zlib.decompress(base64.b64decode(picture["cells"])), np.uint8)
        assert name == "picture"
        assert drawn.reshape(-1, TILE_CELLS, TILE_CELLS).shape[0] == len(picture["tiles"])
        assert np.bincount(drawn, minlength=5)[1:].tolist() == cells.count[1:].tolist()
        # Half a second of work at 2 m/s: the runs make the reader's cells the same as ours.
        changed = cells.add_line(np.array([[900.0, 1.0], [900.0, 7.0]]), np.array([[901.0, 1.5], [901.0, 7.5]]), 1e6)
        message = pictures.changes(cells, changed)
        assert len(message) < 2_500
        hub.publish(lambda: message)
        name, tiles = next(stream)
        assert name == "cells"
        for column, row, runs in tiles:
            state = np.zeros(TILE_CELLS**2, np.uint8)
            for first, count, value in np.reshape(runs, (-1, 3)):
                state[first : first + count] = value
            assert np.array_equal(state.reshape(TILE_CELLS, -1), cells.tiles()[column, row])


def test_stream__of_a_reader_that_hangs_begins_anew_and_holds_up_nobody() -> None:
    hub = Hub(lambda: event("picture", "whole"))
    joined = hub.join()
    assert joined is not None
    for number in range(QUEUED_MESSAGES + 5):
        hub.publish(partial(event, "pose", number))
    queue = joined.queue
    waiting = [queue.get_nowait() for _ in range(queue.qsize())]
    assert waiting[0] == event("picture", "whole")
    assert waiting[-1] == event("pose", QUEUED_MESSAGES + 4)
    assert len(waiting) < QUEUED_MESSAGES


def test_page__is_whole_without_other_hosts_and_takes_no_commands() -> None:
    with page(Hub()) as reader:
        reader.request("GET", "/")
        html = reader.getresponse().read().decode()
        reader.request("GET", "/live.js")
        script = reader.getresponse().read().decode()
        assert "default-src 'none'" in html
        assert "//" not in html.replace("<!DOCTYPE html>", "")
        assert "http" not in script.replace("https and localhost", "")
        languages = json.loads(script.partition("const LANGUAGES = ")[2].partition(";\n")[0])
        assert languages["ja"] == {"name": "日本語", "texts": texts_of("ja", "live"), "marks": {}}
        assert tuple(languages) == LANGUAGES
        for method in ("POST", "PUT", "DELETE"):
            reader.request(method, "/events", b"{}")
            answer = reader.getresponse()
            answer.read()
            assert answer.status == 501
        reader.request("GET", "/../session.toml")
        assert reader.getresponse().status == 404


def test_page__connects_again_where_the_link_was_cut_without_an_end_of_the_connection(browser: Browser) -> None:
    joined = list[float]()

    def first() -> bytes:
        joined.append(time.monotonic())
        return event("alive", None)

    server = PageServer("127.0.0.1", 0, Hub(first), "en")
    reader = browser.new_page()
    reader.clock.install()
    reader.goto(f"http://127.0.0.1:{server.server_address[1]}/")
    for number in (1, 2):
        assert any(len(joined) == number or reader.clock.run_for(100) for _ in range(100))
        reader.clock.fast_forward(6_000)  # in which nothing is heard
    reader.close()
    server.shutdown()
    server.server_close()


def test_outlet__sends_sentences_that_another_reader_understands() -> None:
    frame = map_frame(Crs(map="EPSG:6677"))
    e, n = frame.project(np.array([140.02]), np.array([36.87]))
    yaw = np.radians(90.0 - 81.0)
    turn = np.array([[np.cos(yaw), -np.sin(yaw), 0.0], [np.sin(yaw), np.cos(yaw), 0.0], [0.0, 0.0, 1.0]])
    sigma = (0.01, 0.01, 0.02, 0.2, 0.2, 0.3)
    pose = LivePose(
        1_781_141_020.25,
        (float(e[0]), float(n[0]), 271.4),
        turn,
        sigma,
        -1.0,
        0.0,
        0.1,
        Fix.FIXED,
        leans=True,
        is_guess=False,
    )
    hub = Hub()
    server = serve_lines("127.0.0.1", 0, hub)
    with socket.create_connection(server.server_address[:2], timeout=20) as reader:
        while not hub.readers:
            pass
        hub.publish(lambda: sentences(pose, frame))
        received = b""
        while received.count(b"\r\n") < 3:
            received += reader.recv(4096)
    server.shutdown()
    server.server_close()
    gga, vtg, hdt = (pynmeagps.NMEAReader.parse(line + b"\r\n") for line in received.split(b"\r\n")[:3])
    true_deg = 81.0 + float(frame.convergence_deg(np.array([140.02]), np.array([36.87]))[0])
    assert (gga.lat, gga.lon) == (pytest.approx(36.87, abs=1e-8), pytest.approx(140.02, abs=1e-8))
    assert (gga.quality, gga.alt) == (4, 271.4)
    assert hdt.headingT == pytest.approx(true_deg, abs=0.01)
    assert vtg.cogt == pytest.approx((true_deg + 180.0) % 360.0, abs=0.01)
    assert vtg.sogk == pytest.approx(3.6, abs=0.01)


def packet(content: bytes, source: str, ago_s: float) -> bytes:
    """A record of a capture, received so long ago."""
    head = frame_head((source, 2368), ("192.168.1.10", 2368), len(content))
    size = len(head) + len(content)
    return PCAP_RECORD.pack(*divmod(time.time_ns() - round(1e9 * ago_s), 10**9), size, size) + head + content


def test_feed__follows_the_first_scanner_and_the_receiver_from_file_to_file(
    simulated: furrowmap.Simulated, tmp_path: Path
) -> None:
    capture, own = simulated.folder / "recording.pcap", "lidar-192.168.1.201"
    others = b"".join(packet(b"of no scanner", "192.168.1.201", ago_s) for ago_s in (2.0, 0.0))
    (tmp_path / f"{own}-0001.pcap").write_bytes(PCAP_HEAD + others)
    (tmp_path / "lidar-192.168.1.202-0001.pcap").write_bytes(capture.read_bytes())
    (tmp_path / "gnss-0001.log").write_bytes(b"before,")
    recording = Recording(lidar=(f"{own}-0001.pcap",), gnss=("gnss-0001.log",))
    feed = FolderFeed(tmp_path, recording, ScanStream(tmp_path / f"{own}-0001.pcap", "VLP-16"), Event())
    log, waited, scans = b"", list[str](), list[Scan]()

    def write() -> None:
        with (tmp_path / "gnss-0001.log").open("ab") as file:
            file.write(b"more,")
        (tmp_path / "gnss-0002.log").write_bytes(b"the next file")
        (tmp_path / f"{own}-0002.pcap").write_bytes(capture.read_bytes())

    for piece in feed.pieces():
        if isinstance(piece.data, bytes):
            log += piece.data
        elif isinstance(piece.data, list):
            scans += piece.data
        elif isinstance(piece.data, InputError):
            waited.append(piece.data.what)
        if (
            log == b"before,"
            and any("datagrams" in what for what in waited)
            and not (tmp_path / "gnss-0002.log").exists()
        ):
            write()
        if log.endswith(b"next file") and len(scans) > 40:
            (tmp_path / "status.json").write_text('{"state": "ended"}')
    assert log == b"before,more,the next file"
    assert any("2 other UDP datagrams" in what for what in waited)
    of_file = list(open_session(simulated.session).lidar(0.0).scans())
    assert [len(scan) for scan in scans] == [len(scan) for scan in of_file][: len(scans)]


def test_folder__whose_recorder_waits_for_its_sensors_is_waited_for(tmp_path: Path) -> None:
    said, stop = list[dict[str, Any]](), Event()

    def hear(what: dict[str, Any]) -> None:
        said.append(what)
        if len(said) == 1:
            (tmp_path / "session.toml").write_text(recorded_session("Monday", Machine()), encoding="utf-8")
        else:
            stop.set()

    furrowmap.live(tmp_path, port=None, nmea_port=None, stop=stop, on_scan=hear)
    waits = InputError("live-waits")
    assert "Packets of the scanner" in waits.what
    assert said == [{"waiting": waits.what}] * 2


def test_waiting_and_warnings__are_said_in_the_languages_of_readers() -> None:
    hub = Hub()
    joined = hub.join()
    assert joined is not None
    outlets, waits = Outlets(Pictures(), hub, Hub(), None, None, None), InputError("live-waits")
    silent = Notice("record-silent", source="192.168.1.201", age_s=3.0)  # as the recorder's status has it
    outlets.wait_for(waits, [{"code": silent.code, **silent.texts}])
    said = json.loads(joined.queue.get_nowait().decode().partition("data: ")[2])
    assert said == {
        "en": f"{waits.what} {silent.text}",
        **{one: f"{waits.lines_in(one)[0]} {silent.text_in(one)}" for one in LANGUAGES[1:]},
    }
    assert by_language({"code": silent.code, **silent.texts}) == {one: silent.text_in(one) for one in LANGUAGES}
    assert by_language({"code": "of-an-old-recorder", "text": silent.text})["ja"] == silent.text


def test_sources__that_cannot_be_used_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(furrowmap.UsageError, match="no folder"):
        furrowmap.live(tmp_path / "session.toml", port=None, nmea_port=None)
    assert command_line(["live"]) == 2
    assert "Neither FOLDER nor --from" in capsys.readouterr().err
    assert command_line(["live", str(tmp_path), "--from", "session.toml"]) == 2
    assert "FOLDER and --from cannot be combined" in capsys.readouterr().err
    for port in (65_536, -1):
        with pytest.raises(furrowmap.UsageError, match="cannot be used"):
            furrowmap.live(tmp_path, host="127.0.0.1", port=port, nmea_port=None)
    taken = socket.create_server(("127.0.0.1", 0))
    with taken, pytest.raises(furrowmap.UsageError, match="cannot be used"):
        furrowmap.live(tmp_path, host="127.0.0.1", port=taken.getsockname()[1], nmea_port=None)
