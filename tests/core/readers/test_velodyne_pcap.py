"""Captures of Velodyne sensors: what stands in the sample recordings, and what happens to damaged and odd ones."""

from __future__ import annotations

import gzip
import lzma
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from furrowmap.core.readers.reader import GivesScans, Inspection, ReadOptions, Recognised, open_recording
from furrowmap.core.readers.source import look
from furrowmap.core.readers.velodyne.captures import VelodynePcap
from furrowmap.core.runtime.errors import InputError
from furrowmap.core.values.clock import iso_utc
from furrowmap.core.values.scan import Clock, Scan
from tests.core.readers.velodyne_packets import (
    DUAL,
    PACKET_US,
    Frame,
    data_packet,
    frame,
    frames,
    position_packet,
    rmc,
    turning,
    write_pcap,
)

T0 = 1781141021.0  # 2026-06-11T01:23:41Z
NO_OPTIONS = ReadOptions()


def inspected(path: Path, options: ReadOptions = NO_OPTIONS) -> Inspection:
    return VelodynePcap([path], options).inspect()


def codes(inspection: Inspection) -> list[str]:
    return [notice.code for notice in inspection.notices]


def points(scans: Iterable[Scan]) -> NDArray[np.float64]:
    """Time, x, y, z of all points."""
    return np.concatenate([np.column_stack([s.t_s, s.xyz_m]) for s in scans] or [np.empty((0, 4))])


def read(*paths: Path, options: ReadOptions = NO_OPTIONS) -> NDArray[np.float64]:
    return points(VelodynePcap(paths, options).scans())


SINGLE_GPS = ("VLP-16", "strongest", 293, 57, 73486, 599.1, 3.87)
GPS, HOST = Clock.SENSOR_GPS, Clock.RECORDER
SAMPLES: list[tuple[str, tuple[Any, ...], Clock, list[str]]] = [
    # model, return mode, data and position packets, points, turns a minute, turns; clock; notices
    ("vlp16_single_gps.pcap", SINGLE_GPS, GPS, []),
    ("vlp16_single_gps.pcapng", SINGLE_GPS, GPS, []),
    ("vlp16_single_gps_bigendian.pcap", SINGLE_GPS, GPS, []),
    ("vlp16_dual.pcap", ("VLP-16", "dual", 603, 0, 59414, 600.0, 3.99), HOST, []),
    ("vlp32c_single.pcap", ("VLP-32C", "strongest", 379, 0, 131305, 600.1, 2.51), HOST, ["pauses"]),
    ("hdl32e_single.pcap", ("HDL-32E", "strongest", 500, 0, 146705, 542.4, 2.49), HOST, []),
    ("vlp16_truck_1000packets.pcap", ("VLP-16", "strongest", 1000, 0, 203034, 600.0, 13.26), HOST, []),
    ("damaged_foreign_traffic_mixed.pcap", SINGLE_GPS, GPS, ["other-traffic"]),
    ("damaged_truncated_mid_packet.pcap", ("VLP-16", "dual", 300, 0, 29538, 600.1, 1.98), HOST, ["cut-capture"]),
    ("damaged_lost_packets.pcap", ("VLP-16", "dual", 536, 0, 52206, 600.0, 3.99), HOST, ["lost-packets"]),
]


@pytest.mark.parametrize(("name", "facts", "clock", "notices"), SAMPLES, ids=[s[0] for s in SAMPLES])
def test_inspect__reports_what_is_in_each_sample(
    shared_data: Path, name: str, facts: tuple[Any, ...], clock: Clock, notices: list[str]
) -> None:
    found = Recognised.by_content(shared_data / "velodyne" / name).inspect()
    names = ("model", "return_mode", "data_packets", "position_packets", "points", "rpm", "revolutions")
    assert tuple(found.facts[n] for n in names) == facts
    assert found.clocks[0].clock is clock
    assert set(codes(found)) == {*notices, *(["clock-recorder"] if clock is HOST else [])}


def test_inspect__reports_place_and_clocks_of_a_sensor_with_gps(shared_data: Path) -> None:
    found = inspected(shared_data / "velodyne" / "vlp16_single_gps.pcap")
    assert found.facts["gps_position"] == {"lat_deg": 36.82913093, "lon_deg": -2.40757155}
    assert found.facts["sender"] == "10.0.0.100 to port 2368"
    sensor, recorder, gnss = found.clocks
    assert sensor.first_s == pytest.approx(1453363200 + 1082.341, abs=0.001)
    assert sensor.last_s == pytest.approx(1453363200 + 1082.728, abs=0.001)
    assert recorder.first_s == pytest.approx(1453364282.708714, abs=0.0002)
    assert recorder.last_s == pytest.approx(1453364283.096219, abs=0.0002)
    assert "+0.368 s at the start" in recorder.note
    assert iso_utc(gnss.first_s) == "2016-01-21T08:18:02.000Z"


def test_promise_04__inspect_counts_what_is_missing_and_what_is_foreign(shared_data: Path) -> None:
    lost = {n.code: n.text for n in inspected(shared_data / "velodyne" / "damaged_lost_packets.pcap").notices}
    assert "67 packets are missing in 67 gaps, 0.044 s" in lost["lost-packets"]
    foreign = inspected(shared_data / "velodyne" / "damaged_foreign_traffic_mixed.pcap")
    assert foreign.facts["other_packets"] == {"other UDP datagrams": 40, "not IP": 10}
    pauses = {n.code: n.text for n in inspected(shared_data / "velodyne" / "vlp32c_single.pcap").notices}
    assert "4 pauses of 0.050 s, 0.2 s in total" in pauses["pauses"]


def test_promise_04__scans_of_a_capture_with_foreign_traffic_are_the_same(shared_data: Path) -> None:
    folder = shared_data / "velodyne"
    clean = read(folder / "vlp16_single_gps.pcap")
    for name in ("damaged_foreign_traffic_mixed.pcap", "vlp16_single_gps.pcapng", "vlp16_single_gps_bigendian.pcap"):
        np.testing.assert_array_equal(read(folder / name), clean)


def test_promise_03__scans_of_a_cut_capture_are_those_up_to_the_cut(shared_data: Path) -> None:
    whole = VelodynePcap([shared_data / "velodyne" / "vlp16_dual.pcap"], NO_OPTIONS)
    cut = VelodynePcap([shared_data / "velodyne" / "damaged_truncated_mid_packet.pcap"], NO_OPTIONS)
    expected, found = points(whole.scans()), points(cut.scans())
    assert 29_000 < len(found) < 30_000
    np.testing.assert_array_equal(found[:, 1:], expected[: len(found), 1:])
    np.testing.assert_allclose(found[:, 0], expected[: len(found), 0], rtol=0, atol=2e-4)
    (notice,) = (n for n in cut.notices if n.code == "cut-capture")
    assert "the 300 records before are complete" in notice.text
    assert "516 bytes of it" in notice.text


REFUSED = [
    ("damaged_swapped_endian_header_only.pcap", "damaged-capture", "no valid record after the header"),
    ("damaged_wrong_suffix_is_a_rosbag.pcap", "not-a-capture", "a ROS 1 bag"),
    ("damaged_header_only.pcap", "no-packets", "no packets at all"),
    ("damaged_zero_length.pcap", "not-a-capture", "empty"),
]


@pytest.mark.parametrize(("name", "code", "words"), REFUSED, ids=[r[0] for r in REFUSED])
def test_refusals__are_three_sentences_that_name_the_file(shared_data: Path, name: str, code: str, words: str) -> None:
    with pytest.raises(InputError, match=words) as error:
        inspected(shared_data / "velodyne" / name)
    assert error.value.code == code
    assert name in error.value.lines[0]
    assert all(line.endswith(".") for line in error.value.lines)


@pytest.mark.parametrize(
    ("name", "packets", "returns", "whole", "start", "first_s", "last_s"),
    [
        ("tractor_loop", (45_046, 119), 7_977_874, 597, "2026-06-11T01:23:40.300Z", 0.62, 60.4),
        ("tractor_fishtail", (47_225, 126), 7_807_777, 625, "2026-06-11T01:59:34.150Z", 0.47, 63.1),
    ],
)
def test_tractor__every_scan_and_point_at_its_time(
    shared_data: Path,
    name: str,
    packets: tuple[int, int],
    returns: int,
    whole: int,
    start: str,
    first_s: float,
    last_s: float,
) -> None:
    reader = open_recording([shared_data / name / "recording.pcap.gz"], NO_OPTIONS)
    assert isinstance(reader, GivesScans)
    count = 0
    ends = []
    sizes = []
    for i, scan in enumerate(reader.scans()):
        assert scan.number == i
        assert (np.diff(scan.t_s) >= 0).all()
        count += scan.whole
        ends.append((scan.t_s[0], scan.t_s[-1]))
        sizes.append(len(scan))
    assert (sum(sizes), count, len(sizes)) == (returns, whole, whole + 2)
    flat = np.ravel(ends)
    assert (np.diff(flat) > 0).all()
    begin_s = flat[0] - first_s
    assert iso_utc(round(begin_s, 1 if name == "tractor_loop" else 2)) == start
    assert flat[-1] - begin_s == pytest.approx(last_s, abs=0.05)
    assert reader.clock is Clock.SENSOR_GPS
    assert [reading.clock for reading in reader.clocks] == [Clock.SENSOR_GPS, Clock.RECORDER, Clock.GNSS]
    assert "+0.831 s at the start and +0.831 s at the end" in reader.clocks[1].note
    assert reader.share_read == 1.0
    assert reader.notices == []
    facts = reader.inspect().facts
    assert (facts["data_packets"], facts["position_packets"]) == packets


def test_rover__a_real_drive_with_pauses(shared_data: Path) -> None:
    reader = VelodynePcap([shared_data / "rover_real" / "leo_rover_vlp16.pcap.gz"], NO_OPTIONS)
    found = reader.inspect()
    assert (found.facts["data_packets"], found.facts["points"], found.facts["rpm"]) == (16036, 5395453, 600.0)
    texts = {notice.code: notice.text for notice in found.notices}
    assert texts.keys() == {"clock-recorder", "pauses"}
    assert "210 pauses of 0.403 to 1.413 s" in texts["pauses"]
    assert found.clocks[0].first_s == pytest.approx(1766566967.461496, abs=2e-6)
    assert found.clocks[0].last_s == pytest.approx(1766567128.931522, abs=2e-6)


def recording(count: int = 60, **about: Any) -> list[Frame]:
    """A sensor with GPS, from T0 on, with two position packets; the recorder is 0.83 s ahead."""
    stamp_us = (T0 % 3600) * 1e6
    data = frames(turning(count, stamp_us, 34_000, **about), T0 + 0.83)
    fix = [frame(position_packet(stamp_us + 100_000.0 * i, rmc()), port=8308) for i in range(2)]
    return [data[0], (T0 + 0.8300001, fix[0]), *data[1:], (T0 + 0.93, fix[1])]


@pytest.mark.parametrize(("suffix", "pack"), [(".gz", gzip.compress), (".xz", lzma.compress)])
def test_scans__of_compressed_captures_are_the_same(tmp_path: Path, suffix: str, pack) -> None:  # type: ignore[no-untyped-def]
    path = write_pcap(tmp_path / "a.pcap", recording())
    packed = tmp_path / f"a.pcap{suffix}"
    packed.write_bytes(pack(path.read_bytes()))
    np.testing.assert_array_equal(read(packed), read(path))
    assert Recognised.by_content(packed).reader is VelodynePcap


def test_scans__of_a_split_recording_run_on(tmp_path: Path) -> None:
    content = recording(200)
    whole = list(VelodynePcap([write_pcap(tmp_path / "a.pcap", content)], NO_OPTIONS).scans())
    parts = [
        write_pcap(tmp_path / f"{i}.pcap", part) for i, part in enumerate([content[:70], content[70:75], content[75:]])
    ]
    reader = VelodynePcap(parts, NO_OPTIONS)
    split = list(reader.scans())
    assert [(s.number, s.whole, len(s)) for s in split] == [(s.number, s.whole, len(s)) for s in whole]
    np.testing.assert_array_equal(points(split), points(whole))
    assert reader.notices == []


def test_scans__can_be_read_again(tmp_path: Path) -> None:
    reader = VelodynePcap([write_pcap(tmp_path / "a.pcap", recording()[:40])], NO_OPTIONS)
    np.testing.assert_array_equal(points(reader.scans()), points(reader.scans()))
    assert reader.inspect().facts["points"] == len(points(reader.scans()))


def test_clock__gets_its_lock_late_and_the_scans_before_are_right_too(tmp_path: Path) -> None:
    """The lock comes after more packets than are looked at in any case; the first ones count from 5 s."""
    count, lock = 5000, 4500
    stamp_us = (T0 % 3600) * 1e6
    packets = turning(lock, 5e6, 0, distance=np.eye(12, 32) * 5000)
    packets += turning(count - lock, stamp_us + lock * PACKET_US, 0, distance=np.eye(12, 32) * 5000)
    content = frames(packets, T0 + 0.83)
    void = frame(position_packet(5e6, rmc(status="V"), 0), port=8308)
    fix = frame(position_packet(stamp_us + lock * PACKET_US, rmc("012346"), 2), port=8308)
    content[100:100] = [(content[100][0], void)]
    content[lock + 1 : lock + 1] = [(content[lock + 1][0], fix)]
    reader = VelodynePcap([write_pcap(tmp_path / "a.pcap", content)], NO_OPTIONS)
    assert reader.clock is Clock.SENSOR_GPS
    t_s = points(reader.scans())[:, 0]
    assert t_s[0] == pytest.approx(T0, abs=2e-5)
    assert t_s[-1] - T0 == pytest.approx(count * PACKET_US * 1e-6, abs=0.0015)
    assert np.diff(t_s).max() < 0.002
    found = [notice.code for notice in reader.notices]
    assert found == ["clock-before-lock", "clock-jumps", "pps-unlocked", "gprmc-void"]


def test_clock__with_a_sentence_of_another_second_is_reported(tmp_path: Path) -> None:
    content = recording(100)
    other = frame(position_packet((T0 % 3600) * 1e6, rmc("012351"), 2), port=8308)
    content[60:60] = [(content[60][0], other)]
    reader = VelodynePcap([write_pcap(tmp_path / "a.pcap", content)], NO_OPTIONS)
    points(reader.scans())
    assert "gprmc-disagrees" in {notice.code for notice in reader.notices}


def test_clock__loses_its_pulse_on_the_way(tmp_path: Path) -> None:
    content = recording(100)
    content.append((T0 + 1.0, frame(position_packet((T0 % 3600) * 1e6 + 170_000, rmc(), 1), port=8308)))
    found = inspected(write_pcap(tmp_path / "a.pcap", content))
    (notice,) = found.notices
    assert notice.code == "pps-unlocked"
    assert "In 1 of 3 position packets" in notice.text
    assert "synchronising" in notice.text


def test_clock__of_a_recorder_without_a_date_is_found_by_a_time_near(tmp_path: Path) -> None:
    packets = turning(50, (T0 % 3600) * 1e6)
    path = write_pcap(tmp_path / "a.pcap", frames(packets, 100.0))
    reader = VelodynePcap([path], ReadOptions(near_s=T0 + 1000))
    assert reader.clock is Clock.STATED
    assert points(reader.scans())[0, 0] == pytest.approx(T0, abs=2e-6)


def test_promise_04__two_sensors_are_refused_by_name_until_one_is_chosen(tmp_path: Path) -> None:
    one = frames(turning(60, 0), T0)
    two = [
        (t + 1e-4, frame(data_packet(i * PACKET_US + 77, 100), sender="192.168.1.202")) for i, (t, _) in enumerate(one)
    ]
    path = write_pcap(tmp_path / "a.pcap", [f for pair in zip(one, two, strict=True) for f in pair])
    with pytest.raises(InputError, match=r"192\.168\.1\.201 to port 2368; 192\.168\.1\.202") as error:
        VelodynePcap([path], ReadOptions()).scans()
    assert error.value.code == "two-sensors"
    names = inspected(path).facts["sensors"]
    assert names == ["192.168.1.201 to port 2368", "192.168.1.202 to port 2368"]
    alone = [read(write_pcap(tmp_path / f"{k}.pcap", content)) for k, content in enumerate((one, two))]
    for source, expected in ((names[0], alone[0]), ("192.168.1.202", alone[1]), (names[1], alone[1])):
        chosen = VelodynePcap([path], ReadOptions(source=source))
        np.testing.assert_array_equal(points(chosen.scans()), expected)
    with pytest.raises(InputError) as error:
        open_recording([path], ReadOptions(source="2369"))
    assert error.value.code == "sensor-not-there"


def test_two_sensors__a_few_stray_packets_are_dropped_and_reported(tmp_path: Path) -> None:
    content = recording(300)
    clean = read(write_pcap(tmp_path / "clean.pcap", content))
    content[100:100] = [(content[100][0], frame(data_packet(99, 5), sender="192.168.1.77"))]
    path = write_pcap(tmp_path / "a.pcap", content)
    np.testing.assert_array_equal(read(path), clean)
    assert inspected(path).facts["other_packets"] == {"of another sensor": 1}


def test_capture_without_a_velodyne__is_refused_with_what_is_in_it(tmp_path: Path) -> None:
    path = write_pcap(
        tmp_path / "a.pcap", [(T0, frame(b"hello", port=53)), (T0, b"\xff" * 12 + b"\x08\x06" + bytes(28))]
    )
    assert VelodynePcap.recognise(look(path)) == 0.5
    with pytest.raises(InputError, match=r"\(1 other UDP datagrams, 1 not IP\)") as error:
        inspected(path)
    assert error.value.code == "no-packets"


def test_model__stated_in_the_options_is_used_and_checked(tmp_path: Path) -> None:
    path = write_pcap(tmp_path / "a.pcap", recording())
    assert inspected(path, ReadOptions(model="Puck Hi-Res")).facts["model"] == "Puck Hi-Res"
    with pytest.raises(InputError, match=r"`lidar\.model`: unknown model 'OS1'"):
        inspected(path, ReadOptions(model="OS1"))


WHOLE = recording(40, mode=DUAL, distance=np.arange(384).reshape(12, 32) * 20, packet_us=PACKET_US / 2)


@given(cut=st.integers(0, 42 * 1264))
@settings(max_examples=60)
def test_promise_03__scans_of_a_capture_cut_anywhere_are_a_part_from_the_start(
    tmp_path_factory: pytest.TempPathFactory, cut: int
) -> None:
    folder = tmp_path_factory.mktemp("cut")
    path = write_pcap(folder / "whole.pcap", WHOLE)
    expected = read(path)
    (folder / "cut.pcap").write_bytes(path.read_bytes()[:cut])
    try:
        found = read(folder / "cut.pcap")
    except InputError as error:
        found = np.empty((0, 4))
        assert error.code in ("not-a-capture", "no-packets")  # noqa: PT017
    gps = cut > 24 + 1264 + 570
    np.testing.assert_array_equal(found[:, 1:], expected[: len(found), 1:])
    if gps:
        np.testing.assert_array_equal(found[:, 0], expected[: len(found), 0])
        assert len(found) > 0


@given(seed=st.integers(0, 2**32), bytes_hit=st.integers(1, 400))
@settings(max_examples=150)
def test_scans__of_a_damaged_capture_are_read_or_refused(
    tmp_path_factory: pytest.TempPathFactory, seed: int, bytes_hit: int
) -> None:
    random = np.random.default_rng(seed)
    path = write_pcap(tmp_path_factory.mktemp("damaged") / "a.pcap", WHOLE)
    content = np.frombuffer(path.read_bytes(), np.uint8).copy()
    content[random.integers(0, len(content), bytes_hit)] = random.integers(0, 256, bytes_hit)
    path.write_bytes(content.tobytes())
    try:
        found = inspected(path)
    except InputError as error:
        assert len(error.lines) == 3  # noqa: PT017
    else:
        assert found.facts["points"] <= 40 * 384
        assert np.isfinite(found.clocks[0].last_s)
