"""Trimble logs: values of the records in the tests of Trimble's own driver, pages of transmissions, damage."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest

from furrowmap.core.readers.gsof import GsofLog
from furrowmap.core.readers.reader import ReadOptions, Recognised
from furrowmap.core.runtime.errors import InputError
from furrowmap.core.values.clock import GPS_EPOCH_S, WEEK_S
from furrowmap.core.values.gnss import Fix


def packet(content: bytes, kind: int = 0x40) -> bytes:
    """A packet of the Data Collector Format."""
    body = bytes([0x28, kind, len(content)]) + content
    return b"\x02" + body + bytes([sum(body) & 0xFF, 3])


def transmission(records: bytes, number: int = 1, page_bytes: int = 244) -> list[bytes]:
    """The packets of a transmission."""
    parts = [records[k : k + page_bytes] for k in range(0, len(records), page_bytes)]
    return [packet(bytes([number, k, len(parts) - 1]) + part) for k, part in enumerate(parts)]


def record(kind: int, form: str, *values: object) -> bytes:
    content = struct.pack(f">{form}", *values)
    return bytes([kind, len(content)]) + content


def epoch(
    k: int = 0, solution: int = 7, flags: int = 0xAF, lat: float = 0.7654321, week: int = 2225, mode: int = 3
) -> bytes:
    """The records of an epoch; the values of the first are those in the tests of Trimble's driver."""
    return (
        record(1, "IH4B", 162117007 + 1000 * k, week, 25, flags, solution, 0)
        + record(2, "3d", lat, -1.3876543, 168.25)
        + record(3, "3d", 848942.99, -4527384.15, 4397104.0)
        + record(8, "B3f", 5, 0.597169, 2.062232, -0.0006348496)
        + record(9, "4f", 0.9000375, 0.488651454, 0.7558355, 1.13949406)
        + record(11, "8fH", *range(8), 0)
        + record(12, "9fH", 0.001, 0.200461134, 0.0194671229, -0.0003, 0.0169321168, 0.2, 0.02, 90.4, 1.0, 0)
        + record(27, "I4B4dH7f", 162117007 + 1000 * k, 0b1111, 20, mode, 0, 0.01, -1.5, 0.02, 1.5, 9, *range(7))
        + record(38, "f2Bf2B", 1.5, 2, 0, 1.25, 0, 0)
    )


def log_of(folder: Path, content: bytes) -> GsofLog:
    path = folder / "drive.gsof"
    path.write_bytes(content)
    return GsofLog([path], ReadOptions())


def test_track__has_the_values_of_the_records(tmp_path: Path) -> None:
    pages = transmission(epoch())
    assert len(pages) == 2
    log = log_of(tmp_path, b"".join([*pages, packet(bytes(20), 0x57), *transmission(epoch(1), 2)]))
    assert Recognised.by_content(log.paths[0]).reader is GsofLog
    track = log.track()
    assert log.notices == []
    assert track.t_s - GPS_EPOCH_S == pytest.approx(2225 * WEEK_S + 162117.007 + np.arange(2) - 18, abs=1e-6)
    assert (track.lat_deg[0], track.lon_deg[0]) == pytest.approx(np.degrees((0.7654321, -1.3876543)), abs=1e-12)
    assert (track.height_m[0], track.fix[0], track.satellites[0]) == (168.25, Fix.FIXED, 25)
    sigmas = (track.sigma_e_m[0], track.sigma_n_m[0], track.sigma_h_m[0])
    assert sigmas == pytest.approx((0.200461134, 0.0194671229, 0.0169321168))
    assert (track.speed_mps[0], track.course_deg[0]) == pytest.approx((0.597169, np.degrees(2.062232)))
    assert (track.heading_deg[0], track.hdop[0], track.age_s[0]) == pytest.approx(
        (360 - np.degrees(1.5), 0.48865145, 1.25)
    )
    assert np.isnan(log_of(tmp_path, b"".join(transmission(epoch(mode=2)))).track().heading_deg[0])  # ambiguities float
    facts = log_of(tmp_path, b"".join([*pages, packet(bytes(20), 0x57), *transmission(epoch(1), 2)])).inspect().facts
    assert (facts["messages"]["position sigma"], facts["messages"]["packet 57"], facts["epochs"]) == (2, 1, 2)


@pytest.mark.parametrize(
    ("solution", "network", "fix"),
    [(0, 0, Fix.SINGLE), (4, 0, Fix.DGPS), (1, 0, Fix.DGPS), (3, 0, Fix.FLOAT), (7, 0, Fix.FIXED), (11, 0, Fix.PPP),
     (3, 64, Fix.PPP)],
)  # fmt: skip
def test_fix__by_the_flags_of_the_solution(solution: int, network: int, fix: Fix, tmp_path: Path) -> None:
    records = epoch(0, solution).replace(record(38, "f2Bf2B", 1.5, 2, 0, 1.25, 0, 0), b"")
    records += record(38, "f2Bf2B", 1.5, 2, 0, 1.25, network, 0)
    assert log_of(tmp_path, b"".join(transmission(records))).track().fix.tolist() == [fix]


def test_epochs__without_a_position_or_a_time_and_damage(tmp_path: Path) -> None:
    parts = [
        b"".join(transmission(content, k))
        for k, content in enumerate(
            (
                epoch(0),
                epoch(1, flags=0xAE),
                epoch(2, lat=9.0),
                epoch(3, week=0),
                record(1, "IH4B", 0, 2225, 0, 0, 0, 0),
            )
        )
    ]
    first_page_lost = transmission(epoch(5), 9)[1]
    wrong_sum = bytearray(transmission(epoch(6), 10)[0])
    wrong_sum[50] ^= 1
    two = b"".join(transmission(epoch(7), 11))
    log = log_of(tmp_path, b"noise" + b"".join(parts) + first_page_lost + bytes(wrong_sum) + two + two[:100])
    assert len(log.track()) == 2
    facts = log.inspect().facts
    assert (facts["epochs_without_position"], facts["bad_checksums"], facts["cut"]) == (3, 2, 1)
    assert [notice.code for notice in log.notices] == ["messages-damaged"]
    path = log_of(tmp_path, b"".join(transmission(epoch(0, flags=0)))).paths[0]
    with pytest.raises(InputError, match="none of its 1 records of positions") as caught:
        GsofLog([path], ReadOptions()).track()
    assert caught.value.code == "no-positions"
    path = log_of(tmp_path, b"".join(transmission(record(9, "4f", 1, 1, 1, 1), k)[0] for k in range(5))).paths[0]
    with pytest.raises(InputError, match="there are PDOP") as caught:
        Recognised.by_content(path).open().track()  # type: ignore[attr-defined]
    assert all(line.strip() for line in caught.value.lines)


def test_pieces__of_a_stream_are_joined(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    content = b"".join(b"".join(transmission(epoch(k), k)) for k in range(20))
    whole = log_of(tmp_path, content).track()
    monkeypatch.setattr("furrowmap.core.readers.framed_messages.MESSAGE_CHUNK_BYTES", 37)
    log = log_of(tmp_path, content)
    np.testing.assert_array_equal(log.track().t_s, whole.t_s)
    assert (len(whole), log.notices) == (20, [])
