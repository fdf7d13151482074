"""Random sessions with fixed seeds end in products or in three lines; `make fuzz-sessions` goes on."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from furrowmap.core.values.session import EXAMPLES
from tests.fuzz_sessions.grammar import KEYS, names_files

SESSIONS = 250


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
