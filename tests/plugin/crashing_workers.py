"""Runs inside QGIS: lets workers crash and hang, and prints as JSON what the plugin makes of each.

The argument is the folder with the plugin.
"""

from __future__ import annotations

import importlib
import json
import sys
from typing import Any

from qgis.core import QgsApplication

HELLO = '{"type": "hello", "protocol": 1, "version": "0", "pid": 1}'
PROGRESS = '{"type": "progress", "stage": "Reading field.laz", "share": 0.5}'
LAST = {
    "crash": "echo 'Fatal Python error: Segmentation fault' >&2; echo 'Extension modules: numpy' >&2; kill -SEGV $$",
    "hang": "exec sleep 60",
}


def main() -> None:
    sys.path.insert(0, sys.argv[1])
    application = QgsApplication([], False)
    application.initQgis()
    worker: Any = importlib.import_module("plugin.worker")
    worker.SILENT_S = 1.5
    answers = {}
    for name, last in LAST.items():
        program = ["/bin/sh", "-c", f"echo '{HELLO}'; read order; echo '{PROGRESS}'; sleep 0.3; {last}"]
        try:
            worker.run_command(program, ["inspect", "field.laz"], lambda message: None, lambda: False)
        except worker.WorkerError as error:
            answers[name] = error.lines
    print(json.dumps(answers))
    application.exitQgis()


if __name__ == "__main__":
    main()
