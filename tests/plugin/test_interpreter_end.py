"""The worker's threads do not keep its process from ending, in the Python that QGIS comes with as well."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from conftest import QgisRoot

CHECKOUT = Path(__file__).resolve().parents[2]
LEFT_BEHIND = """
import gc, itertools, time
from furrowmap.core.runtime.background import ahead

class Kept:
    pass

kept = Kept()
kept.itself, kept.items = kept, ahead(itertools.count(), 2)  # a ring: only the interpreter's end collects it
next(kept.items)
time.sleep(0.3)  # the thread waits for room
del kept
gc.disable()
print("the end")
"""


@pytest.fixture
def script(tmp_path: Path) -> Path:
    """What leaves an iterator behind whose thread is at work, beside the room of the module alone."""
    shutil.copytree(CHECKOUT / "core" / "runtime", tmp_path / "furrowmap" / "core" / "runtime")
    path = tmp_path / "left_behind.py"
    path.write_text(LEFT_BEHIND)
    return path


def test_ahead__that_is_left_behind_lets_the_interpreter_end(script: Path) -> None:
    done = subprocess.run([sys.executable, script], capture_output=True, text=True, timeout=20, check=True)
    assert done.stdout == "the end\n"


def test_ahead__that_is_left_behind_lets_the_interpreter_of_qgis_end(qgis: QgisRoot, script: Path) -> None:
    """From Python 3.13 on, threads stand still for good when the interpreter ends: whoever waits for one never ends."""
    assert qgis.run("timeout", "20", "python3", script) == "the end\n"
