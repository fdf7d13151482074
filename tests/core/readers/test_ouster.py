"""Captures of Ouster sensors: real ones against the maker's decoder, made ones with odd metadata and clocks."""

from __future__ import annotations

import hashlib
import json
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import dpkt
import msgspec
import numpy as np
import pytest
from numpy.typing import NDArray
from rosbags.typesys import get_types_from_msg

from furrowmap.core.readers.ouster.captures import OusterPcap
from furrowmap.core.readers.reader import GivesScans, ReadOptions, Recognised, open_recording
from furrowmap.core.runtime.errors import InputError
from furrowmap.core.simulator.capture import FILE_HEADER, records
from furrowmap.core.simulator.rays import Returns
from furrowmap.core.simulator.recording import OS1_32, metadata
from furrowmap.core.simulator.scenario import Scenario, ScenarioLidar
from furrowmap.core.simulator.site import SimulatedSite
from furrowmap.core.values.scan import Clock, Scan
from tests.core.readers.small_bags import ROS1, write_bag1

ROS1.register(get_types_from_msg("uint8[] buf\n", "ouster_ros/msg/PacketMsg"))

NO_OPTIONS = ReadOptions()
OS0, OS1, OS2 = "OS-0-32-U1_v2.2.0_1024x10", "OS-1-128_v2.3.0_1024x10", "OS-2-32-U0_v2.0.0_1024x10"

# By ouster-sdk 1.0.1: beam, column, range in mm, place in the sensor frame, stamp in ns.
BY_THE_SDK: dict[tuple[str, str | None], tuple[int, list[tuple[int, int, int, tuple[float, float, float], int]]]] = {
    (OS0, None): (21803, [
        (20, 856, 7027, (-3.2034, -6.0401, -1.5835), 515900389520),
        (26, 368, 2496, (1.2605, 1.7450, -1.2196), 515852794050),
        (20, 239, 4719, (-0.7158, 4.5355, -1.0494), 515840214380),
        (8, 794, 29812, (-3.1578, -27.7448, 10.4717), 515894342070),
    ]),
    (OS2, None): (28541, [
        (12, 843, 13002, (-5.3446, -11.8374, 0.6771), 464564178740),
        (27, 512, 11676, (11.5612, 0.4234, -1.5024), 464548011870),
        (8, 298, 7388, (1.6169, 7.1749, 0.7734), 464537571170),
    ]),
    (OS1 + "_lb_n3", None): (107647, [
        (89, 277, 11040, (1.6647, 10.7646, -1.7606), 991614415010),
        (79, 99, 24408, (-20.8961, 12.3616, -2.4712), 991597027540),
        (60, 134, 20608, (-12.8764, 16.0875, 0.3165), 991600445370),
    ]),
    ("same_ports", "122247000785"): (1964, [
        (109, 915, 992, (-0.6838, -0.4824, -0.4865), 8949337911424),
        (95, 920, 1376, (-0.8940, -0.9019, -0.4854), 8949338395936),
    ]),
    ("same_ports", "OS-1-64"): (985, [
        (27, 927, 491, (-0.3771, -0.2971, 0.1372), 8915907280973),
        (20, 918, 630, (-0.5105, -0.3339, 0.1916), 8915906407467),
    ]),
}  # fmt: skip


def scans_of(path: Path, options: ReadOptions = NO_OPTIONS) -> tuple[GivesScans, list[Scan]]:
    reader = open_recording([path], options)
    assert isinstance(reader, GivesScans)
    return reader, list(reader.scans())


@pytest.mark.parametrize(("file", "model"), BY_THE_SDK)
def test_real_captures__as_the_makers_decoder_reads_them(file: str, model: str | None, shared_data: Path) -> None:
    folder = shared_data / "other_lidars" / "ouster"
    reader, scans = scans_of(folder / f"{file}.pcap", ReadOptions(model=model))
    count, points = BY_THE_SDK[file, model]
    scan = scans[0]
    assert (reader.clock, len(scan)) == (Clock.RECORDER, count)
    for beam, _, _, xyz_m, stamp_ns in points:
        away = np.linalg.norm(scan.xyz_m - xyz_m, axis=1)
        i = int(away.argmin())
        assert away[i] < 1e-4
        assert scan.laser[i] == scan.lasers - 1 - beam  # the file counts from the top
        apart_s = scan.t_s[i] - scan.t_s[0] - (stamp_ns - points[0][-1]) * 1e-9
        first = int(np.linalg.norm(scan.xyz_m - points[0][3], axis=1).argmin())
        assert apart_s + scan.t_s[0] == pytest.approx(scan.t_s[first], abs=1e-6)


@pytest.mark.parametrize(("file", "pixel", "head", "step"), [(OS2, 12, 16, 20), (OS0, 16, 12, 19)])
def test_real_captures__meet_the_digests(file: str, pixel: int, head: int, step: int, shared_data: Path) -> None:
    """Ranges by the documentation meet the maker's digest, and those of the scan are the same."""
    folder = shared_data / "other_lidars" / "ouster"
    said = json.loads((folder / f"{file}.json").read_text())
    digest = json.loads((folder / f"{file}_digest.json").read_text())["scans"][0]
    ranges = np.zeros((2, 32, 1024), np.uint32)
    with (folder / f"{file}.pcap").open("rb") as raw:
        for _, frame in dpkt.pcap.Reader(raw):
            udp = dpkt.ethernet.Ethernet(frame).data.data
            if udp.dport != 7502:
                continue
            body = udp.data if head == 16 else udp.data[32:-32]
            for column in np.frombuffer(body, np.uint8).reshape(16, -1):
                number = int(column[8]) | int(column[9]) << 8
                pixels = column[head : head + 32 * pixel].reshape(32, pixel)
                for k in range(1 if head == 16 else 2):
                    ranges[k, :, number] = pixels[:, 4 * k : 4 * k + 4].copy().view("<u4")[:, 0] & ((1 << step) - 1)
    assert hashlib.md5(ranges[0].tobytes()).hexdigest() == digest["RANGE"]
    if head == 12:
        assert hashlib.md5(ranges[1].tobytes()).hexdigest() == digest["RANGE2"]
    (scan,) = scans_of(folder / f"{file}.pcap")[1]
    shift = np.round(np.array(said["beam_azimuth_angles"]) * 1024 / 360).astype(int)
    beam = 31 - scan.laser.astype(int)
    number = (scan.column - shift[beam]) % 1024
    angle, n_m = 2.0 * np.pi * (1.0 - number / 1024), said["lidar_origin_to_beam_origin_mm"] * 1e-3
    place = np.column_stack(
        [-n_m * np.cos(angle), -n_m * np.sin(angle), np.full(len(scan), 1e-3 * said["lidar_to_sensor_transform"][11])]
    )
    found = np.zeros((2, 32, 1024))
    range_mm = 1e3 * (np.linalg.norm(scan.xyz_m - place, axis=1) + n_m)
    found[scan.return_number - 1, beam, number] = range_mm
    both = (ranges > 0).all(axis=0) & (ranges[0] != ranges[1])
    near = np.where(both, ranges.min(axis=0), ranges.max(axis=0))
    assert np.abs(found[0] - near).max() < 0.01
    assert np.abs(found[1] - np.where(both, ranges.max(axis=0), 0)).max() < 0.01


SITE = SimulatedSite("EPSG:6677", 16642.0, 96548.0, 271.4, 41.3, 1_781_143_199_000_000)


def recorded(
    folder: Path, turns: float = 4.0, said: Callable[[dict[str, Any]], None] | None = None, **lidar: Any
) -> Path:
    """A capture of made returns, 20 m away, and its metadata, which `said` may change."""
    scenario = msgspec.structs.replace(Scenario(), lidar=ScenarioLidar(model="OS1-32", **lidar))
    spin = OS1_32.spin(scenario, 60.0)
    packets = round(64 * turns)
    ticks = np.full((2, 16 * packets, 32), 20_000, np.uint32)
    ticks[1, ::2] += 3000
    bright = np.full(ticks.shape, 50, np.uint8)
    payload = OS1_32.packets(scenario, SITE, spin, 0, Returns(ticks, bright, bright, np.zeros(ticks.shape, np.int32)))
    sent_s = spin.time_s((1 + np.arange(packets)) * 16)
    time_us = SITE.t0_us + np.round(sent_s * 1e6).astype(np.int64) + 300
    path = folder / "drive.pcap"
    path.write_bytes(FILE_HEADER + records(time_us, payload, 7502, 0).tobytes())
    told = json.loads(metadata(scenario)[1])
    if said is not None:
        said(told)
    (folder / "drive.json").write_text(json.dumps(told))
    return path


def in_fragments(data: bytes) -> list[bytes]:
    """The records of a capture of frames of one length, each as those of its fragments (RFC 791)."""
    size = 16 + int.from_bytes(data[32:36], "little")
    parts = []
    for k, at in enumerate(range(24, len(data), size)):
        record = data[at : at + size]
        body = record[16 + 34 :]
        for begin in range(0, len(body), 1480):
            piece, more = body[begin : begin + 1480], begin + 1480 < len(body)
            ip = struct.pack(">BBHHHBBH", 0x45, 0, 20 + len(piece), k, more << 13 | begin // 8, 64, 17, 0)
            frame = record[16:30] + ip + record[42:50] + piece
            parts.append(record[:8] + struct.pack("<II", len(frame), len(frame)) + frame)
    return parts


def changed(table: str, **values: object) -> Callable[[dict[str, Any]], None]:
    return lambda said: said[table].update(values)


@pytest.mark.parametrize("mode", ["strongest", "dual"])
def test_made_captures__time_direction_and_returns(mode: str, tmp_path: Path) -> None:
    reader, scans = scans_of(recorded(tmp_path, return_mode=mode))
    assert reader.clock is Clock.SENSOR_GPS
    whole = [scan for scan in scans if scan.whole]
    assert [scan.number for scan in scans] == list(range(len(scans)))
    assert len(whole) >= 3
    for scan in whole:
        assert len(scan) == 1024 * (48 if mode == "dual" else 32)
        t_s = np.unique(scan.t_s)
        assert len(t_s) == 1024
        assert np.diff(t_s) == pytest.approx(0.1 / 1024, abs=1e-6)
        assert np.linalg.norm(scan.xyz_m[scan.return_number == 1], axis=1) == pytest.approx(20.0, abs=0.05)
        level = scan.laser == 16
        azimuth = np.degrees(np.arctan2(-scan.xyz_m[level, 1], scan.xyz_m[level, 0])) % 360.0
        apart = (azimuth - (scan.column[level] * (360.0 / 1024) + 180.0) + 180.0) % 360.0 - 180.0
        assert np.abs(apart).max() < 0.2  # columns are directions, though the beam looks 1.41 degrees aside
    assert whole[0].t_s[0] == pytest.approx(SITE.t0_s + 0.62, abs=0.11)


def test_metadata__that_is_missing_of_another_sensor_or_damaged(tmp_path: Path) -> None:
    path = recorded(tmp_path)
    beside = path.with_suffix(".json")
    told = beside.read_text()
    for text, words in (
        (None, "metadata JSON not found beside it (serial number 122000000032)"),
        (told.replace("122000000032", "122000000033"), "there are only those of drive.json (OS-1-32-U0, serial number"),
        (told[:300], "metadata JSON not found"),
        (told.replace("[22.5,", '["x",'), "not usable: drive.json"),
        (told.replace("[22.5,", "["), "31 elevations and 32 azimuths"),
        (told.replace('"RNG19_RFL8_SIG16_NIR16"', '"RNG99"'), "profile 'RNG99'"),
    ):
        beside.unlink(missing_ok=True)
        if text is not None:
            beside.write_text(text)
        with pytest.raises(InputError) as caught:
            Recognised.by_content(path).inspect()
        assert caught.value.code == "ouster-no-metadata"
        assert words in caught.value.what
        assert all(line.strip() for line in caught.value.lines)


def test_metadata__of_another_mode(tmp_path: Path) -> None:
    for columns in (2048, 512):
        path = recorded(
            tmp_path, 5.0, changed("lidar_data_format", columns_per_frame=columns, column_window=[0, columns - 1])
        )
        with pytest.raises(InputError, match=f"states {columns} columns per turn") as caught:
            scans_of(path)
        assert caught.value.code == "ouster-metadata-mode"


def test_metadata__of_packets_that_name_no_sensor(shared_data: Path, tmp_path: Path) -> None:
    folder = shared_data / "other_lidars" / "ouster"
    path = tmp_path / "field.pcap"
    path.write_bytes((folder / f"{OS2}.pcap").read_bytes())
    told = (folder / f"{OS2}.json").read_text()
    (tmp_path / "a.json").write_text(told)
    assert "ouster-metadata-unproven" in [notice.code for notice in Recognised.by_content(path).inspect().notices]
    (tmp_path / "b.json").write_text(
        told.replace("6.97", "7.97")
        .replace("10.9", "11.9")
        .replace('"beam_altitude_angles": [', '"beam_altitude_angles": [1')
    )
    with pytest.raises(InputError) as caught:
        Recognised.by_content(path).inspect()
    assert caught.value.code == "ouster-metadata-ambiguous"
    (tmp_path / "field.json").write_text(told)
    assert Recognised.by_content(path).inspect().facts["metadata"] == "field.json"


def test_two_sensors__are_told_apart(shared_data: Path, tmp_path: Path) -> None:
    folder = shared_data / "other_lidars" / "ouster"
    with pytest.raises(InputError, match="OS-0-128, serial number 122247000785; OS-1-64-AH") as caught:
        scans_of(folder / "same_ports.pcap")
    assert caught.value.code == "two-sensors"
    with pytest.raises(InputError) as caught:
        scans_of(folder / "same_ports.pcap", ReadOptions(model="VLP-16"))
    assert caught.value.code == "ouster-other-sensor"
    by_model, by_source = (
        scans_of(folder / "same_ports.pcap", options)[1]
        for options in (ReadOptions(model="OS-0-128"), ReadOptions(source="122247000785"))
    )
    assert [len(scan) for scan in by_source] == [len(scan) for scan in by_model]
    with pytest.raises(InputError, match="OS-1-64-AH") as caught:
        scans_of(folder / "same_ports.pcap", ReadOptions(source="7500"))
    assert caught.value.code == "sensor-not-there"
    alone = tmp_path / "same_ports.pcap"
    alone.write_bytes((folder / alone.name).read_bytes())
    (tmp_path / "same_ports.1.json").write_text((folder / "same_ports.1.json").read_text())
    assert "ouster-sensor-unknown" in [notice.code for notice in Recognised.by_content(alone).inspect().notices]


def announce(tai_s: int) -> bytes:
    """A PTP announce message whose UTC offset is valid, in the PTP time scale (IEEE 1588-2019, 13.5)."""
    return bytes([0x0B, 2, 0, 64, 0, 0, 0, 0x0C]) + bytes(36) + tai_s.to_bytes(2, "big", signed=True) + bytes(18)


@pytest.mark.parametrize(
    ("mode", "added_s", "announced", "clock", "off_s", "code"),
    [
        ("TIME_FROM_SYNC_PULSE_IN", 0.0, False, Clock.SENSOR_GPS, 0.0, None),
        ("TIME_FROM_PTP_1588", 0.0, False, Clock.SENSOR, 0.0, None),
        ("TIME_FROM_PTP_1588", 37.0, True, Clock.SENSOR, 0.0, None),
        ("TIME_FROM_PTP_1588", 37.0, False, Clock.SENSOR, 37.0, "ouster-clock-tai"),
        ("TIME_FROM_PTP_1588", 18.0, False, Clock.SENSOR, 18.0, "ouster-clock-apart"),
        ("TIME_FROM_INTERNAL_OSC", -1_781_143_190.0, False, Clock.RECORDER, 0.0, "ouster-clock-own"),
    ],
)
def test_clocks(
    mode: str, added_s: float, announced: bool, clock: Clock, off_s: float, code: str | None, tmp_path: Path
) -> None:
    path = recorded(tmp_path, 2.0, changed("config_params", timestamp_mode=mode))
    data = bytearray(path.read_bytes())
    stamps(data)["ns"] += np.int64(added_s * 1e9)
    if announced:
        data[24:24] = records(np.array([SITE.t0_us]), np.frombuffer(announce(37), np.uint8)[None], 320, 9).tobytes()
    path.write_bytes(data)
    reader, scans = scans_of(path)
    assert reader.clock is clock
    first = recorded_first(tmp_path)
    assert scans[0].t_s[0] == pytest.approx(first + off_s, abs=0.01)
    assert [notice.code for notice in reader.notices] == ([code] if code else [])  # type: ignore[attr-defined]


def recorded_first(folder: Path) -> float:
    """Time of the first return of a capture as it was made."""
    (folder / "again").mkdir(exist_ok=True)
    return float(scans_of(recorded(folder / "again", 2.0))[1][0].t_s[0])


def stamps(data: bytearray) -> NDArray[np.void]:
    """The stamps of all columns of a capture with records of 6458 bytes, to be changed in place."""
    column = np.dtype([("ns", "<i8"), ("number", "<u2"), ("rest", "u1", 386)])
    record = np.dtype([("head", "u1", 16 + 42 + 32), ("columns", column, 16), ("tail", "u1", 32)])
    return np.frombuffer(data, record, offset=24)["columns"]  # type: ignore[no-any-return]


def test_lost_repeated_and_late_packets__and_a_clock_that_is_set(tmp_path: Path) -> None:
    path = recorded(tmp_path, 6.0)
    data = path.read_bytes()
    size = 16 + 42 + 6400
    assert (len(data) - 24) % size == 0
    parts = [data[24 + size * k : 24 + size * (k + 1)] for k in range(6 * 64)]
    numbers = [*range(100), 99, *range(110, 200), 130, *range(330, 384)]
    path.write_bytes(data[:24] + b"".join(parts[k] for k in numbers))
    reader, scans = scans_of(path)
    notices = {notice.code: notice for notice in reader.notices}  # type: ignore[attr-defined]
    assert {"lost-packets", "repeated-packets", "late-packets", "pauses"} <= set(notices)
    assert notices["lost-packets"].text.startswith("10 packets are missing in 1 gap")
    assert sum(len(scan) for scan in scans) == 32 * 16 * (100 + 90 + 54)
    late = bytearray(data)
    stamps(late)["ns"][200:] -= 1_000_000_000
    stamps(late)["number"][300, 3] = 5000
    path.write_bytes(late)
    reader, scans = scans_of(path)
    assert {"clock-jumps", "ouster-bad-columns"} <= {notice.code for notice in reader.notices}  # type: ignore[attr-defined]
    assert scans[-1].t_s[-1] - scans[0].t_s[0] == pytest.approx(0.6, abs=0.01)
    path.write_bytes(data[: 24 + 64 * size + 3000])
    assert OusterPcap([path], NO_OPTIONS).inspect().facts["data_packets"] == 64


@pytest.mark.parametrize("told", ["in the bag", "beside it", "nowhere"])
def test_bags_of_packets(told: str, tmp_path: Path) -> None:
    path = recorded(tmp_path, 3.0)
    data = path.read_bytes()
    parts = [data[24 + 6458 * k + 58 : 24 + 6458 * (k + 1)] for k in range(3 * 64)]
    packet = ROS1.types["ouster_ros/msg/PacketMsg"]
    first_ns = SITE.t0_us * 1000
    messages: list[tuple[str, int, Any]] = [
        ("/ouster/lidar_packets", first_ns + k * 1_562_500, packet(buf=np.frombuffer(part, np.uint8)))
        for k, part in enumerate(parts)
    ]
    messages += [("/ouster/imu_packets", first_ns + 1, packet(buf=np.zeros(48, np.uint8)))]
    if told == "in the bag":
        text = ROS1.types["std_msgs/msg/String"](path.with_suffix(".json").read_text())
        messages.insert(0, ("/ouster/metadata", first_ns, text))
    if told != "beside it":
        path.with_suffix(".json").unlink()
    bag = write_bag1(tmp_path / "drive.bag", messages)
    if told == "nowhere":
        with pytest.raises(InputError) as caught:
            scans_of(bag)
        assert caught.value.code == "ouster-no-metadata"
        return
    reader, scans = scans_of(bag)
    assert reader.clock is Clock.SENSOR_GPS
    assert sum(len(scan) for scan in scans) == 3 * 1024 * 32
    assert Recognised.by_content(bag).inspect().facts["scans"]["model"] == "OS-1-32-U0"


def test_fragments__in_any_order_repeated_and_lost(tmp_path: Path) -> None:
    path = recorded(tmp_path, 0.25)
    data = path.read_bytes()
    whole = scans_of(path)[1][0]
    parts = in_fragments(data)
    order = np.random.default_rng(3).permutation(len(parts)).reshape(-1)
    order = order[np.argsort(order // 20, kind="stable")]  # those of a few packets between each other
    path.write_bytes(data[:24] + b"".join(parts[k] for k in (*order, *order[:3])))
    (scan,) = scans_of(path)[1]
    assert len(scan) == len(whole)
    assert np.array_equal(np.sort(scan.t_s), np.sort(whole.t_s))
    path.write_bytes(data[:24] + b"".join(parts[:7] + parts[8:]))
    reader = OusterPcap([path], NO_OPTIONS)
    facts = reader.inspect().facts
    assert (facts["data_packets"], facts["other_packets"]) == (15, {"IP fragments": 4})
