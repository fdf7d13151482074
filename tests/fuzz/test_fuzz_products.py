"""Damaged implements, surveys, scenarios, results and orders with fixed seeds; `make fuzz` goes on."""

from __future__ import annotations

from typing import Any

import pytest

from tests.fuzz.fuzzed import assert_held, fuzzed
from tests.fuzz.products import PRODUCTS


@pytest.fixture(scope="module")
def results() -> dict[str, dict[str, Any]]:
    return fuzzed(PRODUCTS)


@pytest.mark.parametrize("name", [entry.name for entry in PRODUCTS])
def test_damaged__is_read_or_refused_within_bounds(results: dict[str, dict[str, Any]], name: str) -> None:
    assert_held(results[name])
