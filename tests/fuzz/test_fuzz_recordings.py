"""Damaged clouds, captures and bags with fixed seeds; `make fuzz` goes on for as long as one likes."""

from __future__ import annotations

from typing import Any

import pytest

from tests.fuzz.fuzzed import assert_held, fuzzed
from tests.fuzz.recordings import RECORDINGS


@pytest.fixture(scope="module")
def results() -> dict[str, dict[str, Any]]:
    return fuzzed(RECORDINGS)


@pytest.mark.parametrize("name", [entry.name for entry in RECORDINGS])
def test_damaged__is_read_or_refused_within_bounds(results: dict[str, dict[str, Any]], name: str) -> None:
    assert_held(results[name])
