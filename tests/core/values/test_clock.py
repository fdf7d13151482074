"""UTC, GPS time and clocks that show only a part of the time."""

from __future__ import annotations

import datetime as dt
from importlib import resources

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from furrowmap.core.values import clock

CYCLES = st.sampled_from([clock.HOUR_S, clock.DAY_S, clock.WEEK_S])


def utc(text: str) -> float:
    return dt.datetime.fromisoformat(text).replace(tzinfo=dt.UTC).timestamp()


@pytest.mark.parametrize(
    ("date", "leap_s"),
    # Differences that navigation messages carried (GPS − UTC), from ICD-GPS and IERS Bulletin C.
    [
        ("1980-01-06T00:00:00", 0),
        ("1981-06-30T23:59:59", 0),
        ("1981-07-01T00:00:00", 1),
        ("1999-01-01T00:00:00", 13),
        ("2005-12-31T23:59:59", 13),
        ("2006-01-01T00:00:00", 14),
        ("2015-06-30T23:59:59", 16),
        ("2015-07-01T00:00:00", 17),
        ("2016-12-31T23:59:59", 17),
        ("2017-01-01T00:00:00", 18),
        ("2026-06-11T01:23:40", 18),
    ],
)
def test_leap_seconds(date: str, leap_s: int) -> None:
    assert clock.gps_minus_utc_s(utc(date)) == leap_s
    assert clock.utc_to_gps_s(utc(date)) == utc(date) - utc("1980-01-06T00:00:00") + leap_s


def test_leap_seconds__are_those_of_the_time_zone_database() -> None:
    """Those since GPS time began, each a second after the end of a month."""
    lines = resources.files("tzdata").joinpath("zoneinfo/leapseconds").read_text(encoding="ascii").splitlines()
    told = [line.split() for line in lines if line.startswith("Leap\t")]
    ends = [dt.datetime.strptime(f"{year} {month} {day} +0000", "%Y %b %d %z") for _, year, month, day, *_ in told]
    after_s = np.array([end.timestamp() + 86_400.0 for end in ends if end.year > 1980])
    np.testing.assert_array_equal(clock.gps_minus_utc_s(after_s), np.arange(1, len(after_s) + 1))
    np.testing.assert_array_equal(clock.gps_minus_utc_s(after_s - 0.5), np.arange(len(after_s)))


def test_gps_time__of_well_known_moments() -> None:
    assert clock.gps_to_utc_s(1_000_000_000) == utc("2011-09-14T01:46:25")
    assert clock.gps_to_utc_s(1024 * clock.WEEK_S) == utc("1999-08-21T23:59:47")
    assert clock.gps_to_utc_s(2048 * clock.WEEK_S) == utc("2019-04-06T23:59:42")
    assert clock.utc_to_las_time(utc("2011-09-14T01:46:25")) == 0.0


def test_gps_time__inside_a_leap_second_is_the_first_of_the_new_day() -> None:
    midnight = utc("2017-01-01T00:00:00")
    before = clock.utc_to_gps_s(midnight - 1.0)
    np.testing.assert_array_equal(
        clock.gps_to_utc_s(before + np.array([0.0, 0.5, 1.0, 1.5, 2.0, 2.5])) - midnight, [-1, -0.5, 0, 0.5, 0, 0.5]
    )


@given(st.floats(utc("1980-01-07T00:00:00"), utc("2100-01-01T00:00:00")))
def test_gps_time__and_las_time_come_back(t_s: float) -> None:
    assert abs(clock.gps_to_utc_s(clock.utc_to_gps_s(t_s)) - t_s) < 1e-6
    assert abs(clock.las_time_to_utc(clock.utc_to_las_time(t_s)) - t_s) < 1e-6


@given(st.lists(st.floats(3.2e8, 2.5e9), min_size=2, unique=True))
def test_gps_time__runs_through(times: list[float]) -> None:
    """GPS time never stands still or runs back, whatever UTC does."""
    t_s = np.unique(np.round(np.array(times), 3))
    assert np.all(np.diff(clock.utc_to_gps_s(t_s)) > 0)


@given(st.floats(0, 0.999999), st.floats(1e9, 2e9), CYCLES)
def test_nearest_in_cycle__shows_what_the_clock_shows_and_is_near(share: float, near_s: float, cycle_s: float) -> None:
    within = share * cycle_s
    found = float(clock.nearest_in_cycle(within, near_s, cycle_s))
    assert abs(found - near_s) <= cycle_s / 2 + 1e-6
    assert abs((found - within) / cycle_s - round((found - within) / cycle_s)) * cycle_s < 1e-5


def test_nearest_in_cycle__takes_one_reference_for_each_reading() -> None:
    np.testing.assert_array_equal(clock.nearest_in_cycle([10.0, 3590.0], [7190.0, 7210.0], 3600.0), [7210.0, 7190.0])


@given(st.lists(st.floats(-100, 1700), min_size=1), st.floats(0, 1e9), CYCLES)
def test_unroll__takes_roll_overs_out(steps: list[float], start_s: float, cycle_s: float) -> None:
    """A clock that is read at least twice a cycle is known but for a constant, small steps back included."""
    t_s = start_s + np.cumsum(steps)
    unrolled = clock.unroll(t_s % cycle_s, cycle_s)
    np.testing.assert_allclose(unrolled - unrolled[0], t_s - t_s[0], rtol=0, atol=1e-5)
    assert unrolled[0] == t_s[0] % cycle_s


def test_unroll__of_nothing_is_nothing() -> None:
    assert len(clock.unroll([], 3600.0)) == 0


@given(st.lists(st.one_of(st.integers(-3, 20).map(float), st.just(float("nan")))))
def test_runs_forward__keeps_what_is_later_than_all_before(times: list[float]) -> None:
    expected, latest = [], float("-inf")
    for t_s in times:
        expected.append(t_s > latest)
        latest = max(latest, t_s)
    assert clock.runs_forward(times).tolist() == expected


@given(st.floats(0, 4e9))
def test_iso_utc__is_read_back_to_the_millisecond(t_s: float) -> None:
    text = clock.iso_utc(t_s)
    assert text.endswith("Z")
    assert len(text) == len("2026-06-11T01:23:40.300Z")
    assert abs(dt.datetime.fromisoformat(text).timestamp() - t_s) < 0.000_501


def test_decimal_year__is_the_share_of_its_own_year() -> None:
    assert clock.decimal_year(utc("2026-01-01T00:00:00")) == 2026.0
    assert clock.decimal_year(utc("2026-07-02T12:00:00")) == 2026.5
    assert clock.decimal_year(utc("2024-07-02T00:00:00")) == 2024.5  # a leap year


def test_iso_utc__carries_over() -> None:
    assert clock.iso_utc(utc("2016-12-31T23:59:59") + 0.9996) == "2017-01-01T00:00:00.000Z"


@given(st.floats(allow_nan=True, allow_infinity=True))
def test_promise_14__any_time_has_words(t_s: float) -> None:
    words = clock.iso_utc(t_s)
    if clock.FIRST_S <= t_s < clock.LAST_S:
        assert abs(dt.datetime.fromisoformat(words).timestamp() - t_s) < 2e-3
    else:
        assert words.endswith(" s")
