"""Trajectories in CSV: the samples' figures, other people's habits, and every way to refuse one."""

from __future__ import annotations

import gzip
import tempfile
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from furrowmap.core.readers.poses.csv import PoseCsv
from furrowmap.core.readers.reader import ReadOptions
from furrowmap.core.readers.source import look
from furrowmap.core.runtime.errors import InputError
from furrowmap.core.values.clock import utc_to_gps_s
from furrowmap.core.values.pose_track import PoseTrack
from furrowmap.core.values.rotation import wrap_deg
from furrowmap.core.values.scan import Clock

HEADER = "time_unix_s,e_m,n_m,h_m,roll_deg,pitch_deg,heading_deg"
T0 = 1781141019.8


def rows(count: int = 5, t0: float = T0) -> list[str]:
    return [f"{t0 + k / 100:.4f},{100 + k},200.5,30.25,1.5,-0.5,{(359 + k) % 360}" for k in range(count)]


def write(folder: Path, *lines: str, name: str = "trajectory.csv") -> Path:
    path = folder / name
    path.write_bytes(("\n".join(lines) + "\n").encode())
    return path


def poses(*paths: Path, **options: Any) -> PoseTrack:
    return PoseCsv(list(paths), ReadOptions(**options)).poses()


def refusal(path: Path, **options: Any) -> InputError:
    with pytest.raises(InputError) as error:
        poses(path, **options)
    return error.value


@pytest.mark.parametrize(
    ("name", "count", "gaps", "longest_s"),
    [
        ("rover_real/reference_poses.csv", 14330, 385, 2.87),
        ("tractor_loop/truth/trajectory.csv", 6141, 0, 0.0),
        ("tractor_fishtail/truth/trajectory.csv", 6415, 0, 0.0),
    ],
)
def test_samples__are_read_whole(name: str, count: int, gaps: int, longest_s: float, shared_data: Path) -> None:
    path = shared_data / name
    assert PoseCsv.recognise(look(path)) == 1.0
    inspection = PoseCsv([path], ReadOptions()).inspect()
    assert inspection.facts["poses"] == count
    assert (inspection.facts["gaps"]["count"], inspection.facts["gaps"]["longest_s"]) == (gaps, longest_s)
    assert inspection.facts["rate_hz"] == 100.0
    assert inspection.notices == ()
    track = poses(path)
    expected = np.loadtxt(path, delimiter=",", skiprows=1, usecols=range(7))
    np.testing.assert_allclose(track.t_s, expected[:, 0], rtol=0, atol=1e-6)
    np.testing.assert_allclose(track.position, expected[:, 1:4], rtol=1e-14)
    attitude = np.column_stack([track.roll_deg, track.pitch_deg, track.heading_deg])
    np.testing.assert_allclose(attitude, expected[:, 4:7], rtol=1e-14)
    assert track.projected
    assert not track.true_north


def test_columns__in_any_order_with_strangers_between(tmp_path: Path) -> None:
    path = write(
        tmp_path,
        '\ufeff"note" ; heading_deg; sigma_h_m;pitch_deg;roll_deg;h_m;lat_deg;lon_deg;time_unix_s',
        f"hello;10;0.03;2;1;50;36.9;140.0;{T0}",
        f";11;;2;1;50;36.9;140.1;{T0 + 1}",
    )
    reader = PoseCsv([path], ReadOptions())
    assert PoseCsv.recognise(look(path)) == 1.0
    assert reader.inspect().facts["unused_columns"] == ["note"]
    track = reader.poses()
    assert not track.projected
    np.testing.assert_array_equal(track.position, [[140.0, 36.9, 50.0], [140.1, 36.9, 50.0]])
    np.testing.assert_array_equal(track.heading_deg, [10.0, 11.0])
    np.testing.assert_array_equal(track.sigma[:, 2], [0.03, np.nan])
    assert np.isnan(track.sigma[:, [0, 1, 3, 4, 5]]).all()


def test_columns__easting_and_northing_are_preferred_to_longitude_and_latitude(tmp_path: Path) -> None:
    path = write(tmp_path, HEADER + ",lon_deg,lat_deg", *(row + ",139,35" for row in rows()))
    assert poses(path).position[0, 0] == 100.0


@pytest.mark.parametrize(
    ("header", "missing", "nearest"),
    [
        (HEADER.replace("heading_deg", "Heading"), "heading_deg", "Heading"),
        (HEADER.replace("h_m", "Altitude MSL"), "h_m", "Altitude MSL"),
        (HEADER.replace("e_m", "Easting (ft)"), "e_m", "Easting (ft)"),
        (HEADER.replace("time_unix_s", "unix_time_ms"), "time_unix_s", "unix_time_ms"),
        (HEADER.replace("pitch_deg", "pich_deg"), "pitch_deg", "pich_deg"),
    ],
)
def test_columns__a_missing_one_is_named_with_the_nearest(
    header: str, missing: str, nearest: str, tmp_path: Path
) -> None:
    path = write(tmp_path, header, *rows())
    assert PoseCsv.recognise(look(path)) > 0
    error = refusal(path)
    assert error.code == "missing-column"
    assert f"`{missing}`" in error.what
    assert f"`{nearest}`" in error.what


def test_columns__one_named_twice_is_refused(tmp_path: Path) -> None:
    assert refusal(write(tmp_path, HEADER + ",h_m", *(row + ",1" for row in rows()))).code == "column-twice"


def test_times__gps_since_1980_or_of_a_week(tmp_path: Path) -> None:
    header = HEADER.replace("time_unix_s", "time_gps_s")
    gps = float(utc_to_gps_s(T0))
    np.testing.assert_allclose(poses(write(tmp_path, header, *rows(t0=gps))).t_s, T0 + np.arange(5) / 100, atol=1e-6)
    week, second = divmod(gps, 604_800)
    path = write(tmp_path, header, *rows(t0=second))
    for options in ({"week": int(week)}, {"near_s": T0 + 200_000}, {"week": int(week), "time": "gps"}):
        np.testing.assert_allclose(poses(path, **options).t_s, T0 + np.arange(5) / 100, atol=1e-6)
    error = refusal(path)
    assert error.code == "no-gps-week"
    assert "week = N" in error.remedy
    inspection = PoseCsv([path], ReadOptions()).inspect()
    assert inspection.clocks == ()
    assert [notice.code for notice in inspection.notices] == ["no-gps-week"]


def test_times__a_stated_scale_that_the_header_contradicts_is_refused(tmp_path: Path) -> None:
    path = write(tmp_path, HEADER, *rows())
    assert refusal(path, time="gps").code == "time-contradicted"
    assert len(poses(path, time="utc")) == 5


def test_times__milliseconds_are_refused(tmp_path: Path) -> None:
    error = refusal(write(tmp_path, HEADER, *rows(t0=T0 * 1000)))
    assert error.code == "value-out-of-range"
    assert "time_unix_s" in error.what


def test_rows__that_lack_a_number_or_repeat_a_time_are_dropped_and_reported(tmp_path: Path) -> None:
    given_rows = rows(300)
    given_rows[3] = given_rows[3].replace("1.5", "")
    given_rows[5] = given_rows[5].replace("200.5", "inf")
    given_rows[7] = given_rows[6]
    given_rows[9], given_rows[10] = given_rows[10], given_rows[9]
    given_rows.append(given_rows[-1][:20])
    reader = PoseCsv([write(tmp_path, HEADER, *given_rows)], ReadOptions())
    assert len(reader.poses()) == 300 - 4
    texts = {notice.code: notice.text for notice in reader.notices}
    assert "3 of 301 rows" in texts["rows-incomplete"]
    assert texts.keys() == {"rows-incomplete", "poses-repeated", "time-runs-back"}


def test_rows__shuffled_ones_are_refused(tmp_path: Path) -> None:
    path = write(tmp_path, HEADER, *rows(20)[::-1])
    assert refusal(path).code == "time-disorder"
    with pytest.raises(InputError, match="out of time order"):
        PoseCsv([path], ReadOptions()).inspect()


def test_rows__words_instead_of_numbers_are_refused_with_their_line(tmp_path: Path) -> None:
    given_rows = rows()
    given_rows[2] = given_rows[2].replace("200.5", "200,5 m".replace(",", "."))
    error = refusal(write(tmp_path, HEADER, *given_rows))
    assert error.code == "not-a-number"
    assert "line 4: column `n_m` holds '200.5 m'" in error.what


def test_rows__degrees_beyond_reason_are_refused(tmp_path: Path) -> None:
    error = refusal(write(tmp_path, HEADER, *(row.replace("-0.5", "-95") for row in rows())))
    assert error.code == "value-out-of-range"
    assert "pitch_deg" in error.what


@pytest.mark.parametrize("count", [0, 1])
def test_rows__fewer_than_two_are_no_trajectory(count: int, tmp_path: Path) -> None:
    assert refusal(write(tmp_path, HEADER, *rows(count))).code == "no-poses"


def test_files__of_one_trajectory_follow_each_other(tmp_path: Path) -> None:
    a = write(tmp_path, HEADER, *rows(5), name="a.csv")
    b = write(tmp_path, HEADER, *rows(5, T0 + 10), name="b.csv")
    assert len(poses(a, b)) == 10
    other = write(tmp_path, HEADER.replace("e_m,n_m", "lon_deg,lat_deg"), *(r.replace("200.5", "20.5") for r in rows()))
    with pytest.raises(InputError, match="another time scale"):
        poses(a, other)


def test_files__compressed_and_cut(shared_data: Path, tmp_path: Path) -> None:
    packed = gzip.compress((shared_data / "tractor_loop/truth/trajectory.csv").read_bytes())
    path = tmp_path / "trajectory.csv.gz"
    path.write_bytes(packed)
    assert len(poses(path)) == 6141
    path.write_bytes(packed[: len(packed) // 2])
    reader = PoseCsv([path], ReadOptions())
    track = reader.poses()
    assert 1000 < len(track) < 6141
    assert [notice.code for notice in reader.notices] == ["stream-cut"]


@pytest.mark.parametrize(
    "text", ["", "a,b\n1,2\n", "roll,pitch\n1,2\n", HEADER, "x" * 10_000 + "\n1\n", HEADER + "\n\0\n"]
)
def test_recognise__rejects_other_text(text: str, tmp_path: Path) -> None:
    path = tmp_path / "other.csv"
    path.write_text(text or " ")
    assert PoseCsv.recognise(look(path)) == 0.0


@given(st.lists(st.integers(1, 10**6), min_size=2, max_size=30), st.data())
def test_numbers__come_back_as_written(steps: list[int], data: st.DataObject) -> None:
    t_s = T0 + np.cumsum(steps) / 1000
    place = data.draw(st.tuples(*[st.floats(-1e7, 1e7)] * 3))
    values = [[round(axis + data.draw(st.floats(-5, 5)), 4) for axis in place] for _ in steps]
    angles = [[data.draw(st.floats(-89, 89)) for _ in range(3)] for _ in steps]
    lines = [",".join(map(repr, [float(t), *v, *a])) for t, v, a in zip(t_s, values, angles, strict=True)]
    with tempfile.TemporaryDirectory() as folder:
        track = poses(write(Path(folder), HEADER, *lines))
    np.testing.assert_allclose(track.t_s, t_s, rtol=1e-15)
    np.testing.assert_allclose(track.position, values, rtol=1e-15)
    np.testing.assert_allclose(wrap_deg(track.heading_deg - np.array(angles)[:, 2]), 0.0, atol=1e-12)
    assert np.all((track.heading_deg >= 0.0) & (track.heading_deg < 360.0))


@pytest.mark.parametrize("end", [0, 1])
@pytest.mark.parametrize(
    ("column", "low", "high"),
    [
        ("lon_deg", -180.0, 360.0),
        ("lat_deg", -90.0, 90.0),
        ("roll_deg", -180.0, 180.0),
        ("pitch_deg", -90.0, 90.0),
        ("heading_deg", -360.0, 720.0),
    ],
)
def test_rows__an_angle_at_its_limit_is_read_and_beyond_it_is_refused(
    column: str, low: float, high: float, end: int, tmp_path: Path
) -> None:
    names = ["time_unix_s", "lon_deg", "lat_deg", "h_m", "roll_deg", "pitch_deg", "heading_deg"]

    def with_values(*values: float) -> Path:
        cells = [dict(zip(names, (T0 + k, 140.0, 36.9, 50.0, 1.0, 2.0, 3.0), strict=True)) for k in range(3)]
        lines = [",".join(map(repr, (row | {column: v}).values())) for row, v in zip(cells, values, strict=True)]
        return write(tmp_path, ",".join(names), *lines)

    limit = (low, high)[end]
    track = poses(with_values(limit, limit, limit))
    read = np.column_stack([track.position, track.roll_deg, track.pitch_deg, track.heading_deg])
    assert wrap_deg(read[:, names.index(column) - 1] - limit).tolist() == [0.0, 0.0, 0.0]
    error = refusal(with_values(limit, limit * (1.0 + 1e-9), limit))
    assert error.code == "value-out-of-range"
    assert "pose 2" in error.what
    assert f"`{column}`" in error.what
    assert f"{low:g} to {high:g}" in error.lines[1]


@pytest.mark.parametrize(
    ("first", "last"),
    [("1980-01-06T00:00:00Z", "1980-01-06T00:00:01Z"), ("2099-12-31T23:59:59Z", "2100-01-01T00:00:00Z")],
)
def test_times__from_the_first_day_of_gps_to_the_end_of_the_century(first: str, last: str, tmp_path: Path) -> None:
    begin_s, end_s = (datetime.fromisoformat(text).timestamp() for text in (first, last))
    assert len(poses(write(tmp_path, HEADER, *rows(1, begin_s), *rows(1, end_s)))) == 2
    beyond = (begin_s - 1.0, begin_s) if begin_s < 1e9 else (end_s, end_s + 1.0)
    error = refusal(write(tmp_path, HEADER, *(row for at in beyond for row in rows(1, at))))
    assert (error.code, "`time_unix_s`" in error.what) == ("value-out-of-range", True)


def test_inspect__tells_the_place_and_the_clock(tmp_path: Path) -> None:
    """Of a file with easting and northing and, besides, a longitude and latitude on the Earth."""
    for lon, lat, is_place in (("139.5", "-90", True), ("-180", "35", True), ("360", "90", True), ("361", "35", False),
                               ("139", "90.1", False), ("x", "35", False)):  # fmt: skip
        path = write(tmp_path, HEADER + ",lon_deg,lat_deg", *(f"{row},{lon},{lat}" for row in rows()))
        found = PoseCsv([path], ReadOptions()).inspect()
        assert found.facts.get("place") == ({"lat_deg": float(lat), "lon_deg": float(lon)} if is_place else None)
    (clock,) = found.clocks
    assert (clock.clock, clock.note) == (Clock.STATED, "from its column `time_unix_s`")
    assert (clock.first_s, clock.last_s) == pytest.approx((T0, T0 + 0.04), abs=1e-4)
    assert (found.path, found.format) == (path, "pose-csv")


@pytest.mark.parametrize(
    ("names", "certainty"),
    [
        ("time_unix_s,roll_deg,lon_deg", 1.0),
        ("time_unix_s,roll_deg", 0.6),
        ("roll_deg,pitch_deg,heading_deg", 0.6),
        ("roll_deg,pitch_deg", 0.0),
        ("a,b,c,d,Roll,Pitch", 0.2),
        ("a,b,c,Roll,Pitch", 0.0),
        ("a,b,c,d,e,Roll", 0.0),
        ("a,b,c,d,e,Pitch", 0.0),
    ],
)
def test_recognise__by_the_names_of_columns(names: str, certainty: float, tmp_path: Path) -> None:
    path = write(tmp_path, names, ",".join("1" for _ in names.split(",")))
    assert PoseCsv.recognise(look(path)) == certainty


@pytest.mark.parametrize(("late", "is_read"), [(2, True), (3, False)])
def test_rows__one_in_a_hundred_may_run_back(late: int, is_read: bool, tmp_path: Path) -> None:
    many = rows(200 - late)
    path = write(tmp_path, HEADER, *many[:100], *many[50 : 50 + late], *many[100:])
    if is_read:
        assert len(poses(path)) == 200 - late
    else:
        assert f"{late} of 200 poses are out of time order, the first is pose 101" in refusal(path).what
