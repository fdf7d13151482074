"""The background of a live page, and messages for a broker, as others read them."""

from __future__ import annotations

import json
import socket
import sys
from http.client import HTTPConnection
from pathlib import Path

import numpy as np
import pytest
from pyproj import Transformer

import furrowmap
from furrowmap.core.geodesy.projection import map_frame
from furrowmap.core.values.session import Crs
from furrowmap.workflows.live.background_map import BackgroundMap, open_background
from furrowmap.workflows.live.mqtt import MqttOutlet
from furrowmap.workflows.live.server import Hub, PageServer

from .map_tiles import TILE, image, mbtiles, pmtiles


@pytest.mark.parametrize("make", [mbtiles, pmtiles])
def test_background__tiles_are_served_as_they_are(make: object, tmp_path: Path) -> None:
    assert callable(make)
    background = open_background(make(tmp_path / "map"))
    assert (background.zooms, background.attribution) == ((17, 17), "The Survey")
    server = PageServer("127.0.0.1", 0, Hub(), "", background)
    reader = HTTPConnection("127.0.0.1", server.server_address[1], timeout=20)
    for place, status in ((TILE, 200), ((17, TILE[1], TILE[2] + 1), 204), ((31, 1, 1), 204), ((3, 9, 9), 204)):
        reader.request("GET", "/tiles/" + "/".join(map(str, place)))
        answer = reader.getresponse()
        assert (answer.status, answer.read() == image()) == (status, status == 200)
    server.shutdown()
    server.server_close()


def test_background__lies_where_web_mercator_has_it() -> None:
    """Against PROJ, in a plane coordinate system of Japan, whose north is not that of the meridian."""
    frame, half_m = map_frame(Crs(map="EPSG:6677")), 20_037_508.342789244
    e, n = frame.project(np.array([139.99]), np.array([36.87]))
    background = BackgroundMap((3, 17), "", lambda *_: None)
    place = background.place(frame, float(e[0]), float(n[0]))
    to_mercator = Transformer.from_crs("EPSG:6677", "EPSG:3857", always_xy=True)
    for east, north in ((0.0, 0.0), (700.0, -700.0), (-300.0, 900.0)):
        x, y = to_mercator.transform(float(e[0]) + east, float(n[0]) + north)
        unit = np.array([0.5 + 0.5 * x / half_m, 0.5 - 0.5 * y / half_m]) - place["at"]
        assert np.hypot(*(np.array(place["to_m"]) @ unit - (east, north))) < 0.15


def test_background__that_is_none_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    other = tmp_path / "other"
    for content, fault in ((b"", "neither"), (b"SQLite format 3\0", ""), (b"PMTiles\3" + bytes(20), "")):
        other.write_bytes(content)
        with pytest.raises(furrowmap.InputError, match=f"background map: .*{fault}"):
            open_background(other)
    with pytest.raises(furrowmap.InputError, match="no PNG"):
        open_background(mbtiles(tmp_path / "vector.mbtiles", b"\x1f\x8b of vectors"))
    monkeypatch.setitem(sys.modules, "pmtiles.reader", None)
    with pytest.raises(furrowmap.InputError, match="pmtiles is not installed"):
        open_background(pmtiles(tmp_path / "map.pmtiles"))


def received(broker: socket.socket) -> tuple[int, bytes]:
    """Kind and content of a packet (MQTT 3.1.1, section 2.2)."""
    head, size, shift = broker.recv(1)[0], 0, 0
    while True:
        byte = broker.recv(1)[0]
        size |= (byte & 0x7F) << shift
        shift += 7
        if not byte & 0x80:
            break
    content = b""
    while len(content) < size:
        content += broker.recv(size - len(content))
    return head >> 4, content


def test_mqtt__publishes_what_a_broker_can_read() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        outlet = MqttOutlet(f"mqtt://driver:a%40b@127.0.0.1:{server.getsockname()[1]}/tractor")
        assert outlet.fault is not None
        outlet.publish("pose", {"lost": "there is no connection yet"})
        broker, _ = server.accept()
        with broker:
            broker.settimeout(20.0)
            kind, connect = received(broker)
            assert kind == 1
            assert connect.endswith(b"\0\x06driver\0\x03a@b")
            assert b"tractor/state\0\x07offline" in connect
            broker.sendall(b"\x20\x02\0\0")
            kind, online = received(broker)
            assert (kind, online) == (3, b"\0\x0dtractor/stateonline")
            assert outlet.fault is None
            outlet.publish("pose", {"tool": "down", "heading_deg": 81.0})
            kind, message = received(broker)
            size = int.from_bytes(message[:2], "big")
            assert (kind, message[2 : 2 + size]) == (3, b"tractor/pose")
            assert json.loads(message[2 + size :]) == {"tool": "down", "heading_deg": 81.0}
            outlet.close()
            assert received(broker) == (3, b"\0\x0dtractor/stateoffline")


def test_mqtt__says_why_it_sends_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        outlet = MqttOutlet(f"mqtt://127.0.0.1:{server.getsockname()[1]}")
        broker, _ = server.accept()
        with broker:
            received(broker)
            broker.sendall(b"\x20\x02\0\x05")  # not authorised
            broker.settimeout(5.0)
            while broker.recv(100):
                pass
        outlet.close()
    assert outlet.fault is not None
    assert "Not authorized" in outlet.fault.text
    others = ("mqtt://host:0", "mqtt://host:99999", "mqtt://192.168.1..30", "http://127.0.0.1:1883")
    for url in ("broker.example.org", "http://127.0.0.1", "mqtt://", "mqtt://host:port", *others):
        with pytest.raises(furrowmap.UsageError, match="no address of an MQTT broker"):
            MqttOutlet(url)
    monkeypatch.setitem(sys.modules, "paho.mqtt.client", None)
    with pytest.raises(furrowmap.InputError, match="paho-mqtt is not installed"):
        MqttOutlet("mqtt://127.0.0.1")
