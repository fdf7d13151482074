"""Random sessions with fixed seeds end in products or in three lines; `make fuzz-sessions` goes on."""

from __future__ import annotations

import ctypes
import os
import socket
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import pytest

from furrowmap.core.values.session import EXAMPLES
from tests.fuzz_sessions.grammar import KEYS, names_files
from tests.fuzz_sessions.material import Material, Stock
from tests.fuzz_sessions.trials import run

SESSIONS = int(os.environ.get("SESSIONS", "40"))


def test_random_sessions__end_in_products_or_in_three_lines(tmp_path: Path) -> None:
    # In a process of its own: forked ones need one without threads.
    command = [sys.executable, "-m", "tests.fuzz_sessions", "--sessions", str(SESSIONS), "--seed", "1"]
    done = subprocess.run([*command, "--folder", tmp_path], capture_output=True, text=True, timeout=600, check=False)
    assert done.returncode == 0, f"{done.stdout}\n{done.stderr}"
    assert f"{SESSIONS} sessions" in done.stdout
    assert ": 0\n" in done.stdout  # some are right


def test_grammar__has_every_key_of_the_session() -> None:
    assert {".".join(key) for key in KEYS} == EXAMPLES.keys() - {"name"}
    assert names_files("recording.lidar")
    assert not names_files("recording.date")


def outside() -> Path:
    """The folder of files that nobody named, as a command in a trial has it."""
    return Path(tempfile.gettempdir()).parent / "outside"


FAULTS: dict[str, Callable[[], object]] = {
    "": lambda: None,
    "outside": lambda: (outside() / "made").write_text("x"),
    "opened": lambda: ctypes.CDLL(None).fopen(os.fsencode(outside() / "canary.csv"), b"r"),
    "network": lambda: socket.socket().connect(("127.0.0.1", 9)),
    "left": lambda: Path(tempfile.gettempdir(), "left").write_text("x"),
    "crash": lambda: ctypes.string_at(0),
    "printed": lambda: os.write(2, b"Traceback (most recent call last)"),
}


@pytest.mark.skipif(sys.platform != "linux", reason="what the kernel sees is Linux's")
@pytest.mark.parametrize("kind", FAULTS)
def test_faults__are_found(kind: str, tmp_path: Path) -> None:
    names = ("drive_gnss.nmea", "drive_boundary.geojson", "field.gpkg", "field.zip", "points.csv")
    stock = Stock(tuple(Material(name, {name: b"x" * 50}, frozenset()) for name in names), {}, {})

    def give(line: object) -> tuple[int, None]:
        FAULTS[kind]()
        return 3, None

    (tally,) = run(stock, "1", range(1), tmp_path, give)
    assert kind in {finding.kind for finding in tally.findings} or not (kind or tally.findings)
    assert (tmp_path / "found0" / "cards").is_dir() == bool(kind)
