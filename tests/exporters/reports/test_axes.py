"""Axes of drawings have round labels, and neither one nor dozens of them."""

from __future__ import annotations

import re
from itertools import pairwise

from hypothesis import given
from hypothesis import strategies as st

from furrowmap.exporters.reports.svg import TimeAxis, _round_step


def seconds(text: str) -> int:
    parts = [int(part) for part in text.split(":")]
    return sum(part * 60**k for k, part in enumerate(reversed(parts)))


@given(length_s=st.floats(2.0, 300_000.0))
def test_time_axis__has_labels_at_round_times(length_s: float) -> None:
    axis = TimeAxis(1000.5, 1000.5 + length_s)
    found = [
        (seconds(text), float(x)) for x, text in re.findall(r'x="([\d.]+)".*?>([\d:]+)<', "".join(axis.labels(0.0)))
    ]
    times = [t for t, _ in found]
    assert 2 <= len(times) <= 6 or length_s > 5 * 86_400.0
    (step,) = {after - before for before, after in pairwise(times)}
    assert times[0] == 0
    whole = next(unit for unit in (60, 3600, 86_400) if step <= unit)
    assert whole % step == 0, "whole minutes, hours and days have labels"
    for t, x in found:
        assert abs(x - float(axis.at(1000.5 + t))) <= 0.051


@given(length=st.floats(1e-3, 1e6))
def test_nice_steps__are_1_2_or_5_and_at_most_the_length(length: float) -> None:
    step = _round_step(length)
    assert f"{step:.6e}"[0] in "125"
    assert float(f"{step:.6e}"[:8]) in (1.0, 2.0, 5.0)
    assert 0.4 * length * (1 - 1e-6) <= step <= length * (1 + 1e-6)
