"""What the tests of damaged inputs share: the readers of one list, given their inputs by one process."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Sequence
from typing import Any

from tests.conftest import CHECKOUT
from tests.fuzz.trials import Entry


def fuzzed(entries: Sequence[Entry]) -> dict[str, dict[str, Any]]:
    """The result of each reader, by its name."""
    names = ",".join(entry.name for entry in entries)
    command = [sys.executable, "-m", "tests.fuzz", "--json", "--only", names]
    done = subprocess.run(command, cwd=CHECKOUT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-3000:]
    return {result["entry"]: result for result in map(json.loads, done.stdout.splitlines())}


def assert_held(result: dict[str, Any]) -> None:
    """Each input is read or refused; there are some of both, or the damage would be too small or too great."""
    assert result["findings"] == []
    assert 0 < result["refused"] < result["trials"]
