"""Times of a log as `inspect` reports them, in closed form."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from furrowmap.core.readers.facts import timing_facts, utc_facts


@given(rate_hz=st.sampled_from([1, 2, 5, 10, 20]), count=st.integers(20, 200), gap_s=st.floats(2.0, 100.0))
def test_times__of_a_regular_log_with_a_gap(rate_hz: int, count: int, gap_s: float) -> None:
    t_s = 1.75e9 + np.arange(count) / rate_hz
    t_s[count // 2 :] += gap_s - 1.0 / rate_hz
    facts = timing_facts(t_s)
    assert abs(facts["span_s"] - ((count - 2) / rate_hz + gap_s)) < 2e-3
    assert facts["rate_hz"] == rate_hz
    assert facts["gaps"]["count"] == 1
    assert abs(facts["gaps"]["longest_s"] - gap_s) < 2e-3
    assert abs(facts["gaps"]["longer_than_s"] - 1.5 / rate_hz) < 2e-3


def test_times__without_a_gap_and_of_too_few() -> None:
    facts = timing_facts(1.75e9 + 0.25 * np.arange(9))
    assert facts == {"span_s": 2.0, "rate_hz": 4.0, "gaps": {"longer_than_s": 0.375, "count": 0, "longest_s": 0.0}}
    assert timing_facts(np.array([1.75e9])) == {}
    assert utc_facts(np.zeros(0)) == {}
    found = utc_facts(np.array([1_781_143_200.0, 1_781_143_201.5]))
    assert found == {"first": "2026-06-11T02:00:00.000Z", "last": "2026-06-11T02:00:01.500Z", "gps_minus_utc_s": 18}
