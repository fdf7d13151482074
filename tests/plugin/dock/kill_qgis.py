"""Runs inside the tests' QGIS root: QGIS is killed in the midst of a run; prints what of the worker is left, as JSON.

Arguments: folder with the plugin, a session file, the worker's command; with a fourth it is QGIS itself, which begins
the run in a task, as the dock does, and kills itself once the worker is at work.
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
    ended = subprocess.run([sys.executable, __file__, plugins, session, worker, "inside"], timeout=200, check=False)
    begun = time.monotonic()
    while workers() and time.monotonic() - begun < LONGEST_S:
        time.sleep(0.05)
    left = [path.name for path in Path(session).parent.iterdir() if path.name.endswith("_result")]
    print(json.dumps({"signal": -ended.returncode, "workers": workers(), "left": left}))


def inside(plugins: str, session: str, worker: str) -> None:
    import qgis.utils
    from qgis.core import QgsApplication, QgsSettings
    from qgis.PyQt.QtCore import QTimer

    application = QgsApplication([], False)
    application.initQgis()
    qgis.utils.iface = None
    sys.path.insert(0, plugins)
    qgis.utils.plugin_paths.append(plugins)
    qgis.utils.updateAvailablePlugins()
    assert qgis.utils.loadPlugin("furrowmap")
    assert qgis.utils.startProcessingPlugin("furrowmap")
    QgsSettings().setValue("furrowmap/interpreter", worker)
    from furrowmap.dock.tasks import RunTask

    stages: list[str] = []
    parameters = {"SESSION": session, "OUTPUT": session.replace(".toml", "_result"), "OPEN": False}
    task = RunTask(parameters, stages.append)
    QgsApplication.taskManager().addTask(task)
    timer = QTimer()

    def look() -> None:
        if stages and workers():
            os.kill(os.getpid(), signal.SIGKILL)

    timer.timeout.connect(look)
    timer.start(50)
    application.exec_()


if len(sys.argv) > 4:
    inside(*sys.argv[1:4])
else:
    outside(*sys.argv[1:])
