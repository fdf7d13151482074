"""A host of its own, as far as the system shows: its runs write to a folder; a line of JSON each on standard input.

It is started in namespaces of its own, and named after its argument. A run can be killed after some time.
"""

from __future__ import annotations

import json
import os
import signal
import socket
import sys
import time
from pathlib import Path
from typing import Any

from furrowmap.core.runtime.errors import RefusedError
from furrowmap.exporters.files import lease
from furrowmap.exporters.files.staging import staged_folder

NAMES = ("cloud.copc.laz", "field.gpkg", "report.json")
PATIENCE_S = 2.0
REFUSED = 4


def run(task: dict[str, Any]) -> None:
    with staged_folder(Path(task["folder"])) as staging:
        for name in NAMES:
            (staging / name).write_text(task["text"])
            time.sleep(task["pause_s"])


if __name__ == "__main__":
    socket.sethostname(sys.argv[1])
    lease.MAX_SILENCE_S, lease.BEAT_S = PATIENCE_S, PATIENCE_S / 10.0  # type: ignore[misc]
    for line in sys.stdin:
        task = json.loads(line)
        process = os.fork()
        if process == 0:
            status = 1
            try:
                run(task)
                status = 0
            except RefusedError as error:
                status = REFUSED if error.code in ("output-busy", "output-lost") else 1
            finally:
                os._exit(status)
        if task.get("kill_s") is not None:
            time.sleep(task["kill_s"])
            os.kill(process, signal.SIGKILL)
        _, ended = os.waitpid(process, 0)
        sys.stdout.write(f"{os.waitstatus_to_exitcode(ended)}\n")
        sys.stdout.flush()
