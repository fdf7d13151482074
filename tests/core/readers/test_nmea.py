"""NMEA logs: what the samples hold, agreement with pynmeagps, and laws of the byte scan."""

from __future__ import annotations

import datetime as dt
import functools
import gzip
import lzma
import operator
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pynmeagps
import pytest
from hypothesis import given
from hypothesis import strategies as st

from furrowmap.core.readers.nmea.log import NmeaLog
from furrowmap.core.readers.nmea.sentences import Kind, SentenceCounts, Sentences, scan_bytes
from furrowmap.core.readers.reader import ReadOptions
from furrowmap.core.readers.source import look, zstd
from furrowmap.core.runtime.errors import InputError
from furrowmap.core.values.gnss import Fix, GnssTrack
from furrowmap.core.values.scan import Clock


def sentence(body: str) -> bytes:
    return f"${body}*{functools.reduce(operator.xor, body.encode(), 0):02X}\r\n".encode()


def gga(
    tod: str, lat_min: float = 30.0, *, quality: int = 4, talker: str = "GN", tail: str = "100.0,M,40.0,M,,"
) -> bytes:
    return sentence(f"{talker}GGA,{tod},35{lat_min:09.6f},N,13900.000000,E,{quality},12,0.8,{tail}")


def rmc(tod: str, date: str, status: str = "A", speed: str = "1.0", course: str = "90.0") -> bytes:
    return sentence(f"GNRMC,{tod},{status},3530.000000,N,13900.000000,E,{speed},{course},{date},,,A")


def write(folder: Path, *parts: bytes, name: str = "log.nmea") -> Path:
    path = folder / name
    path.write_bytes(b"".join(parts))
    return path


def track_of(path: Path, **options: Any) -> GnssTrack:
    return NmeaLog([path], ReadOptions(**options)).track()


def utc(text: str) -> float:
    return dt.datetime.fromisoformat(text).replace(tzinfo=dt.UTC).timestamp()


def codes(reader: NmeaLog) -> set[str]:
    return {notice.code for notice in reader.notices}


# As the samples' README lists them: GGA sentences, positions by kind of fix, first and last time, path in metres.
# Where two counts are given for GGA, the README's is the first: it reads line by line, and the others stand behind a
# sentence that breaks off in the same line, each with a right checksum of its own.
HELD: dict[str, tuple[int | tuple[int, int], dict[str, int], str, str, float | None]] = {
    "gnss/walk_f9p/walk.nmea": (
        3902, {"single": 1774, "dgps": 2128}, "2025-09-09T18:58:41.900Z", "2025-09-09T19:05:13.750Z", 2364,
    ),
    "gnss/walk_f9p/walk_raw_mixed.log": (
        3902, {"single": 1774, "dgps": 2128}, "2025-09-09T18:58:41.900Z", "2025-09-09T19:05:13.750Z", 2364,
    ),
    "gnss/car_reference/derived_rover_rtk.nmea": (
        5395, {"fixed": 1799, "float": 3596}, "2023-07-11T06:04:12.000Z", "2023-07-11T06:24:42.000Z", None,
    ),
    "gnss/clas/clas_static.nmea": (600, {"single": 19, "fixed": 581}, "11:59:42.000", "12:09:41.000", None),
    "gnss/clas/clas_kinematic.nmea": (900, {"single": 19, "fixed": 881}, "11:59:42.000", "12:14:41.000", None),
    "gnss/nmea/drone_rtk_fixed_10hz.nmea": (1851, {"fixed": 1837, "float": 14}, "12:08:02.800", "12:12:47.400", 2400),
    "gnss/nmea/drone_farm_rtk_fix_float.nmea": (
        2133, {"fixed": 1586, "float": 535, "dgps": 12}, "16:05:31.400", "16:10:38.800", 3080,
    ),
    "gnss/nmea/car_10hz.nmea": ((1678, 1684), {"single": 1667}, "15:43:13.900", "15:47:20.300", 2300),
    "gnss/nmea/car_10hz_dgps_mix.nmea": (817, {"single": 610, "dgps": 206}, "15:08:57.800", "15:10:42.700", 552),
    "gnss/nmea/trimble_rtk_10hz.nmea": (
        122, {"dgps": 104, "fixed": 18}, "2020-03-18T13:28:19.600Z", "2020-03-18T13:39:01.500Z", 16,
    ),
    "gnss/nmea/skytraq_dgps_gst_1hz.nmea": (
        96, {"dgps": 96}, "2016-04-07T21:31:21.000Z", "2016-04-07T21:32:56.000Z", 3,
    ),
    "gnss/nmea/derived_noisy_skytraq.nmea": (
        87, {"dgps": 87}, "2016-04-07T21:31:21.000Z", "2016-04-07T21:32:56.000Z", 3,
    ),
    "gnss/nmea/derived_crosses_midnight.nmea": (
        96, {"dgps": 96}, "2016-04-07T23:59:12.000Z", "2016-04-08T00:00:47.000Z", 3,
    ),
    "gnss/nmea/f9p_4gnss_1hz.nmea": (29, {"single": 29}, "2019-04-12T00:39:56.000Z", "2019-04-12T00:40:24.000Z", None),
    "gnss/nmea/f9p_highprec_1hz.nmea": (9, {"dgps": 9}, "2021-12-23T01:45:00.000Z", "2021-12-23T01:45:08.000Z", None),
    "gnss/nmea/f9p_nmea_in_binary.log": (
        655, {"single": 655}, "2019-04-12T01:19:03.000Z", "2019-04-12T01:29:57.000Z", None,
    ),
    "gnss/nmea/um621_loses_fix.nmea": (
        20, {"single": 16}, "2024-06-09T00:06:53.000Z", "2024-06-09T00:07:12.000Z", None,
    ),
    # 187 positions, of which the second is 0.3 s earlier than the first.
    "gnss/nmea/he910_cold_start.nmea": (
        224, {"single": 186}, "2019-03-12T10:51:53.710Z", "2019-03-12T10:54:59.408Z", None,
    ),
    "gnss/nmea/clock_jump_at_first_fix.nmea": (
        11, {"single": 4}, "2008-08-23T08:14:36.000Z", "2008-08-23T08:14:39.000Z", None,
    ),
    "gnss/nmea/hemisphere_heading.nmea": (
        215, {"single": 21}, "2018-09-07T19:40:50.000Z", "2018-09-07T19:41:00.000Z", None,
    ),
    "gnss/nmea/lc79d_multignss.nmea": (
        29, {"single": 29}, "2020-11-30T08:03:59.000Z", "2020-11-30T08:04:27.000Z", None,
    ),
    "gnss/nmea/septentrio_polarx2_gst.nmea": (
        5, {"single": 5}, "2012-03-22T11:22:57.000Z", "2012-03-22T11:23:01.000Z", None,
    ),
    "gnss/nmea/bad_checksum_one.nmea": (1, {"single": 1}, "2022-01-20T11:59:34.000Z", "2022-01-20T11:59:34.000Z", None),
    "gnss/nmea/bad_header.nmea": (1, {"single": 1}, "2021-03-07T10:29:29.000Z", "2021-03-07T10:29:29.000Z", None),
    # The receiver GL of three; by its talker 723 lines, and 37 more sentences behind broken ones.
    "gnss/nmea/three_receivers_interleaved_gl_gn_ga.nmea": (
        (723 + 670 + 651, 760 + 690 + 680), {"single": 571, "dgps": 189}, "18:34:16.700", "18:36:56.500", 140,
    ),
    "tractor_loop/gnss.nmea": (605, {"fixed": 605}, "2026-06-11T01:23:40.300Z", "2026-06-11T01:24:40.700Z", None),
    "tractor_fishtail/gnss.nmea": (
        581, {"fixed": 521, "float": 60}, "2026-06-11T01:59:34.200Z", "2026-06-11T02:00:37.200Z", None,
    ),
    "rover_real/gnss.nmea": (1437, {"fixed": 1437}, "2025-12-24T09:02:47.600Z", "2025-12-24T09:05:28.700Z", None),
}  # fmt: skip


@pytest.mark.parametrize("name", HELD)
def test_inspect__reports_the_content_of_the_sample(name: str, shared_data: Path) -> None:
    count, fixes, first, last, path_m = HELD[name]
    path = shared_data / name
    assert NmeaLog.recognise(look(path)) > 0.5
    inspection = NmeaLog([path], ReadOptions()).inspect()
    facts = inspection.facts
    by_line, intact = count if isinstance(count, tuple) else (count, count)
    assert facts["sentences"]["GGA"] == intact
    assert 0 <= intact - by_line <= facts["begun_in_mid_line"] + 5
    assert facts["epochs_by_fix"] == fixes
    assert facts["epochs"] == sum(fixes.values())
    assert facts["first"].removesuffix(" (no date)") == first
    assert facts["last"].removesuffix(" (no date)") == last
    assert [clock.clock for clock in inspection.clocks] == ([] if " (no date)" in facts["first"] else [Clock.GNSS])
    assert any(notice.code == "no-date" for notice in inspection.notices) == (" (no date)" in facts["first"])
    if path_m is not None:
        assert facts["distance_m"] == pytest.approx(path_m, abs=max(0.6, 0.003 * path_m))


def inspected(shared_data: Path, name: str) -> tuple[dict[str, Any], dict[str, str]]:
    inspection = NmeaLog([shared_data / "gnss" / name], ReadOptions()).inspect()
    return inspection.facts, {notice.code: notice.text for notice in inspection.notices}


def test_inspect__counts_types_talkers_and_damage(shared_data: Path) -> None:
    facts, notices = inspected(shared_data, "nmea/derived_noisy_skytraq.nmea")
    assert (facts["intact"], facts["bad_checksums"], facts["cut_or_without_checksum"]) == (892, 60, 38 + 34)
    assert "60" in notices["sentences-damaged"]
    assert "72" in notices["sentences-damaged"]
    facts, _ = inspected(shared_data, "nmea/skytraq_dgps_gst_1hz.nmea")
    assert {kind: facts["sentences"][kind] for kind in ("GGA", "GLL", "RMC", "VTG", "ZDA", "GST")} == dict.fromkeys(
        ("GGA", "GLL", "RMC", "VTG", "ZDA", "GST"), 96
    )
    assert set(facts["talkers"]) == {"GP", "BD", "proprietary"}
    assert facts["gps_minus_utc_s"] == 17
    for name in ("nmea/bad_checksum_one.nmea", "nmea/bad_header.nmea"):
        assert inspected(shared_data, name)[0]["bad_checksums"] == 1


def test_inspect__reports_gaps_rate_speed_and_place(shared_data: Path) -> None:
    facts, notices = inspected(shared_data, "car_reference/derived_rover_rtk.nmea")
    assert facts["rate_hz"] == 5.0
    assert facts["gaps"]["count"] == 20
    assert "position-jumps" in notices
    facts, notices = inspected(shared_data, "walk_f9p/walk.nmea")
    assert facts["speed_max_mps"] == pytest.approx(33.87 * 1852 / 3600, abs=0.01)
    assert facts["place"] == {"lat_deg": pytest.approx(39.1949, abs=1e-4), "lon_deg": pytest.approx(-77.2585, abs=1e-4)}
    assert facts["sentences"]["RMC"] == 4122
    assert facts["sentences"]["VTG"] == 4118
    assert "position-jumps" not in notices
    facts, _ = inspected(shared_data, "nmea/car_10hz.nmea")
    assert facts["epochs_without_position"] == 17


def test_inspect__reports_what_else_is_in_the_file(shared_data: Path) -> None:
    facts, notices = inspected(shared_data, "nmea/f9p_nmea_in_binary.log")
    assert facts["other_bytes"] == pytest.approx(1_095_124, abs=10)
    assert "88 %" in notices["bytes-skipped"]
    assert {kind: facts["sentences"][kind] for kind in ("GGA", "RMC", "VTG", "GLL")} == dict.fromkeys(
        ("GGA", "RMC", "VTG", "GLL"), 655
    )


def test_inspect__missing_separation_means_no_ellipsoidal_height(shared_data: Path) -> None:
    facts, notices = inspected(shared_data, "nmea/lc79d_multignss.nmea")
    assert "no-ellipsoidal-height" in notices
    assert "height_m" not in facts


def test_inspect__invalid_times_before_the_first_fix_are_reported(shared_data: Path) -> None:
    facts, notices = inspected(shared_data, "nmea/clock_jump_at_first_fix.nmea")
    assert facts["epochs_without_position"] == 7
    assert "23:59:" in notices["clock-set-at-first-fix"]


def test_inspect__time_running_back_is_dropped_and_counted(shared_data: Path) -> None:
    facts, notices = inspected(shared_data, "nmea/he910_cold_start.nmea")
    assert facts["positions_by_talker"] == {"GP": 187}
    assert facts["epochs_dropped"] == 1
    assert "time-runs-back" in notices


def test_track__receivers_with_talkers_of_their_own_are_separated(shared_data: Path) -> None:
    path = shared_data / "gnss/nmea/three_receivers_interleaved_gl_gn_ga.nmea"
    reader = NmeaLog([path], ReadOptions(date="2025-09-09"))
    track = reader.track()
    assert len(track) == 760
    text = next(notice.text for notice in reader.notices if notice.code == "several-receivers")
    assert "Those of GL (760 positions) are used, those of GA (680 positions), GN (690 positions) are not" in text


def test_track__one_receiver_that_changes_its_talker_is_one(shared_data: Path) -> None:
    reader = NmeaLog([shared_data / "gnss/nmea/trimble_rtk_10hz.nmea"], ReadOptions())
    assert len(reader.track()) == 122
    assert "several-receivers" not in codes(reader)


def test_track__receivers_under_one_talker_are_refused(shared_data: Path) -> None:
    path = shared_data / "gnss/nmea/two_receivers_same_talker_interleaved.nmea"
    with pytest.raises(InputError) as error:
        track_of(path, date="2025-09-09")
    assert error.value.code == "receivers-interleaved"
    assert "byte 180" in error.value.what
    facts, notices = inspected(shared_data, "nmea/two_receivers_same_talker_interleaved.nmea")
    assert facts["positions_by_talker"] == {"GN": 4755}
    assert "receivers-interleaved" in notices


def test_track__receivers_that_share_talker_and_times_are_distinguished_from_parts_in_the_wrong_order(
    tmp_path: Path,
) -> None:
    both = (gga(f"1200{k // 2:02d}.00", 30 + k / 1e4 + k % 2) for k in range(80))
    with pytest.raises(InputError) as error:
        track_of(write(tmp_path, *both), date="2026-06-11")
    assert error.value.code == "receivers-interleaved"
    assert "different talkers are sufficient" in error.value.remedy


@pytest.mark.parametrize(
    "name",
    [
        "gnss/walk_f9p/walk.nmea",
        "gnss/nmea/skytraq_dgps_gst_1hz.nmea",
        "gnss/nmea/f9p_4gnss_1hz.nmea",
        "gnss/nmea/hemisphere_heading.nmea",
        "gnss/nmea/um621_loses_fix.nmea",
        "tractor_fishtail/gnss.nmea",
        "rover_real/gnss.nmea",
    ],
)
def test_sentences__agree_with_pynmeagps(name: str, shared_data: Path) -> None:
    """Every number of every GGA, RMC, GST, VTG, HDT and ZDA, read by another library."""
    path = shared_data / name
    counts = SentenceCounts()
    ours, _ = scan_bytes(path.read_bytes(), counts)
    with path.open("rb") as stream:
        quiet = pynmeagps.NMEAReader(stream, quitonerror=pynmeagps.ERR_IGNORE, nmeaonly=False)
        theirs = [m for _, m in quiet if m is not None and m.msgID in Kind.__members__ and m.talker != "P"]
    for kind in Kind:
        expected = np.array([oracle(m) for m in theirs if m.msgID == kind.name], float)
        rows = ours.of_kind(kind).values
        assert len(rows) == len(expected)
        if len(rows):
            np.testing.assert_allclose(rows[:, : expected.shape[1]], expected, rtol=0, atol=2e-8, err_msg=kind.name)


def oracle(message: Any) -> list[float]:
    """The columns of sentences.FIELDS, of a sentence as pynmeagps understands it."""

    def number(name: str) -> float:
        value = getattr(message, name, "")
        return float("nan") if value in ("", None) else float(value)

    def tod() -> float:
        at = message.time
        return float("nan") if at in ("", None) else at.hour * 3600 + at.minute * 60 + at.second + at.microsecond / 1e6

    def day(date: Any) -> float:
        return float("nan") if date in ("", None) else date.year * 10000.0 + date.month * 100.0 + date.day

    match message.msgID:
        case "GGA":
            names = ("lat", "lon", "alt", "sep", "quality", "numSV", "HDOP")
            return [tod(), *(number(name) for name in names)]
        case "RMC":
            knot = 1852 / 3600
            return [tod(), day(message.date), float(message.status == "A"), number("spd") * knot, number("cog")]
        case "GST":
            return [tod(), number("stdLat"), number("stdLong"), number("stdAlt")]
        case "VTG":
            return [float("nan"), number("sogn") * 1852 / 3600, number("cogt")]
        case "HDT":
            return [float("nan"), number("headingT")]
        case _:
            return [tod(), number("year") * 10000 + number("month") * 100 + number("day")]


def test_track__heights_are_the_published_ones(shared_data: Path) -> None:
    """CLAS positions against the antenna's published place: ellipsoidal height is altitude + separation."""
    track = track_of(shared_data / "gnss/clas/clas_static.nmea", date="2021-03-19")
    fixed = track[track.fix == Fix.FIXED]
    assert np.mean(fixed.height_m) - 65.712 == pytest.approx(0.097, abs=0.002)
    assert (np.mean(fixed.lat_deg) - 35.339325776) * 110_940 == pytest.approx(-0.001, abs=0.002)
    assert (np.mean(fixed.lon_deg) - 139.522173128) * 90_900 == pytest.approx(0.005, abs=0.002)
    assert track.t_s[0] == utc("2021-03-19T11:59:42")


def test_track__carries_all_that_the_sentences_state(shared_data: Path) -> None:
    track = track_of(shared_data / "tractor_fishtail/gnss.nmea")
    for values in (track.sigma_e_m, track.sigma_n_m, track.sigma_h_m, track.speed_mps, track.hdop):
        assert np.isfinite(values).all()
    assert np.all(track.sigma_e_m[track.fix == Fix.FLOAT] > track.sigma_e_m[track.fix == Fix.FIXED].max())
    assert (track.satellites[0], track.satellites.min(), track.satellites.max()) == (14, 9, 16)
    rover = track_of(shared_data / "rover_real/gnss.nmea")
    assert rover.heading_deg[0] == 215.107
    assert rover.heading_deg[1] == 215.454
    assert np.isfinite(rover.heading_deg).all()
    assert np.all(rover.satellites == -1)


def test_pubx__is_the_position_where_there_is_no_other(tmp_path: Path) -> None:
    # A NEO-M8 and its date; the accuracies in metres, the speed in km/h.
    position = b"PUBX,00,103607.00,5327.03942,N,00214.42462,W,104.461,G3,29,31,0.085,39.63,-0.007,,5.88,7.62,8.09,6,0,0"
    date = sentence("PUBX,04,103607.00,060321,556585.00,2147,18,0,0,0,")
    log = sentence(position.decode())
    parsed = pynmeagps.NMEAReader.parse(log.strip())
    track = track_of(write(tmp_path, date, log))
    assert track.t_s[0] == utc("2021-03-06T10:36:07")
    assert (track.lat_deg[0], track.lon_deg[0]) == pytest.approx((parsed.lat, parsed.lon), abs=1e-9)
    assert (track.height_m[0], track.fix[0], track.satellites[0], track.hdop[0]) == (104.461, Fix.SINGLE, 6, 5.88)
    assert (track.sigma_e_m[0], track.sigma_h_m[0]) == pytest.approx((29 / np.sqrt(2), 31))
    assert (track.speed_mps[0], track.course_deg[0]) == pytest.approx((0.085 / 3.6, 39.63))
    reader = NmeaLog([write(tmp_path, date, log)], ReadOptions())
    reader.track()
    assert "geoid-separation" not in codes(reader), "its height is above the ellipsoid"
    beside = track_of(write(tmp_path, gga("103607.00"), date, log))
    assert beside.height_m[0] == pytest.approx(track_of(write(tmp_path, gga("103607.00"), date)).height_m[0])
    assert beside.sigma_h_m[0] == 31
    for status, fix in {"G2": Fix.SINGLE, "D3": Fix.DGPS, "RK": Fix.SINGLE, "DR": Fix.ESTIMATED}.items():
        other = sentence(position.decode().replace("G3", status))
        assert track_of(write(tmp_path, date, other)).fix[0] == fix
    for status in ("NF", "TT", ""):
        with pytest.raises(InputError):
            track_of(write(tmp_path, date, sentence(position.decode().replace("G3", status))))
    # The array of rows has room for two of each `$PUBX,00,`; of another address it would be written beyond its end.
    damaged, _ = scan_bytes(sentence(position.decode().replace("PUBX,00,", "PUBX,00;,")), SentenceCounts())
    assert len(damaged) == 0


def test_pashr__has_heading_and_attitude(tmp_path: Path) -> None:
    def pashr(k: int, aligned: int = 1) -> bytes:
        angles = f"{359.5 + k:.2f},T,+1.{k}0,-2.{k}0,+00.00"
        return sentence(f"PASHR,23595{8 + k}.000,{angles},0.1,0.1,0.3,2,{aligned}")

    positions = [gga(f"23595{8 + k}.00") + rmc(f"23595{8 + k}.00", "110626") for k in range(2)]
    path = write(tmp_path, positions[0], pashr(0), positions[1], pashr(1))
    assert track_of(path).heading_deg == pytest.approx([359.5, 360.5])
    attitude = NmeaLog([path], ReadOptions()).attitude()
    assert attitude.t_s.tolist() == [utc("2026-06-11T23:59:58"), utc("2026-06-11T23:59:59")]
    assert (attitude.roll_deg.tolist(), attitude.pitch_deg.tolist()) == ([1.0, 1.1], [-2.0, -2.1])
    assert attitude.north == "true"
    path = write(tmp_path, positions[0], pashr(0, aligned=0))
    assert np.isnan(track_of(path).heading_deg).all()
    with pytest.raises(InputError, match="no attitude"):
        NmeaLog([path], ReadOptions()).attitude()


def test_track__across_midnight(shared_data: Path) -> None:
    path = shared_data / "gnss/nmea/derived_crosses_midnight.nmea"
    track = track_of(path)
    np.testing.assert_array_equal(np.diff(track.t_s), 1.0)
    assert np.isfinite(track.speed_mps).all()
    assert np.isfinite(track.sigma_h_m).all()


def test_track__midnight_without_dates(tmp_path: Path) -> None:
    tods = ("235958.00", "235959.00", "000000.00", "000001.00")
    path = write(tmp_path, *(gga(tod, 30 + k / 1e4) for k, tod in enumerate(tods)))
    expected = utc("2026-06-11T23:59:58") + np.arange(4)
    np.testing.assert_array_equal(track_of(path, date="2026-06-11").t_s, expected)
    np.testing.assert_array_equal(track_of(path, near_s=utc("2026-06-12T03:00:00")).t_s, expected)
    np.testing.assert_array_equal(track_of(path, near_s=utc("2026-06-11T21:00:00")).t_s, expected)
    inspection = NmeaLog([path], ReadOptions()).inspect()
    assert inspection.facts["span_s"] == 3.0
    assert inspection.facts["last"] == "00:00:01.000 (no date)"


def test_track__without_any_date_explains_how_to_state_one(tmp_path: Path) -> None:
    path = write(tmp_path, gga("120000.00"), gga("120001.00"))
    with pytest.raises(InputError) as error:
        track_of(path)
    assert error.value.code == "no-date"
    assert 'date = "YYYY-MM-DD"' in error.value.remedy
    assert "[recording]" in error.value.remedy
    with pytest.raises(InputError, match="not a date"):
        track_of(path, date="11.6.2026")


def test_track__a_pause_over_a_day_takes_the_date_of_its_own_sentences(tmp_path: Path) -> None:
    """15 hours later: nearer to nine hours earlier, if only the sentence before were asked."""
    path = write(
        tmp_path, gga("180000.00"), rmc("180000.00", "100626"), gga("090000.00", 31), rmc("090000.00", "110626")
    )
    np.testing.assert_array_equal(track_of(path).t_s, [utc("2026-06-10T18:00:00"), utc("2026-06-11T09:00:00")])


def test_track__dates_of_an_unset_calendar_do_not_count(tmp_path: Path) -> None:
    unset = [gga("235958.00", quality=0), sentence("GNZDA,235958.00,05,01,1980,00,00"), rmc("235958.00", "050180", "V")]
    for dated in (rmc("101500.00", "110626"), sentence("GNZDA,101500.00,11,06,2026,00,00")):
        path = write(tmp_path, *unset, gga("101500.00"), dated, gga("101501.00", 30.001))
        np.testing.assert_array_equal(track_of(path).t_s, utc("2026-06-11T10:15:00") + np.arange(2))


def test_track__a_stated_date_that_the_sentences_contradict_is_reported(tmp_path: Path) -> None:
    path = write(tmp_path, gga("120000.00"), rmc("120000.00", "110626"))
    reader = NmeaLog([path], ReadOptions(date="2026-06-12"))
    assert reader.track().t_s[0] == utc("2026-06-11T12:00:00")
    assert "date-contradicted" in codes(reader)


def test_track__files_of_one_recording_follow_each_other(tmp_path: Path) -> None:
    """The second file has no date of its own, and begins behind midnight."""
    first = write(tmp_path, gga("235959.00"), rmc("235959.00", "110626"), name="a.nmea")
    second = write(tmp_path, gga("000000.00", 30.001), gga("000001.00", 30.002), name="b.nmea")
    track = NmeaLog([first, second], ReadOptions()).track()
    np.testing.assert_array_equal(track.t_s, utc("2026-06-11T23:59:59") + np.arange(3))


def test_track__pieces_in_the_wrong_order_are_refused(tmp_path: Path) -> None:
    later = [gga(f"1210{k:02d}.00", 30 + k / 1e4) for k in range(20)]
    earlier = [gga(f"1200{k:02d}.00", 30 + k / 1e4) for k in range(20)]
    with pytest.raises(InputError) as error:
        track_of(write(tmp_path, *later, *earlier), date="2026-06-11")
    assert error.value.code == "time-disorder"
    assert f"byte {len(b''.join(later))}" in error.value.what


def test_track__what_belongs_to_an_epoch_joins_it_whatever_the_order(tmp_path: Path) -> None:
    """VTG and HDT carry no time: in a log that begins with them they stand before their epoch, else behind it."""

    def log(order: str) -> Path:
        parts = []
        for k in range(5):
            tod = f"12000{k}.00"
            of = {
                "G": gga(tod, 30 + k / 1e4),
                "H": sentence(f"HEHDT,{100 + k}.0,T"),
                "V": sentence(f"GNVTG,{200 + k}.0,T,,M,,N,{3.6 * k:.1f},K,A"),
                "S": sentence(f"GNGST,{tod},,,,,0.0{k + 1},0.1{k},0.2{k}"),
                "Z": sentence(f"GNZDA,{tod},11,06,2026,00,00"),
            }
            parts += [of[letter] for letter in order]
        return write(tmp_path, *parts, name=f"{order}.nmea")

    for order in ("GSVHZ", "HVGSZ", "ZSGHV", "SVGHZ", "HSZVG", "VZHSG"):
        track = track_of(log(order))
        np.testing.assert_array_equal(track.heading_deg, 100.0 + np.arange(5), err_msg=order)
        np.testing.assert_array_equal(track.course_deg, 200.0 + np.arange(5), err_msg=order)
        np.testing.assert_allclose(track.speed_mps, np.arange(5.0), err_msg=order)
        np.testing.assert_allclose(track.sigma_n_m, 0.01 + 0.01 * np.arange(5), err_msg=order)
        np.testing.assert_allclose(track.sigma_e_m, 0.10 + 0.01 * np.arange(5), err_msg=order)


def test_track__a_lost_position_does_not_lend_its_heading_to_its_neighbour(tmp_path: Path) -> None:
    parts: list[bytes] = []
    for k in range(4):
        position = gga(f"12000{k}.00", 30 + k / 1e4)
        parts += [position if k != 2 else position[:40] + b"\r\n", sentence(f"GNHDT,{100 + k}.0,T")]
    track = track_of(write(tmp_path, *parts), date="2026-06-11")
    np.testing.assert_array_equal(track.heading_deg, [100.0, 101.0, 103.0])


def test_track__speed_of_an_invalid_rmc_is_not_used(tmp_path: Path) -> None:
    path = write(
        tmp_path,
        gga("120000.00"), rmc("120000.00", "110626"),
        gga("120001.00", 30.001), rmc("120001.00", "110626", status="V", speed="99.0"),
    )  # fmt: skip
    assert np.isnan(track_of(path).speed_mps[1])


def test_track__equal_positions_under_two_talkers_count_once(tmp_path: Path) -> None:
    parts = [gga(f"12000{k}.00", 30 + k / 1e4, talker=talker) for k in range(5) for talker in ("GN", "GP")]
    assert len(track_of(write(tmp_path, *parts), date="2026-06-11")) == 5


def test_track__the_receiver_with_rtk_is_preferred_to_the_one_with_more_positions(tmp_path: Path) -> None:
    parts = [gga(f"12000{k}.{h}0", 30 + k / 1e4, talker="GP", quality=1) for k in range(5) for h in (0, 5)]
    parts = [part for k in range(5) for part in (*parts[2 * k : 2 * k + 2], gga(f"12000{k}.00", 31, talker="GN"))]
    track = track_of(write(tmp_path, *parts), date="2026-06-11")
    np.testing.assert_array_equal(track.fix, Fix.FIXED)


def test_track__repeated_positions_count_once(tmp_path: Path) -> None:
    path = write(tmp_path, *(2 * gga(f"12000{k}.00", 30 + k / 1e4) for k in range(5)))
    reader = NmeaLog([path], ReadOptions(date="2026-06-11"))
    assert len(reader.track()) == 5
    assert codes(reader) == {"positions-repeated"}


def test_track__without_gga_is_refused(tmp_path: Path) -> None:
    for parts in ([rmc("120000.00", "110626")], [gga("120000.00", quality=0)], [b"nothing"]):
        with pytest.raises(InputError) as error:
            track_of(write(tmp_path, *parts))
        assert error.value.code == "no-positions"


def test_promise_12__jumps_of_metres_are_listed_with_time_and_place(tmp_path: Path) -> None:
    minutes = 30 + np.arange(40) * 1e-4
    minutes[20:] += 5 / 1852
    path = write(tmp_path, *(gga(f"1200{k:02d}.00", m, quality=5 if k < 20 else 4) for k, m in enumerate(minutes)))
    reader = NmeaLog([path], ReadOptions(date="2026-06-11"))
    reader.track()
    text = next(notice.text for notice in reader.notices if notice.code == "position-jumps")
    assert "1 time " in text
    assert "jump is 5.0 m" in text
    assert "2026-06-11T12:00:20.000Z at 35.50008, 139.00000" in text


@pytest.mark.parametrize("suffix", [".gz", ".zst", ".xz"])
def test_track__compressed_is_read_as_it_is(suffix: str, shared_data: Path, tmp_path: Path) -> None:
    plain = shared_data / "tractor_loop/gnss.nmea"
    pack = {".gz": gzip.compress, ".zst": zstd.compress, ".xz": lzma.compress}[suffix]
    path = write(tmp_path, pack(plain.read_bytes()), name=f"gnss.nmea{suffix}")
    np.testing.assert_array_equal(track_of(path).t_s, track_of(plain).t_s)
    cut = write(tmp_path, path.read_bytes()[:-3000], name=f"cut.nmea{suffix}")
    reader = NmeaLog([cut], ReadOptions())
    assert 100 < len(reader.track()) < 605
    assert "stream-cut" in codes(reader)


BODIES = st.lists(
    st.sampled_from(
        [
            "GNGGA,120000.00,3530.0,N,13900.0,E,4,12,0.8,100.0,M,40.0,M,,",
            "GPRMC,120000.00,A,3530.0,N,13900.0,E,1.0,2.0,110626,,,A",
            "PSTI,030,1.0",
            "GNHDT,214.107,T",
            "GLGSV,1,1,00",
        ]
    ),
    min_size=1,
    max_size=12,
)


@given(BODIES, st.data())
def test_scan__noise_between_sentences_hides_none(bodies: list[str], data: st.DataObject) -> None:
    """Whatever bytes stand before, between and behind sentences, every one is found; only chance makes another."""
    noise = [data.draw(st.binary(max_size=30)) for _ in range(len(bodies) + 1)]
    stream = noise[0] + b"".join(sentence(body) + between for body, between in zip(bodies, noise[1:], strict=True))
    counts = SentenceCounts()
    scan_bytes(stream, counts)
    expected = Counter(body.split(",")[0] for body in bodies)
    assert expected <= counts.kinds


@given(BODIES, st.lists(st.integers(1, 600), max_size=6))
def test_scan__pieces_of_a_stream_give_what_the_whole_gives(bodies: list[str], cuts: list[int]) -> None:
    stream = b"\x01$\x02".join(sentence(body) for body in bodies) + b"$GNGGA,1200"
    whole = SentenceCounts()
    expected, _ = scan_bytes(stream, whole)
    counts, parts, rest, base = SentenceCounts(), [], b"", 0
    edges = sorted({min(cut, len(stream)) for cut in cuts} | {len(stream)})
    for begin, end in zip([0, *edges], [*edges, len(stream)], strict=True):
        rest += stream[begin:end]
        found, used = scan_bytes(rest, counts, base, last=end == begin)
        parts.append(found)
        base, rest = base + used, rest[used:]
    joined = Sentences.joined(parts)
    assert counts.kinds == whole.kinds
    assert (counts.bad, counts.cut) == (whole.bad, whole.cut)
    np.testing.assert_array_equal(joined.at, expected.at)
    np.testing.assert_array_equal(joined.values, expected.values)


@given(
    lat=st.floats(-89.99, 89.99),
    lon=st.floats(-179.99, 179.99),
    tod_ms=st.integers(0, 86_399_999),
    altitude=st.floats(-400, 9000),
)
def test_scan__numbers_come_back(lat: float, lon: float, tod_ms: int, altitude: float) -> None:
    def angle(value: float, digits: int) -> str:
        degrees, minutes = divmod(round(abs(value) * 60e7), 60 * 10**7)
        return f"{degrees:0{digits}d}{minutes / 1e7:010.7f}"

    tod = f"{tod_ms // 3_600_000:02d}{tod_ms // 60_000 % 60:02d}{tod_ms // 1000 % 60:02d}.{tod_ms % 1000:03d}"
    body = (
        f"GPGGA,{tod},{angle(lat, 2)},{'N' if lat >= 0 else 'S'},{angle(lon, 3)},{'E' if lon >= 0 else 'W'},"
        f"5,07,1.25,{altitude:.4f},M,-33.057,M,2.5,0120"
    )
    found, _ = scan_bytes(sentence(body), SentenceCounts())
    expected = [tod_ms / 1000, lat, lon, altitude, -33.057, 5, 7, 1.25, 2.5]
    assert np.all(np.abs(found.values[0] - expected) <= [1e-9, 2e-9, 2e-9, 6e-5, 0, 0, 0, 0, 0])


@pytest.mark.parametrize(
    "body",
    [
        "GPGGA,246060.00,3530.0,N,13900.0,E,4,12,0.8,1.0,M,4.0,M,,",
        "GPGGA,120000.00,9960.0,N,13900.0,E,4,12,0.8,1.0,M,4.0,M,,",
        "GPGGA,120000.00,3530.0,X,13900.0,E,4,12,0.8,1.0,M,4.0,M,,",
        "GPGGA,120000.00,35.3.0,N,13900.0,E,4,12,0.8,1.0,M,4.0,M,,",
        "GPGGA,120000.00",
        "GPGGA,",
        "GPGGA,120000.00,,,,,4",
        "GPGGA" + "," * 40,
    ],
)
def test_track__impossible_positions_are_none(body: str, tmp_path: Path) -> None:
    inspection = NmeaLog([write(tmp_path, sentence(body))], ReadOptions(date="2026-06-11")).inspect()
    assert inspection.facts["intact"] == 1
    assert inspection.facts["epochs"] == 0
    assert inspection.facts["epochs_without_position"] == 1


@pytest.mark.parametrize("place", ["3530.0,N,18100.0,E", "9900.0,S,13900.0,E", "0000.0,N,00000.0,W"])
def test_promise_17__positions_off_the_earth_are_refused(place: str, tmp_path: Path) -> None:
    body = f"GPGGA,120000.00,{place},4,12,0.8,1.0,M,4.0,M,,"
    with pytest.raises(InputError) as error:
        NmeaLog([write(tmp_path, sentence(body))], ReadOptions(date="2026-06-11")).track()
    assert error.value.code == "positions-impossible"


def test_read__has_every_epoch_of_an_hour_at_10_hz(tmp_path: Path) -> None:
    def clock(k: int) -> str:
        return f"{12 + k // 36000:02d}{k // 600 % 60:02d}{k // 10 % 60:02d}.{k % 10}0"

    parts = []
    for k in range(36_000):
        tod = clock(k)
        parts += [
            gga(tod, 30 + k * 1e-5 % 1), rmc(tod, "110626"), sentence(f"GNGST,{tod},0.1,,,,0.01,0.01,0.02"),
            sentence("GNVTG,90.0,T,,M,1.0,N,1.9,K,A"),
        ]  # fmt: skip
    path = write(tmp_path, *parts)
    track = track_of(path)
    assert len(track) == 36_000
    np.testing.assert_allclose(np.diff(track.t_s), 0.1, rtol=0, atol=1e-6)


def test_track__heading_of_ths_counts_where_it_is_valid(tmp_path: Path) -> None:
    path = write(
        tmp_path,
        gga("120000.00"), sentence("GNTHS,123.4,A"), gga("120001.00", 30.001), sentence("GNTHS,99.9,V"),
    )  # fmt: skip
    np.testing.assert_array_equal(track_of(path, date="2026-06-11").heading_deg, [123.4, np.nan])


@pytest.mark.parametrize("line_end", [b"", b"\n", b"\r", b"\r\n", b"\n\n", b"\r\n\r\n"])
def test_scan__bytes_of_sentences_include_two_of_a_line_end(line_end: bytes) -> None:
    bare = sentence("GNHDT,214.107,T").rstrip(b"\r\n")
    counts = SentenceCounts()
    scan_bytes((bare + line_end + b"x") * 3, counts)
    assert counts.kinds.total() == 3
    assert counts.message_bytes == 3 * (len(bare) + min(len(line_end), 2))
    cut, of_cut = bare[: bare.index(b"*")], SentenceCounts()
    scan_bytes(cut + line_end + bare, of_cut)
    assert of_cut.cut == 1
    assert of_cut.message_bytes == len(cut) + min(len(line_end), 2) + len(bare)


@pytest.mark.parametrize(("others", "least", "most"), [(0, 0.9, 1.0), (80, 0.5, 0.7), (95, 0.5, 0.7), (99, 0.0, 0.0)])
def test_recognise__is_less_certain_of_a_log_that_has_more_of_something_else(
    others: int, least: float, most: float, tmp_path: Path
) -> None:
    """Whoever knows the other bytes, of which these are per cent, is surer: certainties go from 0 to 1."""
    epochs = b"".join(gga(f"1200{k:02}.00") for k in range(20))
    path = tmp_path / "mixed.log"
    path.write_bytes(bytes([0xD3]) * (len(epochs) * others // (100 - others)) + b"\r\n" + epochs)
    assert least <= NmeaLog.recognise(look(path)) <= most


@pytest.mark.parametrize(
    ("tod", "seconds"),
    [
        ("000000", 0.0),
        ("235959.999999", 86_399.999999),
        ("235960.5", 86_400.5),
        ("005900", 3540.0),
        ("240000", None),
        ("006000", None),
        ("000061", None),
        ("12000", None),
        ("-20000.0", None),
        ("", None),
        ("12000x", None),
    ],
)
def test_scan__times_of_day_are_six_digits_on_the_clock_with_a_leap_second(tod: str, seconds: float | None) -> None:
    place = "3530.0,N,13900.0,E,4,12,0.8,1.0,M,4.0,M,,"
    gns, date = "3530.0,N,13900.0,E,RR,12,0.8,1.0,4.0,,", "A,3530.0,N,13900.0,E,1,2,110626,,,A"
    behind = {"GGA": place, "GNS": gns, "GST": ",,,,1,1,1", "RMC": date, "ZDA": "11,06,2026,00,00"}
    for body in (f"GN{kind},{tod},{rest}" for kind, rest in behind.items()):
        found, _ = scan_bytes(sentence(body), SentenceCounts())
        np.testing.assert_equal(found.values[0, 0], np.nan if seconds is None else seconds)


@pytest.mark.parametrize(
    ("lat", "lon", "expected"),
    [
        ("0000.0,N", "00000.0,E", (0.0, 0.0)),
        ("0000.6,S", "00059.4,W", (-0.01, -0.99)),
        ("8959.4,N", "17959.4,W", (89.99, -179.99)),
        ("3560.0,N", "13960.0,E", (np.nan, np.nan)),
        ("-3530.0,N", "-13900.0,E", (np.nan, np.nan)),
        ("3530.0,E", "13900.0,N", (np.nan, np.nan)),
        ("3530.0,NN", "13900.0,EE", (np.nan, np.nan)),
        ("3530.0,", "13900.0,", (np.nan, np.nan)),
    ],
)
def test_scan__angles_have_less_than_60_minutes_and_one_letter(lat: str, lon: str, expected: tuple[float, ...]) -> None:
    for body in (f"GPGGA,120000,{lat},{lon},4,12,0.8,1.0,M,4.0,M,,", f"GNGNS,120000,{lat},{lon},RR,12,0.8,1.0,4.0,,"):
        found, _ = scan_bytes(sentence(body), SentenceCounts())
        assert found.values[0, 1:3] == pytest.approx(expected, abs=1e-12, nan_ok=True)


@pytest.mark.parametrize(
    ("modes", "quality"),
    [("N", 0), ("S", 8), ("M", 7), ("E", 6), ("A", 1), ("D", 2), ("P", 3), ("F", 5), ("R", 4), ("NNA", 1), ("RFN", 4),
     ("DAS", 2), ("EM", 6), ("", 0)],
)  # fmt: skip
def test_scan__gns_has_the_quality_of_its_best_constellation(modes: str, quality: int) -> None:
    """NMEA 0183 4.10: mode indicators of GNS and the quality indicators of GGA that mean the same."""
    found, _ = scan_bytes(sentence(f"GNGNS,120000,3530.0,N,13900.0,E,{modes},12,0.8,1.0,4.0,,"), SentenceCounts())
    assert found.column(Kind.GGA, "quality")[0] == quality


@pytest.mark.parametrize(
    ("date", "ymd"), [("010180", 19800101), ("311279", 20791231), ("110626", 20260611), ("311299", 19991231)]
)
def test_scan__two_digits_of_a_year_are_1980_to_2079(date: str, ymd: int) -> None:
    found, _ = scan_bytes(rmc("120000.00", date), SentenceCounts())
    assert found.column(Kind.RMC, "date_ymd")[0] == ymd


@pytest.mark.parametrize(("stated", "satellites"), [("0", 0), ("999", 999), ("1000", -1), ("", -1)])
def test_track__satellites_beyond_three_digits_are_unknown(stated: str, satellites: int, tmp_path: Path) -> None:
    body = f"GPGGA,120000.00,3530.0,N,13900.0,E,4,{stated},0.8,1.0,M,4.0,M,,"
    assert track_of(write(tmp_path, sentence(body)), date="2026-06-11").satellites[0] == satellites


@pytest.mark.parametrize(
    ("quality", "fix"),
    [(1, Fix.SINGLE), (2, Fix.DGPS), (3, Fix.PPS), (4, Fix.FIXED), (5, Fix.FLOAT), (9, Fix.DGPS), (10, Fix.SINGLE)],
)
def test_track__qualities_beyond_the_standard_are_differential_or_single(
    quality: int, fix: Fix, tmp_path: Path
) -> None:
    """9 is written by NovAtel for SBAS; what no receiver's manual says is taken as the least."""
    assert track_of(write(tmp_path, gga("120000.00", quality=quality)), date="2026-06-11").fix.tolist() == [fix]


@pytest.mark.parametrize(("separation", "told"), [("36.6", False), ("28.0", False), ("0.0", True), ("-20.0", True)])
def test_geoid_separation__far_from_the_geoid_is_told(tmp_path: Path, separation: str, told: bool) -> None:
    log = NmeaLog(
        [write(tmp_path, gga("010000.00", tail=f"100.0,M,{separation},M,,"), rmc("010000.00", "230526"))], ReadOptions()
    )
    log.track()
    assert ("geoid-separation" in codes(log)) == told


def without_checksums(log: bytes, star: bytes) -> bytes:
    return b"".join(line.rpartition(b"*")[0] + star + b"\r\n" for line in log.splitlines() if b"*" in line)


@pytest.mark.parametrize("star", [b"", b"*"])
def test_unchecked__positions_are_those_of_the_log_with_checksums(star: bytes, tmp_path: Path) -> None:
    """Before version 3.0 of NMEA 0183 checksums were optional."""
    lines = [gga(f"0930{k:02d}.00", 30.0 + 1e-4 * k) + rmc(f"0930{k:02d}.00", "120526") for k in range(30)]
    whole = b"".join(lines)
    checked = NmeaLog([write(tmp_path, whole)], ReadOptions())
    bare = NmeaLog([write(tmp_path, without_checksums(whole, star), name="bare.nmea")], ReadOptions())
    for name in GnssTrack.columns():
        assert np.array_equal(getattr(bare.track(), name), getattr(checked.track(), name), equal_nan=True)
    assert codes(bare) - codes(checked) == {"sentences-unchecked"}
    assert NmeaLog.recognise(look(tmp_path / "bare.nmea")) == NmeaLog.recognise(look(tmp_path / "log.nmea"))


def test_unchecked__a_sentence_cut_by_the_end_or_the_next_one_is_not_used(tmp_path: Path) -> None:
    lines = [gga(f"0930{k:02d}.00") + rmc(f"0930{k:02d}.00", "120526") for k in range(10)]
    bare = without_checksums(b"".join(lines), b"")
    cut = bare[:-20] + b"$GNGGA,093010.00,3530.0" + without_checksums(gga("093011.00"), b"")[:-2]
    assert NmeaLog([write(tmp_path, cut)], ReadOptions()).track().t_s[-1] == utc("2026-05-12T09:30:09")


def test_unchecked__only_logs_without_any_checksum(tmp_path: Path) -> None:
    bare = without_checksums(b"".join(gga(f"0930{k:02d}.00") for k in range(10)), b"")
    reader = NmeaLog([write(tmp_path, rmc("093000.00", "120526"), gga("093000.00"), bare)], ReadOptions())
    assert len(reader.track()) == 1
    assert "sentences-unchecked" not in codes(reader)


@pytest.mark.parametrize(
    ("name", "epochs"),
    [
        ("14-nmea-without-checksum/nochk.nmea", 10),
        ("14-nmea-without-checksum/star_only.nmea", 10),
        ("14-nmea-without-checksum/utf16.nmea", 20),
        ("25-nmea-without-checksums/hp58534a.log", 2),
        ("25-nmea-without-checksums/nmea_no_checksum.nmea", 2),
    ],
)
def test_unchecked__samples(name: str, epochs: int, shared_data: Path) -> None:
    path = shared_data / "foreign" / name
    if not path.is_file():
        pytest.skip("the sample inputs of other software are not beside this checkout")
    track = track_of(path)
    assert len(track) == epochs
    if name.startswith("14"):
        assert (track.lat_deg[0], track.lon_deg[0]) == (52.0, 10.0)
    if "hp58534a" in name:  # by gpsd's own fields of the sentences
        assert (track.lat_deg[0], track.lon_deg[0]) == pytest.approx((-33.817228333, 18.732136667), abs=1e-8)
        assert track.height_m[0] == pytest.approx(115.4 + 33.3)
