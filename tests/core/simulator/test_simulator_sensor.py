"""Packets and their capture, read by velodyne-decoder and dpkt."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import dpkt
import msgspec
import numpy as np
import pytest
import velodyne_decoder as vd
from numpy.typing import NDArray

from furrowmap.core.readers.reader import ReadOptions, open_recording
from furrowmap.core.simulator.capture import FILE_HEADER, records
from furrowmap.core.simulator.rays import Returns
from furrowmap.core.simulator.recording import HI_RES, MID360, VLP16, XT32, ScannerModel, vlp16_packets
from furrowmap.core.simulator.scenario import Scenario, ScenarioClock, ScenarioLidar
from furrowmap.core.simulator.simulate import Simulated
from furrowmap.core.simulator.site import SimulatedSite
from tests.core.readers.hesai_packets import packet
from tests.core.readers.small_bags import LIVOX, ROS1

SITE = SimulatedSite("EPSG:6677", 16642.0, 96548.0, 271.4, 41.3, 1_781_143_199_000_000)  # 01:59:59 UTC


def returns_of(n: int, seed: int = 0) -> Returns:
    """Returns whose strongest and last differ in one pulse of four."""
    rng = np.random.default_rng(seed)
    ticks = np.repeat(rng.integers(300, 40_000, (1, n, 16), np.uint16), 2, axis=0)
    ticks[:, rng.random((n, 16)) < 0.1] = 0
    two = (rng.random((n, 16)) < 0.25) & (ticks[0] > 0)
    ticks[1][two] += 1000
    bright = np.broadcast_to(rng.integers(1, 101, (1, n, 16), np.uint8), (2, n, 16))
    return Returns(ticks, bright, np.ones((2, n, 16), np.uint8), np.full((2, n, 16), -1, np.int32))


def decoded(packets: NDArray[np.uint8], model: vd.Model = vd.Model.VLP16) -> NDArray[Any]:
    decoder = vd.StreamDecoder(vd.Config(model=model, min_range=0.0, max_range=200.0))
    scans = [
        decoder.decode(1.78e9 + 0.001 * i, packet.tobytes(), as_pcl_structs=True) for i, packet in enumerate(packets)
    ]
    scans.append(decoder.finish(as_pcl_structs=True))
    return np.concatenate([scan[1] for scan in scans if scan is not None])


@pytest.mark.parametrize(
    ("name", "rpm", "model", "decoder"),
    [
        ("VLP-16", 300, VLP16, vd.Model.VLP16),
        ("VLP-16", 600, VLP16, vd.Model.VLP16),
        ("VLP-16", 1200, VLP16, vd.Model.VLP16),
        ("Puck Hi-Res", 600, HI_RES, vd.Model.PuckHiRes),
    ],
)
def test_data_packets__are_decoded_as_the_returns_that_went_in(
    name: str, rpm: int, model: ScannerModel, decoder: vd.Model
) -> None:
    scenario = Scenario(lidar=ScenarioLidar(model=name, rpm=rpm))  # type: ignore[arg-type]
    spin, returns = model.spin(scenario, 20.0), returns_of(24 * 100)
    points = decoded(model.packets(scenario, SITE, spin, 0, returns), decoder)
    there = returns.ticks[0] > 0
    assert len(points) == there.sum()
    order = np.argsort(np.argsort(model.beams.elevation_deg))
    assert (points["ring"] == np.broadcast_to(order, there.shape)[there]).all()
    assert (points["intensity"] == returns.reflectivity[0][there]).all()
    # range and direction by the formulas of the manual, at the true azimuth of each laser
    firing_s = spin.time_s(np.arange(24 * 100))
    t_s = firing_s[:, None] + 2.304e-6 * np.arange(16)
    azimuth = 2.0 * np.pi * spin.turns(t_s)
    elevation = np.radians(model.beams.elevation_deg)
    r = returns.ticks[0] * 0.002
    x = r * np.cos(elevation) * np.cos(azimuth)
    y = -r * np.cos(elevation) * np.sin(azimuth)
    z = r * np.sin(elevation) + model.beams.height_m
    stated = np.stack([points["x"], points["y"], points["z"]], axis=-1)
    true = np.stack([x, y, z], axis=-1)[there]
    off = np.abs(stated - true).max(axis=1)
    # the decoder takes the speed of rotation from block to block, in hundredths of a degree
    assert (off < 1e-4 + np.radians(0.016) * r[there]).all()
    assert np.median(off) < 0.004


def test_data_packets__last_and_dual_returns() -> None:
    returns = returns_of(12 * 40)
    last = vlp16_packets(
        msgspec.structs.replace(Scenario(), lidar=ScenarioLidar(return_mode="last")),
        SITE,
        VLP16.spin(Scenario(), 9.0),
        0,
        returns,
    )
    assert last.shape == (20, 1206)
    assert (last[:, 1204] == 0x38).all()
    assert len(decoded(last)) == (returns.ticks[1] > 0).sum()
    scenario = Scenario(lidar=ScenarioLidar(return_mode="dual"))
    spin = VLP16.spin(scenario, 9.0)
    dual = vlp16_packets(scenario, SITE, spin, 0, returns)
    assert dual.shape == (40, 1206)
    assert (dual[:, 1204] == 0x39).all()
    points = decoded(dual)
    # the decoder tells equal returns once
    assert len(points) == (returns.ticks[0] > 0).sum() + (returns.ticks[0] != returns.ticks[1]).sum()
    azimuth = np.ascontiguousarray(dual[:, :1200]).reshape(40, 12, 100)[:, :, 2:4].copy().view("<u2")[..., 0]
    assert (azimuth[:, 0::2] == azimuth[:, 1::2]).all()
    assert VLP16.spin(scenario, 9.0).packets == pytest.approx(2 * VLP16.spin(Scenario(), 9.0).packets, abs=1)


def test_data_packets__stamps_start_again_with_the_hour() -> None:
    scenario = Scenario(lidar=ScenarioLidar(start_s=0.0))
    spin = VLP16.spin(scenario, 5.0)
    stamps = np.ascontiguousarray(vlp16_packets(scenario, SITE, spin, 0, returns_of(24 * 1500))[:, 1200:1204]).view(
        "<u4"
    )[:, 0]
    assert stamps[0] == 3_599_000_000
    assert np.count_nonzero(np.diff(stamps.astype(np.int64)) < 0) == 1
    assert stamps[-1] < 1_000_000
    assert set(np.diff(stamps.astype(np.int64)) % 3_600_000_000) == {1327, 1328}


def test_data_packets__tell_the_clock_that_is_off() -> None:
    scenario = Scenario(
        lidar=ScenarioLidar(start_s=0.0), clock=ScenarioClock(lidar_minus_gnss_s=0.0, true_lidar_minus_gnss_s=-0.25)
    )
    packet = vlp16_packets(scenario, SITE, VLP16.spin(scenario, 5.0), 0, returns_of(24))
    assert struct.unpack("<I", packet[0, 1200:1204].tobytes())[0] == 3_598_750_000


@pytest.mark.parametrize(("mode", "returns"), [("strongest", 1), ("dual", 2)])
def test_xt32__packets_are_those_of_the_manual(mode: str, returns: int) -> None:
    """Byte by byte, besides the encoder's rounding and the counter: of 2500 counts, and 2600 for the first return."""
    scenario = Scenario(lidar=ScenarioLidar(rpm=600, return_mode=mode, rpm_wander=0.0))  # type: ignore[arg-type]
    spin = XT32.spin(scenario, 20.0)
    shape = (2, 3 * spin.firings_a_packet, 32)
    ticks = np.stack([np.full(shape[1:], 2500 + 100 * (returns - 1), np.uint32), np.full(shape[1:], 2500, np.uint32)])
    bright = np.stack([np.full(shape[1:], 9 + returns, np.uint8), np.full(shape[1:], 10, np.uint8)])
    flat = Returns(ticks, bright, np.ones(shape, np.uint8), np.full(shape, -1, np.int32))
    made = XT32.packets(scenario, SITE, spin, 0, flat)
    firing = np.arange(shape[1])
    azimuth = np.round(36000 * (spin.turns(spin.time_s(firing)) % 1.0)).astype(int).reshape(3, -1)
    stamp_s = SITE.t0_us * 1e-6 + spin.time_s(firing[spin.firings_a_packet - 1 :: spin.firings_a_packet])
    for row, first, at_s in zip(made, azimuth[:, 0].tolist(), stamp_s.tolist(), strict=True):
        stated = np.frombuffer(packet("PandarXT-32", at_s, first, returns=returns), np.uint8)
        differ = np.flatnonzero(row[:-4] != stated[:-4])
        assert set((differ - 12) % 130) <= {0, 1}
        assert (differ < 1052).all()
        turned = row[12:1052].reshape(8, 130)[:, :2].copy().view("<u2")[:, 0].astype(int)
        theirs = stated[12:1052].reshape(8, 130)[:, :2].copy().view("<u2")[:, 0].astype(int)
        assert np.abs((turned - theirs + 18000) % 36000 - 18000).max() <= 1


def test_rosette__is_a_bag_of_custom_messages(tmp_path: Path) -> None:
    """By `rosbags`: times from the stamp, ranges, the clock, and no return as 0, 0, 0."""
    scenario = Scenario(lidar=ScenarioLidar(model="Mid-360"))  # type: ignore[arg-type]
    spin, shape = MID360.spin(scenario, 20.0), (2, 400, 100)
    ticks = np.full(shape, 5000, np.uint32)
    ticks[:, 7] = 0
    given = Returns(ticks, np.full(shape, 9, np.uint8), np.ones(shape, np.uint8), np.full(shape, -1, np.int32))
    payload = MID360.packets(scenario, SITE, spin, 0, given)
    message = ROS1.deserialize_ros1(payload[1].tobytes(), LIVOX)
    assert message.timebase // 1000 == SITE.t0_us + round(1e6 * float(spin.time_s(np.array([200]))[0]))
    assert message.point_num == len(message.points) == 20_000
    some = message.points[150]
    assert some.offset_time == pytest.approx(0.5e6 + 50 * 5e3, abs=2)
    assert np.linalg.norm([some.x, some.y, some.z]) == pytest.approx(5.0, abs=1e-5)
    assert (some.reflectivity, some.line) == (9, 150 % 4)
    bag = tmp_path / "recording.bag"
    chunks = MID360.container.records(np.array([SITE.t0_us, SITE.t0_us + 100_000]), payload, 0, 0)
    bag.write_bytes(MID360.container.head + chunks.tobytes())
    first, second = open_recording([bag], ReadOptions()).scans()  # type: ignore[attr-defined]
    assert (len(first), len(second)) == (19_900, 20_000)
    assert second.t_s[0] == pytest.approx(message.timebase * 1e-9, abs=1e-6)


def test_records__are_frames_with_right_checksums() -> None:
    rng = np.random.default_rng(0)
    payload = rng.integers(0, 256, (300, 1206), np.uint8)
    time_us = 1_781_143_199_000_000 + np.arange(300) * 1327
    written = FILE_HEADER + records(time_us, payload, 2368, 65_500).tobytes()
    import io

    seen = 0
    for i, (stamp, frame) in enumerate(dpkt.pcap.Reader(io.BytesIO(written))):
        ip = dpkt.ethernet.Ethernet(frame).data
        assert stamp == pytest.approx(time_us[i] * 1e-6, abs=1e-6)
        assert bytes(ip.data.data) == payload[i].tobytes()
        assert (ip.data.sport, ip.data.dport, ip.id) == (2368, 2368, (65_500 + i) % 65_536)
        sums = ip.sum, ip.data.sum
        ip.sum = ip.data.sum = 0
        again = dpkt.ip.IP(bytes(ip))
        assert sums == (again.sum, again.data.sum)
        seen += 1
    assert seen == 300


def captured(file: Path) -> list[tuple[float, int, bytes]]:
    """(time, port, payload) of every datagram."""
    with file.open("rb") as opened:
        frames = [(stamp, dpkt.ethernet.Ethernet(frame).data.data) for stamp, frame in dpkt.pcap.Reader(opened)]
    return [(float(stamp), udp.dport, bytes(udp.data)) for stamp, udp in frames]


def test_recording__position_packets_speak_of_the_last_whole_second(short_drive: Simulated) -> None:
    datagrams = captured(short_drive.recording)
    positions = [(stamp, payload) for stamp, port, payload in datagrams if port == 8308]
    assert len(positions) == short_drive.figures["lidar"]["position_packets"] >= 8
    assert {len(payload) for _, payload in positions} == {512}
    said = [payload[206:].split(b"\0")[0].decode() for _, payload in positions]
    assert said[0].startswith("$GPRMC,235956,A,3652.")
    assert ",311225,,,D*" in said[0]
    assert any(text.startswith("$GPRMC,000000,A,") and ",010126," in text for text in said)
    stamps = np.array([struct.unpack("<I", payload[198:202])[0] for _, payload in positions])
    seconds = np.array([int(text[11:13]) for text in said])
    assert (stamps // 1_000_000 % 60 == seconds).all()
    assert {payload[202] for _, payload in positions} == {2}


def test_recording__the_computer_is_ahead_and_late(short_drive: Simulated) -> None:
    data = [(stamp, payload) for stamp, port, payload in captured(short_drive.recording) if port == 2368]
    assert len(data) == short_drive.figures["lidar"]["data_packets"]
    host = np.array([stamp for stamp, _ in data])
    sensor = np.unwrap([struct.unpack("<I", payload[1200:1204])[0] * 1e-6 for _, payload in data], period=3600.0)
    sent = short_drive.figures["lidar"]["first_firing_unix_s"] + sensor - sensor[0] + 24 * 55.296e-6
    ahead = host - sent
    assert ahead.min() == pytest.approx(0.83, abs=2e-5)
    # jitter of 1 ms in one direction, and no packet overtakes another: the median is at least that of the half-normal
    assert 0.674e-3 < np.median(ahead) - 0.83 < 1.5e-3
    assert (np.diff(host) >= 0.0).all()


def test_recording__stops_are_firings_of_one_clock(short_drive: Simulated) -> None:
    lidar: dict[str, Any] = short_drive.figures["lidar"]
    packet_s = 24 * 55.296e-6
    assert lidar["firings"] == 24 * lidar["data_packets"]
    assert lidar["last_packet_unix_s"] - lidar["first_firing_unix_s"] == pytest.approx(
        (lidar["data_packets"] - 1) * packet_s, abs=2e-6
    )
    assert lidar["turns"] == pytest.approx(10.0 * lidar["firings"] * 55.296e-6, rel=1e-3)
    points = sum(
        len(scan) for _, scan in vd.read_pcap(short_drive.recording, vd.Config(model=vd.Model.VLP16, min_range=0.0))
    )
    assert points == lidar["points"]
