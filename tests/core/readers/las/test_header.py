"""Headers of LAS files: both sides of what is accepted, and the meaning of times."""

from __future__ import annotations

import datetime as dt
import struct
from dataclasses import replace
from pathlib import Path

import laspy
import numpy as np
import pytest

from furrowmap.core.readers.las.header import LasHeader, read_header
from furrowmap.core.readers.las.point_records import TimeKind, clock_of
from furrowmap.core.runtime.errors import InputError
from furrowmap.core.values.clock import las_time_to_utc

SIZES = {0: 227, 1: 227, 2: 227, 3: 235, 4: 375}
"""Bytes of the header by minor version (LAS 1.0 to 1.4, "header size")."""


def packed(version: int = 4, kind: int = 6, **fields: object) -> bytes:
    """A header by the specification's table, with room of 100 bytes behind it."""
    stated = {
        "encoding": 0, "day": 150, "year": 2020, "size": SIZES[version], "offset": SIZES[version],
        "record_bytes": laspy.PointFormat(kind).size if kind <= 10 else 100, "legacy": 0, "points": 7,
        "scale": (0.001, 0.002, 0.003), "shift": (1.0, 2.0, 3.0), "major": 1, "minor": version,
    } | fields  # fmt: skip
    head = b"LASF" + struct.pack("<HH16sBB", 1, stated["encoding"], b"", stated["major"], stated["minor"])
    head += struct.pack("<32s32sHHHII", b"system", b"software", stated["day"], stated["year"], stated["size"],
                        stated["offset"], 3)  # fmt: skip
    head += struct.pack("<BHI5I", kind, stated["record_bytes"], stated["legacy"], 11, 12, 13, 14, 15)
    head += struct.pack("<12d", *stated["scale"], *stated["shift"], 40.0, 10.0, 50.0, 20.0, 60.0, 30.0)
    if version >= 3:
        head += struct.pack("<Q", 9000)
    if version >= 4:
        head += struct.pack("<QIQ15Q", 8000, 2, stated["points"], *range(21, 36))
    assert len(head) == SIZES[version]
    return head + b"\0" * 100


def read(version: int = 4, kind: int = 6, **fields: object) -> LasHeader:
    data = packed(version, kind, **fields)
    return read_header(Path("a.las"), data, len(data))


def refusal(version: int = 4, kind: int = 6, **fields: object) -> str:
    """The byte that the error names."""
    with pytest.raises(InputError, match=r"a\.las, byte \d+: ") as error:
        read(version, kind, **fields)
    return error.value.what.partition(": ")[0].removeprefix("a.las, ")


def test_fields__are_those_of_the_specification() -> None:
    found = read(encoding=17)
    assert (found.version, found.system, found.software, found.records) == (4, "system", "software", 3)
    assert found.created == dt.date(2020, 5, 29)
    assert (found.scale, found.shift) == ((0.001, 0.002, 0.003), (1.0, 2.0, 3.0))
    assert (found.low, found.high) == ((10.0, 20.0, 30.0), (40.0, 50.0, 60.0))
    assert (found.points, found.by_return) == (7, tuple(range(21, 36)))
    assert (found.waveforms_at, found.extended_at, found.extended) == (9000, 8000, 2)
    assert (found.is_standard_time, found.crs_is_wkt, found.has_time, found.compressed) == (True, True, True, False)
    assert (read(encoding=1).crs_is_wkt, read(encoding=16).is_standard_time) == (False, False)
    old = read(3, 1, legacy=9)
    assert (old.points, old.by_return, old.waveforms_at, old.extended) == (9, (11, 12, 13, 14, 15), 9000, 0)
    assert read(2, 1, legacy=9).waveforms_at == 0
    assert [read(2, kind, legacy=9).has_time for kind in range(4)] == [False, True, False, True]


def test_points__of_the_wide_field_count_and_of_the_old_one_where_it_is_zero() -> None:
    for legacy, points, counted, codes in (
        (0, 7, 7, []), (7, 7, 7, []), (9, 7, 7, ["legacy-count"]), (9, 0, 9, ["legacy-count"]), (0, 0, 0, []),
    ):  # fmt: skip
        found = read(legacy=legacy, points=points)
        assert found.points == counted
        assert found.by_return == (tuple(range(21, 36)) if points else (11, 12, 13, 14, 15))
        assert [notice.code for notice in found.notices] == codes


@pytest.mark.parametrize("version", SIZES)
def test_layout__of_each_version(version: int) -> None:
    kind, size = (6 if version == 4 else 1), SIZES[version]
    assert read(version, kind).header_bytes == size
    assert refusal(version, kind, size=size - 1) == "byte 94"
    assert read(version, kind, size=size + 5, offset=size + 5).header_bytes == size + 5
    assert refusal(version, kind, size=size + 5, offset=size + 4) == "byte 96"
    assert read(version, kind, offset=size + 100).offset == size + 100
    assert refusal(version, kind, offset=size + 101) == "byte 96"
    data = packed(version, kind)
    assert read_header(Path("a.las"), data[:size], size + 100).version == version
    with pytest.raises(InputError, match=f"of {size} bytes") as cut:
        read_header(Path("a.las"), data[: size - 1], size - 1)
    assert cut.value.code == "las-header"


@pytest.mark.parametrize(("major", "minor"), [(0, 2), (2, 0), (1, 5)])
def test_version__is_1_0_to_1_4(major: int, minor: int) -> None:
    assert refusal(major=major, minor=minor) == "byte 24"


@pytest.mark.parametrize("kind", range(11))
def test_records__have_at_least_the_bytes_of_their_format(kind: int) -> None:
    """By laspy's tables; bit 7 marks compression."""
    size = laspy.PointFormat(kind).size
    assert read(kind=kind, record_bytes=size).record_bytes == size
    assert refusal(kind=kind, record_bytes=size - 1) == "byte 105"
    found = read(kind=kind | 0x80, record_bytes=size)
    assert (found.point_format, found.compressed) == (kind, True)


def test_records__of_format_11_are_unknown() -> None:
    assert refusal(kind=11) == "byte 104"
    assert refusal(kind=11 | 0x80) == "byte 104"


@pytest.mark.parametrize("axis", range(3))
def test_scales_and_offsets__are_those_of_coordinates(axis: int) -> None:
    def changed(scale: float, shift: float) -> dict[str, tuple[float, ...]]:
        steps, starts = [0.001] * 3, [0.0] * 3
        steps[axis], starts[axis] = scale, shift
        return {"scale": tuple(steps), "shift": tuple(starts)}

    for good in ((1e-12, 0.0), (0.01, 9.9e12), (0.01, -9.9e12), (4000.0, 0.0)):
        assert read(**changed(*good)).scale[axis] == good[0]
    for bad in ((0.9e-12, 0.0), (0.0, 0.0), (-0.01, 0.0), (0.01, 1.1e13), (0.01, -1.1e13), (5000.0, 0.0),
                (np.nan, 0.0), (0.01, np.nan), (np.inf, 0.0), (0.01, np.inf)):  # fmt: skip
        assert refusal(**changed(*bad)) == f"byte {131 + 8 * axis}"


def test_date_of_creation__is_a_day_since_1990() -> None:
    this_year = dt.datetime.now(dt.UTC).year
    for year, day, created in (
        (1990, 1, dt.date(1990, 1, 1)), (1989, 365, None), (2024, 366, dt.date(2024, 12, 31)),
        (2023, 365, dt.date(2023, 12, 31)), (2023, 366, None), (2023, 367, None), (2023, 0, None),
        (this_year + 1, 1, dt.date(this_year + 1, 1, 1)), (this_year + 2, 1, None),
    ):  # fmt: skip
        found = read(year=year, day=day)
        assert found.created == created
        assert [notice.code for notice in found.notices] == ([] if created else ["creation-date"])
    unstated = read(year=0, day=0)
    assert (unstated.created, unstated.notices) == (None, ())


def clock(times: list[float], *, standard: bool, year: int = 2020) -> tuple[TimeKind, list[str]]:
    header = replace(read(encoding=int(standard)), created=dt.date(year, 6, 1))
    found, notices = clock_of(Path("a.las"), header, np.array(times))
    return found, [notice.code for notice in notices]


FLIGHT = 2.8e8
"""Adjusted standard time of a moment in 2020."""


@pytest.mark.parametrize(
    ("times", "standard", "kind", "codes"),
    [
        ([0.0, 0.0], False, TimeKind.WEEK, []),
        ([0.0, np.nan], True, TimeKind.STANDARD, []),
        ([1.0, 604_800.0], False, TimeKind.WEEK, []),
        ([1.0, 691_200.0], False, TimeKind.WEEK, []),
        ([FLIGHT, FLIGHT], True, TimeKind.STANDARD, []),
        ([-1e9, -1e9], True, TimeKind.STANDARD, []),
        ([-1e9 - 1.0] * 2, True, TimeKind.UNKNOWN, ["gps-time-impossible"]),
        ([FLIGHT, FLIGHT, 5.0], False, TimeKind.STANDARD, ["gps-time-type"]),
        ([FLIGHT, 5.0, 6.0], False, TimeKind.WEEK, []),
        ([5.0, 6.0, FLIGHT], True, TimeKind.WEEK, ["gps-time-type"]),
        ([5.0, FLIGHT, FLIGHT], True, TimeKind.STANDARD, []),
        ([-9e8, -9e8], False, TimeKind.UNKNOWN, ["gps-time-impossible"]),
        ([2.7e9, 2.7e9], False, TimeKind.UNKNOWN, ["gps-time-impossible"]),
        ([1e12, 1e12], False, TimeKind.UNKNOWN, ["gps-time-impossible"]),
        ([1e12, 1e12], True, TimeKind.UNKNOWN, ["gps-time-impossible"]),
        ([5.0, 6.0, 1e12], False, TimeKind.WEEK, []),
        ([5.0, 1e12], False, TimeKind.WEEK, []),
        ([5.0, 1e12, 1e12], False, TimeKind.UNKNOWN, ["gps-time-impossible"]),
        ([FLIGHT, 1e12], True, TimeKind.STANDARD, []),
    ],
)
def test_times__are_of_the_kind_that_most_are_possible_for(
    times: list[float], standard: bool, kind: TimeKind, codes: list[str]
) -> None:
    assert clock(times, standard=standard) == (kind, codes)


@pytest.mark.parametrize(
    ("year", "kind"),
    [(2010, TimeKind.WEEK), (2011, TimeKind.STANDARD), (2012, TimeKind.STANDARD), (2013, TimeKind.WEEK)],
)
def test_times__of_september_2011_are_standard_in_files_of_then(year: int, kind: TimeKind) -> None:
    assert clock([3600.0, 7200.0], standard=True, year=year)[0] is kind


@pytest.mark.parametrize(
    ("moment", "is_plausible"),
    [
        (dt.datetime(1993, 1, 1, 0, 1, tzinfo=dt.UTC), True),
        (dt.datetime(1992, 12, 31, 23, 59, tzinfo=dt.UTC), False),
        (dt.datetime.now(dt.UTC) + dt.timedelta(days=365), True),
        (dt.datetime.now(dt.UTC) + dt.timedelta(days=368), False),
    ],
)
def test_times__declared_as_of_a_week_may_be_standard_from_1993_to_next_year(
    moment: dt.datetime, is_plausible: bool
) -> None:
    at_s = moment.timestamp() - dt.datetime(1980, 1, 6, tzinfo=dt.UTC).timestamp() - 1e9
    expected = (TimeKind.STANDARD, ["gps-time-type"]) if is_plausible else (TimeKind.UNKNOWN, ["gps-time-impossible"])
    assert clock([at_s, at_s], standard=False) == expected


def test_checked_times__beyond_their_kind_are_none() -> None:
    end = dt.datetime(2100, 1, 1, tzinfo=dt.UTC).timestamp() - dt.datetime(1980, 1, 6, tzinfo=dt.UTC).timestamp() - 1e9
    week = TimeKind.WEEK.checked(np.array([-0.1, 0.0, 691_200.0, 691_200.1, np.nan]))
    np.testing.assert_array_equal(week, [np.nan, 0.0, 691_200.0, np.nan, np.nan])
    standard = TimeKind.STANDARD.checked(np.array([-1e9 - 1.0, -1e9, end, end + 1.0]))
    np.testing.assert_array_equal(standard, [np.nan, -1e9, end, np.nan])


def test_utc__of_times_around_a_leap_second() -> None:
    """That of the end of 2016."""
    leap = dt.datetime(2017, 1, 1, tzinfo=dt.UTC).timestamp() - dt.datetime(1980, 1, 6, tzinfo=dt.UTC).timestamp()
    times = leap + 18.0 - 1e9 + np.array([-100.0, np.nan, 100.0])
    clock = TimeKind.STANDARD
    utc_s = clock.utc(times)
    assert utc_s is not None
    np.testing.assert_array_equal(utc_s, las_time_to_utc(times))
    new_year_s = dt.datetime(2017, 1, 1, tzinfo=dt.UTC).timestamp()
    np.testing.assert_allclose(utc_s - new_year_s, [-99.0, np.nan, 100.0], atol=1e-6)
    assert TimeKind.WEEK.utc(times) is None
