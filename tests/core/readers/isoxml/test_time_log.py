"""Time logs: every record and value as packed, damage size, nothing else changed by it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from furrowmap.core.readers.isoxml.time_log import EPOCH_S, read_header, read_time_log
from furrowmap.core.values.errors import InputError
from tests.core.readers.isoxml.time_logs import Record, header

CHANNELS = [(67, "DET-1"), (141, "DET-1"), (116, "DET-2")]

records = st.builds(
    Record,
    ms=st.integers(0, 86_399_999),
    day=st.just(15_000) | st.just(15_001),
    position=st.fixed_dictionaries(
        {
            "A": st.integers(-900_000_000, 900_000_000),
            "B": st.integers(-1_800_000_000, 1_800_000_000),
            "C": st.integers(-500_000, 9_000_000),
            "D": st.integers(1, 8),
            "F": st.integers(0, 5_000),
            "G": st.integers(0, 60),
        }
    ),
    values=st.dictionaries(st.integers(0, len(CHANNELS) - 1), st.integers(-(2**31), 2**31 - 1), max_size=3),
)


@settings(max_examples=50)
@given(st.lists(records, min_size=1, max_size=20))
def test_log__gives_back_what_was_packed(packed: list[Record]) -> None:
    log = read_time_log(header(CHANNELS, "ABCDFG"), b"".join(record.pack() for record in packed), "TLG00001")
    assert log.notices == ()
    assert log.clock_s.tolist() == [EPOCH_S + 86_400 * r.day + r.ms / 1000 for r in packed]
    somewhere = [r.position["A"] != 0 or r.position["B"] != 0 for r in packed]
    assert log.placed.tolist() == somewhere
    assert np.allclose(
        log.lat_deg[somewhere], [r.position["A"] / 1e7 for r in packed if r.position["A"] or r.position["B"]]
    )
    assert np.allclose(log.up_m, [r.position["C"] / 1000 for r in packed])
    assert log.status.tolist() == [r.position["D"] for r in packed]
    assert np.allclose(log.hdop, [r.position["F"] / 100 for r in packed])
    assert log.satellites.tolist() == [r.position["G"] for r in packed]
    values = [(n, channel, value) for n, r in enumerate(packed) for channel, value in r.values.items()]
    assert list(zip(log.record.tolist(), log.channel.tolist(), log.value.tolist(), strict=True)) == values


@settings(max_examples=50)
@given(st.lists(records, min_size=1, max_size=12), st.data())
def test_latest__is_the_last_value_logged(packed: list[Record], data: st.DataObject) -> None:
    log = read_time_log(header(CHANNELS, "ABCDFG"), b"".join(record.pack() for record in packed), "TLG00001")
    channel = data.draw(st.integers(0, len(CHANNELS) - 1))
    expected, last = [], np.nan
    for record in packed:
        last = record.values.get(channel, last)
        expected.append(last)
    assert np.array_equal(log.latest(channel), expected, equal_nan=True)


def drive(count: int) -> list[Record]:
    return [
        Record(36_000_000 + 1000 * k, 15_000, {"A": 500_000_000 + 100 * k, "B": 100_000_000, "D": 4}, {1: k % 2})
        for k in range(count)
    ]


@pytest.mark.parametrize("lost", [1, 3, 7])
def test_damage__costs_a_few_records_and_is_reported(lost: int) -> None:
    whole = [record.pack() for record in drive(100)]
    head = b"".join(whole[:50])
    data = head[:-lost] + b"".join(whole[50:])
    log = read_time_log(header(CHANNELS), data, "TLG00001")
    assert [notice.code for notice in log.notices] == ["time-log-damaged"]
    assert 96 <= len(log) <= 99
    assert np.all(np.diff(log.clock_s) >= 1.0)
    assert log.lat_deg[-1] == pytest.approx(50.0 + 99e-5)


def test_damage__a_log_cut_short_keeps_its_whole_records() -> None:
    data = b"".join(record.pack() for record in drive(10))
    log = read_time_log(header(CHANNELS), data[:-3], "TLG00001")
    assert len(log) == 9
    assert "are not records" in log.notices[0].text


@settings(max_examples=50)
@given(st.binary(max_size=600))
def test_noise__never_gives_more_than_it_holds(noise: bytes) -> None:
    log = read_time_log(header(CHANNELS), noise, "TLG00001")
    size = sum(len(one.value[one.record == k]) * 5 + 16 for one in (log,) for k in range(len(log)))
    assert size <= len(noise)
    assert size == len(noise) or log.notices
    assert np.all(log.channel < len(CHANNELS))


def test_positions_that_are_none__are_no_positions() -> None:
    nowhere = [(0x7FFFFFFF, 0x7FFFFFFF), (0, 0), (-0x7FFFFFFF, 100)]
    data = b"".join(Record(1000 * k, 15_000, {"A": a, "B": b, "D": 15}).pack() for k, (a, b) in enumerate(nowhere))
    no_fix = Record(9000, 15_000, {"A": 500_000_000, "B": 1, "D": 0}).pack()
    log = read_time_log(header(CHANNELS), data + no_fix, "TLG00001")
    assert len(log) == 4
    assert not log.placed.any()
    assert log.status.tolist() == [-1, -1, -1, 0]


def test_header__attributes_with_a_value_are_not_in_the_records() -> None:
    data = Record(1000, 15_000, {"A": 500_000_000, "B": 90_000_000}).pack()
    log = read_time_log(header(CHANNELS, "AB", {"D": "4", "F": "80"}), data, "TLG00001")
    assert (log.status.tolist(), log.hdop.tolist()) == ([4], [0.8])


@pytest.mark.parametrize(
    ("text", "code"),
    [
        (b"<TIM A='' D='4'><PTN A='' B=''/>", "xml-damaged"),
        (b"<TIM A='' D='4'/>", "time-log-header"),
        (b"<TIM A='' D='4'><PTN A='' B=''/><DLV A='XYZ' C='DET-1'/></TIM>", "time-log-header"),
        (b"<!DOCTYPE a [<!ENTITY b 'c'>]><TIM><PTN A='' B=''/></TIM>", "xml-hostile"),
        (b"<a>" * 100 + b"</a>" * 100, "xml-hostile"),
    ],
)
def test_header__of_another_kind_is_refused(text: bytes, code: str) -> None:
    with pytest.raises(InputError) as error:
        read_header(text, "TLG00001")
    assert error.value.code == code
    assert all(error.value.lines)


def test_broken_headers__of_the_samples(shared_data: Path) -> None:
    """Five are whole; the third lacks its end, and the error says where."""
    folder = shared_data / "isoxml" / "hostile" / "broken_headers"
    codes = {}
    for path in sorted(folder.glob("*.xml")):
        try:
            codes[path.stem] = len(read_header(path.read_bytes(), path.stem).channels)
        except InputError as error:
            codes[path.stem] = error.what
    damaged = codes.pop("TLG00003")
    assert "TLG00003.xml, line 30" in str(damaged)
    assert set(codes.values()) == {26}
