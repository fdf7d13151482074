"""UBX logs: what the samples hold, agreement with pyubx2 and with NMEA of the same drive, and laws of the frames."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import pyubx2
from hypothesis import given
from hypothesis import strategies as st

from furrowmap.core.readers.framed_messages import MessageCounts, find_frames, read_messages
from furrowmap.core.readers.nmea.log import NmeaLog
from furrowmap.core.readers.reader import ReadOptions
from furrowmap.core.readers.rtklib.pos import RtklibPos
from furrowmap.core.readers.source import Source
from furrowmap.core.readers.ubx.log import NAV_PVT, UBX, UBX_LAYOUTS, UBX_NAMES, UbxLog
from furrowmap.core.runtime.errors import InputError
from furrowmap.core.values.gnss import Fix, GnssTrack

# As the samples' README lists them; positions by kind of fix, first and last time.
HELD: dict[str, tuple[int, dict[str, int], str, str]] = {
    "ubx/f9p_pvt_hpposllh_1hz.ubx": (29, {"single": 29}, "2019-04-22T21:19:20.000Z", "2019-04-22T21:19:48.000Z"),
    "ubx/f9p_rtk_float_1hz.ubx": (10, {"float": 10}, "2022-10-11T11:04:24.000Z", "2022-10-11T11:04:33.000Z"),
    "ubx/m8l_dead_reckoning_hnr10hz.ubx": (19, {"dgps": 19}, "2024-01-30T15:31:52.000Z", "2024-01-30T15:32:10.000Z"),
    "ubx/m8p_4hz.ubx": (59, {"single": 59}, "2021-06-10T18:18:55.500Z", "2021-06-10T18:19:10.000Z"),
    "ubx/mixed_many_messages.ubx": (39, {"single": 39}, "2020-10-23T11:33:15.000Z", "2020-10-23T11:33:53.000Z"),
    "ubx/bad_checksum.ubx": (1, {"dgps": 1}, "2021-12-04T11:34:59.000Z", "2021-12-04T11:34:59.000Z"),
    "ubx/truncated_end.ubx": (1, {"single": 1}, "2020-10-20T14:04:49.000Z", "2020-10-20T14:04:49.000Z"),
    "car_reference/derived_rover_rtk.ubx": (
        5395, {"fixed": 1799, "float": 3596}, "2023-07-11T06:04:12.000Z", "2023-07-11T06:24:42.000Z",
    ),
}  # fmt: skip


def frame(kind: int, payload: bytes) -> bytes:
    return bytes(pyubx2.UBXMessage(bytes([kind >> 8]), bytes([kind & 255]), pyubx2.GET, payload=payload).serialize())


def track_of(path: Path, **options: Any) -> GnssTrack:
    return UbxLog([path], ReadOptions(**options)).track()


@pytest.mark.parametrize("name", HELD)
def test_inspect__reports_the_content_of_the_sample(name: str, shared_data: Path) -> None:
    count, fixes, first, last = HELD[name]
    facts = UbxLog([shared_data / "gnss" / name], ReadOptions()).inspect().facts
    assert facts["messages"]["NAV-PVT"] == count
    assert facts["epochs_by_fix"] == fixes
    # Times are the receiver's own, to the nanosecond; a calendar second may begin a little late or early.
    assert (facts["first"], facts["last"]) == (first, last)


@pytest.mark.parametrize(
    ("flags", "used"),
    [
        ({"isMoving": 1, "carrSoln": 2}, True),
        ({"isMoving": 0, "carrSoln": 2}, False),  # the bearing of a base beside the field
        ({"isMoving": 1, "carrSoln": 1}, False),
        ({"isMoving": 1, "carrSoln": 2, "relPosHeadingValid": 0}, False),
        ({"isMoving": 1, "carrSoln": 2, "gnssFixOK": 0}, False),
    ],
)
def test_track__heading_is_that_of_a_moving_base_with_its_ambiguities_fixed(
    tmp_path: Path, shared_data: Path, flags: dict[str, int], used: bool
) -> None:
    """Beside each NAV-PVT of a log a NAV-RELPOSNED, written by pyubx2, but at the third epoch."""
    with (shared_data / "gnss/ubx/f9p_rtk_float_1hz.ubx").open("rb") as stream:
        parsed = list(pyubx2.UBXReader(stream, protfilter=2, quitonerror=0))
    stated = {"gnssFixOK": 1, "relPosValid": 1, "relPosHeadingValid": 1, **flags}
    with (tmp_path / "rover.ubx").open("wb") as log:
        number = 0
        for raw, message in parsed:
            log.write(raw)
            if message.identity == "NAV-PVT":
                if number != 2:
                    values = {"version": 1, "iTOW": message.iTOW, "relPosHeading": 350.0 + 2.5 * number}
                    log.write(pyubx2.UBXMessage("NAV", "NAV-RELPOSNED", pyubx2.GET, **values, **stated).serialize())
                number += 1
    heading = track_of(tmp_path / "rover.ubx").heading_deg
    expected = np.array([(350.0 + 2.5 * k) % 360.0 if used and k != 2 else np.nan for k in range(10)])
    np.testing.assert_allclose(heading, expected, atol=1e-5)


def test_inspect__weak_reception(shared_data: Path) -> None:
    facts = UbxLog([shared_data / "gnss/ubx/m8_weak_2d_3d_nofix_300s.ubx"], ReadOptions()).inspect().facts
    assert facts["kinds_of_fix"] == {"none": 8, "2D": 169, "3D": 122}
    assert facts["epochs"] + facts["epochs_without_position"] == 299


@pytest.mark.parametrize("name", ["ubx/m8_weak_2d_3d_nofix_300s.ubx", *list(HELD)[:5]])
def test_track__is_what_pyubx2_reads(name: str, shared_data: Path) -> None:
    path = shared_data / "gnss" / name
    with path.open("rb") as stream:
        parsed = [message for _, message in pyubx2.UBXReader(stream, protfilter=2, quitonerror=0)]
    precise = {m.iTOW: m for m in parsed if m.identity == "NAV-HPPOSLLH"}
    usable = [m for m in parsed if m.identity == "NAV-PVT" and m.gnssFixOk and m.fixType in (2, 3, 4)]
    track = track_of(path)
    assert len(track) == len(usable)
    for k, m in enumerate(usable):
        best = precise.get(m.iTOW, m)
        assert track.lon_deg[k] == pytest.approx(best.lon, abs=1e-12)
        assert track.lat_deg[k] == pytest.approx(best.lat, abs=1e-12)
        assert track.height_m[k] == pytest.approx(best.height / 1000.0, abs=1e-9)
        assert np.hypot(track.sigma_e_m[k], track.sigma_n_m[k]) == pytest.approx(best.hAcc / 1000.0)
        assert track.sigma_h_m[k] == pytest.approx(best.vAcc / 1000.0)
        assert track.speed_mps[k] == pytest.approx(m.gSpeed / 1000.0)
        assert track.satellites[k] == m.numSV


def test_covariance__takes_the_place_of_the_estimate(shared_data: Path) -> None:
    path = shared_data / "gnss/ubx/bad_checksum.ubx"
    with path.open("rb") as stream:
        parsed = {m.identity: m for _, m in pyubx2.UBXReader(stream, protfilter=2, quitonerror=0)}
    cov, track = parsed["NAV-COV"], track_of(path)
    assert track.sigma_e_m[0] == pytest.approx(cov.posCovEE**0.5, rel=1e-6)
    assert track.sigma_n_m[0] == pytest.approx(cov.posCovNN**0.5, rel=1e-6)
    assert track.sigma_h_m[0] == pytest.approx(cov.posCovDD**0.5, rel=1e-6)
    # The receiver's own covariance shows what its horizontal estimate is: both axes together.
    assert (cov.posCovEE + cov.posCovNN) ** 0.5 == pytest.approx(parsed["NAV-PVT"].hAcc / 1000.0, rel=0.01)
    assert track.hdop[0] == pytest.approx(parsed["NAV-DOP"].hDOP)


def test_two_logs_of_one_drive__agree_within_their_rounding(shared_data: Path) -> None:
    folder = shared_data / "gnss/walk_f9p"
    ubx, nmea = track_of(folder / "walk.ubx", date="2025-09-09"), NmeaLog([folder / "walk.nmea"], ReadOptions()).track()
    assert (len(ubx), len(nmea)) == (4122, 3902)
    key = np.round(ubx.t_s * 1000).astype(np.int64)
    both, at_ubx, at_nmea = np.intersect1d(key, np.round(nmea.t_s * 1000).astype(np.int64), return_indices=True)
    assert len(both) == 3900
    east_m = np.radians(ubx.lon_deg[at_ubx] - nmea.lon_deg[at_nmea]) * 6_386_000.0 * np.cos(np.radians(39.19))
    north_m = np.radians(ubx.lat_deg[at_ubx] - nmea.lat_deg[at_nmea]) * 6_361_000.0
    apart_m = np.hypot(east_m, north_m)
    assert np.sqrt(np.mean(apart_m**2)) == pytest.approx(0.0068, abs=2e-4)
    assert apart_m.max() < 0.012
    up_m = ubx.height_m[at_ubx] - nmea.height_m[at_nmea]
    # Altitude and geoid separation are each rounded to a decimetre.
    assert np.sqrt(np.mean(up_m**2)) == pytest.approx(0.1 * np.sqrt(2 / 12), abs=0.005)
    assert np.abs(up_m).max() < 0.1001


def test_one_solution_written_in_three_ways__is_one(shared_data: Path) -> None:
    """RTKLIB's .pos, and NAV-PVT and GGA made of it: equal to the digits that each has."""
    folder = shared_data / "gnss/car_reference"
    pos = RtklibPos([folder / "rover_rtk.pos"], ReadOptions()).track()
    ubx, nmea = (
        track_of(folder / "derived_rover_rtk.ubx"),
        NmeaLog([folder / "derived_rover_rtk.nmea"], ReadOptions()).track(),
    )
    for other, digits_m in ((ubx, 0.011), (nmea, 0.011)):
        np.testing.assert_array_equal(other.fix, pos.fix)
        np.testing.assert_allclose(other.t_s, pos.t_s, atol=0.011)  # its times are of hundredths
        np.testing.assert_allclose(other.lat_deg, pos.lat_deg, atol=1e-7)
        np.testing.assert_allclose(other.lon_deg, pos.lon_deg, atol=1e-7)
        np.testing.assert_allclose(other.height_m, pos.height_m, atol=digits_m)


@pytest.mark.parametrize("options", [{"week": 2383}, {"near_s": 1757444000.0}, {"date": "2025-09-09"}])
def test_week__may_be_stated_in_three_ways(options: dict[str, Any], shared_data: Path) -> None:
    track = track_of(shared_data / "gnss/walk_f9p/walk.ubx", **options)
    assert track.t_s[0] == pytest.approx(1757444321.95, abs=1e-6)


def test_no_date__is_refused_and_a_wrong_day_too(shared_data: Path) -> None:
    path = shared_data / "gnss/walk_f9p/walk.ubx"
    for options, code in (({}, "no-date"), ({"date": "2025-09-10"}, "date-contradicted"), ({"date": "x"}, "bad-date")):
        with pytest.raises(InputError) as error:
            track_of(path, **options)
        assert error.value.code == code
    assert UbxLog([path], ReadOptions()).inspect().facts["first"].startswith("Tuesday 18:58:59.950")


def test_a_log_without_positions__is_refused(shared_data: Path, tmp_path: Path) -> None:
    raw = (shared_data / "gnss/nmea/f9p_nmea_in_binary.log").read_bytes()
    (tmp_path / "raw.ubx").write_bytes(raw)
    for path in (tmp_path / "raw.ubx", shared_data / "gnss/ubx/mixed_ubx_nmea_rtcm3.ubx"):
        with pytest.raises(InputError) as error:
            track_of(path)
        assert error.value.code == "no-positions"
    with pytest.raises(InputError, match="raw observations"):
        track_of(tmp_path / "raw.ubx")


def test_two_receivers_in_one_log__are_refused(shared_data: Path, tmp_path: Path) -> None:
    """Their messages alternate; the times are the same, and the places are not."""
    data = bytearray((shared_data / "gnss/car_reference/derived_rover_rtk.ubx").read_bytes()[: 100 * 300])
    mixed = b""
    for at in range(0, len(data), 100):
        payload = bytearray(data[at + 6 : at + 98])
        payload[28] ^= 0x55  # another latitude
        mixed += bytes(data[at : at + 100]) + frame(NAV_PVT, bytes(payload))
    (tmp_path / "two.ubx").write_bytes(mixed)
    with pytest.raises(InputError) as error:
        track_of(tmp_path / "two.ubx")
    assert error.value.code == "receivers-interleaved"


def test_time__is_the_week_where_the_calendar_is_not_vouched_for(shared_data: Path, tmp_path: Path) -> None:
    data = (shared_data / "gnss/ubx/f9p_pvt_hpposllh_1hz.ubx").read_bytes()
    frames = find_frames(np.frombuffer(data, np.uint8), UBX)
    is_pvt = frames.kind == NAV_PVT
    payloads = [bytearray(data[at : at + n]) for at, n in zip(frames.at[is_pvt], frames.length[is_pvt], strict=True)]
    whole = track_of(shared_data / "gnss/ubx/f9p_pvt_hpposllh_1hz.ubx")
    for payload in payloads:
        payload[11] = 0b011  # date and time are valid, but the leap seconds not yet known
        payload[10] = (payload[10] + 2) % 60  # so that the calendar may be off
    (tmp_path / "log.ubx").write_bytes(b"".join(frame(NAV_PVT, bytes(payload)) for payload in payloads))
    assert track_of(tmp_path / "log.ubx").t_s == pytest.approx(whole.t_s, abs=6e-4)


def test_fix__goes_by_the_flags_of_the_message(shared_data: Path, tmp_path: Path) -> None:
    data = (shared_data / "gnss/car_reference/derived_rover_rtk.ubx").read_bytes()[:1000]
    expected = [
        (3, 0b10000011, Fix.FIXED), (3, 0b01000011, Fix.FLOAT), (3, 0b11, Fix.DGPS), (2, 0b1, Fix.SINGLE),
        (1, 0b1, Fix.ESTIMATED), (3, 0b0, None), (0, 0b1, None), (5, 0b1, None), (4, 0b1, Fix.SINGLE),
    ]  # fmt: skip
    log = b""
    for k, (kind, flags, _) in enumerate(expected):
        payload = bytearray(data[100 * k + 6 : 100 * k + 98])
        payload[20:22] = bytes([kind, flags])
        log += frame(NAV_PVT, bytes(payload))
    (tmp_path / "log.ubx").write_bytes(log)
    assert track_of(tmp_path / "log.ubx").fix.tolist() == [fix for *_, fix in expected if fix is not None]


@given(
    parts=st.lists(st.one_of(st.tuples(st.integers(0, 0xFFFF), st.binary(max_size=40)), st.binary(max_size=30))),
    cuts=st.lists(st.integers(0, 600)),
)
def test_frames__are_found_whatever_stands_between_and_wherever_the_stream_is_cut(
    parts: list[tuple[int, bytes] | bytes], cuts: list[int]
) -> None:
    noise = [part.replace(b"\xb5", b"\0") for part in parts if isinstance(part, bytes)]
    frames = [part for part in parts if isinstance(part, tuple)]
    stream = b"".join(
        frame_by_hand(*part) if isinstance(part, tuple) else part.replace(b"\xb5", b"\0") for part in parts
    )
    found: list[tuple[int, bytes]] = []
    rest = b""
    edges = sorted({min(cut, len(stream)) for cut in cuts} | {len(stream)})
    for begin, end in zip([0, *edges], [*edges, len(stream)], strict=True):
        rest += stream[begin:end]
        piece = find_frames(np.frombuffer(rest, np.uint8), UBX, last=begin == end)
        rows = list(zip(piece.kind.tolist(), piece.at.tolist(), piece.length.tolist(), strict=True))
        found += [(kind, rest[at : at + size]) for kind, at, size in rows]
        assert piece.intact_bytes == sum(size + 8 for _, _, size in rows)
        rest = rest[piece.used :]
    assert found == frames
    assert rest == b""
    assert len(noise) + len(frames) == len(parts)


def frame_by_hand(kind: int, payload: bytes) -> bytes:
    """A frame with the checksum as the interface description writes it down (RFC 1145)."""
    body = bytes([kind >> 8, kind & 255]) + len(payload).to_bytes(2, "little") + payload
    a = b = 0
    for byte in body:
        a = (a + byte) & 255
        b = (b + a) & 255
    return b"\xb5\x62" + body + bytes([a, b])


def test_frames__that_claim_much_are_not_read_over_and_over(tmp_path: Path) -> None:
    """A frame at every sixth byte, each claiming 8 kB: were each read through, these 6 MB would take minutes."""
    (tmp_path / "hostile").write_bytes(b"\xb5\x62\x01\x07\xff\x1f" * 1_000_000)
    counts = MessageCounts[int]()
    with Source(tmp_path / "hostile") as source:
        read_messages(source, UBX, {}, counts)
    assert (counts.intact, counts.bad + counts.cut) == (0, 1_000_000)


FIELDS = {  # ours, and pyubx2's: name and scale
    "NAV-PVT": {
        "itow": ("iTOW", 1), "year": ("year", 1), "month": ("month", 1), "day": ("day", 1), "hour": ("hour", 1),
        "minute": ("min", 1), "second": ("second", 1), "nano": ("nano", 1), "kind": ("fixType", 1),
        "satellites": ("numSV", 1), "lon": ("lon", 1e7), "lat": ("lat", 1e7), "height": ("height", 1),
        "h_acc": ("hAcc", 1), "v_acc": ("vAcc", 1), "speed": ("gSpeed", 1), "course": ("headMot", 1e5),
    },
    "NAV-COV": {
        "itow": ("iTOW", 1), "valid": ("posCovValid", 1), "nn": ("posCovNN", 1), "ee": ("posCovEE", 1),
        "dd": ("posCovDD", 1),
    },
    "NAV-DOP": {"itow": ("iTOW", 1), "hdop": ("hDOP", 100)},
    "NAV-STATUS": {"itow": ("iTOW", 1), "kind": ("gpsFix", 1)},
    "NAV-TIMEGPS": {"itow": ("iTOW", 1), "week": ("week", 1)},
    "NAV-TIMEUTC": {
        "itow": ("iTOW", 1), "year": ("year", 1), "month": ("month", 1), "day": ("day", 1), "hour": ("hour", 1),
        "minute": ("min", 1), "second": ("sec", 1),
    },
    "RXM-RAWX": {"tow": ("rcvTow", 1), "week": ("week", 1)},
    "NAV-RELPOSNED": {"version": ("version", 1), "itow": ("iTOW", 1), "heading": ("relPosHeading", 1e5)},
    "NAV-HPPOSLLH": {"itow": ("iTOW", 1), "h_acc": ("hAcc", 10), "v_acc": ("vAcc", 10)},
}  # fmt: skip
SIZES = {"NAV-PVT": 92, "NAV-COV": 64, "NAV-DOP": 18, "NAV-STATUS": 16, "NAV-TIMEGPS": 16, "NAV-TIMEUTC": 20,
         "RXM-RAWX": 16, "NAV-RELPOSNED": 64, "NAV-HPPOSLLH": 36}  # fmt: skip


@given(content=st.binary(min_size=92, max_size=92))
def test_fields__are_what_pyubx2_reads_of_any_payload(content: bytes) -> None:
    kinds = {name: kind for kind, name in UBX_NAMES.items()}
    for name, fields in FIELDS.items():
        payload = content[: SIZES[name]]
        if name == "RXM-RAWX":
            payload = payload[:11] + b"\0" + payload[12:]  # no measurements
        elif name == "NAV-RELPOSNED":
            payload = b"\1" + payload[1:]  # version 0 has another layout
        read = np.frombuffer(payload[: UBX_LAYOUTS[kinds[name]].itemsize], UBX_LAYOUTS[kinds[name]])[0]
        raw = frame(kinds[name], payload)
        oracle = pyubx2.UBXReader.parse(raw)
        assert oracle.identity == name
        for ours, (theirs, scale) in fields.items():
            value = getattr(oracle, theirs)
            assert np.isnan(value) == np.isnan(read[ours])
            assert np.isnan(value) or float(read[ours]) == pytest.approx(value * scale, rel=1e-9, abs=1e-6)


@given(content=st.binary(min_size=36, max_size=36))
def test_precise_position__is_what_pyubx2_reads_of_any_payload(content: bytes) -> None:
    hp = np.frombuffer(content, UBX_LAYOUTS[0x0114])[0]
    oracle = pyubx2.UBXReader.parse(frame(0x0114, content))
    assert hp["lon"] / 1e7 + hp["lon_hp"] / 1e9 == pytest.approx(oracle.lon, abs=1e-10)
    assert hp["lat"] / 1e7 + hp["lat_hp"] / 1e9 == pytest.approx(oracle.lat, abs=1e-10)
    assert hp["height"] + hp["height_hp"] / 10 == pytest.approx(oracle.height, abs=1e-3)
    assert hp["flags"] & 1 == oracle.invalidLlh


def test_names__are_those_of_pyubx2() -> None:
    own = {key: name for key, name in pyubx2.UBX_MSGIDS.items() if len(key) == 2 and key[0] < 0x66}
    assert {kind.to_bytes(2, "big"): name for kind, name in UBX_NAMES.items()} == own


def pvt(tow_ms: int, **fields: int) -> bytes:
    """A NAV-PVT of 2026-06-11 10:00:00 by pyubx2, with other fields."""
    stated = {"iTOW": tow_ms, "year": 2026, "month": 6, "day": 11, "hour": 10, "min": 0,
              "second": (tow_ms // 1000 - 18) % 60, "valid": 7, "nano": 0, "fixType": 3, "flags": 1, "numSV": 9,
              "lon": 1_400_000_000, "lat": 360_000_000,
              "height": 55_000, "hAcc": 20, "vAcc": 30, "gSpeed": 1500, "headMot": 9_000_000}  # fmt: skip
    payload = bytearray(92)
    places = {"iTOW": (0, "<I"), "year": (4, "<H"), "month": (6, "<B"), "day": (7, "<B"), "hour": (8, "<B"),
              "min": (9, "<B"), "second": (10, "<B"), "valid": (11, "<B"), "nano": (16, "<i"), "fixType": (20, "<B"),
              "flags": (21, "<B"), "numSV": (23, "<B"), "lon": (24, "<i"), "lat": (28, "<i"), "height": (32, "<i"),
              "hAcc": (40, "<I"), "vAcc": (44, "<I"), "gSpeed": (60, "<i"), "headMot": (64, "<i"),
              "flags3": (78, "<H")}  # fmt: skip
    for name, value in (stated | fields).items():
        struct.pack_into(places[name][1], payload, places[name][0], value)
    return frame(NAV_PVT, bytes(payload))


NOON_S = 1_781_172_000.0
"""2026-06-11 10:00:00 UTC, a Thursday; 381,618 s of the GPS week."""
TOW_MS = 381_618_000


@pytest.mark.parametrize(
    ("fields", "is_time"),
    [
        ({}, True),
        ({"valid": 6}, False),
        ({"valid": 5}, False),
        ({"valid": 3}, False),
        ({"hour": 23, "min": 59, "second": 60}, True),
        ({"hour": 24}, False),
        ({"min": 60}, False),
        ({"second": 61}, False),
        ({"day": 31}, False),
        ({"month": 13}, False),
        ({"year": 1979}, False),
    ],
)
def test_calendar__counts_where_it_is_valid_and_a_time(fields: dict[str, int], is_time: bool, tmp_path: Path) -> None:
    """Else it is the second of the week, in a week that is known otherwise."""
    off = {"second": 30} | fields
    log = pvt(TOW_MS) + pvt(TOW_MS + 2000, **off)
    (tmp_path / "log.ubx").write_bytes(log)
    track = track_of(tmp_path / "log.ubx")
    clock = {"hour": 10, "min": 0, "second": 30} | fields
    told_s = 3600.0 * (clock["hour"] - 10) + 60.0 * clock["min"] + clock["second"]
    assert track.t_s - NOON_S == pytest.approx([0.0, told_s if is_time else 2.0], abs=1e-6)


@pytest.mark.parametrize(
    ("fields", "fix"),
    [
        ({"fixType": 0}, None),
        ({"fixType": 1}, Fix.ESTIMATED),
        ({"fixType": 1, "flags3": 1}, None),
        ({"fixType": 2}, Fix.SINGLE),
        ({"fixType": 3, "flags": 3}, Fix.DGPS),
        ({"fixType": 3, "flags": 0x43}, Fix.FLOAT),
        ({"fixType": 3, "flags": 0x83}, Fix.FIXED),
        ({"fixType": 3, "flags": 0x82}, None),
        ({"fixType": 3, "flags": 0x83, "flags3": 1}, None),
        ({"fixType": 4}, Fix.SINGLE),
        ({"fixType": 5}, None),
    ],
)
def test_fix__with_an_invalid_position_or_outside_of_its_limits_is_none(
    fields: dict[str, int], fix: Fix | None, tmp_path: Path
) -> None:
    (tmp_path / "log.ubx").write_bytes(pvt(TOW_MS) + pvt(TOW_MS + 1000, **fields))
    assert track_of(tmp_path / "log.ubx").fix.tolist()[1:] == ([] if fix is None else [fix])


def test_fields__have_the_units_of_the_manual(tmp_path: Path) -> None:
    (tmp_path / "log.ubx").write_bytes(pvt(TOW_MS, nano=-250_000_000, headMot=-1_000_000, numSV=255))
    track = track_of(tmp_path / "log.ubx")
    assert track.t_s[0] == pytest.approx(NOON_S - 0.25, abs=1e-6)
    assert (track.lon_deg[0], track.lat_deg[0], track.height_m[0]) == (140.0, 36.0, 55.0)
    assert (track.sigma_e_m[0], track.sigma_n_m[0]) == pytest.approx((0.02 / np.sqrt(2.0),) * 2)
    assert (track.sigma_h_m[0], track.speed_mps[0]) == pytest.approx((0.03, 1.5))
    assert (track.course_deg[0], track.satellites[0]) == (pytest.approx(350.0), 255)
