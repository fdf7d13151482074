"""Margins are twice the standard deviation, in two significant digits, and values have no digits beyond them."""

from __future__ import annotations

import math
import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from furrowmap.core.values.margins import margin, with_margin

sigmas = st.floats(1e-6, 1e6)


@given(sigmas, st.sampled_from([1.0, 100.0, 1000.0]))
def test_margin__is_two_sigmas_in_two_digits(sigma: float, factor: float) -> None:
    shown = margin(sigma, "", factor).removeprefix("± ").replace(",", "")
    assert float(shown) == pytest.approx(2.0 * factor * sigma, rel=0.051)
    assert re.fullmatch(r"[1-9][0-9]?", shown.replace(".", "").strip("0"))


@given(st.floats(-1e6, 1e6), sigmas)
def test_value__has_the_decimals_of_its_margin(value: float, sigma: float) -> None:
    first, sign, second = with_margin(value, sigma).split()
    assert sign == "±"
    assert len(first.partition(".")[2]) == len(second.partition(".")[2])
    assert abs(float(first.replace(",", "")) - value) <= max(0.5, 0.06 * sigma)


@pytest.mark.parametrize(
    ("value", "sigma", "unit", "factor", "words"),
    [
        (4.4, 11.45, " m²", 1.0, "4 ± 23 m²"),
        (0.342, 0.009, " cm", 100.0, "34.2 ± 1.8 cm"),
        (12_345.6, 89.25, " m", 1.0, "12,346 ± 180 m"),
        (1.0, 0.4999, "", 1.0, "1.00 ± 1.00"),
        (2.0, math.nan, " m", 1.0, "2.0 m"),
        (2.0, None, " m", 1.0, "2.0 m"),
        (math.nan, 1.0, " m", 1.0, "unknown"),
        (None, None, " m", 1.0, "unknown"),
    ],
)
def test_words(value: float | None, sigma: float | None, unit: str, factor: float, words: str) -> None:
    assert with_margin(value, sigma, unit, factor) == words


def test_margin__without_a_standard_deviation_is_unknown() -> None:
    assert {margin(sigma) for sigma in (None, 0.0, math.nan, math.inf)} == {"unknown"}
