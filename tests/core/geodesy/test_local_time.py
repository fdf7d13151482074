"""The local time of places against the IANA database."""

from __future__ import annotations

import datetime as dt
from zoneinfo import ZoneInfo, available_timezones

import pytest
import tzfpy
from hypothesis import given
from hypothesis import strategies as st
from pyproj import CRS

from furrowmap.core.geodesy.local_time import (
    clock_words,
    in_local_time,
    local_day,
    local_time,
    span_words,
    zone_at,
    zone_words,
)

JUNE_S = dt.datetime(2026, 6, 11, 16, 23, 5, 250_000, tzinfo=dt.UTC).timestamp()
JANUARY_S = dt.datetime(2026, 1, 11, 23, 23, 5, tzinfo=dt.UTC).timestamp()


@pytest.mark.parametrize(
    ("place", "zone", "june", "january"),
    [
        ((140.02, 36.87), "Asia/Tokyo", "01:23:05", "08:23:05"),
        ((9.58, 55.49), "Europe/Copenhagen", "18:23:05", "00:23:05"),
        ((-93.63, 42.03), "America/Chicago", "11:23:05", "17:23:05"),
        ((77.2, 28.6), "Asia/Kolkata", "21:53:05", "04:53:05"),
    ],
    ids=["Japan", "Denmark", "Iowa", "India"],
)
def test_clocks__show_what_they_do_at_the_place(place: tuple[float, float], zone: str, june: str, january: str) -> None:
    found = zone_at(*place)
    assert found.key == zone
    assert (clock_words(JUNE_S, found), clock_words(JANUARY_S, found)) == (june, january)


@given(lon_deg=st.floats(-180.0, 180.0), lat_deg=st.floats(-90.0, 90.0))
def test_every_place__has_a_zone_near_its_nautical_one(lon_deg: float, lat_deg: float) -> None:
    zone = zone_at(lon_deg, lat_deg)
    offset = local_time(JANUARY_S, zone).utcoffset()
    assert zone.key in available_timezones()
    assert offset is not None
    apart = (offset.total_seconds() / 3600.0 - lon_deg / 15.0 + 12.0) % 24.0 - 12.0
    assert abs(apart) < 4.0 or abs(lat_deg) > 60.0


def test_words__name_the_zone_and_its_offset_of_that_day() -> None:
    copenhagen = ZoneInfo("Europe/Copenhagen")
    assert zone_words(JUNE_S, copenhagen) == "Europe/Copenhagen, UTC+02:00"
    assert zone_words(JANUARY_S, copenhagen) == "Europe/Copenhagen, UTC+01:00"


def test_day__is_that_of_the_place() -> None:
    """Half past seven in the evening of 10 June in UTC is the morning of the 11th in Japan (140 E, 36 N)."""
    t_s = dt.datetime(2026, 6, 10, 19, 30, tzinfo=dt.UTC).timestamp()
    assert local_day(t_s, CRS("EPSG:6677"), (0.0, 0.0)) == dt.date(2026, 6, 11)
    assert local_day(t_s, CRS("EPSG:25832"), (500_000.0, 6_100_000.0)) == dt.date(2026, 6, 10)


@pytest.mark.parametrize(
    ("lon_deg", "hours"), [(139.7, 9), (-93.6, -6), (7.4, 0), (7.6, 1), (-7.6, -1), (179.0, 12), (-179.0, -12)]
)
def test_zone_that_the_system_does_not_know__is_the_nautical_one(
    lon_deg: float, hours: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tzfpy, "get_tz", lambda *_: "Mars/Base")
    assert local_time(JUNE_S, zone_at(lon_deg, 0.0)).utcoffset() == dt.timedelta(hours=hours)


def test_local_time__is_to_the_millisecond() -> None:
    found = local_time(1_749_999_999.9996, ZoneInfo("Asia/Tokyo"))
    assert found.isoformat() == "2025-06-16T00:06:40+09:00"


def test_span__names_the_second_day_only_where_it_is_another() -> None:
    tokyo = ZoneInfo("Asia/Tokyo")
    first_s = dt.datetime(2026, 6, 11, 14, 50, tzinfo=dt.UTC).timestamp()
    assert str(span_words(first_s, first_s + 90.0, tokyo)) == "2026-06-11, 23:50:00 to 23:51:30 (Asia/Tokyo, UTC+09:00)"
    assert str(span_words(first_s, first_s + 3600.0, tokyo)) == (
        "2026-06-11, 23:50:00 to 2026-06-12, 00:50:00 (Asia/Tokyo, UTC+09:00)"
    )
    marquesas = ZoneInfo("Pacific/Marquesas")
    assert zone_words(first_s, marquesas) == "Pacific/Marquesas, UTC-09:30"


def test_times_in_a_text__are_local_and_the_last_one_names_the_zone() -> None:
    text = "Off from 2026-06-11T14:59:59.960Z to 2026-06-11T15:00:01.250Z: 3 positions."
    assert in_local_time(text, ZoneInfo("Asia/Tokyo")) == (
        "Off from 2026-06-11 23:59:59.9 to 2026-06-12 00:00:01.2 (Asia/Tokyo): 3 positions."
    )
    assert in_local_time("Nothing in 2026.", ZoneInfo("Asia/Tokyo")) == "Nothing in 2026."


def test_day__of_a_plan_without_a_place_is_unknown() -> None:
    plan = CRS('LOCAL_CS["site",UNIT["metre",1]]')
    assert local_day(JUNE_S, plan, (0.0, 0.0)) is None
