"""Damaged recordings of IMUs with fixed seeds; `make fuzz` goes on for as long as one likes."""

from __future__ import annotations

from typing import Any

import pytest

from tests.fuzz.fuzzed import assert_held, fuzzed
from tests.fuzz.inertial import INERTIAL


@pytest.fixture(scope="module")
def results() -> dict[str, dict[str, Any]]:
    return fuzzed(INERTIAL)


@pytest.mark.parametrize("name", [entry.name for entry in INERTIAL])
def test_damaged__is_read_or_refused_within_bounds(results: dict[str, dict[str, Any]], name: str) -> None:
    assert_held(results[name])
