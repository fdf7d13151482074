"""Solutions of RTKLIB and its kin: what the samples hold, all styles of writing, and damage."""

from __future__ import annotations

import datetime as dt
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from pyproj import Geod

from furrowmap.core.readers.nmea.log import NmeaLog
from furrowmap.core.readers.reader import ReadOptions, Recognised
from furrowmap.core.readers.rtklib.pos import PosHeader, RtklibPos
from furrowmap.core.readers.source import look
from furrowmap.core.runtime.errors import InputError
from furrowmap.core.values.gnss import Fix, GnssTrack

# As the samples' README lists them; times are GPS time there, 18 s ahead of these.
HELD: dict[str, tuple[dict[str, int], str, str, str]] = {
    "car_reference/rover_rtk.pos": (
        {"fixed": 1799, "float": 3596}, "2023-07-11T06:04:12.000Z", "2023-07-11T06:24:42.000Z", "rtk",
    ),
    "car_reference/rover_1Hz_rtk.pos": (
        {"fixed": 142, "float": 389}, "2023-07-11T06:04:14.000Z", "2023-07-11T06:24:42.000Z", "rtk",
    ),
    "car_reference/rover_1Hz_spp.pos": ({"single": 550}, "2023-07-11T06:04:12.000Z", "2023-07-11T06:24:42.000Z", ""),
    "car_reference/reference_1Hz.pos": ({"fixed": 1231}, "2023-07-11T06:04:12.000Z", "2023-07-11T06:24:42.000Z", ""),
    "clas/clas_static.pos": ({"single": 19, "fixed": 581}, "2021-03-19T11:59:42.000Z", "2021-03-19T12:09:41.000Z",
                             "clas"),
    "clas/clas_kinematic.pos": ({"single": 19, "fixed": 881}, "2021-03-19T11:59:42.000Z", "2021-03-19T12:14:41.000Z",
                                "clas"),
    "pos/static_rtk.pos": ({"fixed": 301}, "2024-06-24T08:19:42.000Z", "2024-06-24T08:24:42.000Z", "rtk"),
    "pos/car_f9p_demo5_calendar.pos": (
        {"fixed": 4449, "float": 72}, "2020-12-24T21:28:24.000Z", "2020-12-24T22:43:44.000Z", "rtk",
    ),
    "pos/car_f9p_rtklibpy_weektow.pos": (
        {"fixed": 1649, "float": 2872}, "2020-12-24T21:28:24.000Z", "2020-12-24T22:43:44.000Z", "",
    ),
}  # fmt: skip

HEAD = "%  {scale:<21}  latitude(deg) longitude(deg)  height(m)   Q  ns   sdn(m)   sde(m)   sdu(m)\n"


def track_of(path: Path) -> GnssTrack:
    return RtklibPos([path], ReadOptions()).track()


def written(folder: Path, text: str) -> Path:
    path = folder / "solution.pos"
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.parametrize("name", HELD)
def test_inspect__reports_the_content_of_the_sample(name: str, shared_data: Path) -> None:
    fixes, first, last, service = HELD[name]
    path = shared_data / "gnss" / name
    facts = Recognised.by_content(path).inspect().facts
    assert facts["epochs_by_fix"] == fixes
    assert (facts["first"], facts["last"]) == (first, last)
    assert facts["lines_damaged"] == 0
    assert track_of(path).service == service


@pytest.mark.parametrize(
    ("program", "mode", "service"),
    [
        ("RTKLIB ver.2.4.2", "ppp-rtk", "ppp-rtk"),  # as CLASLIB heads its files
        ("CLASLIB ver.0.8.2", "ppp-rtk", "clas"),
        ("MADOCALIB ver.2.0", "ppp-kinematic", "madoca"),
        ("RTKLIB ver.2.4.3 b34", "ppp-static", "ppp"),
        ("RTKLIB ver.2.4.3 b34", "kinematic", "rtk"),
        ("RTKLIB ver.2.4.3 b34", "single", ""),
    ],
)
def test_track__whose_corrections_by_the_processors_words(
    tmp_path: Path, program: str, mode: str, service: str
) -> None:
    """The quality is that of RTKLIB's numbers in all of them."""
    head = f"% program   : {program}\n% pos mode  : {mode}\n" + HEAD.format(scale="GPST")
    rows = "".join(
        f"2026/06/11 00:00:{q:02d}.000  36.100000000 140.100000000 60.0000 {q} 11 0.01 0.01 0.02\n" for q in range(1, 7)
    )
    track = track_of(written(tmp_path, head + rows))
    assert track.service == service
    assert track.fix.tolist() == [Fix.FIXED, Fix.FLOAT, Fix.DGPS, Fix.DGPS, Fix.SINGLE, Fix.PPP]


def test_header__words_are_kept_to_200_characters(tmp_path: Path) -> None:
    """A comment may be as long as a file."""
    words = "x" * 199 + "yz"
    head = f"% program   : {words}\n% pos mode  : {words}\n"
    form = PosHeader()
    for line in head.splitlines():
        form.read_comment(line)
    assert form.program == form.mode == words[:200]


def test_track__is_what_pandas_reads(shared_data: Path) -> None:
    path = shared_data / "gnss/car_reference/rover_1Hz_rtk.pos"
    table = pd.read_csv(path, sep=r"\s+", comment="%", header=None)
    track = track_of(path)
    np.testing.assert_array_equal(track.lat_deg, table[2])
    np.testing.assert_array_equal(track.lon_deg, table[3])
    np.testing.assert_array_equal(track.height_m, table[4])
    np.testing.assert_array_equal(track.sigma_n_m, table[7])
    np.testing.assert_array_equal(track.sigma_e_m, table[8])
    np.testing.assert_array_equal(track.sigma_h_m, table[9])
    np.testing.assert_array_equal(track.age_s, table[13])
    np.testing.assert_allclose(track.speed_mps, np.hypot(table[15], table[16]))
    stamps = (table[0] + " " + table[1]).tolist()
    gps = [dt.datetime.strptime(s, "%Y/%m/%d %H:%M:%S.%f").replace(tzinfo=dt.UTC).timestamp() for s in stamps]
    np.testing.assert_allclose(track.t_s, np.array(gps) - 18.0, atol=1e-6)


def test_both_time_styles__give_one_drive(shared_data: Path) -> None:
    """Two processors' solutions of the same drive, of which the README holds the differences."""
    calendar = track_of(shared_data / "gnss/pos/car_f9p_demo5_calendar.pos")
    week = track_of(shared_data / "gnss/pos/car_f9p_rtklibpy_weektow.pos")
    np.testing.assert_allclose(calendar.t_s, week.t_s, atol=2e-3)
    apart_m = Geod(ellps="WGS84").inv(calendar.lon_deg, calendar.lat_deg, week.lon_deg, week.lat_deg)[2]
    assert (np.median(apart_m), np.quantile(apart_m, 0.95)) == pytest.approx((0.082, 0.363), abs=1e-3)
    fixed = (calendar.fix == Fix.FIXED) & (week.fix == Fix.FIXED)
    assert int(fixed.sum()) == 1649
    assert (np.median(apart_m[fixed]), np.quantile(apart_m[fixed], 0.95)) == pytest.approx((0.012, 0.028), abs=6e-4)


def test_pos_and_nmea_of_clas__are_the_same_positions(shared_data: Path) -> None:
    pos = track_of(shared_data / "gnss/clas/clas_static.pos")
    nmea = NmeaLog([shared_data / "gnss/clas/clas_static.nmea"], ReadOptions(date="2021-03-19")).track()
    np.testing.assert_allclose(pos.t_s, nmea.t_s, atol=1e-6)
    np.testing.assert_array_equal(pos.fix, nmea.fix)
    np.testing.assert_allclose(pos.lat_deg, nmea.lat_deg, atol=2e-9)
    assert np.isnan(pos.sigma_e_m).all()
    assert set(pos.satellites.tolist()) == {-1}


@pytest.mark.parametrize(
    ("scale", "time", "utc"),
    [
        ("GPST", "2026/06/11 01:23:45.600", "2026-06-11T01:23:27.600"),
        ("UTC", "2026/06/11 01:23:45.600", "2026-06-11T01:23:45.600"),
        ("JST", "2026/06/11 01:23:45.600", "2026-06-10T16:23:45.600"),
        ("GPST", "2422 350625.600", "2026-06-11T01:23:27.600"),
    ],
)
@pytest.mark.parametrize("between", ["  ", ",", "\t", " ; "])
def test_styles(scale: str, time: str, utc: str, between: str, tmp_path: Path) -> None:
    row = between.join([*time.split(" "), "36.1", "140.2", "55.5", "6", "12", "0.01", "0.02", "0.03"])
    track = track_of(written(tmp_path, HEAD.format(scale=scale) + row + "\n"))
    assert track.t_s[0] == pytest.approx(dt.datetime.fromisoformat(utc + "+00:00").timestamp(), abs=1e-6)
    assert (track.lat_deg[0], track.lon_deg[0], track.height_m[0]) == (36.1, 140.2, 55.5)
    assert (track.sigma_n_m[0], track.sigma_e_m[0], track.sigma_h_m[0]) == (0.01, 0.02, 0.03)
    assert (track.fix[0], track.satellites[0]) == (Fix.PPP, 12)


def test_sexagesimal_and_cartesian__are_the_same_place(tmp_path: Path) -> None:
    head = "%  GPST latitude(d'\") longitude(d'\") height(m) Q ns\n"
    row = "2026/06/11 01:00:00.0  -36 30 36.0  -140 15 18.0  55.5  1 10 0.01 0.02 0.03\n"
    angles = track_of(written(tmp_path, head + row))
    assert (angles.lat_deg[0], angles.lon_deg[0]) == pytest.approx((-36.51, -140.255))
    head = "%  GPST x-ecef(m) y-ecef(m) z-ecef(m) Q ns sdx(m) sdy(m) sdz(m) sdxy(m) sdyz(m) sdzx(m) age(s) ratio\n"
    row = "2026/06/11 01:00:00.0 -3962108.673 3381309.574 3668678.638 1 10 0.1 0.1 0.1 0 0 0 1.0 9\n"
    cartesian = track_of(written(tmp_path, head + row))
    # The published place of the antenna of the samples of CLAS.
    assert (cartesian.lat_deg[0], cartesian.lon_deg[0]) == pytest.approx((35.339325776, 139.522173128), abs=2e-9)
    assert cartesian.height_m[0] == pytest.approx(65.712, abs=1e-3)
    # A sphere of errors is one however it is turned.
    assert (cartesian.sigma_e_m[0], cartesian.sigma_n_m[0], cartesian.sigma_h_m[0]) == pytest.approx((0.1, 0.1, 0.1))


def test_what_is_not_certain__is_reported_or_refused(tmp_path: Path) -> None:
    row = "2026/06/11 01:00:0{}.0 36.1 140.2 55.5 1 10 0.01 0.02 0.03\n"
    rows = "".join(row.format(k) for k in range(5))
    log = RtklibPos([written(tmp_path, rows)], ReadOptions())
    assert len(log.track()) == 5
    assert [notice.code for notice in log.notices] == ["time-scale-assumed"]
    geodetic = "% (lat/lon/height=WGS84/geodetic,Q=1:fix)\n" + HEAD.format(scale="GPST") + rows
    log = RtklibPos([written(tmp_path, geodetic)], ReadOptions())
    assert np.isnan(log.track().height_m).all()
    assert [notice.code for notice in log.notices] == ["no-ellipsoidal-height"]
    with pytest.raises(InputError) as error:
        track_of(written(tmp_path, "%  GPST  e-baseline(m)  n-baseline(m)  u-baseline(m) Q ns\n" + rows))
    assert error.value.code == "pos-baseline"
    with pytest.raises(InputError) as error:
        track_of(written(tmp_path, HEAD.format(scale="GPST")))
    assert error.value.code == "no-positions"


def test_backward_solutions__are_turned_round(shared_data: Path, tmp_path: Path) -> None:
    path = shared_data / "gnss/pos/static_rtk.pos"
    lines = path.read_text().splitlines()
    head, rows = [s for s in lines if s.startswith("%")], [s for s in lines if not s.startswith("%")]
    backward = track_of(written(tmp_path, "\n".join(head + rows[::-1])))
    np.testing.assert_array_equal(backward.lat_deg, track_of(path).lat_deg)


def test_two_solutions_in_one_file__are_refused(shared_data: Path, tmp_path: Path) -> None:
    one = (shared_data / "gnss/pos/static_rtk.pos").read_text().splitlines()
    rows = [s for s in one if not s.startswith("%")]
    mixed = [s for row in rows for s in (row, row.replace("35.1346", "35.1347"))]
    with pytest.raises(InputError) as error:
        track_of(written(tmp_path, HEAD.format(scale="GPST") + "\n".join(mixed)))
    assert error.value.code == "receivers-interleaved"


def test_damaged_lines__are_counted_and_the_others_read(shared_data: Path, tmp_path: Path) -> None:
    lines = (shared_data / "gnss/pos/static_rtk.pos").read_text().splitlines()
    first = next(k for k, line in enumerate(lines) if not line.startswith("%"))
    lines[first + 3] = lines[first + 3][:40]
    lines[first + 5] = lines[first + 5].replace("2024/06/24", "2024/06/99")
    lines[first + 7] = lines[first + 7].replace("35.13", "35.1x")
    lines[first + 9] = "x" * 100_000
    log = RtklibPos([written(tmp_path, "\n".join(lines))], ReadOptions())
    facts = log.inspect().facts
    assert (facts["epochs"], facts["lines_damaged"], facts["epochs_without_position"]) == (297, 3, 1)
    assert "lines-damaged" in {notice.code for notice in log.notices}


@given(
    lat=st.integers(-89_999_999_999, 89_999_999_999), lon=st.integers(-179_999_999_999, 179_999_999_999),
    tow_ms=st.integers(0, 604_799_999), height_mm=st.integers(-400_000, 9_000_000), quality=st.integers(1, 7),
)  # fmt: skip
def test_numbers_come_back(
    lat: int, lon: int, tow_ms: int, height_mm: int, quality: int, tmp_path_factory: pytest.TempPathFactory
) -> None:
    assume(max(abs(lat), abs(lon)) > 10**6)  # 0, 0 stands for no position
    row = f"2422 {tow_ms / 1000:.3f} {lat / 1e9:.9f} {lon / 1e9:.9f} {height_mm / 1e3:.3f} {quality} 9 1 2 3\n"
    track = track_of(written(tmp_path_factory.mktemp("pos"), HEAD.format(scale="GPST") + row))
    assert track.lat_deg[0] == float(f"{lat / 1e9:.9f}")
    assert track.lon_deg[0] == float(f"{lon / 1e9:.9f}")
    assert track.height_m[0] == float(f"{height_mm / 1e3:.3f}")
    assert track.t_s[0] == pytest.approx(315_964_800 + 2422 * 604_800 + tow_ms / 1000 - 18, abs=1e-6)


@pytest.mark.parametrize(
    ("quality", "satellites", "fix", "count"),
    [
        ("1", "1", Fix.FIXED, 1),
        ("7", "999", Fix.ESTIMATED, 999),
        ("8", "9", None, 9),
        ("0", "9", None, 9),
        ("-1", "9", None, 9),
        ("5", "0", Fix.SINGLE, -1),
        ("5", "1000", Fix.SINGLE, -1),
    ],
)
def test_quality_and_satellites__beyond_their_ranges_are_unknown(
    quality: str, satellites: str, fix: Fix | None, count: int, tmp_path: Path
) -> None:
    row = "2026/06/11 01:00:0{}.0  36.1 140.1 60.0 {} {} 0.01 0.02 0.03\n"
    text = HEAD.format(scale="GPST") + row.format(1, quality, satellites) + row.format(2, 2, 30)
    track = track_of(written(tmp_path, text))
    found = [fix for fix in track.fix.tolist() if fix != Fix.NONE]
    assert found == [one for one in (fix, Fix.FLOAT) if one is not None]
    if fix is not None:
        assert track.satellites.tolist() == [count, 30]


@pytest.mark.parametrize(
    ("time", "is_time"),
    [
        ("2026/06/11 23:59:59.999", True),
        ("2026/12/31 23:59:60.999", True),
        ("2026/06/11 24:00:00.000", False),
        ("2026/06/11 23:60:00.000", False),
        ("2026/06/11 23:59:61.000", False),
        ("2026/06/31 12:00:00.000", False),
    ],
)
def test_times__are_on_the_clock_and_in_the_calendar(time: str, is_time: bool, tmp_path: Path) -> None:
    rows = "".join(f"{one}  36.1 140.1 60.0 1 9 0.01 0.02 0.03\n" for one in ("2026/06/11 01:00:00.0", time))
    facts = RtklibPos([written(tmp_path, HEAD.format(scale="UTC") + rows)], ReadOptions()).inspect().facts
    assert (facts["epochs"], facts["epochs_without_position"]) == ((2, 0) if is_time else (1, 1))


def test_sigmas_and_ages__of_zero_are_not_stated(tmp_path: Path) -> None:
    row = "2026/06/11 01:00:0{}.0 36.1 140.1 60.0 1 9 {} 0 0 0 {} 3.0 0.3 -0.4 0\n"
    text = HEAD.format(scale="GPST") + row.format(1, "0 0.02 0.03", 0) + row.format(2, "0.01 0 0", 0)
    track = track_of(written(tmp_path, text))
    np.testing.assert_array_equal(track.sigma_n_m, [np.nan, 0.01])
    np.testing.assert_array_equal(track.sigma_e_m, [0.02, np.nan])
    np.testing.assert_array_equal(track.sigma_h_m, [0.03, np.nan])
    assert np.isnan(track.age_s).all()
    assert track.speed_mps.tolist() == [0.5, 0.5]
    assert track.course_deg == pytest.approx(np.degrees(np.arctan2(-0.4, 0.3)) % 360.0)
    text += row.format(3, "1 1 1", 1.5)
    assert track_of(written(tmp_path, text)).age_s.tolist() == [0.0, 0.0, 1.5]


@pytest.mark.parametrize(
    ("lines", "certainty"),
    [
        ([HEAD.format(scale="GPST").strip()], 0.95),
        (["% program : RTKLIB", "row", "row", "cut"], 0.7),
        (["row", "row", "cut"], 0.7),
        (["row", "cut"], 0.0),
        (["row", "row", "row", "row", "x", "cut"], 0.7),
        (["row", "row", "row", "x", "cut"], 0.0),
        (["row", "row", "", "", "cut"], 0.7),
        (["x", "y", "cut"], 0.0),
        ([HEAD.format(scale="GPST").strip() + "\0"], 0.0),
    ],
)
def test_recognise__by_the_header_or_four_of_five_of_the_first_rows(
    lines: list[str], certainty: float, tmp_path: Path
) -> None:
    """The last line may be cut."""
    rows = ("2422 350625.6 36.1 140.2 55.5 6 12 0.01 0.02 0.03" if line == "row" else line for line in lines)
    assert RtklibPos.recognise(look(written(tmp_path, "\n".join(rows)))) == certainty
