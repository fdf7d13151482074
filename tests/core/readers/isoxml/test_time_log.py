"""Time logs: every record and value as packed, damage size, nothing else changed by it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from furrowmap.core.coverage.task_work import task_works
from furrowmap.core.readers.isoxml.time_log import EPOCH_S, TimeLog, read_header, read_time_log
from furrowmap.core.runtime.errors import InputError
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
    assert np.isfinite(log.lat_deg).tolist() == somewhere
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
    assert not np.isfinite(log.lat_deg).any()
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


def read(records: list[Record], letters: str = "ABD") -> TimeLog:
    return read_time_log(header(CHANNELS, letters), b"".join(record.pack() for record in records), "TLG00001")


@pytest.mark.parametrize(
    ("letter", "raw", "field", "value"),
    [
        ("C", 2**31 - 2, "up_m", (2**31 - 2) / 1000),
        ("C", 2**31 - 1, "up_m", np.nan),
        ("C", 2 - 2**31, "up_m", (2 - 2**31) / 1000),
        ("D", 8, "status", 8),
        ("D", 9, "status", -1),
        ("D", 14, "status", -1),
        ("F", 0, "hdop", 0.0),
        ("F", 0xFFFD, "hdop", 655.33),
        ("F", 0xFFFE, "hdop", np.nan),
        ("F", 0xFFFF, "hdop", np.nan),
        ("G", 0, "satellites", 0),
        ("G", 0xFD, "satellites", 253),
        ("G", 0xFE, "satellites", -1),
        ("G", 0xFF, "satellites", -1),
        ("I", 0, "gps_s", np.nan),
        ("I", 1, "gps_s", 315_532_800 + 86_400 + 3_723.5),
        ("I", 0xFFFD, "gps_s", 315_532_800 + 0xFFFD * 86_400 + 3_723.5),
        ("I", 0xFFFE, "gps_s", np.nan),
        ("I", 0xFFFF, "gps_s", np.nan),
    ],
)
def test_attributes__at_the_ends_of_their_ranges(letter: str, raw: int, field: str, value: float) -> None:
    """ISO 11783-10, table D.2: the last numbers of each type stand for an error or for what is not available."""
    stated = {"A": 500_000_000, "B": 90_000_000, "C": 1, "D": 4, "F": 1, "G": 1, "H": 3_723_500, "I": 1} | {letter: raw}
    found = read([Record(1000, 15_000, stated)], "ABCDFGHI")
    np.testing.assert_allclose(getattr(found, field), [value], rtol=1e-15)
    assert found.notices == ()


@pytest.mark.parametrize("letter", ["A", "B"])
@pytest.mark.parametrize("sign", [1, -1])
def test_positions__off_the_earth_are_damage_unless_they_stand_for_none(letter: str, sign: int) -> None:
    limit = {"A": 900_000_000, "B": 1_800_000_000}[letter]
    for raw, is_record, is_placed in (
        (limit, True, True),
        (limit + 1, False, False),
        (0x7FFFFFF0 - 1, False, False),
        (0x7FFFFFF0, True, False),
        (0x7FFFFFFF, True, False),
    ):
        one = Record(1000, 15_000, {"A": 1, "B": 1, "D": 4} | {letter: sign * raw})
        found = read([one])
        assert (len(found), np.isfinite(found.lat_deg).tolist()) == (int(is_record), [is_placed] * is_record)
        assert bool(found.notices) is not is_record


@pytest.mark.parametrize(
    ("second", "count"),
    [
        ((86_400_999, 15_000), 2),
        ((86_401_000, 15_000), 1),
        ((2000, 15_366), 2),
        ((2000, 14_634), 2),
        ((2000, 15_367), 1),
        ((2000, 14_633), 1),
    ],
)
def test_records__of_a_day_with_a_leap_second_within_a_year_of_each_other(second: tuple[int, int], count: int) -> None:
    position = {"A": 500_000_000, "B": 90_000_000, "D": 4}
    found = read([Record(1000, 15_000, position), Record(*second, position)])
    assert len(found) == count
    assert bool(found.notices) is (count == 1)


@pytest.mark.parametrize(("days_on", "kept"), [(0, 2), (1, 2), (2, 0)])
def test_damage__two_records_of_neighbouring_days_end_it(days_on: int, kept: int) -> None:
    position = {"A": 500_000_000, "B": 90_000_000, "D": 4}
    last_two = [Record(3000, 15_000, position), Record(4000, 15_000 + days_on, position)]
    records = [Record(1000, 15_000, position), Record(90_000_000, 15_000, position), *last_two]
    found = read(records)
    assert len(found) == 1 + kept
    size = len(records[0].pack())
    assert f"{size * (3 - kept)} of {4 * size} bytes in 1 place " in found.notices[0].text


def test_header__numbers_256_values_and_no_more() -> None:
    assert len(read_header(header([(67, "DET-1")] * 256), "TLG00001").channels) == 256
    with pytest.raises(InputError, match="257 values; at most 256") as refused:
        read_header(header([(67, "DET-1")] * 257), "TLG00001")
    assert refused.value.code == "time-log-header"


def test_values__of_a_number_that_the_header_does_not_have_are_damage() -> None:
    position = {"A": 500_000_000, "B": 90_000_000, "D": 4}
    assert len(read([Record(1000, 15_000, position, {len(CHANNELS) - 1: 5})])) == 1
    assert len(read([Record(1000, 15_000, position, {len(CHANNELS): 5})])) == 0


@pytest.mark.parametrize("day", [0, 1, 7305, 0xFFFF], ids=["1980", "1980-01-02", "2000-01-01", "not available"])
@pytest.mark.parametrize("first", [1, 5, 49])
def test_undated_records__cost_nothing_but_themselves(day: int, first: int) -> None:
    """Terminals write the first records before they know the date; the values in them hold on."""
    whole = drive(100)
    undated = [Record(1000 * k, day, r.position, r.values | {0: 3000}) for k, r in enumerate(whole[:first])]
    log = read_time_log(header(CHANNELS), b"".join(r.pack() for r in [*undated, *whole[first:]]), "TLG00001")
    alone = read_time_log(header(CHANNELS), b"".join(r.pack() for r in whole[first:]), "TLG00001")
    assert np.array_equal(log.clock_s, alone.clock_s)
    assert np.array_equal(log.lat_deg, alone.lat_deg)
    assert log.latest(0).tolist() == [3000.0] * (100 - first)
    assert np.array_equal(log.latest(1), alone.latest(1))
    assert [notice.code for notice in log.notices] == ["time-log-undated"]
    assert f"{first} of 100 records" in log.notices[0].text


def test_undated_records__of_a_whole_log_stay() -> None:
    records = [Record(1000 * k, 0, {"A": 500_000_000, "B": 100_000_000, "D": 4}) for k in range(10)]
    log = read_time_log(header(CHANNELS), b"".join(record.pack() for record in records), "TLG00001")
    assert log.clock_s.tolist() == [EPOCH_S + k for k in range(10)]
    assert log.notices == ()


@pytest.mark.parametrize(("folder", "records"), [("first1980", 119), ("first5_1980", 115), ("ok", 120)])
def test_undated_records__of_a_sample(folder: str, records: int, shared_data: Path) -> None:
    task = shared_data / "foreign" / "03-isoxml-first-date" / folder
    if not task.is_dir():
        pytest.skip("the sample inputs of other software are not beside this checkout")
    (work,) = task_works(task).works
    assert len(work.task.track) == records
    assert work.work.ground is not None
    assert work.work.ground.coverage.area == pytest.approx(3.0 * 2.0 * (records - 1), rel=0.02)
