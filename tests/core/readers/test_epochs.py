from __future__ import annotations

import datetime as dt
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from furrowmap.core.readers.epochs import day_of_week, midnights_utc_s, week_time, week_times
from furrowmap.core.readers.position_log import in_order
from furrowmap.core.readers.reader import ReadOptions
from furrowmap.core.runtime.errors import InputError

PARTS = st.tuples(st.integers(1970, 2110), st.integers(-1, 14), st.integers(-1, 33))


@given(st.lists(PARTS, min_size=1))
def test_midnights__are_the_calendars_from_1980_to_2099(days: list[tuple[int, int, int]]) -> None:
    found = midnights_utc_s(*np.array(days).T)
    for (year, month, day), midnight_s in zip(days, found, strict=True):
        try:
            expected = dt.datetime(year, month, day, tzinfo=dt.UTC).timestamp() if 1980 <= year < 2100 else np.nan
        except ValueError:
            expected = np.nan
        np.testing.assert_equal(midnight_s, expected)


WEEK_S = 604_800.0
GPS_EPOCH_S = 315_964_800.0


def gps_of(text: str) -> float:
    """GPS seconds of a UTC time of 2026."""
    return dt.datetime.fromisoformat(f"{text}+00:00").timestamp() - GPS_EPOCH_S + 18.0


@pytest.mark.parametrize(
    ("first", "options"),
    [
        ("2026-06-11T10:00:00", {"week": 2422}),
        ("2026-06-11T00:00:00", {"date": "2026-06-11"}),
        ("2026-06-11T23:59:59", {"date": "2026-06-11"}),
        ("2026-06-13T23:59:50", {"date": "2026-06-13"}),
        ("2026-06-14T00:00:01", {"date": "2026-06-14"}),
        ("2026-06-11T10:00:00", {"near_s": gps_of("2026-06-08T00:00:00") + GPS_EPOCH_S - 18.0}),
        ("2026-06-11T10:00:00", {"near_s": gps_of("2026-06-14T20:00:00") + GPS_EPOCH_S - 18.0}),
    ],
)
@pytest.mark.parametrize("steps_s", [(0.0, 1.0, 2.0), (0.0, 250_000.0, 500_000.0)])
def test_weeks__are_stated_or_follow_from_a_date_or_a_time_nearby(
    first: str, options: dict[str, Any], steps_s: tuple[float, ...]
) -> None:
    """And go on where the second of the week begins anew."""
    expected = gps_of(first) + np.array(steps_s)
    found = week_times(expected % WEEK_S, ReadOptions(**options), "log")
    np.testing.assert_array_equal(found, expected)
    assert week_times(expected % WEEK_S, ReadOptions(), "log") is None


@pytest.mark.parametrize("first", ["2026-06-10T23:59:59.9", "2026-06-12T00:00:00"])
def test_weeks__of_a_date_on_another_day_are_refused(first: str) -> None:
    with pytest.raises(InputError, match="2026-06-11, is a Thursday") as refused:
        week_times(np.array([gps_of(first) % WEEK_S]), ReadOptions(date="2026-06-11"), "log")
    assert refused.value.code == "date-contradicted"


def test_weeks__have_the_names_of_their_days() -> None:
    assert week_time(0.0) == "Sunday 00:00:00.000"
    assert week_time(2 * 86_400.0 + 68_339.95) == "Tuesday 18:58:59.950"
    assert [day_of_week(86_400.0 * k - 1.0) for k in range(1, 8)] == [
        *("Sunday", "Monday", "Tuesday", "Wednesday", "Thursday", "Friday", "Saturday")
    ]


def ordered(t_s: NDArray[np.float64], lat_deg: NDArray[np.float64]) -> tuple[list[bool], dict[str, str]]:
    forward, notices = in_order(t_s, np.zeros(len(t_s)), lat_deg, "log", "place {}".format)
    return forward.tolist(), {notice.code: notice.text for notice in notices}


@pytest.mark.parametrize(("late", "is_log"), [(5, True), (6, False)])
def test_order__a_twentieth_of_the_epochs_may_be_late(late: int, is_log: bool) -> None:
    t_s = np.concatenate([np.arange(60.0), np.arange(50.0, 50.0 + late) + 0.25, np.arange(60.0, 100.0 - late)])
    lat = np.arange(100.0)
    if is_log:
        forward, notices = ordered(t_s, lat)
        assert forward == [True] * 60 + [False] * 5 + [True] * 35
        assert f"{late} of 100 positions" in notices["time-runs-back"]
        assert "up to 8.750 s" in notices["time-runs-back"]
    else:
        with pytest.raises(InputError, match="place 60: time steps back here; 6 of 100") as refused:
            ordered(t_s, lat)
        assert refused.value.code == "time-disorder"


def test_order__repeated_positions_are_no_disorder() -> None:
    t_s, lat = np.repeat(np.arange(10.0), 2), np.repeat(np.arange(10.0), 2)
    forward, notices = ordered(t_s, lat)
    assert forward == [True, False] * 10
    assert notices.keys() == {"positions-repeated"}
    assert "10 positions are duplicates" in notices["positions-repeated"]
    lat[1::2] += 0.5  # other positions at the same times
    with pytest.raises(InputError) as refused:
        ordered(t_s, lat)
    assert refused.value.code == "receivers-interleaved"


@pytest.mark.parametrize(("parts", "code"), [(5, "time-disorder"), (6, "receivers-interleaved")])
def test_order__parts_in_the_wrong_order_are_few(parts: int, code: str) -> None:
    """Four steps back at most; in a long log, one in a hundred epochs."""
    t_s = np.concatenate([np.arange(20.0) + 100.0 * (parts - k) for k in range(parts)])
    with pytest.raises(InputError) as refused:
        ordered(t_s, np.arange(len(t_s), dtype=np.float64))
    assert refused.value.code == code
    long = np.concatenate([np.arange(200.0) + 1000.0 * (parts - k) for k in range(parts)])
    with pytest.raises(InputError) as refused:
        ordered(long, np.arange(len(long), dtype=np.float64))
    assert refused.value.code == "time-disorder"
