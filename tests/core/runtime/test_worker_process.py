"""The workers of a pool end with the process that started them, in whatever way that ends."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

PROGRAM = """
import os
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

from furrowmap.core.runtime.worker_process import end_with_parent

if __name__ == "__main__":
    pool = ProcessPoolExecutor(1, get_context("spawn"), end_with_parent)
    print(pool.submit(abs, -7).result(), flush=True)
    os._exit(9)  # as when it is killed: nothing ends the pool
"""


def test_workers_of_a_pool__end_with_the_process_that_started_them(tmp_path: Path) -> None:
    program = tmp_path / "program.py"
    program.write_text(PROGRAM, encoding="utf-8")
    # The output stays open, and waited for, as long as any process has it.
    done = subprocess.run([sys.executable, str(program)], stdout=subprocess.PIPE, timeout=120, check=False)
    assert (done.returncode, done.stdout.split()) == (9, [b"7"])
