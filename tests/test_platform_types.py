"""Which modules are checked for Windows and macOS as well."""

from __future__ import annotations

import runpy
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

CHECKOUT = Path(__file__).resolve().parents[1]


@pytest.fixture(scope="module")
def script() -> dict[str, Any]:
    return runpy.run_path(str(CHECKOUT / "scripts" / "platform_types.py"))


@pytest.mark.parametrize(
    "source",
    [
        "import sys\nif sys.platform == 'win32': ...",
        "from sys import platform",
        "import os\nos.fork()",
        "import resource\nresource.setrlimit(0, (1, 1))",
        "import signal\nsignal.SIGKILL",
        "from signal import CTRL_BREAK_EVENT",
        "import subprocess\nsubprocess.Popen('x', creationflags=subprocess.CREATE_NO_WINDOW)",
        "def lock(file):\n    import fcntl\n    fcntl.flock(file, fcntl.LOCK_EX)",
        "import ctypes\nctypes.WinDLL('kernel32')",
        "import time\ntime.tzset()",
    ],
)
def test_module__that_uses_what_some_platforms_have_is_checked(source: str, script: dict[str, Any]) -> None:
    assert script["depends_on_platform"](source)


@pytest.mark.parametrize("source", ["import sys\nsys.exit()", "import os\nos.getpid()", "fork = 1", "import numpy"])
def test_module__that_all_platforms_run_alike_is_not(source: str, script: dict[str, Any]) -> None:
    assert not script["depends_on_platform"](source)


def test_modules_of_furrowmap__that_ask_for_the_platform_are_among_them(script: dict[str, Any]) -> None:
    modules: Callable[[], list[str]] = script["dependent_modules"]
    assert {
        "furrowmap.process",
        "furrowmap.core.runtime.memory",
        "furrowmap.core.readers.las.las_decoder",
        "furrowmap.exporters.files.owner",
        "furrowmap.exporters.farm.farm_geopackage",
        "furrowmap.cli.main",
        "furrowmap.plugin.program",
    } <= set(modules())
