"""Positions where the recording cannot have been, and epochs that a log has lost: left out, or named."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pyproj import Geod

from furrowmap.core.geodesy.projection import map_frame
from furrowmap.core.readers import implausible_positions as module
from furrowmap.core.readers.framed_messages import find_frames
from furrowmap.core.readers.implausible_positions import (
    MAX_FROM_MIDDLE_M,
    STRAY_ANCHORS,
    drop_implausible_positions,
    far_from_middle,
    is_implausible,
    spans_in_words,
    strays,
)
from furrowmap.core.readers.nmea.log import NmeaLog
from furrowmap.core.readers.poses.csv import PoseCsv
from furrowmap.core.readers.reader import ReadOptions
from furrowmap.core.readers.rtklib.pos import RtklibPos
from furrowmap.core.readers.sbf.log import SBF, SbfLog
from furrowmap.core.readers.ubx.log import UbxLog
from furrowmap.core.runtime.errors import InputError
from furrowmap.core.runtime.languages.texts import joined
from furrowmap.core.trajectory.from_gnss import trajectory_from_gnss
from furrowmap.core.values.gnss import GnssTrack
from furrowmap.core.values.session import Crs

FOREIGN = {
    "0, 0": ("0000.0000000", "N", "00000.0000000", "E"),
    "beyond the pole": ("9912.0000000", "N", "14000.0000000", "E"),
    "200 km away": ("3840.0000000", "N", "14000.0000000", "E"),
    "2 km away": ("3653.3000000", "N", "14000.0000000", "E"),
}
RTCM = b"\xd3\x00\x13" + bytes(range(0x80, 0x93)) + b"\x81\x82\x83"
GONE = range(200, 260)


def with_positions(log: bytes, place: tuple[str, str, str, str], epochs: range) -> bytes:
    """A log of NMEA whose GGA sentences of some epochs have another place, with the right checksum."""
    lines, count = log.split(b"\r\n"), 0
    for k, line in enumerate(lines):
        if line[3:6] == b"GGA":
            if count in epochs:
                fields = line[1:].split(b"*")[0].split(b",")
                fields[2:6] = [word.encode() for word in place]
                body = b",".join(fields)
                lines[k] = b"$%s*%02X" % (body, np.bitwise_xor.reduce(np.frombuffer(body, np.uint8)))
            count += 1
    return b"\r\n".join(lines)


@pytest.mark.parametrize("place", FOREIGN.values(), ids=FOREIGN.keys())
def test_promise_14__positions_elsewhere_are_left_out_listed_and_change_nothing_else(
    place: tuple[str, str, str, str], shared_data: Path, tmp_path: Path
) -> None:
    log = (shared_data / "tractor_loop/gnss.nmea").read_bytes()
    path = tmp_path / "gnss.nmea"
    path.write_bytes(with_positions(log, place, GONE))
    frame, lever_m = map_frame(Crs(map="EPSG:6677")), (1.85, 0.0, 1.62)
    reader = NmeaLog([path], ReadOptions())
    found = trajectory_from_gnss(reader.track(), frame, lever_m, None)
    right_log = NmeaLog([shared_data / "tractor_loop/gnss.nmea"], ReadOptions()).track()
    kept = ~np.isin(np.arange(len(right_log)), GONE)
    right = trajectory_from_gnss(right_log[kept], frame, lever_m, None)
    np.testing.assert_array_equal(found.trajectory.t_s, right.trajectory.t_s)
    np.testing.assert_allclose(found.trajectory.xyz_m, right.trajectory.xyz_m, atol=1e-6)
    told = [n.text for n in (*reader.notices, *found.notices) if n.code in ("positions-elsewhere", "gnss-jumps")]
    assert len(told) == 1
    assert f"(60 positions) at {float(place[0][:2]) + float(place[0][2:]) / 60.0:.5f}" in told[0]
    assert "2026-06-11T01:24:00.300Z to 2026-06-11T01:24:06.200Z" in told[0]


def test_promise_14__a_log_mostly_elsewhere_is_refused_in_three_sentences(shared_data: Path, tmp_path: Path) -> None:
    log = (shared_data / "tractor_loop/gnss.nmea").read_bytes()
    path = tmp_path / "gnss.nmea"
    path.write_bytes(with_positions(log, FOREIGN["0, 0"], range(400)))
    with pytest.raises(InputError) as error:
        NmeaLog([path], ReadOptions()).track()
    assert error.value.code == "positions-impossible"
    assert "400 of 605" in error.value.what
    inspection = NmeaLog([path], ReadOptions()).inspect()
    assert "positions-impossible" in {notice.code for notice in inspection.notices}


@given(
    lon=st.floats(-180, 180), lat=st.floats(-90, 90), bearing=st.floats(0, 360), far_m=st.floats(0, 3e6),
    count=st.integers(3, 40),
)  # fmt: skip
def test_is_implausible__is_a_distance_on_the_ellipsoid(
    lon: float, lat: float, bearing: float, far_m: float, count: int
) -> None:
    other_lon, other_lat, _ = Geod(ellps="WGS84").fwd(lon, lat, bearing, far_m)
    lons, lats = np.append(np.full(count, lon), other_lon), np.append(np.full(count, lat), other_lat)
    found = is_implausible(lons, lats, np.full(count + 1, np.nan))
    nowhere = (np.abs(lons) < 1e-3) & (np.abs(lats) < 1e-3)
    if not nowhere.any() and abs(far_m - MAX_FROM_MIDDLE_M) > 0.02 * MAX_FROM_MIDDLE_M:
        assert not found[:count].any()
        assert found[count] == (far_m > MAX_FROM_MIDDLE_M)


@pytest.mark.parametrize("burst", [[], [(1000, 1060)], [(2, 4), (1200, 1230), (4100, 4200)]])
def test_is_implausible__a_flight_of_500_km_is_whole(burst: list[tuple[int, int]]) -> None:
    """However far it leads; positions of another country within it are left out."""
    lon, lat = np.transpose(Geod(ellps="WGS84").npts(9.0, 48.0, 14.5, 51.0, 5000))
    foreign = np.zeros(len(lon), bool)
    for begin, end in burst:
        foreign[begin:end] = True
        lon[begin:end], lat[begin:end] = 30.0, -20.0
    assert np.array_equal(is_implausible(lon, lat, np.full(len(lon), 1500.0)), foreign)


@pytest.mark.parametrize("place", [("0.0", "0.0"), ("5e6", "5e6")], ids=["98 km away", "abroad"])
def test_promise_14__poses_elsewhere_are_left_out_and_counted(
    place: tuple[str, str], shared_data: Path, tmp_path: Path
) -> None:
    lines = (shared_data / "tractor_loop/truth/trajectory.csv").read_text(encoding="utf-8").splitlines()
    names = lines[0].split(",")
    for row in range(1000, 1100):
        cells = lines[row].split(",")
        cells[names.index("e_m")], cells[names.index("n_m")] = place
        lines[row] = ",".join(cells)
    path = tmp_path / "trajectory.csv"
    path.write_text("\n".join([*lines, ""]), encoding="utf-8")
    reader = PoseCsv([path], ReadOptions())
    assert len(reader.poses()) == len(lines) - 1 - 100
    assert ["100 of 6141" in notice.text for notice in reader.notices] == [True]


@pytest.mark.parametrize(
    ("reader", "name", "sync"),
    [(UbxLog, "gnss/ubx/f9p_pvt_hpposllh_1hz.ubx", b"\xb5\x62\x01\x07"), (SbfLog, "gnss/sbf/sbfdata.sbf", b"$@")],
)
@pytest.mark.parametrize("lost", [0, 1])
def test_promise_11__a_lost_byte_of_synchronisation_is_a_warning_with_the_lost_epoch(
    reader: type[UbxLog | SbfLog], name: str, sync: bytes, lost: int, shared_data: Path, tmp_path: Path
) -> None:
    data = (shared_data / name).read_bytes()
    whole = reader([shared_data / name], ReadOptions())
    epochs = len(whole.track())
    assert not {"messages-damaged", "epochs-missing"} & {notice.code for notice in whole.notices}
    lost_epochs = 0
    for at in (k for k in range(len(data)) if data.startswith(sync, k)):
        path = tmp_path / "log"
        path.write_bytes(data[: at + lost] + data[at + lost + 1 :])
        opened = reader([path], ReadOptions())
        found = opened.track()
        codes = {notice.code for notice in opened.notices}
        assert "messages-damaged" in codes
        inside = whole.track().t_s[1:-1]
        if not np.isin(inside, found.t_s).all():
            assert "epochs-missing" in codes
        lost_epochs += epochs - len(found)
    assert lost_epochs >= epochs - 2


@given(noise=st.lists(st.sampled_from([b"text\r\n", b"\0\0", RTCM, b"\x80"]), max_size=8), piece=st.integers(20, 300))
def test_find_frames__counts_only_bytes_of_no_known_protocol(noise: list[bytes], piece: int, shared_data: Path) -> None:
    """However the stream is cut into pieces."""
    frame = (shared_data / "gnss/sbf/x5_pvtgeod.sbf").read_bytes()
    stream = b"".join(part + frame for part in noise)
    foreign, rest = 0, b""
    for at in range(0, len(stream) + piece, piece):
        data = rest + stream[at : at + piece]
        frames = find_frames(np.frombuffer(data, np.uint8), SBF, last=at >= len(stream))
        foreign += frames.foreign
        rest = data[frames.used :]
    assert foreign == noise.count(b"\x80")


def test_far_from_middle__a_way_leads_there_unless_it_is_in_too_many_pieces(monkeypatch: pytest.MonkeyPatch) -> None:
    """A ship leaves the middle by steps that count as a way; with more stretches than are followed, it does not."""
    way = np.zeros((400, 3))
    way[:, 0] = np.concatenate([np.zeros(300), np.linspace(0.0, 2.0 * MAX_FROM_MIDDLE_M, 100)])
    jump = way.copy()
    jump[350:, 1] += 10.0 * MAX_FROM_MIDDLE_M
    assert not far_from_middle(way).any()
    assert far_from_middle(jump).tolist() == [False] * 350 + [True] * 50
    outlier = way.copy()
    outlier[380] = 10.0 * MAX_FROM_MIDDLE_M
    assert np.flatnonzero(far_from_middle(outlier)).tolist() == [380]  # the way goes on behind it
    monkeypatch.setattr(module, "MAX_STRETCHES", 2)
    assert np.flatnonzero(far_from_middle(outlier)).tolist() == list(range(380, 400))


@pytest.mark.parametrize(
    "sizes", [(20, 40), (40, 20), (20, 40, 20), (10, *(40,) * STRAY_ANCHORS), (*(40,) * STRAY_ANCHORS, 10)]
)
def test_strays__stretches_that_follow_each_other_within_reach_are_one_drive(sizes: tuple[int, ...]) -> None:
    """Positions on both sides of a border are off to opposite sides: a step out of reach between stretches that fit."""
    place = np.zeros((sum(sizes), 2))
    ends = np.cumsum(sizes)[:-1]
    place[ends - 1, 1], place[ends, 1] = 80.0, -80.0
    t_s, sigma = np.arange(float(len(place))), np.full(len(place), 0.02)
    assert not strays(t_s, place, sigma).any()


def test_strays__of_more_stretches_than_are_followed_none_is_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    t_s, sigma = np.arange(40.0), np.full(40, 0.02)
    place = np.where(np.arange(40)[:, None] >= 30, 5000.0, 0.0) * np.ones(2)
    assert strays(t_s, place, sigma).tolist() == [False] * 30 + [True] * 10
    assert not strays(t_s[:6], place[28:34], sigma[:6]).any()  # too few to tell which are the rest
    monkeypatch.setattr(module, "MAX_STRETCHES", 1)
    assert strays(t_s, place, sigma).all()


@pytest.mark.parametrize(
    ("lon", "lat", "height_m", "is_bad"),
    [
        (9.0, 90.0, 0.0, False),
        (9.0, 90.0001, 0.0, True),
        (9.0, -90.0, 0.0, False),
        (9.0, -90.0001, 0.0, True),
        (180.0, 50.0, 0.0, False),
        (180.0001, 50.0, 0.0, True),
        (-180.0, 50.0, 0.0, False),
        (-180.0001, 50.0, 0.0, True),
        (9.0, 50.0, -999.0, False),
        (9.0, 50.0, -1001.0, True),
        (9.0, 50.0, 19_999.0, False),
        (9.0, 50.0, 20_001.0, True),
        (0.0, 50.0, 0.0, False),
        (9.0, 0.0, 0.0, False),
        (0.00009, -0.00009, 0.0, True),
        (0.00011, 0.0, 0.0, False),
        (0.0, -0.00011, 0.0, False),
        (np.nan, 91.0, 0.0, False),
        (181.0, np.nan, 0.0, False),
        (9.0, 50.0, np.nan, False),
    ],
)
def test_is_implausible__the_earth_ends_at_its_poles_and_at_180_degrees(
    lon: float, lat: float, height_m: float, is_bad: bool
) -> None:
    """And vehicles between 1 km below the sea and 20 km above it; 10 m around 0° N 0° E stand for unknown."""
    found = is_implausible(np.full(9, lon), np.full(9, lat), np.full(9, height_m))
    assert found.tolist() == [is_bad] * 9


def test_drop_implausible_positions__up_to_half_of_the_positions_may_be_elsewhere() -> None:
    lon, lat = np.full(10, 140.0), np.full(10, 36.0)
    lat[:5] = 95.0
    track = GnssTrack.build(np.arange(10.0), lon_deg=lon, lat_deg=lat, source="log")
    kept, which, notices = drop_implausible_positions(track)
    assert (len(kept), which.tolist()) == (5, [False] * 5 + [True] * 5)
    assert "5 of 10 positions" in notices[0].text
    assert "(5 positions) at 95.00000, 140.00000" in notices[0].text
    lat[5] = 95.0
    with pytest.raises(InputError, match="6 of 10 positions") as refused:
        drop_implausible_positions(track)
    assert refused.value.code == "positions-impossible"
    lat[9] = np.nan
    lat[5] = 36.0
    with pytest.raises(InputError, match="5 of 10 positions"):  # of nine that there are
        drop_implausible_positions(track)


def test_rtklib_pos__longitudes_to_360_degrees_are_in_the_west(tmp_path: Path) -> None:
    places = [(263.25 + 1e-5 * k, 44.5, 210.0) for k in range(20)]
    header = "%  GPST                  latitude(deg) longitude(deg)  height(m)   Q  ns"
    tracks = []
    for name, shift_deg in (("east.pos", 0.0), ("west.pos", -360.0)):
        rows = [
            f"2026/06/11 01:24:{k:06.3f}   {lat:.9f} {lon + shift_deg:.9f} {height:.4f} 1 12"
            for k, (lon, lat, height) in enumerate(places)
        ]
        (tmp_path / name).write_text("\n".join([header, *rows]) + "\n")
        tracks.append(RtklibPos([tmp_path / name], ReadOptions()).track())
    np.testing.assert_allclose(tracks[0].lon_deg, tracks[1].lon_deg, atol=1e-9)


def test_spans_in_words__are_the_first_five_and_the_number_of_the_others() -> None:
    track = GnssTrack.build(np.arange(20.0), lon_deg=np.arange(20.0), lat_deg=np.arange(20.0) + 0.5)
    chosen = np.isin(np.arange(20), [0, 2, 3, 5, 7, 9, 11, 13])
    words = spans_in_words(track, chosen, "{:.0f} s".format)
    assert joined(words, ";", "en") == (
        "0 s at 0.50000, 0.00000; 2 s to 3 s (2 positions) at 2.50000, 2.00000; 5 s at 5.50000, 5.00000; "
        "7 s at 7.50000, 7.00000; 9 s at 9.50000, 9.00000; and 2 more times"
    )


@pytest.mark.parametrize(("apart_m", "is_stray"), [(1720.0, False), (1725.0, True)])
@pytest.mark.parametrize("sigmas_m", [(17.0, 0.02), (0.02, 17.0)])
def test_strays__are_out_of_reach_at_100_metres_a_second_and_the_allowance(
    apart_m: float, is_stray: bool, sigmas_m: tuple[float, float]
) -> None:
    """16 s from the middle of seven positions to that of the next seven, 20 m, and six of the larger sigma: 1722 m."""
    place = np.zeros((30, 2))
    place[20:, 1] = apart_m
    t_s = np.append(np.arange(20.0), 29.0 + np.arange(10.0))
    assert strays(t_s, place, np.repeat(sigmas_m, [20, 10])).tolist() == [False] * 20 + [is_stray] * 10
