"""Nothing but what was named is created, changed or deleted, whatever results, sessions, archives and orders name."""

from __future__ import annotations

from typing import Any

import pytest

from tests.fuzz.fuzzed import fuzzed
from tests.fuzz.places import PLACES


@pytest.fixture(scope="module")
def results() -> dict[str, dict[str, Any]]:
    return fuzzed(PLACES)


@pytest.mark.parametrize("name", [entry.name for entry in PLACES])
def test_promise_23__nothing_changes_outside_the_named_folders(results: dict[str, dict[str, Any]], name: str) -> None:
    assert results[name]["findings"] == []
    assert results[name]["refused"] > 0
