"""Damaged images and their tables with fixed seeds; `make fuzz` goes on for as long as one likes."""

from __future__ import annotations

from typing import Any

import pytest

from tests.fuzz.fuzzed import assert_held, fuzzed
from tests.fuzz.images import IMAGES


@pytest.fixture(scope="module")
def results() -> dict[str, dict[str, Any]]:
    return fuzzed(IMAGES)


@pytest.mark.parametrize("name", [entry.name for entry in IMAGES])
def test_damaged__is_read_or_refused_within_bounds(results: dict[str, dict[str, Any]], name: str) -> None:
    assert_held(results[name])
