"""Point clouds as drivers lay them out, each way: what comes out is what went in."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from furrowmap.core.readers.reader import ReadOptions, open_recording
from furrowmap.core.readers.rosbag.bag_storage import BagMessage, Damage
from furrowmap.core.readers.rosbag.cloud_messages import CloudScans
from furrowmap.core.readers.rosbag.ros_messages import deserialize
from furrowmap.core.runtime.errors import InputError
from furrowmap.core.values.scan import Scan
from tests.core.readers.small_bags import (
    LIVOX,
    ROS1,
    ROS2,
    T0_NS,
    livox_cloud,
    mixed,
    point_cloud,
    revolution,
    write_bag1,
    write_bag2,
)

T0_S = T0_NS * 1e-9

TIMES: dict[str, tuple[str, float, float]] = {
    # How drivers write times: type, unit, and what they count from.
    "time f4": ("f4", 1.0, 0.0),
    "t u4": ("u4", 1e-9, 0.0),
    "time_stamp u4": ("u4", 1e-9, 0.0),
    "t f4": ("f4", 1e-6, 0.0),
    "offset_time u4": ("u4", 1e-6, 0.0),
    "timestamp f8": ("f8", 1.0, T0_S),
    "timestamp u4": ("u4", 1e-3, 0.0),
    "t f8": ("f8", 1e-9, T0_S),
    "time f8": ("f8", 1e-6, T0_S),
}


def cloud(points: NDArray[Any], stamp_ns: int = T0_NS, **options: Any) -> Any:
    return point_cloud(stamp_ns, points, **options)


def scans_of(*messages: Any) -> tuple[list[Scan], CloudScans]:
    decoder = CloudScans("test")
    message = BagMessage("/points", "sensor_msgs/msg/PointCloud2", "cdr", T0_NS, b"")
    return [scan for content in messages for scan in decoder.push(content, message)], decoder


def codes(decoder: CloudScans) -> set[str]:
    return {notice.code for notice in decoder.notices()}


@settings(max_examples=60, suppress_health_check=[HealthCheck.too_slow])
@given(
    how=st.sampled_from(sorted(TIMES)),
    big=st.booleans(),
    ring=st.sampled_from(["u1", "u2", "i4"]),
    intensity=st.sampled_from(["u1", "u2", "f4", "f8"]),
    xyz=st.sampled_from(["f4", "f8"]),
    rows=st.sampled_from([1, 4, 16]),
    pad=st.integers(0, 7),
    gaps=st.integers(0, 4),
    seed=st.integers(0, 1000),
)
def test_every_layout_gives_the_points_that_were_put_in(
    how: str, big: bool, ring: str, intensity: str, xyz: str, rows: int, pad: int, gaps: int, seed: int
) -> None:
    random = np.random.default_rng(seed)
    name, kind = how.split()
    unit_s, origin_s = TIMES[how][1:]
    n = rows * 8
    order = ">" if big else "<"
    fields = [("x", xyz), ("y", xyz), ("intensity", intensity), ("z", xyz), ("ring", ring), (name, kind)]
    points = np.zeros(n, [(field, order + form) for field, form in fields])
    truth = random.uniform(-50, 50, (n, 3)).astype(np.float32)
    offset_s = np.linspace(0.0, 0.1, n)
    for k, axis in enumerate("xyz"):
        points[axis] = truth[:, k]
    points["intensity"] = random.integers(0, 256, n)
    points["ring"] = np.arange(n) // 8 if rows > 1 else np.arange(n) % 4
    points[name] = np.round((origin_s + offset_s) / unit_s, 9 if unit_s == 1.0 else 0)
    gone = random.permutation(n)[:gaps]
    points["x"][gone] = np.nan
    kept = np.setdiff1d(np.arange(n), gone)
    (scan,), decoder = scans_of(cloud(points.reshape(rows, -1), pad=pad))
    resolution_s = max(unit_s, 1e-6) if unit_s < 1.0 else 1e-6
    np.testing.assert_allclose(scan.t_s, T0_S + offset_s[kept], rtol=0, atol=resolution_s)
    # Points of one time (milliseconds are coarse) may change places: both sides in the order of x.
    mine, its = np.argsort(scan.xyz_m[:, 0]), kept[np.argsort(truth[kept, 0])]
    np.testing.assert_array_equal(scan.xyz_m[mine], truth[its])
    np.testing.assert_array_equal(scan.intensity[mine], points["intensity"][its].astype(int))
    np.testing.assert_array_equal(scan.laser[mine], points["ring"][its].astype(int))
    assert (np.diff(scan.t_s) >= 0).all()
    assert not codes(decoder)


def test_a_message_without_times_per_point_is_reported() -> None:
    points = revolution()[["x", "y", "z", "intensity", "ring"]]
    (scan,), decoder = scans_of(cloud(np.array(points, points.dtype)))
    assert set(scan.t_s) == {T0_S}
    assert codes(decoder) == {"no-point-times"}


def test_the_same_time_for_all_points_is_none() -> None:
    points = revolution()
    points["time"] = 0.05
    (scan,), decoder = scans_of(cloud(points))
    assert set(scan.t_s) == {T0_S}
    assert codes(decoder) == {"no-point-times"}


def test_times_before_the_stamp_are_kept() -> None:
    points = revolution()
    points["time"] -= 0.1
    (scan,), _ = scans_of(cloud(points))
    assert scan.t_s[[0, -1]] == pytest.approx([T0_S - 0.1, T0_S], abs=1e-6)


def test_times_from_an_unknown_zero_start_at_the_stamp() -> None:
    points = revolution()
    wide = np.zeros(len(points), [(name, points.dtype[name]) for name in "xyz"] + [("timestamp", "<f8")])
    for axis in "xyz":
        wide[axis] = points[axis]
    wide["timestamp"] = 5000.0 + points["time"].astype(np.float64)
    (scan,), decoder = scans_of(cloud(wide))
    assert scan.t_s[[0, -1]] == pytest.approx([T0_S, T0_S + 0.1], abs=1e-6)
    assert codes(decoder) == {"point-times-unanchored", "no-rings"}


DRIVERS = {
    # Fields of drivers with their types; how times are written; how rings are counted; how points are laid out.
    "ouster": ([("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("pad", "<f4"), ("intensity", "<f4"), ("t", "<u4"),
                ("reflectivity", "<u2"), ("ring", "<u2"), ("ambient", "<u2"), ("range", "<u4")], 1e9, 0.0, True, True),
    "ouster 2020": ([("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("intensity", "<f4"), ("t", "<u4"),
                     ("reflectivity", "<u2"), ("ring", "u1"), ("range", "<u4")], 1e9, 0.0, True, True),
    "rslidar_sdk": ([("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("intensity", "<f4"), ("ring", "<u2"),
                     ("timestamp", "<f8")], 1.0, T0_S, False, False),
    "hesai": ([("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("intensity", "<f4"), ("ring", "<u2"), ("timestamp", "<f8")],
              1.0, T0_S, True, False),
    "velodyne": ([("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("intensity", "<f4"), ("ring", "<u2"), ("time", "<f4")],
                 1.0, 0.0, False, False),
}  # fmt: skip


@pytest.mark.parametrize("lasers", [32, 64, 128])
@pytest.mark.parametrize("driver", DRIVERS)
def test_drivers__lasers_count_from_the_lowest_beam(driver: str, lasers: int) -> None:
    """A turn of 100 columns over flat ground and a wall all round, as each driver writes it."""
    fields, unit, origin_s, from_top, organised = DRIVERS[driver]
    elevation = np.radians(np.linspace(-22.5, 22.5, lasers))
    column, beam = np.meshgrid(np.arange(100), np.arange(lasers))
    azimuth = -2.0 * np.pi * column / 100
    level = np.minimum(30.0, 2.0 / np.tan(np.maximum(-elevation[beam], 1e-3)))
    points = np.zeros((lasers, 100), fields)
    points["x"], points["y"] = level * np.cos(azimuth), level * np.sin(azimuth)
    points["z"] = level * np.tan(elevation[beam])
    points["intensity"] = 7
    points["ring"] = lasers - 1 - beam if from_top else beam
    time = next(name for name in ("t", "timestamp", "time") if name in points.dtype.names)
    time_s = column * 1e-3 + (0.0 if organised else beam * 1e-6)
    points[time] = np.round((origin_s + time_s) * unit, 0 if unit > 1.0 else 9)
    laid_out = points[::-1] if from_top else points
    if not organised:  # those without a return are left out, here the highest beams
        laid_out = np.ascontiguousarray(points.T).ravel()
        laid_out = laid_out[np.arctan2(laid_out["z"], np.hypot(laid_out["x"], laid_out["y"])) < np.radians(20.0)]
    (scan, again), decoder = scans_of(cloud(laid_out), cloud(laid_out, T0_NS + 100_000_000))
    assert again.lasers == scan.lasers == (lasers if from_top or organised else (elevation < np.radians(20.0)).sum())
    np.testing.assert_array_equal(again.laser, scan.laser)
    x, y, z = scan.xyz_m.T
    rank = np.rint(np.interp(np.arctan2(z, np.hypot(x, y)), elevation, range(lasers)))
    np.testing.assert_array_equal(scan.laser, rank)
    np.testing.assert_array_equal(scan.column, np.rint(-np.arctan2(y, x) * 50 / np.pi) % 100)
    since_s = scan.column * 1e-3 + (0.0 if organised else rank * 1e-6)
    np.testing.assert_allclose(scan.t_s, T0_S + since_s, rtol=0, atol=1.1e-6)
    assert not codes(decoder)


def test_columns_are_firings_whether_organised_or_not() -> None:
    """16 lasers, 10 firings of 55 µs: as rows of firings, as rows of lasers, and as a list with returns missing."""
    points = revolution(160)
    points["time"] = np.arange(160) // 16 * 0.01 + np.arange(160) % 16 * 1e-5
    firing = np.arange(160) // 16
    grid = points.reshape(10, 16)
    for laid_out in (grid, np.ascontiguousarray(grid.T)):
        (scan,), _ = scans_of(cloud(laid_out))
        np.testing.assert_array_equal(scan.column, firing)
    some = np.delete(np.arange(160), [0, 17, 18, 40, 159])
    (scan,), _ = scans_of(cloud(points[some]))
    np.testing.assert_array_equal(scan.column, firing[some])


def test_zeros_and_infinities_are_no_returns() -> None:
    points = revolution(8)
    points["x"][0] = np.inf
    for axis in "xyz":
        points[axis][1] = 0.0
    (scan,), _ = scans_of(cloud(points))
    assert len(scan) == 6


def test_clouds_that_run_back_or_hold_nothing_are_left_out_and_counted() -> None:
    empty = revolution()
    empty["x"] = np.nan
    messages = [
        cloud(revolution(), T0_NS),
        cloud(revolution(), T0_NS - 100_000_000),
        cloud(empty, T0_NS + 100_000_000),
        cloud(revolution(), T0_NS + 200_000_000),
    ]
    scans, decoder = scans_of(*messages)
    assert [scan.number for scan in scans] == [0, 1]
    assert codes(decoder) == {"clouds-late", "clouds-empty"}


def test_intensities_beyond_a_byte_are_kept() -> None:
    points = revolution()
    points["intensity"] = 3000.0
    (scan,), _ = scans_of(cloud(points))
    assert scan.intensity.dtype == np.uint16
    assert set(scan.intensity) == {3000}


@pytest.mark.parametrize(
    "change",
    [
        {"data": np.zeros(10, np.uint8)},
        {"point_step": 4},
        {"width": 2**31},
        {"fields": []},
        {"row_step": 0},
    ],
    ids=str,
)
def test_a_cloud_that_contradicts_itself_is_damaged(change: dict[str, Any]) -> None:
    content = cloud(revolution())
    for name, value in change.items():
        setattr(content, name, value)
    with pytest.raises(Damage):
        scans_of(content)


def test_reading_needs_no_more_memory_for_a_longer_bag(tmp_path: Path) -> None:
    import tracemalloc

    peaks = []
    for clouds in (10, 40):
        path = write_bag1(tmp_path / f"{clouds}.bag", mixed(ROS1, clouds, 20_000), "LZ4")
        reader = open_recording([path], ReadOptions())
        next(iter(open_recording([path], ReadOptions()).scans()))
        tracemalloc.start()
        assert sum(1 for _ in reader.scans()) == clouds
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[1] < 1.1 * peaks[0]


def test_promise_14__points_that_are_none_are_left_out_and_counted_by_reason() -> None:
    points = revolution(100)
    points["x"][:3] = np.nan
    points["y"][3] = np.inf
    points["z"][4:6] = 1e6
    points["time"][7] = 3e4
    sound = revolution(100)
    scans, decoder = scans_of(cloud(points), cloud(sound, T0_NS + 100_000_000))
    decoder.finish()
    assert [len(scan) for scan in scans] == [100 - 7, 100]
    (notice,) = (notice for notice in decoder.notices() if notice.code == "points-invalid")
    assert decoder.facts()["slots_without_return"] == 3
    assert "of 197 points" in notice.text
    assert "1 with coordinates that are no numbers" in notice.text
    assert "2 with coordinates beyond 2,000 m" in notice.text
    assert "1 with times apart from the others" in notice.text


def test_promise_14__a_cloud_of_mostly_invalid_points_is_refused() -> None:
    points = revolution(100)
    points["x"][:60] = 1e9
    _, decoder = scans_of(cloud(points))
    with pytest.raises(InputError, match="most points are invalid") as error:
        decoder.finish()
    assert error.value.code == "points-mostly-invalid"


@pytest.mark.parametrize("count", [0, 1, 2])
def test_promise_14__tiny_clouds_are_read(count: int) -> None:
    scans, decoder = scans_of(cloud(revolution(count)), cloud(revolution(50), T0_NS + 100_000_000))
    decoder.finish()
    assert [len(scan) for scan in scans] == [n for n in (count, 50) if n]


def test_promise_14__two_points_apart_in_time_leave_one() -> None:
    two = revolution(2)
    two["time"] = 0.0, 4.0
    scans, decoder = scans_of(cloud(revolution(50)), cloud(two, T0_NS + 100_000_000))
    assert [len(scan) for scan in scans] == [50, 1]
    assert codes(decoder) == {"points-invalid"}


@pytest.mark.parametrize("axis", "xyz")
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_coordinates__up_to_2_km_are_returns(axis: str, sign: float) -> None:
    points = revolution(20)
    points[axis][3], points[axis][4] = sign * 2000.0, sign * 2000.5
    (scan,), decoder = scans_of(cloud(points))
    assert scan.xyz_m[:, "xyz".index(axis)].tolist() == [v for k, v in enumerate(points[axis].tolist()) if k != 4]
    assert "1 with coordinates beyond 2,000 m" in next(iter(decoder.notices())).text


@pytest.mark.parametrize(("dense", "codes_of_it", "slots"), [(False, set(), 1), (True, {"points-invalid"}, 0)])
def test_coordinates__that_are_no_numbers_are_no_returns_where_the_cloud_may_have_such(
    dense: bool, codes_of_it: set[str], slots: int
) -> None:
    points = revolution(20)
    points["y"][3] = np.nan
    message = cloud(points)
    message.is_dense = dense
    (scan,), decoder = scans_of(message)
    assert len(scan) == 19
    assert codes(decoder) == codes_of_it
    assert decoder.facts()["slots_without_return"] == slots


def test_coordinates__of_0_in_one_axis_or_two_are_returns() -> None:
    points = revolution(20)
    points["x"][3] = points["y"][3] = points["z"][4] = 0.0
    (scan,), _ = scans_of(cloud(points))
    assert len(scan) == 20


@pytest.mark.parametrize(("far", "is_refused"), [(50, False), (51, True)])
def test_clouds__half_of_whose_points_are_invalid_are_read(far: int, is_refused: bool) -> None:
    points = revolution(100)
    points["x"][:far] = 1e9
    _, decoder = scans_of(cloud(points))
    if is_refused:
        with pytest.raises(InputError, match=f"100 points {far} with"):
            decoder.finish()
    else:
        assert decoder.finish() == []


@pytest.mark.parametrize(
    ("span_s", "begin_s", "unit_s", "written", "first_s"),
    [
        (0.006, 0.0, 1.0, "s from the message's stamp", 0.0),
        (0.0045, 0.0, 1.0, "none", 0.0),
        (1.45, 0.0, 1.0, "s from the message's stamp", 0.0),
        (1.55, 0.0, 1.0, "none", 0.0),
        (0.1, -0.1, 1e-3, "ms from the message's stamp", -0.1),
        (0.1, 0.2, 1e-6, "µs from the message's stamp", 0.2),
        (0.1, 9.9, 1e-9, "ns from the message's stamp", 9.9),
        (0.1, 10.0, 1e-3, "ms from an unknown zero", 0.0),
        (0.1, -10.2, 1.0, "s from an unknown zero", 0.0),
        (0.1, T0_S - 86_000.0, 1.0, "s since 1970", -86_000.0),
        (0.1, T0_S + 86_000.0, 1.0, "s since 1970", 86_000.0),
        (0.1, T0_S - 87_000.0, 1.0, "s from an unknown zero", 0.0),
        (0.1, T0_S + 87_000.0, 1.0, "s from an unknown zero", 0.0),
    ],
)
def test_times__have_the_unit_that_makes_them_a_revolution(
    span_s: float, begin_s: float, unit_s: float, written: str, first_s: float
) -> None:
    """Of 5 ms to 1.5 s, counted from the stamp up to ten seconds off it, or from 1970 up to a day off it."""
    plain = revolution(100)
    points = np.zeros(100, [(name, plain.dtype[name]) for name in ("x", "y", "z", "ring")] + [("time", "<f8")])
    for name in ("x", "y", "z", "ring"):
        points[name] = plain[name]
    points["time"] = (begin_s + np.linspace(0.0, span_s, 100)) / unit_s
    (scan,), decoder = scans_of(cloud(points))
    assert decoder.facts()["time_per_point"] == written
    assert scan.t_s[0] - T0_S == pytest.approx(first_s, abs=1e-5)
    assert np.ptp(scan.t_s) == pytest.approx(0.0 if written == "none" else span_s, abs=1e-5)


def test_rings_and_intensities__are_cut_to_their_range() -> None:
    points = revolution(6).astype([*((name, "<f4") for name in ("x", "y", "z", "intensity", "time")), ("ring", "<i4")])
    points["ring"] = [-1, 0, 1, 254, 255, 256]
    points["intensity"] = [-5.0, 0.4, 0.6, 65_535.0, 70_000.0, np.nan]
    (scan,), _ = scans_of(cloud(points))
    assert scan.laser.tolist() == [0, 0, 1, 254, 255, 255]
    assert scan.intensity.tolist() == [0, 0, 1, 65_535, 65_535, 0]
    points["intensity"] = [255.4, 0.0, 0.0, 0.0, 0.0, 0.0]
    (scan,), _ = scans_of(cloud(points))
    assert (scan.intensity.dtype, scan.intensity[0]) == (np.uint8, 255)
    points["intensity"] = [255.6, 0.0, 0.0, 0.0, 0.0, 0.0]
    (scan,), _ = scans_of(cloud(points))
    assert (scan.intensity.dtype, scan.intensity[0]) == (np.uint16, 256)


@pytest.mark.parametrize("store", [ROS1, ROS2], ids=["ros1", "ros2"])
@pytest.mark.parametrize("count", [1, 2, 500])
def test_livox__points_have_their_own_times_and_no_rings(tmp_path: Path, store: Any, count: int) -> None:
    """As of a Mid-360: four lasers in turn, 0.1 s a message; a point at 0, 0, 0 is none."""
    kind = [("offset_time", "u4"), *((axis, "f4") for axis in "xyz"), *((name, "u1") for name in ("r", "tag", "line"))]
    points = np.zeros(count, kind)
    points["offset_time"] = np.linspace(0, 99_000_000, count)
    points["x"], points["y"], points["z"] = np.random.default_rng(1).uniform(1, 20, (3, count))
    points["r"], points["line"] = np.arange(count) % 256, np.arange(count) % 4
    if count > 100:
        points["x"][7] = points["y"][7] = points["z"][7] = 0
    recorded = [("/livox/lidar", T0_NS + i * 10**8, livox_cloud(T0_NS + i * 10**8, points, store)) for i in range(2)]
    path = write_bag1(tmp_path / "l.bag", recorded) if store is ROS1 else write_bag2(tmp_path / "l", recorded)
    reader = open_recording([path], ReadOptions())
    first = next(reader.scans())  # type: ignore[attr-defined]
    there = points[(points["x"] != 0)]
    np.testing.assert_array_equal(first.xyz_m, np.stack([there[axis] for axis in "xyz"], axis=1))
    np.testing.assert_array_equal(first.laser, there["line"])
    np.testing.assert_array_equal(first.intensity, there["r"])
    if count > 1:
        np.testing.assert_allclose(first.t_s - T0_S, there["offset_time"] * 1e-9, atol=1e-6)
    told = {notice.code for notice in reader.inspect().notices}
    assert ("rosette" in told) == (count > 100)


@pytest.mark.parametrize("cut", [1, 3, 40, 10**6])
@pytest.mark.parametrize("encoding", ["ros1", "cdr"])
def test_livox__damaged_messages_are_refused(cut: int, encoding: str) -> None:
    store = ROS1 if encoding == "ros1" else ROS2
    kind = [("offset_time", "u4"), *((axis, "f4") for axis in "xyz"), *((name, "u1") for name in ("r", "tag", "line"))]
    message = livox_cloud(T0_NS, np.zeros(5, kind), store)
    data = bytes((store.serialize_ros1 if store is ROS1 else store.serialize_cdr)(message, LIVOX))
    with pytest.raises(Damage):
        deserialize(BagMessage("/livox/lidar", LIVOX, encoding, T0_NS, data[: max(len(data) - cut, 2)]))
