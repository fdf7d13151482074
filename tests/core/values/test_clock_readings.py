"""How far clocks are off for common causes: a step more than the largest that occurs has no name."""

from __future__ import annotations

import pytest

from furrowmap.core.values.scan import Clock, ClockReading, likely_offset, named_offset

T0_S = 1.75e9
HOUR_S, DAY_S, WEEK_S = 3600.0, 86_400.0, 604_800.0


def reading(begin_s: float) -> ClockReading:
    return ClockReading(Clock.GNSS, begin_s, begin_s + 300.0)


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(
    ("step_s", "largest", "cause"),
    [
        (HOUR_S, 14, "local time"),  # UTC+14, the Line Islands
        (HOUR_S / 4, 55, "local time"),  # no zone is beyond 14 hours
        (DAY_S, 7, "date"),
        (1024 * WEEK_S, 2, "week rollover"),
    ],
)
def test_likely_offset__has_the_multiples_that_occur(step_s: float, largest: int, cause: str, sign: float) -> None:
    found = likely_offset(reading(T0_S + sign * largest * step_s), reading(T0_S))
    assert found is not None
    assert found[0] == sign * largest * step_s
    assert cause in str(found[1])


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("offset_s", [15 * HOUR_S, 14.25 * HOUR_S, 8 * DAY_S, 3 * 1024 * WEEK_S, 900.0 + 450.0])
def test_likely_offset__beyond_them_is_none(offset_s: float, sign: float) -> None:
    assert likely_offset(reading(T0_S + sign * offset_s), reading(T0_S)) is None


@pytest.mark.parametrize(
    ("offset_s", "word"), [(18.0, "leap"), (17.6, "leap"), (-3600.3, "local time"), (36.0, ""), (19.0, ""), (5.0, "")]
)
def test_named_offset__within_what_a_clock_without_a_receiver_may_be_off(offset_s: float, word: str) -> None:
    assert (word in str(named_offset(offset_s))) if word else not named_offset(offset_s)
