"""Damaged inputs with fixed seeds to all readers; `make fuzz` goes on for as long as one likes."""

from __future__ import annotations

import json
import subprocess
import sys
from typing import Any

import pytest

from tests.conftest import CHECKOUT
from tests.fuzz.places import PLACES
from tests.fuzz.registry import ENTRIES

NEVER_REFUSED = {"drive"}
"""What remains of a log of positions whose damaged sentences are left out is enough."""
OTHERS = sorted(ENTRIES.keys() - {entry.name for entry in PLACES})


@pytest.fixture(scope="module")
def results() -> dict[str, dict[str, Any]]:
    """The result of each reader, by its name, in a part of a round of `make fuzz`; one process imports all."""
    command = [sys.executable, "-m", "tests.fuzz", "--json", "--part", "0.4"]
    done = subprocess.run(command, cwd=CHECKOUT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-3000:]
    return {result["entry"]: result for result in map(json.loads, done.stdout.splitlines())}


@pytest.mark.parametrize("name", OTHERS)
def test_damaged__is_read_or_refused_within_bounds(results: dict[str, dict[str, Any]], name: str) -> None:
    """Some are read and some refused, or the damage would be too small or too great."""
    assert results[name]["findings"] == []
    assert (results[name]["refused"] > 0) == (name not in NEVER_REFUSED)
    assert results[name]["refused"] < results[name]["trials"]


@pytest.mark.parametrize("name", [entry.name for entry in PLACES])
def test_promise_23__nothing_changes_outside_the_named_folders(results: dict[str, dict[str, Any]], name: str) -> None:
    assert results[name]["findings"] == []
    assert results[name]["refused"] > 0
