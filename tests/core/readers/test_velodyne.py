"""Packets to scans: against velodyne-decoder, others' published clouds, and geometry in closed form."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import velodyne_decoder as vd
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from furrowmap.core.readers.reader import ReadOptions, open_recording
from furrowmap.core.readers.spinning.hour_clock import SensorClock
from furrowmap.core.readers.spinning.packet_decoder import PacketDecoder
from furrowmap.core.readers.velodyne.captures import PACKET_BYTES, VELODYNE, VelodynePcap
from furrowmap.core.runtime.errors import InputError
from furrowmap.core.values.scan import Clock, Scan
from tests.core.readers.velodyne_packets import (
    DUAL,
    HDL32E,
    HI_RES,
    PACKET_US,
    VLP16,
    VLP32C,
    data_packet,
    turning,
)

PRODUCTS = {"VLP-16": VLP16, "Puck Hi-Res": HI_RES, "VLP-32C": VLP32C, "HDL-32E": HDL32E}
VD_MODELS = {
    "VLP-16": vd.Model.VLP16,
    "Puck Hi-Res": vd.Model.PuckHiRes,
    "VLP-32C": vd.Model.VLP32C,
    "HDL-32E": vd.Model.HDL32E,
}
HALF_COUNT_RAD = np.radians(0.005)
"""velodyne-decoder rounds azimuths to hundredths of a degree."""


def run(packets: list[bytes], model: str | None = None, batch: int = 10_000) -> tuple[PacketDecoder, list[Scan]]:
    """A decoder that packets went through, and its scans. The clock is the stamps' own, counted from 1970."""
    decoder = PacketDecoder(VELODYNE, model, clock=SensorClock(Clock.SENSOR_GPS, 0.0, 0.0))
    payloads = np.frombuffer(b"".join(packets), np.uint8).reshape(-1, PACKET_BYTES)
    host_s = payloads[:, 1200:1204].copy().view("<u4")[:, 0] * 1e-6
    scans = []
    for i in range(0, len(payloads), batch):
        scans += decoder.push(payloads[i : i + batch], host_s[i : i + batch])
    return decoder, scans + decoder.finish()


def decode(packets: list[bytes], model: str | None = None) -> PacketDecoder:
    return run(packets, model)[0]


def scans_of(packets: list[bytes], model: str | None = None, batch: int = 10_000) -> list[Scan]:
    return run(packets, model, batch)[1]


def joined(scans: list[Scan], name: str) -> NDArray[np.float64]:
    """One array of all scans."""
    return np.concatenate([getattr(scan, name) for scan in scans])


def by_others(path: Path) -> tuple[NDArray[np.float64], NDArray[np.float32]]:
    """Device times and points (x, y, z, intensity, time, column, ring, return) of velodyne-decoder."""
    clouds = list(vd.read_pcap(str(path)))
    t_s = np.concatenate([c.stamp.device + c.points[:, 4].astype(np.float64) for c in clouds])
    return t_s, np.concatenate([c.points for c in clouds])


@pytest.mark.parametrize(
    ("name", "returns"),
    [
        ("vlp16_single_gps", 73486),
        ("vlp16_dual", 59414),
        ("vlp32c_single", 131305),
        ("hdl32e_single", 146705),
        ("vlp16_truck_1000packets", 203034),
    ],
)
def test_points__are_those_of_velodyne_decoder(shared_data: Path, name: str, returns: int) -> None:
    path = shared_data / "velodyne" / f"{name}.pcap"
    scans = list(VelodynePcap([path], ReadOptions()).scans())
    xyz, laser, intensity, t_s = (joined(scans, n) for n in ("xyz_m", "laser", "intensity", "t_s"))
    others_t_s, others = by_others(path)
    assert len(xyz) == len(others) == returns

    range_m, others_range_m = np.hypot(xyz[:, 0], xyz[:, 1]), np.hypot(others[:, 0], others[:, 1])
    if name == "vlp16_dual":  # pairs of returns stand the other way round
        mine, theirs = np.lexsort((range_m, laser, t_s)), np.lexsort((others_range_m, others[:, 6], others_t_s))
        xyz, laser, intensity, t_s, range_m = xyz[mine], laser[mine], intensity[mine], t_s[mine], range_m[mine]
        others, others_t_s = others[theirs], others_t_s[theirs]
    np.testing.assert_array_equal(laser, others[:, 6])
    np.testing.assert_array_equal(intensity, others[:, 3])
    apart_s = t_s - others_t_s - np.median(t_s - others_t_s)
    leapt = np.abs(apart_s) > 1e-3
    assert leapt.any() == (name == "vlp32c_single")
    if leapt.any():  # it times and turns packets across this sensor's hidden sector as if there were none
        leapt = cKDTree(others_t_s[leapt][:, None]).query(others_t_s[:, None])[0] < 0.7e-3
        assert leapt.mean() < 0.02
    assert np.abs(apart_s[~leapt]).max() < 1e-6
    apart_m = np.linalg.norm(xyz - others[:, :3], axis=1)
    assert (apart_m <= 1.05 * HALF_COUNT_RAD * range_m + 2e-5)[~leapt].all()


def pcd(path: Path) -> NDArray[np.void]:
    """A binary PCD file."""
    content = path.read_bytes()
    head, _, body = content.partition(b"DATA binary\n")
    fields = {line.split()[0]: line.split()[1:] for line in head.decode().splitlines()[1:]}
    kinds = {"F": "f", "U": "u", "I": "i"}
    dtype = [
        (name, f"<{kinds[kind]}{size}")
        for name, kind, size in zip(fields["FIELDS"], fields["TYPE"], fields["SIZE"], strict=True)
    ]
    return np.frombuffer(body, np.dtype(dtype), int(fields["POINTS"][0]))


@pytest.mark.parametrize(
    ("name", "which", "median_m", "most_m"),
    [("vlp16_dual", 3, 0.0055, 0.0135), ("vlp32c_single", 0, 0.0068, 0.020)],
)
def test_points__lie_where_another_driver_put_them(
    shared_data: Path, name: str, which: int, median_m: float, most_m: float
) -> None:
    scans = list(VelodynePcap([shared_data / "velodyne" / f"{name}.pcap"], ReadOptions()).scans())
    truth = pcd(shared_data / "velodyne" / f"{name}_truth.pcd")
    xyz = np.stack([truth["x"], truth["y"], truth["z"]], axis=1)
    apart_m = cKDTree(np.concatenate([s.xyz_m for s in scans[which : which + 2]])).query(xyz)[0]
    assert np.median(apart_m) < median_m
    assert np.percentile(apart_m, 95) < most_m


def test_points__of_a_drive_lie_where_its_driver_published_them(shared_data: Path) -> None:
    reader = VelodynePcap([shared_data / "rover_real" / "leo_rover_vlp16.pcap.gz"], ReadOptions())
    scans = reader.scans()
    xyz = next(scans).xyz_m
    source = np.fromfile(shared_data / "rover_real" / "source_scan_000.bin", "<f4").reshape(-1, 5)
    source = source[np.isfinite(source[:, 0])]
    assert len(xyz) == len(source) == 25852
    apart_m = cKDTree(xyz).query(source[:, :3])[0]
    assert np.median(apart_m) < 0.0015
    assert np.percentile(apart_m, 99) < 0.009
    assert apart_m.max() < 0.025


def test_vls128__is_that_of_velodyne_decoder(shared_data: Path) -> None:
    """It pauses two steps after the eighth firing, not one, and has no turning rate in the first packet."""
    path = shared_data / "velodyne" / "vls128_single_cut.pcap"
    scans = list(VelodynePcap([path], ReadOptions()).scans())
    xyz, laser, intensity, t_s = (joined(scans, n) for n in ("xyz_m", "laser", "intensity", "t_s"))
    clouds = list(vd.read_pcap(str(path), vd.Config(max_range=300.0)))
    others = np.concatenate([c.points for c in clouds])
    others_t_s = np.concatenate([c.stamp.device + c.points[:, 4].astype(np.float64) for c in clouds])
    assert len(xyz) == len(others) == 209907
    np.testing.assert_array_equal(laser, others[:, 6])
    np.testing.assert_array_equal(intensity, others[:, 3])
    np.testing.assert_allclose(xyz[:, 2], others[:, 2], rtol=0, atol=5e-5)
    azimuth, others_azimuth = (np.degrees(np.arctan2(-p[:, 1], p[:, 0])) for p in (xyz, others))
    turned_deg = (azimuth - others_azimuth + 180.0) % 360.0 - 180.0
    assert (np.abs(turned_deg) < 0.02).mean() > 0.998
    apart_us = 1e6 * (t_s - others_t_s - np.median(t_s - others_t_s))
    assert np.abs(np.percentile(apart_us, [0.5, 99.5])).max() < 4.0


def test_vls128_bag__has_the_points_of_another_driver(shared_data: Path) -> None:
    """Its cloud has no heights of origins and, in the first three blocks of four, the azimuth of the block.

    It ends with the packet before azimuth 359 degrees.
    """
    (path,) = (shared_data / "other_lidars" / "velodyne_vls128").glob("*.db3")
    scan = list(open_recording([path], ReadOptions()).scans())[1]  # type: ignore[attr-defined]
    truth = pcd(next(path.parent.glob("*.pcd")))
    theirs = np.stack([truth["x"], truth["y"], truth["z"]], axis=1).astype(float)
    model = VELODYNE.named("VLS-128")
    elevation_deg, firing = np.empty(128), np.empty(128)
    elevation_deg[model.laser_order], firing[model.laser_order] = model.elevation_deg, np.arange(128) // 8
    mine = scan.xyz_m.astype(float)
    mine[:, 2] += 0.05863 * np.tan(np.radians(elevation_deg))[scan.laser]
    turned = np.radians(3600.0 * 2.764e-6 * (firing + firing // 8)[scan.laser])
    cos, sin = np.cos(turned), np.sin(turned)
    mine[:, :2] = np.stack([mine[:, 0] * cos - mine[:, 1] * sin, mine[:, 0] * sin + mine[:, 1] * cos], axis=1)
    laser = np.abs(np.degrees(np.arctan2(theirs[:, 2], np.hypot(*theirs[:, :2].T)))[:, None] - elevation_deg).argmin(1)
    first = theirs[firing[laser] < 12]
    assert len(first) > 0.7 * len(theirs) > 0.99 * 0.7 * len(mine)
    apart_m = cKDTree(mine).query(first)[0]
    assert (apart_m < 0.01 + np.radians(0.01) * np.linalg.norm(first, axis=1)).mean() > 0.999
    times = [scan.t_s[scan.laser == i] for i in np.unique(scan.laser)]
    assert len(times) == 127  # the highest has no return
    assert all((np.diff(t_s) > 0).all() for t_s in times)
    assert np.median([np.ptp(t_s) for t_s in times]) > 0.09


@pytest.mark.parametrize("name", PRODUCTS)
def test_geometry__is_the_table_of_each_model(name: str) -> None:
    """One packet, against velodyne-decoder's tables: angles, heights, firing times, order of elevation."""
    packets = turning(2, 1_000_000, product=PRODUCTS[name], step=20)
    (scan,) = scans_of(packets)
    decoder = vd.ScanDecoder(vd.Config(model=VD_MODELS[name]))
    _, others = decoder.decode([vd.VelodynePacket(1.0, p) for p in packets])
    half = len(others) // 2
    np.testing.assert_allclose(scan.xyz_m[:half], others[:half, :3], rtol=0, atol=21 * HALF_COUNT_RAD)
    np.testing.assert_allclose(scan.xyz_m[:half, 2], others[:half, 2], rtol=0, atol=2e-5)
    np.testing.assert_allclose(scan.t_s[:half] - 1.0, others[:half, 4] - others[0, 4], rtol=0, atol=1e-8)
    np.testing.assert_array_equal(scan.laser, others[:, 6])


@pytest.mark.parametrize("model", VELODYNE.models, ids=lambda m: m.name)
def test_laser__counts_the_elevations_from_below(model) -> None:  # type: ignore[no-untyped-def]
    (scan,) = scans_of([data_packet(product=model.product)])
    z = np.array([scan.xyz_m[scan.laser == i, 2].mean() for i in range(model.lasers)])
    assert (np.diff(z) > 0).all()
    assert set(scan.laser) == set(range(model.lasers))


@pytest.mark.parametrize(("product", "step"), [(VLP32C, 20), (0xA1, 5)])
def test_columns__of_a_range_image_are_directions(product: int, step: int) -> None:
    """Lasers look up to 6 degrees aside; the same column is the same azimuth, within 0.2 degrees."""
    scan = scans_of(turning(40, product=product, step=step))[0]
    azimuth_deg = np.degrees(np.arctan2(-scan.xyz_m[:, 1], scan.xyz_m[:, 0]))
    assert np.ptp(azimuth_deg - 0.2 * scan.column) < 2.1 * 0.2
    assert scan.lasers == len(np.unique(scan.laser))


def test_frame__has_x_at_azimuth_0_and_y_at_270() -> None:
    level = np.zeros((12, 32))
    level[0, 1] = 5000  # the laser at +1 degree, of 10 m
    for azimuth, x, y in ((0, 1, 0), (9000, 0, -1), (18000, -1, 0), (27000, 0, 1)):
        (scan,) = scans_of([data_packet(azimuth=azimuth, step=0, distance=level)])
        expected = np.array([x, y, 0]) * 10 * np.cos(np.radians(1))
        expected[2] = 10 * np.sin(np.radians(1)) - 0.04191 * np.tan(np.radians(1))
        np.testing.assert_allclose(scan.xyz_m[0], expected, atol=2e-6)


def test_heights__are_those_of_the_manual() -> None:
    """VLP-16 manual, table 9-1: +11.2 mm at -15 degrees to -11.2 mm at +15 degrees."""
    model = VELODYNE.named("VLP-16")
    printed_mm = [11.2, -0.7, 9.7, -2.2, 8.1, -3.7, 6.6, -5.1, 5.1, -6.6, 3.7, -8.1, 2.2, -9.7, 0.7, -11.2]
    np.testing.assert_allclose(model.height_m * 1e3, printed_mm, atol=0.06)


def test_azimuth__runs_on_within_a_block() -> None:
    """A wall of range at a constant rate: every point's azimuth is the rate times its own time."""
    packets = turning(100, 0, 100, step=40)
    scan = scans_of(packets)[0]
    azimuth_deg = np.degrees(np.arctan2(-scan.xyz_m[:, 1], scan.xyz_m[:, 0])) % 360
    np.testing.assert_allclose(azimuth_deg, 1.0 + 0.40 / 110.592e-6 * (scan.t_s - scan.t_s[0]), atol=0.002)


def test_scans__end_where_azimuth_passes_0_and_are_numbered() -> None:
    scans = scans_of(turning(400, 0, 30000))
    assert [scan.number for scan in scans] == [0, 1, 2, 3, 4, 5, 6]
    assert [scan.whole for scan in scans] == [False, True, True, True, True, True, False]
    for scan in scans[1:-1]:
        azimuth = np.degrees(np.arctan2(-scan.xyz_m[:, 1], scan.xyz_m[:, 0])) % 360
        assert azimuth[0] < 0.3
        assert azimuth[-1] > 359.7
        assert scan.column[0] == 0
        assert len(np.unique(scan.column)) == int(scan.column[-1]) + 1 == 1800
        assert (np.diff(scan.column.astype(int)) >= 0).all()
    assert sum(len(scan) for scan in scans) == 400 * 384


def test_scans__end_at_pauses_and_not_at_lost_packets() -> None:
    packets = turning(300, 0, 200)
    lost = scans_of(packets[:20] + packets[30:60])
    assert [len(scan) for scan in lost] == [50 * 384]
    paused = scans_of(packets[:20] + packets[245:265])
    assert [(len(scan), scan.whole) for scan in paused] == [(20 * 384, False), (20 * 384, False)]


def test_scans__between_pauses_are_single_revolutions_wherever_they_begin() -> None:
    """As recorders store that keep every fifth revolution: 362.7 degrees each, cut at no azimuth of its own."""
    packets = turning(76 * 16, 0, 20000)
    stored = [packet for k in range(0, 16, 5) for packet in packets[76 * k : 76 * (k + 1)]]
    scans = scans_of(stored)
    assert [(scan.number, len(scan), scan.whole) for scan in scans] == [(k, 76 * 384, True) for k in range(4)]
    for scan in scans:
        assert np.all(np.diff(scan.t_s) >= 0)
        assert np.all(np.diff(scan.column.astype(int)) >= 0)
        assert len(np.unique(scan.column)) == 76 * 24


def test_scans__over_a_long_gap_know_that_azimuth_passed_0() -> None:
    """From 300 degrees over 0 to 282 without a packet: azimuth hardly falls, yet a new revolution has begun."""
    before = turning(5, 0, 30000)
    after = turning(5, 342 / 360 * 1e5 * 36000 / 36169, 28200)
    assert len(scans_of(before + after)) == 2


def test_sector__blocks_behind_it_have_their_own_time() -> None:
    """A sensor set to report 270 to 90 degrees fills one packet across the rest."""
    packet = bytearray(data_packet(0, 8900, step=40))
    for block in range(6, 12):
        turned = (27000 + 40 * (block - 6)).to_bytes(2, "little")
        packet[block * 100 + 2 : block * 100 + 4] = turned
    (scan,) = scans_of([bytes(packet)])
    leap_s = (27000 - 8900 - 5 * 40) / 40 * 110.592e-6
    fired_s = scan.t_s[scan.laser == 0]
    assert len(fired_s) == 24
    np.testing.assert_allclose(np.diff(fired_s)[:11], 55.296e-6, atol=1e-9)
    assert fired_s[12] - fired_s[10] == pytest.approx(leap_s, abs=30e-6)
    np.testing.assert_allclose(np.diff(fired_s)[12:], 55.296e-6, atol=1e-9)


@pytest.mark.parametrize(
    ("last", "strongest", "expected"),
    [
        (5000, 5000, [(10.0, 200, 1, 1)]),
        (6000, 5000, [(10.0, 200, 1, 2), (12.0, 100, 2, 2)]),
        (5000, 6000, [(10.0, 100, 1, 2), (12.0, 200, 2, 2)]),
        (0, 5000, [(10.0, 200, 1, 1)]),
        (5000, 0, [(10.0, 100, 1, 1)]),
        (0, 0, []),
    ],
)
def test_dual__the_nearer_return_is_the_first(
    last: int, strongest: int, expected: list[tuple[float, int, int, int]]
) -> None:
    distance, intensity = np.zeros((12, 32), int), np.zeros((12, 32), int)
    distance[0, 1], distance[1, 1] = last, strongest
    intensity[0, 1], intensity[1, 1] = 100, 200
    distance[2, 0] = distance[3, 0] = 1000
    (scan,) = scans_of([data_packet(distance=distance, intensity=intensity, mode=DUAL)])
    found = [
        (round(float(np.hypot(*scan.xyz_m[i, :2]) / np.cos(np.radians(1))), 4), *(int(a[i]) for a in attributes))
        for attributes in [(scan.intensity, scan.return_number, scan.returns)]
        for i in range(len(scan) - 1)
    ]
    assert found == expected
    assert scan.t_s[-1] - (110.592e-6 if expected else 0) == pytest.approx(scan.t_s[0] - (2.304e-6 if expected else 0))


def test_unknown_return_mode__is_reported_and_pairs_count_as_dual() -> None:
    packets = [bytes(p[:1204]) + b"\x00" + p[1205:] for p in turning(30, mode=DUAL, packet_us=PACKET_US / 2)]
    decoder = decode(packets)
    assert decoder.counts.points == 30 * 192
    assert "return-mode-unknown" in codes(decoder)


def codes(decoder: PacketDecoder) -> list[str]:
    return [notice.code for notice in decoder.notices()]


def test_promise_05__return_mode_is_that_of_the_packets() -> None:
    single = turning(30)
    dual = turning(30, 30 * PACKET_US, 30 * 480, mode=DUAL, packet_us=PACKET_US / 2)
    decoder = decode(single + dual)
    assert decoder.counts.points == 30 * 384 + 30 * 192
    assert codes(decoder) == ["return-mode-changed"]


def test_promise_05__model_stated_against_the_packets_is_reported_with_both() -> None:
    packets = turning(40, product=VLP16)
    decoder = decode(packets, "Puck Hi-Res")
    assert decoder.model is VELODYNE.named("puck hi res")
    (notice,) = decoder.notices()
    assert notice.code == "model-differs"
    assert "Decoded as Puck Hi-Res (stated in the session)" in notice.text
    assert "VLP-16 (0x22) in 40 packets" in notice.text


def test_promise_05__model_that_contradicts_the_packet_rate_is_reported() -> None:
    decoder = decode(turning(40, product=VLP16), "HDL-32E")
    texts = {notice.code: notice.text for notice in decoder.notices()}
    assert texts.keys() == {"model-differs", "packet-rate"}
    assert "1.327 ms does not match a HDL-32E with one return (0.553 ms)" in texts["packet-rate"]
    assert "VLP-16 (one return)" in texts["packet-rate"]


@pytest.mark.parametrize(
    ("product", "code", "words"),
    [(0x63, "unsupported-model", "VLS-128"), (0x23, "unsupported-model", "VLP-32A"), (0x00, "model-unknown", "0x00")],
)
def test_promise_05__model_that_is_not_known_is_refused(product: int, code: str, words: str) -> None:
    with pytest.raises(InputError, match=words) as error:
        decode(turning(5, product=product))
    assert error.value.code == code
    assert "VLP-16, Puck Hi-Res, VLP-32C, HDL-32E" in error.value.lines[2]
    assert decode(turning(5, product=product), "VLP-16").counts.points == 5 * 384


@pytest.mark.parametrize("name", ["VLP-16", "vlp16", "Velodyne VLP-16", "Puck", "Puck LITE", "puck_lite"])
def test_model_named__reads_the_usual_spellings(name: str) -> None:
    assert VELODYNE.named(name).name == "VLP-16"


def test_model_named__unknown_names_the_nearest() -> None:
    with pytest.raises(InputError, match="Did you mean 'VLP-32C'") as error:
        VELODYNE.named("VLP-23C")
    assert error.value.code == "unknown-model"
    assert "`lidar.model`: unknown model 'VLP-23C'" in error.value.what


def test_rpm__is_that_of_the_azimuths() -> None:
    """0.4° a block, twelve blocks a packet."""
    assert decode(turning(10)).counts.rpm == pytest.approx(60.0 * 12 * 0.4 / 360.0 / (PACKET_US * 1e-6), rel=1e-3)


def test_gaps__are_counted() -> None:
    packets = turning(600)
    decoder = decode(packets[:100] + packets[103:200] + packets[210:300] + packets[500:])
    counts = decoder.counts
    assert (counts.lost, counts.gaps, len(counts.pauses_s)) == (13, 2, 1)
    assert counts.lost_s == pytest.approx(13 * PACKET_US * 1e-6, abs=1e-5)
    assert max(counts.pauses_s) == pytest.approx(201 * PACKET_US * 1e-6, abs=1e-5)
    assert codes(decoder) == ["lost-packets", "pauses"]
    assert counts.rpm == pytest.approx(40 / 36000 / 110.592e-6 * 60, rel=1e-6)


def test_repeated_packets__count_once() -> None:
    packets = turning(50)
    decoder = decode([p for packet in packets for p in (packet, packet)])
    assert decoder.counts.points == 50 * 384
    assert codes(decoder) == ["repeated-packets"]


def test_packets_out_of_order__are_reported() -> None:
    packets = turning(50)
    packets[20], packets[21] = packets[21], packets[20]
    decoder = decode(packets)
    assert decoder.counts.points == 50 * 384
    assert "late-packets" in codes(decoder)


def test_damaged_blocks__are_left_out_and_counted() -> None:
    packets = turning(30)
    packets[3] = packets[3][:500] + b"\0\0" + packets[3][502:]
    decoder = decode(packets)
    assert decoder.counts.points == 30 * 384 - 7 * 32
    assert codes(decoder) == ["bad-blocks"]


def test_standing_sensor__gives_no_endless_scan() -> None:
    scans = scans_of(turning(6000, step=0))
    assert [len(np.unique(scan.column)) for scan in scans] == [65536, 65536, 6000 * 24 - 2 * 65536]
    assert not any(scan.whole for scan in scans)


def test_without_a_clock__the_first_packets_wait_for_one() -> None:
    packets = turning(2500, 1_000_000_000)
    payloads = np.frombuffer(b"".join(packets), np.uint8).reshape(-1, PACKET_BYTES)
    host_s = 1.75e9 + np.arange(2500) * PACKET_US * 1e-6
    decoder = PacketDecoder(VELODYNE)
    assert decoder.push(payloads[:1000], host_s[:1000]) == []
    scans = decoder.push(payloads[1000:], host_s[1000:]) + decoder.finish()
    assert sum(len(scan) for scan in scans) == 2500 * 384
    assert decoder.kind is Clock.RECORDER
    assert scans[0].t_s[0] == pytest.approx(1.75e9, abs=2e-6)
    assert "clock-recorder" in codes(decoder)


@given(batch=st.integers(1, 130), mode=st.sampled_from([0x37, DUAL]), start=st.integers(0, 35999))
@settings(max_examples=25)
def test_scans__do_not_depend_on_the_batches(batch: int, mode: int, start: int) -> None:
    distance = np.random.default_rng(start).integers(0, 3, (12, 32)) * 4000
    every = PACKET_US / (2 if mode == DUAL else 1)
    packets = turning(130, 5_000, start, mode=mode, distance=distance, packet_us=every)
    at_once, in_parts = scans_of(packets), scans_of(packets, batch=batch)
    assert [(s.number, s.whole, len(s)) for s in at_once] == [(s.number, s.whole, len(s)) for s in in_parts]
    for name in ("t_s", "xyz_m", "intensity", "laser", "column", "return_number", "returns"):
        np.testing.assert_array_equal(joined(at_once, name), joined(in_parts, name))


@given(seed=st.integers(0, 2**32), count=st.integers(1, 40), damage=st.floats(0, 1))
@settings(max_examples=60)
def test_any_bytes__give_points_or_a_refusal(seed: int, count: int, damage: float) -> None:
    """Packets with random bytes in them: finite points within the range that two bytes can tell, and no more."""
    random = np.random.default_rng(seed)
    payloads = np.frombuffer(b"".join(turning(count)), np.uint8).copy()
    hit = random.random(len(payloads)) < damage
    payloads[hit] = random.integers(0, 256, int(hit.sum()))
    scans = scans_of([payloads.tobytes()], "VLP-16")
    assert sum(len(scan) for scan in scans) <= count * 384
    for scan in scans:
        assert np.isfinite(scan.xyz_m).all()
        assert np.linalg.norm(scan.xyz_m, axis=1).max() < 131.2
        assert np.isfinite(scan.t_s).all()
        assert scan.laser.max() < 16
        assert (scan.return_number <= scan.returns).all()
