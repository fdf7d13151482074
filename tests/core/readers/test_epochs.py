from __future__ import annotations

import datetime as dt

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from furrowmap.core.readers.epochs import midnights_utc_s

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
