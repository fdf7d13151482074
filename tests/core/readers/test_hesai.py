"""Hesai packets to scans: against another driver's clouds, and times and angles by the maker's formulas."""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import cKDTree

from furrowmap.core.readers.hesai.captures import HESAI, HesaiPcap
from furrowmap.core.readers.reader import ReadOptions, Recognised, open_recording
from furrowmap.core.readers.spinning.hour_clock import SensorClock
from furrowmap.core.readers.spinning.packet_decoder import PacketDecoder
from furrowmap.core.runtime.errors import InputError
from furrowmap.core.values.scan import Clock, Scan
from tests.core.readers.hesai_packets import calibration, gps_packet, packet, turning
from tests.core.readers.velodyne_packets import frames, rmc, write_pcap

EVERY_S = 400e-6
XT32_DEG = 15.0 - np.arange(32.0)


def bag(shared_data: Path, name: str) -> Path:
    return next((shared_data / "other_lidars" / "hesai" / name).glob("*.db3"))


def capture(folder: Path, packets: list[bytes], host_s: float = 1.75e9, *, name: str = "drive.pcap") -> Path:
    return write_pcap(folder / name, frames(packets, host_s, EVERY_S))


@pytest.mark.parametrize(("name", "model"), [("xt16", "PandarXT-16"), ("xt32", "PandarXT-32")])
def test_points__are_those_of_another_driver(shared_data: Path, name: str, model: str) -> None:
    """Its cloud has each return at the azimuth of its block, not at that of its firing."""
    path = bag(shared_data, name)
    content = next(path.parent.glob("*.pcd")).read_bytes()
    x, y, z = np.frombuffer(content.partition(b"DATA binary\n")[2], "<f4").reshape(-1, 3).T.astype(float)
    reader = open_recording([path], ReadOptions())
    (scan,) = (scan for scan in reader.scans() if len(scan) == len(x))  # type: ignore[attr-defined]
    order = HESAI.named(model).laser_order
    fired_s = np.empty(len(order))
    fired_s[order] = (6.0 + 48.384 / len(order) * np.arange(len(order))) * 1e-6
    turned = np.radians(3600.0 * fired_s[scan.laser])  # at 600 rpm
    mine = scan.xyz_m.astype(float)
    mine[:, 0], mine[:, 1] = (
        mine[:, 0] * np.cos(turned) - mine[:, 1] * np.sin(turned),
        mine[:, 0] * np.sin(turned) + mine[:, 1] * np.cos(turned),
    )
    theirs = np.stack([y, -x, z], axis=1)
    apart_m, which = cKDTree(mine).query(theirs)
    assert len(np.unique(which)) > 0.999 * len(theirs)
    assert np.percentile(apart_m, 99.9) < 1e-5
    times = [scan.t_s[scan.laser == laser] for laser in range(len(order))]
    assert all((np.diff(t_s) >= 0).all() for t_s in times)
    assert min(np.ptp(t_s) for t_s in times) > 0.09
    assert [notice.code for notice in reader.notices] == ["clock-recorder"]


SDK_US: dict[str, Callable[[int, int, int], float]] = {
    "PandarXT-32": lambda b, i, n: 5.632 - 50.0 * ((7 - b) // n) + 0.368 + 1.512 * i,
    "PandarXT-16": lambda b, i, n: 5.632 - 50.0 * ((7 - b) // n) + 0.368 + 3.024 * i,
    "PandarXT-32M": lambda b, i, n: 5.632 - 50.0 * ((5 - b) // n) + 0.368 + 2.888 * (i % 16),
    "PandarQT64": lambda b, i, n: (
        25.71 + 500.0 / 3.0 * (b // n) + 10.0 + {0: 2.31, 31: 67.86, 63: 136.45}.get(i, np.nan)
    ),
    "Pandar40P": lambda b, i, n: -28.58 - 55.56 * ((9 - b) // n) - {0: 42.22, 31: 9.5, 39: 3.62}.get(i, np.nan),
    "Pandar64": lambda b, i, n: -42.58 - 55.56 * ((5 - b) // n) - {0: 23.18, 31: 48.764, 63: 12.748}.get(i, np.nan),
}
"""Microseconds from the packet's stamp to the firing of channel i (from 0) in block b with n returns."""


def decoded(packets: list[bytes], model: str | None = None) -> list[Scan]:
    decoder = PacketDecoder(HESAI, model, clock=SensorClock(Clock.SENSOR, 0.0, 0.0))
    payloads = np.frombuffer(b"".join(packets), np.uint8).reshape(len(packets), -1)
    return decoder.push(payloads, np.full(len(packets), 1.75e9)) + decoder.finish()


@pytest.mark.parametrize(("name", "returns"), [*product(SDK_US, (1, 2)), ("PandarXT-32M", 3)])
def test_times_and_angles__are_those_of_the_maker(name: str, returns: int) -> None:
    model = HESAI.named(name)
    (scan,) = decoded(turning(name, 3, 1.75e9, returns=returns, azimuth=9000))
    groups = model.layout.blocks // returns
    assert len(scan) == 3 * groups * returns * model.lasers
    later_s = {"PandarQT64": 500e-6 / 3, "Pandar40P": 55.56e-6, "Pandar64": 55.56e-6}.get(name, 50e-6)
    for channel in (0, 31, model.lasers - 1):
        if channel >= model.lasers:
            continue
        mine = scan[scan.laser == model.laser_order[channel]]
        expected_s = [
            1.75e9 + p * groups * later_s + SDK_US[name](block, channel, returns) * 1e-6
            for p in range(3)
            for block in range(groups * returns)
        ]
        np.testing.assert_allclose(mine.t_s, expected_s, rtol=0, atol=1.2e-6)  # stamps are whole microseconds
        range_m = np.linalg.norm(mine.xyz_m, axis=1)
        np.testing.assert_allclose(range_m, 10.0 + 0.4 * (mine.return_number - 1), atol=1e-5)
        elevation_deg = np.degrees(np.arcsin(mine.xyz_m[:, 2] / range_m))
        np.testing.assert_allclose(elevation_deg, model.elevation_deg[channel], atol=1e-4)
        # A point's azimuth runs on with its time: so far after the first block's 90 degrees, at 3600 degrees a second.
        start_s = 1.75e9 + (SDK_US[name](0, 0, returns) - 1e6 * model.laser_s[0]) * 1e-6
        azimuth_deg = np.degrees(np.arctan2(-mine.xyz_m[:, 1], mine.xyz_m[:, 0]))
        turned_deg = 90.0 + model.azimuth_deg[channel] + 3600.0 * (mine.t_s - start_s)
        np.testing.assert_allclose(azimuth_deg, turned_deg, atol=0.02)
    assert set(scan.returns) == {returns}


def test_angles__are_those_of_the_data_sheets() -> None:
    """From -6 to 2 degrees, a Pandar40P has a beam every third of a degree, a Pandar64 every sixth."""
    for name, inner, apart_deg in (("Pandar40P", 25, 0.011), ("Pandar64", 49, 0.12)):
        outer = np.array([-7.0, -8.0, -9.0, -10.0, -11.0, -12.0, -13.0, -14.0, -19.0, -25.0])
        fan_deg = np.concatenate([[15.0, 11.0, 8.0, 5.0, 3.0], np.linspace(2.0, -6.0, inner), outer])
        np.testing.assert_allclose(HESAI.named(name).elevation_deg, fan_deg, rtol=0, atol=apart_deg)
    columns = [set(HESAI.named(name).azimuth_deg.tolist()) for name in ("Pandar40P", "Pandar64")]
    assert columns == [{-5.208, -1.042, 3.125}, {-5.208, -3.125, -1.042, 1.042, 3.125, 5.208}]


def test_angles__of_the_pandar_qt_are_smooth_and_alike_above_and_below() -> None:
    """Four groups of sixteen lasers, in turn to the left and to the right, those of a group almost in a plane."""
    model = HESAI.named("PandarQT64")
    assert np.ptp(model.elevation_deg) == pytest.approx(104.2, abs=0.1)
    assert np.abs(model.elevation_deg + model.elevation_deg[::-1]).max() < 0.02
    assert np.abs(np.diff(model.elevation_deg, 3)).max() < 0.03
    aside = (np.cos(np.radians(model.elevation_deg)) * np.tan(np.radians(model.azimuth_deg))).reshape(4, 16)
    assert np.sign(aside).T.tolist() == [[1, -1, 1, -1]] * 16
    assert np.ptp(np.abs(aside), axis=1).max() < 0.0015


def test_firings__follow_each_other_in_the_steps_of_each_model() -> None:
    """Microseconds; two lasers of a Pandar64 fire at once, 16 steps of 1.968 and then 16 of 1.304."""
    steps_us = np.concatenate([3.62 + 1.304 * np.arange(16), 25.148 + 1.968 * np.arange(16)])
    before_us = -1e6 * HESAI.named("Pandar64").laser_s
    np.testing.assert_allclose(np.sort(before_us), np.repeat(steps_us, 2), rtol=0, atol=1e-6)
    between_us = np.diff(np.sort(-1e6 * HESAI.named("Pandar40P").laser_s))
    assert np.abs(between_us[:, None] - [0.0, 1.304, 1.968]).min(axis=1).max() < 0.01
    after = np.arange(1, 64)
    expected_us = 2.055 + np.where(after % 16 == 0, 0.995, np.where(after % 8 == 0, 0.39, 0.0))
    np.testing.assert_allclose(np.diff(1e6 * HESAI.named("PandarQT64").laser_s), expected_us, rtol=0, atol=0.02)


def notices_of(path: Path) -> dict[str, str]:
    reader = HesaiPcap([path], ReadOptions())
    assert sum(len(scan) for scan in reader.scans()) == 200 * 8 * 32
    return {notice.code: notice.text for notice in reader.notices}


def test_angles__come_from_the_file_beside_or_are_said_to_be_the_models(tmp_path: Path) -> None:
    path = capture(tmp_path, turning("PandarXT-32", 200))
    assert Recognised.by_content(path).reader is HesaiPcap
    assert "the angles of the model are used" in notices_of(path)["angles-of-model"]
    (tmp_path / "own.csv").write_text("EEFF,1,1\n" + calibration(XT32_DEG - 0.1))
    (tmp_path / "other.csv").write_text("t_s,state\n0,up\n")
    assert "angles-of-model" not in notices_of(path)
    assert HesaiPcap([path], ReadOptions()).inspect().facts["angles"] == "own.csv"
    scan = next(HesaiPcap([path], ReadOptions()).scans())
    top = scan.xyz_m[scan.laser == 31][0]
    assert np.degrees(np.arctan2(top[2], np.hypot(*top[:2]))) == pytest.approx(14.9, abs=1e-3)


@pytest.mark.parametrize(
    ("files", "code"),
    [
        ({"a.csv": calibration(15.0 - 2.0 * np.arange(16.0))}, "angles-of-other-model"),
        ({"a.csv": calibration(19.5 - 1.3 * np.arange(32.0))}, "angles-of-other-model"),
        ({"a.csv": calibration(XT32_DEG).replace("7,9", "7,nine")}, "angles-damaged"),
        ({"a.csv": calibration(XT32_DEG).replace("7,9", "8,9")}, "angles-damaged"),
        ({"a.csv": calibration(XT32_DEG), "b.csv": calibration(XT32_DEG)}, "angles-ambiguous"),
    ],
)
def test_angles__of_another_sensor_or_damaged_are_refused(tmp_path: Path, files: dict[str, str], code: str) -> None:
    path = capture(tmp_path, turning("PandarXT-32", 200))
    for name, text in files.items():
        (tmp_path / name).write_text(text)
    with pytest.raises(InputError) as error:
        list(HesaiPcap([path], ReadOptions()).scans())
    assert error.value.code == code
    assert all(line.endswith(".") for line in error.value.lines)


@pytest.mark.parametrize(
    ("version", "name"),
    [((1, 1), "Pandar128"), ((1, 3), "Pandar128"), ((1, 4), "Pandar128 or OT128"), ((3, 2), "QT128"), ((4, 1), "AT128"),
     ((4, 3), "AT128"), ((5, 1), "FT120"), ((7, 2), "FT120"), ((9, 9), None)],
)  # fmt: skip
def test_models__that_are_not_supported_are_named(tmp_path: Path, version: tuple[int, int], name: str | None) -> None:
    other = bytes((0xEE, 0xFF, *version, 0, 0, 128, 2)).ljust(861, b"\0")
    with pytest.raises(InputError) as error:
        HesaiPcap([capture(tmp_path, [other] * 20)], ReadOptions())
    assert (error.value.code == "unsupported-model") == (name is not None)
    assert name is None or re.search(rf"\b{name}\b", str(error.value))


def test_models__that_contradict_the_packets_are_refused() -> None:
    with pytest.raises(InputError, match="PandarXT-16, but the packets are those of a PandarXT-32") as error:
        decoded([packet("PandarXT-32", 1.75e9, 0)], "XT16")
    assert error.value.code == "model-contradicted"


def test_lost_packets_and_a_cut__are_said(tmp_path: Path) -> None:
    packets = turning("PandarXT-32", 300)
    path = capture(tmp_path, packets[:100] + packets[110:210])
    assert "10 " in notices_of(path)["lost-packets"]
    path.write_bytes(path.read_bytes()[:-500])
    reader = HesaiPcap([path], ReadOptions())
    assert sum(len(scan) for scan in reader.scans()) == 199 * 8 * 32
    assert "cut-capture" in {notice.code for notice in reader.notices}


@pytest.mark.parametrize(
    ("ahead_s", "gps", "clock", "code", "first_s"),
    [
        (0.4, True, Clock.SENSOR_GPS, None, 0.4),
        (0.4, False, Clock.SENSOR, "clock-sensor", 0.4),
        (37.3, False, Clock.SENSOR, "clock-tai", 0.3),
        (700.0, False, Clock.RECORDER, "clock-recorder", 0.0),
    ],
)
def test_clock__is_gps_or_ptp_or_the_recorders(
    tmp_path: Path, ahead_s: float, gps: bool, clock: Clock, code: str | None, first_s: float
) -> None:
    """The sensor's clock, ahead of a recorder at 01:23:40 whose clock is right or late."""
    host_s = 1_781_141_020.0  # 2026-06-11 01:23:40, the time of `rmc`'s sentences
    packets = turning("PandarXT-32", 200, host_s + ahead_s)
    if gps:
        packets[50:50] = [gps_packet(host_s + ahead_s + 0.6, rmc("012340", "110626"))]
    reader = HesaiPcap([capture(tmp_path, packets, host_s)], ReadOptions())
    t_s = np.concatenate([scan.t_s for scan in reader.scans()])
    assert reader.clock is clock
    assert t_s[0] - host_s == pytest.approx(first_s - 344e-6, abs=1e-3)
    assert {notice.code for notice in reader.notices} - {"angles-of-model"} == ({code} if code else set())


def test_bag__without_its_calibration_says_so(shared_data: Path, tmp_path: Path) -> None:
    copy = shutil.copy(bag(shared_data, "xt32"), tmp_path / "drive.db3")
    reader = open_recording([Path(copy)], ReadOptions())
    assert sum(len(scan) for scan in reader.scans()) == 252_132  # type: ignore[attr-defined]
    assert {notice.code for notice in reader.notices} == {"angles-of-model", "clock-recorder"}
