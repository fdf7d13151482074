"""Runs inside the tests' QGIS root: QGIS is killed in the midst of a run; prints what of the worker is left, as JSON.

Arguments: folder with the plugin, a session file, the worker's command.
Started again by QGIS itself (`iface` is there then) it begins the run and kills QGIS once the worker is at work.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

LONGEST_S = 90.0


def workers() -> list[int]:
    found = []
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            words = (folder / "cmdline").read_bytes().split(b"\0")
        except OSError:
            continue
        if b"worker" in words and any(b"furrowmap" in word for word in words):
            found.append(int(folder.name))
    return found


def outside(plugins: str, session: str, worker: str) -> None:
    command = ["scripts/qgis_desktop.sh", plugins, __file__, session]
    ended = subprocess.run(command, env=os.environ | {"QGIS_INTERPRETER": worker}, timeout=200, check=False)
    begun = time.monotonic()
    while workers() and time.monotonic() - begun < LONGEST_S:
        time.sleep(0.05)
    left = [path.name for path in Path(session).parent.iterdir() if path.name.endswith("_result")]
    print(json.dumps({"status": ended.returncode, "workers": workers(), "left": left}))


def inside(session: str) -> None:
    import qgis.utils
    from qgis.PyQt.QtCore import QTimer
    from qgis.PyQt.QtWidgets import QListWidget

    dock = qgis.utils.plugins["furrowmap"].dock
    dock.run_session(session)
    stages = dock.findChild(QListWidget, "furrowmapStages")
    globals()["timer"] = timer = QTimer()

    def look() -> None:
        if stages.count() and workers():
            os.kill(os.getpid(), signal.SIGKILL)

    timer.timeout.connect(look)
    timer.start(50)


if "iface" in globals():
    inside(*arguments)  # noqa: F821 - given by qgis_desktop.sh
else:
    outside(*sys.argv[1:])
