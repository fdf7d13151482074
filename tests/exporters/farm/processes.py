"""Processes that add results to bases, to be killed or set against each other."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

CHECKOUT = Path(__file__).resolve().parents[3]


@contextmanager
def adders(number: int) -> Iterator[list[subprocess.Popen[str]]]:
    """So many programs that start such processes."""
    helpers = [
        subprocess.Popen(
            [sys.executable, "-m", "tests.exporters.farm.adder"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            cwd=CHECKOUT,
        )
        for _ in range(number)
    ]
    try:
        yield helpers
    finally:
        for helper in helpers:
            helper.communicate()


def ask(helper: subprocess.Popen[str], *words: Path | str) -> int:
    """Let a process of its own add results to a base; its number."""
    assert helper.stdin is not None
    assert helper.stdout is not None
    helper.stdin.write(json.dumps([str(word) for word in words]) + "\n")
    helper.stdin.flush()
    return int(helper.stdout.readline())


def ended(helper: subprocess.Popen[str]) -> int:
    """Wait for that process; its exit status, negative where it was killed."""
    assert helper.stdout is not None
    return int(helper.stdout.readline())
