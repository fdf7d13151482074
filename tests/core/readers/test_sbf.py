"""SBF logs: what the samples hold, agreement with pysbf2, and laws of the blocks."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pysbf2
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pyproj import Transformer

from furrowmap.core.readers.framed_messages import MessageCounts, find_frames, read_messages
from furrowmap.core.readers.reader import ReadOptions
from furrowmap.core.readers.sbf.log import SBF, SBF_LAYOUTS, SBF_NAMES, SbfLog
from furrowmap.core.readers.source import Head, Source
from furrowmap.core.runtime.errors import InputError
from furrowmap.core.values.clock import GPS_EPOCH_S, WEEK_S
from furrowmap.core.values.gnss import Fix, GnssTrack

LEAP_S = 18
WITH_POSITIONS = {
    "sbfdata.sbf": 58, "x5pvt.sbf": 16, "x5_pvtgeod.sbf": 1, "x5_pvttruncated.sbf": 1, "mixed.sbf": 1,
    "x5_pvtcart.sbf": 1,
}  # fmt: skip


def track_of(path: Path) -> GnssTrack:
    return SbfLog([path], ReadOptions()).track()


def block(number: int, body: bytes, revision: int = 0) -> bytes:
    """A block; its CRC by pysbf2."""
    body += b"\0" * (-len(body) % 4)
    rest = struct.pack("<HH", number | revision << 13, 8 + len(body)) + body
    return b"$@" + pysbf2.calc_crc(rest).to_bytes(2, "little") + rest


def pvt(tow_ms: int, mode: int = 4, error: int = 0, lat_deg: float = 36.0, week: int = 2400) -> bytes:
    """A PVTGeodetic of revision 2."""
    body = struct.pack("<IHBB3d5fdf3BBHHIBBHHHHB", tow_ms, week, mode, error, np.radians(lat_deg), np.radians(140.0),
                       55.5, 40.0, 0.6, 0.8, 0.0, 53.13, 0.0, 0.0, 0, 0, 20, 0, 7, 150, 0, 0, 1, 0,
                       0, 5, 7, 0)  # fmt: skip
    return block(4007, body, revision=2)


@pytest.mark.parametrize("name", WITH_POSITIONS)
def test_track__is_what_pysbf2_reads(name: str, shared_data: Path) -> None:
    path = shared_data / "gnss/sbf" / name
    with path.open("rb") as stream:
        parsed = [message for _, message in pysbf2.SBFReader(stream, protfilter=2, quitonerror=0)]
    positions = [m for m in parsed if m.identity in ("PVTGeodetic", "PVTCartesian")]
    covariances = {m.TOW: m for m in parsed if m.identity in ("PosCovGeodetic", "PosCovCartesian")}
    to_geodetic = Transformer.from_crs("EPSG:4978", "EPSG:4979", always_xy=True)
    track = track_of(path)
    assert len(track) == len(positions) == WITH_POSITIONS[name]
    for k, m in enumerate(positions):
        if m.identity == "PVTGeodetic":
            lon, lat, height = np.degrees(m.Longitude), np.degrees(m.Latitude), m.Height
        else:
            lon, lat, height = to_geodetic.transform(m.X, m.Y, m.Z)
        assert (track.lon_deg[k], track.lat_deg[k]) == pytest.approx((lon, lat), abs=1e-11)
        assert track.height_m[k] == pytest.approx(height, abs=1e-6)
        assert track.satellites[k] == m.NrSV
        cov = covariances.get(m.TOW)
        if cov is None:
            assert np.isnan(track.sigma_e_m[k])
            continue
        stated = track.sigma_e_m[k] ** 2 + track.sigma_n_m[k] ** 2 + track.sigma_h_m[k] ** 2
        names = ("latlat", "lonlon", "hgthgt") if m.identity == "PVTGeodetic" else ("xx", "yy", "zz")
        assert stated == pytest.approx(sum(getattr(cov, f"Cov_{n}") for n in names), rel=1e-5)
        # The receiver states its vertical accuracy twice: as two sigmas, rounded to a centimetre.
        assert 2.0 * track.sigma_h_m[k] == pytest.approx(m.VAccuracy, abs=0.011)


def test_inspect__reports_times_and_fixes(shared_data: Path) -> None:
    facts = SbfLog([shared_data / "gnss/sbf/sbfdata.sbf"], ReadOptions()).inspect().facts
    assert facts["blocks"] == {"PVTCartesian": 58, "PosCovCartesian": 58, "VelCovCartesian": 58, "BaseVectorCart": 58}
    assert facts["epochs_by_fix"] == {"single": 58}
    assert facts["solutions"] == {"stand-alone": 58}
    track = track_of(shared_data / "gnss/sbf/sbfdata.sbf")
    assert track.t_s[[0, -1]] - GPS_EPOCH_S - 2367 * WEEK_S + LEAP_S == pytest.approx([218303, 218360])
    assert np.median(track.satellites) == 15
    geodetic = track_of(shared_data / "gnss/sbf/x5_pvtgeod.sbf")
    assert (geodetic.lat_deg[0], geodetic.lon_deg[0]) == pytest.approx((53.344053, -2.246687), abs=2e-6)
    assert geodetic.fix.tolist() == [Fix.DGPS]
    assert geodetic.service == "sbas"
    assert geodetic.age_s[0] == pytest.approx(2.78)


def test_logs_without_positions__say_so(shared_data: Path) -> None:
    folder = shared_data / "gnss/sbf"
    for path in sorted(set(folder.iterdir()) - {folder / name for name in WITH_POSITIONS}):
        with pytest.raises(InputError, match=path.name) as error:
            track_of(path)
        assert error.value.code == "no-positions"


def test_heading__is_of_two_antennas_at_the_same_time(tmp_path: Path) -> None:
    def attitude(tow_ms: int, mode: int, error: int, heading: float) -> bytes:
        return block(5938, struct.pack("<IHBBHBB6f", tow_ms, 2400, 20, error, mode, 0, 0, heading, 1, 2, 0, 0, 0))

    log = [pvt(1000 * k) for k in range(5)]
    log += [
        attitude(0, 4, 0, 90.5),
        attitude(1000, 0, 0, 91.0),
        attitude(2000, 4, 1, 92.0),
        attitude(3000, 2, 0, -2e10),
    ]
    (tmp_path / "log.sbf").write_bytes(b"".join(log))
    track = track_of(tmp_path / "log.sbf")
    np.testing.assert_array_equal(track.heading_deg, [90.5, np.nan, np.nan, np.nan, np.nan])
    assert track.speed_mps == pytest.approx(1.0)
    assert track.age_s == pytest.approx(1.5)


def test_quality__goes_by_type_and_error(tmp_path: Path) -> None:
    kinds = [(0, 0, None), (1, 0, Fix.SINGLE), (2, 0, Fix.DGPS), (4, 0, Fix.FIXED), (4, 3, None), (5, 0, Fix.FLOAT),
             (6, 0, Fix.DGPS), (7, 0, Fix.FIXED), (8, 0, Fix.FLOAT), (10, 0, Fix.PPP), (13, 0, None)]  # fmt: skip
    (tmp_path / "log.sbf").write_bytes(b"".join(pvt(1000 * k, m, e) for k, (m, e, _) in enumerate(kinds)))
    assert track_of(tmp_path / "log.sbf").fix.tolist() == [fix for *_, fix in kinds if fix is not None]


def test_nothing_stated__is_no_position(tmp_path: Path) -> None:
    log = [pvt(0), pvt(1000, week=0xFFFF), pvt(0xFFFFFFFF), pvt(2000, lat_deg=float(np.degrees(-2e10))), pvt(3000)]
    (tmp_path / "log.sbf").write_bytes(b"".join(log))
    track = track_of(tmp_path / "log.sbf")
    assert np.diff(track.t_s).tolist() == [3.0]


def test_two_receivers_in_one_log__are_refused(tmp_path: Path) -> None:
    log = [pvt(100 * k, lat_deg=lat) for k in range(50) for lat in (36.0, 36.001)]
    (tmp_path / "two.sbf").write_bytes(b"".join(log))
    with pytest.raises(InputError) as error:
        track_of(tmp_path / "two.sbf")
    assert error.value.code == "receivers-interleaved"


@given(
    parts=st.lists(st.one_of(st.tuples(st.integers(0, 0x1FFF), st.binary(max_size=40)), st.binary(max_size=30))),
    cuts=st.lists(st.integers(0, 600)),
)
def test_blocks__are_found_whatever_stands_between_and_wherever_the_stream_is_cut(
    parts: list[tuple[int, bytes] | bytes], cuts: list[int]
) -> None:
    stream = b"".join(block(*part) if isinstance(part, tuple) else part.replace(b"$", b"\0") for part in parts)
    found: list[bytes] = []
    rest = b""
    edges = sorted({min(cut, len(stream)) for cut in cuts} | {len(stream)})
    for begin, end in zip([0, *edges], [*edges, len(stream)], strict=True):
        rest += stream[begin:end]
        piece = find_frames(np.frombuffer(rest, np.uint8), SBF, last=begin == end)
        found += [rest[at : at + size] for at, size in zip(piece.at.tolist(), piece.length.tolist(), strict=True)]
        rest = rest[piece.used :]
    assert found == [block(*part) for part in parts if isinstance(part, tuple)]


def test_blocks__that_claim_much_are_not_read_over_and_over(tmp_path: Path) -> None:
    """A block at every eighth byte, each claiming 32 kB: were each read through, these 4 MB would take minutes."""
    (tmp_path / "hostile").write_bytes(b"$@\x12\x34\xa7\x4f\xfc\x7f" * 500_000)
    counts = MessageCounts[int]()
    with Source(tmp_path / "hostile") as source:
        read_messages(source, SBF, {}, counts)
    assert (counts.intact, counts.bad + counts.cut) == (0, 500_000)


_STAMP = {"tow": ("TOW", 1), "week": ("WNc", 1)}
_PVT = _STAMP | {"error": ("Error", 1), "course": ("COG", 1), "satellites": ("NrSV", 1), "age": ("MeanCorrAge", 100)}
FIELDS = {  # ours, and pysbf2's: name and scale
    "PVTGeodetic": _PVT | {
        "lat": ("Latitude", 1), "lon": ("Longitude", 1), "height": ("Height", 1), "vn": ("Vn", 1), "ve": ("Ve", 1),
    },
    "PVTCartesian": _PVT | {name.lower(): (name, 1) for name in ("X", "Y", "Z", "Vx", "Vy", "Vz")},
    "PosCovGeodetic": _STAMP | {
        "error": ("Error", 1), "nn": ("Cov_latlat", 1), "ee": ("Cov_lonlon", 1), "hh": ("Cov_hgthgt", 1),
    },
    "PosCovCartesian": _STAMP | {
        "error": ("Error", 1), **{name: (f"Cov_{name}", 1) for name in ("xx", "yy", "zz", "xy", "xz", "yz")},
    },
    "AttEuler": _STAMP | {"error": ("Error", 1), "mode": ("Mode", 1), "heading": ("Heading", 1)},
    "DOP": _STAMP | {"hdop": ("HDOP", 100)},
}  # fmt: skip
SIZES = {"PVTGeodetic": 88, "PVTCartesian": 88, "PosCovGeodetic": 48, "PosCovCartesian": 48, "AttEuler": 36, "DOP": 24}


@given(content=st.binary(min_size=88, max_size=88))
def test_fields__are_what_pysbf2_reads_of_any_block(content: bytes) -> None:
    numbers = {name: number for number, name in SBF_NAMES.items()}
    for name, fields in FIELDS.items():
        raw = block(numbers[name], content[: SIZES[name]])
        read = np.frombuffer(raw[: SBF_LAYOUTS[numbers[name]].itemsize], SBF_LAYOUTS[numbers[name]])[0]
        oracle = pysbf2.SBFReader.parse(raw)
        assert oracle.identity == name
        for ours, (theirs, scale) in fields.items():
            value = getattr(oracle, theirs)
            assert np.isnan(value) == np.isnan(read[ours])
            assert np.isnan(value) or float(read[ours]) == pytest.approx(value * scale, rel=1e-9, abs=1e-6)


def test_names__are_those_of_pysbf2() -> None:
    assert {number: name for number, (name, *_) in pysbf2.SBF_MSGIDS.items()} == SBF_NAMES


def test_times__are_within_a_week_that_is_stated(tmp_path: Path) -> None:
    last_ms = 604_800_000
    (tmp_path / "log.sbf").write_bytes(b"".join([pvt(last_ms - 1), pvt(last_ms), pvt(0, week=0xFFFE)]))
    facts = SbfLog([tmp_path / "log.sbf"], ReadOptions()).inspect().facts
    assert (facts["epochs"], facts["epochs_without_position"]) == (2, 1)


@pytest.mark.parametrize(
    ("at", "layout", "raw", "column", "value"),
    [
        (74, "<B", 0, "satellites", 0),
        (74, "<B", 254, "satellites", 254),
        (74, "<B", 255, "satellites", -1),
        (78, "<H", 0, "age_s", 0.0),
        (78, "<H", 0xFFFE, "age_s", 655.34),
        (78, "<H", 0xFFFF, "age_s", np.nan),
        (56, "<f", -90.0, "course_deg", 270.0),
        (56, "<f", 360.0, "course_deg", 0.0),
        (56, "<f", -2e10, "course_deg", np.nan),
        (32, "<d", -2e10, "height_m", np.nan),
        (32, "<d", -400.0, "height_m", -400.0),
        (44, "<f", -2e10, "speed_mps", np.nan),
        (48, "<f", -2e10, "speed_mps", np.nan),
    ],
)
def test_fields__that_are_not_stated_are_unknown(
    at: int, layout: str, raw: float, column: str, value: float, tmp_path: Path
) -> None:
    """SBF reference guide, "Do-Not-Use" values."""
    body = bytearray(pvt(0)[8:])
    struct.pack_into(layout, body, at - 8, raw)
    (tmp_path / "log.sbf").write_bytes(block(4007, bytes(body), revision=2))
    np.testing.assert_allclose(getattr(track_of(tmp_path / "log.sbf"), column), [value], rtol=1e-6)


def test_covariances_and_dilution__of_the_same_time_without_an_error(tmp_path: Path) -> None:
    def covariance(tow_ms: int, error: int, *values: float) -> bytes:
        return block(5906, struct.pack("<IHBB3f", tow_ms, 2400, 4, error, *values) + b"\0" * 28)

    def dilution(tow_ms: int, hundredths: int) -> bytes:
        return block(4001, struct.pack("<IHBBHHHH2f", tow_ms, 2400, 9, 0, 0, 0, hundredths, 0, 0.0, 0.0))

    log = [pvt(1000 * k) for k in range(4)]
    log += [covariance(0, 0, 0.01, 0.04, 0.09), covariance(1000, 1, 1, 1, 1), covariance(2000, 0, -1.0, -2e10, 0.0)]
    log += [dilution(0, 125), dilution(1000, 0), dilution(9000, 125)]
    (tmp_path / "log.sbf").write_bytes(b"".join(log))
    track = track_of(tmp_path / "log.sbf")
    nan = np.nan
    np.testing.assert_allclose(track.sigma_n_m, [0.1, nan, nan, nan], rtol=1e-6)
    np.testing.assert_allclose(track.sigma_e_m, [0.2, nan, nan, nan], rtol=1e-6)
    np.testing.assert_allclose(track.sigma_h_m, [0.3, nan, 0.0, nan], rtol=1e-6)
    np.testing.assert_allclose(track.hdop, [1.25, nan, nan, nan])


def test_positions__of_two_dimensions_and_of_sbas_are_told(tmp_path: Path) -> None:
    for modes, codes, service in (((4, 4, 4), [], ""), ((4, 132, 4), ["positions-2d"], ""), ((6, 6, 1), [], "sbas"),
                                  ((6, 1), [], "")):  # fmt: skip
        (tmp_path / "log.sbf").write_bytes(b"".join(pvt(1000 * k, mode) for k, mode in enumerate(modes)))
        reader = SbfLog([tmp_path / "log.sbf"], ReadOptions())
        assert reader.track().service == service
        assert [notice.code for notice in reader.notices] == codes
        assert all("1 position is a 2D fix" in notice.text for notice in reader.notices)


@pytest.mark.parametrize(
    ("blocks", "others", "certainty"),
    [
        ([4007], 0, 0.95),
        ([4006], 0, 0.95),
        ([4007], 9000, 0.95),
        ([4027], 0, 0.3),
        ([4027], 98, 0.3),
        ([4027], 4800, 0.3),
        ([4027], 5100, 0.0),
        ([], 500, 0.0),
    ],
)
def test_recognise__by_positions_or_by_a_fiftieth_of_whole_blocks(
    blocks: list[int], others: int, certainty: float
) -> None:
    """A block here has 100 bytes."""
    content = b"".join(block(number, b"\0" * 92) for number in blocks) + b"\0" * others
    assert SbfLog.recognise(Head(Path(), content, "", ".bin")) == certainty
