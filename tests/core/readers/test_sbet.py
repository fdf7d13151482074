"""SBET against the trajectory it was made of and the point clouds that were made with it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import laspy
import numpy as np
import pytest
from numpy.typing import NDArray
from pyproj import Transformer

from furrowmap.core.readers.poses.sbet import Sbet
from furrowmap.core.readers.reader import ReadOptions
from furrowmap.core.readers.source import Head, look
from furrowmap.core.runtime.errors import InputError
from furrowmap.core.values.clock import GPS_EPOCH_S, gps_to_utc_s, las_time_to_utc
from furrowmap.core.values.pose_track import PoseTrack

WEEK = 1678


def poses(*paths: Path, **options: Any) -> PoseTrack:
    return Sbet(list(paths), ReadOptions(**options)).poses()


def records(count: int = 300, first_s: float = 407_106.0) -> NDArray[np.float64]:
    out = np.zeros((count, 17))
    out[:, 0] = first_s + np.arange(count) / 200
    out[:, 1:4] = np.radians(36.9), np.radians(140.0), 300.0
    out[:, 7:11] = 0.01, -0.02, 1.5, 0.25
    return out


def write(folder: Path, data: NDArray[np.float64] | bytes, name: str = "mission.sbet") -> Path:
    path = folder / name
    path.write_bytes(data if isinstance(data, bytes) else data.astype("<f8").tobytes())
    return path


def utm(track: PoseTrack) -> NDArray[np.float64]:
    e, n = Transformer.from_crs(4979, 32615, always_xy=True).transform(*track.position[:, :2].T)
    return np.column_stack([e, n, track.position[:, 2]])


def test_sample__agrees_with_its_source(shared_data: Path) -> None:
    path = shared_data / "sbet/flight_derived.sbet"
    assert Sbet.recognise(look(path)) > 0.9
    track = poses(path, week=WEEK)
    source = np.loadtxt(shared_data / "sbet/trajectory_utm15n.csv", delimiter=",", skiprows=1)
    assert len(track) == len(source) == 14_600
    np.testing.assert_allclose(utm(track), source[:, [2, 1, 3]], rtol=0, atol=1e-6)
    np.testing.assert_allclose(track.roll_deg, source[:, 4], atol=1e-9)
    np.testing.assert_allclose(track.pitch_deg, source[:, 5], atol=1e-9)
    np.testing.assert_allclose(track.heading_deg, source[:, 6] % 360, atol=1e-9)
    np.testing.assert_allclose(track.t_s, gps_to_utc_s(WEEK * 604_800 + source[:, 0]), atol=1e-6)
    assert track.true_north
    assert not track.projected


def test_sample__is_the_flight_of_its_point_cloud(shared_data: Path) -> None:
    """Each point of the strip hangs below the aircraft of its moment, off the vertical by its own scan angle.

    At 67 m/s a second of error in time, such as one leap second, would be off by 7 degrees at nadir.
    """
    track = poses(shared_data / "sbet/flight_derived.sbet", week=WEEK)
    cloud = laspy.read(shared_data / "sbet/derived_strip_adjusted_standard_time.laz")
    t_s = las_time_to_utc(np.asarray(cloud.gps_time))
    assert track.t_s[0] < t_s.min() < t_s.max() < track.t_s[-1]
    way = utm(track)
    aircraft = np.column_stack([np.interp(t_s, track.t_s, way[:, axis]) for axis in range(3)])
    to_point = np.column_stack([cloud.x, cloud.y, cloud.z]) - aircraft
    off_nadir = np.degrees(np.arctan2(np.hypot(to_point[:, 0], to_point[:, 1]), -to_point[:, 2]))
    np.testing.assert_allclose(off_nadir, np.abs(np.asarray(cloud.scan_angle) * 0.006), rtol=0, atol=0.01)
    in_week = laspy.read(shared_data / "sbet/derived_strip_week_time.laz")
    np.testing.assert_allclose(gps_to_utc_s(WEEK * 604_800 + np.asarray(in_week.gps_time)), t_s, atol=1e-6)


def test_inspect__reports_the_content_of_the_sample(shared_data: Path) -> None:
    inspection = Sbet([shared_data / "sbet/flight_derived.sbet"], ReadOptions()).inspect()
    facts = inspection.facts
    assert (facts["poses"], facts["rate_hz"], facts["gaps"]["count"]) == (14_600, 200.0, 0)
    assert facts["seconds_of_week"] == [407106.003, 407178.999]
    assert facts["lat_deg"] == pytest.approx([29.7145, 29.7150], abs=5e-5)
    assert facts["lon_deg"] == pytest.approx([-95.3629, -95.3123], abs=5e-5)
    assert facts["h_m"] == pytest.approx([514.0, 553.1], abs=0.05)
    assert facts["roll_deg"] == pytest.approx([-18.5, 4.0], abs=0.05)
    assert inspection.clocks == ()
    assert [notice.code for notice in inspection.notices] == ["no-gps-week"]
    dated = Sbet([shared_data / "sbet/flight_derived.sbet"], ReadOptions(week=WEEK)).inspect()
    assert dated.facts["first"].startswith("2012-03-08")
    assert len(dated.clocks) == 1
    two = Sbet([shared_data / "sbet/2-points.sbet"], ReadOptions(week=WEEK)).inspect().facts
    assert (two["poses"], two["h_m"]) == (2, [107.715, 107.715])


def test_week__comes_from_the_session_or_a_time_nearby_or_is_asked_for(shared_data: Path) -> None:
    path = shared_data / "sbet/flight_derived.sbet"
    stated = poses(path, week=WEEK)
    for hours in (-80, 0, 80):
        np.testing.assert_array_equal(poses(path, near_s=stated.t_s[0] + 3600 * hours).t_s, stated.t_s)
    with pytest.raises(InputError) as error:
        poses(path)
    assert error.value.code == "no-gps-week"
    assert "`week = N` under `[trajectory]`" in error.value.remedy


def test_times__in_utc_where_stated(tmp_path: Path) -> None:
    path = write(tmp_path, records())
    as_utc = poses(path, week=2422, time="utc")
    assert as_utc.t_s[0] == GPS_EPOCH_S + 2422 * 604_800 + 407_106.0
    assert poses(path, week=2422, time="gps").t_s[0] == as_utc.t_s[0] - 18
    whole = write(tmp_path, records(first_s=2422 * 604_800 + 407_106.0))
    np.testing.assert_allclose(poses(whole).t_s, as_utc.t_s - 18, atol=1e-6)


@pytest.mark.parametrize("begins_anew", [True, False])
def test_times__over_the_end_of_the_week(begins_anew: bool, tmp_path: Path) -> None:
    data = records(first_s=604_799.0)
    if begins_anew:
        data[:, 0] %= 604_800
    track = poses(write(tmp_path, data), week=2422)
    np.testing.assert_allclose(np.diff(track.t_s), 0.005, atol=1e-6)
    assert track.t_s[200] == gps_to_utc_s(2423 * 604_800)


def test_times__of_no_known_kind_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="unknown time scale"):
        poses(write(tmp_path, records(first_s=15_261_507.0)), week=WEEK)


def test_heading__is_freed_of_the_wander_angle(tmp_path: Path) -> None:
    track = poses(write(tmp_path, records()), week=2422)
    np.testing.assert_allclose(track.heading_deg, np.degrees(1.5 - 0.25))
    np.testing.assert_allclose(track.roll_deg, np.degrees(0.01))
    np.testing.assert_allclose(track.pitch_deg, np.degrees(-0.02))


def test_file__that_ends_inside_a_record(shared_data: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError) as error:
        poses(shared_data / "sbet/badfile.sbet", week=WEEK)
    assert error.value.code == "no-poses"
    assert "135 bytes" in error.value.what
    reader = Sbet([write(tmp_path, records().tobytes()[:-50])], ReadOptions(week=WEEK))
    assert len(reader.poses()) == 299
    assert "86 bytes" in reader.notices[0].text


def test_file__with_a_damaged_record_is_refused_with_its_byte(tmp_path: Path) -> None:
    data = records()
    data[123, 1] = 7.0
    with pytest.raises(InputError) as error:
        poses(write(tmp_path, data), week=WEEK)
    assert f"byte {123 * 136}" in error.value.what


def test_files__of_one_trajectory_follow_each_other(tmp_path: Path) -> None:
    a = write(tmp_path, records(), "a.sbet")
    b = write(tmp_path, records(first_s=407_200.0), "b.sbet")
    assert len(poses(a, b, week=WEEK)) == 600
    with pytest.raises(InputError, match="out of time order"):
        poses(b, a, week=WEEK)


def test_recognise__rejects_other_binary_files(shared_data: Path, tmp_path: Path) -> None:
    noise = np.random.default_rng(1).bytes(136 * 50)
    for data in (b"\0" * 1360, noise, np.arange(17 * 20, dtype="<f8").tobytes(), b"text " * 100):
        assert Sbet.recognise(look(write(tmp_path, data))) == 0.0
    for path in (p for folder in ("las", "velodyne", "geo", "gnss") for p in (shared_data / folder).rglob("*")):
        if path.is_file() and path.stat().st_size:
            assert Sbet.recognise(look(path)) == 0.0, path


BOUNDS_DEG = {
    "latitude": (1, -90.0, 90.0),
    "longitude": (2, -180.0, 360.0),
    "roll": (7, -180.0, 180.0),
    "pitch": (8, -90.0, 90.0),
    "platform heading": (9, -360.0, 720.0),
    "wander angle": (10, -360.0, 360.0),
}


@pytest.mark.parametrize("end", [0, 1])
@pytest.mark.parametrize("name", [*BOUNDS_DEG, "height"])
def test_record__at_a_limit_is_read_and_beyond_it_is_damage(name: str, end: int, tmp_path: Path) -> None:
    """Both poles, the antimeridian, a loop, the sea floor and the edge of space: each is a pose."""
    if name == "height":
        field, limit = 3, (-1e4, 1e6)[end]
    else:
        field, *limits = BOUNDS_DEG[name]
        limit = float(np.radians(limits[end]))
    data = records(20)
    data[:, field] = limit
    path = write(tmp_path, data)
    assert Sbet.recognise(look(path)) > 0.9
    data[7, field] = limit * (1.0 + 1e-9)
    path = write(tmp_path, data)
    assert Sbet.recognise(look(path)) == 0.0
    with pytest.raises(InputError, match=f"byte {7 * 136}:") as refused:
        poses(path, week=WEEK)
    assert refused.value.code == "damaged-record"


@pytest.mark.parametrize(("lat_deg", "lon_deg"), [(89.9, 12.0), (-89.9, 12.0), (5.0, 179.999), (5.0, -179.999)])
def test_positions__near_the_poles_and_the_antimeridian(lat_deg: float, lon_deg: float, tmp_path: Path) -> None:
    data = records(20)
    data[:, 1:3] = np.radians(lat_deg), np.radians(lon_deg)
    track = poses(write(tmp_path, data), week=WEEK)
    np.testing.assert_allclose(track.position[:, :2], np.tile([lon_deg, lat_deg], (20, 1)), rtol=1e-12)


def test_recognise__times_increase_by_up_to_an_hour() -> None:
    data = records(20)

    def score(first_step_s: float, suffix: str = ".bin", count: int = 20) -> float:
        data[0, 0] = data[1, 0] - first_step_s
        return Sbet.recognise(Head(Path(), data[:count].tobytes(), "", suffix))

    assert [score(step_s) > 0.9 for step_s in (-0.1, 0.0, 0.1, 3600.0, 3601.0)] == [False, False, True, True, False]
    assert score(0.1) <= 1.0
    data[:, 0] += 1e10 - data[-1, 0]
    assert score(0.01) > 0.9
    data[:, 0] += 1.0
    assert score(0.01) == 0.0
    data[:, 0] -= 9e9
    assert [score(0.1, suffix, 1) > 0.9 for suffix in (".sbet", ".out", ".bin")] == [True, True, False]
    assert score(0.1, ".bin", 2) > 0.9
