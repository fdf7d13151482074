"""Adds results to bases in processes of their own, which whoever asks may kill: a line of JSON each on standard input.

Everything is imported once, so that a kill falls into the work and not into Python's start.
"""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path

from furrowmap.workflows.farm.farm import add_to_farm_map

for line in sys.stdin:
    base, *folders = json.loads(line)
    process = os.fork()
    if process == 0:
        try:
            add_to_farm_map(base, [Path(folder) for folder in folders])
        except BaseException as error:  # noqa: BLE001 (the end of a process)
            sys.stderr.write(f"{error}\n")
            os._exit(1)
        os._exit(0)
    sys.stdout.write(f"{process}\n")
    sys.stdout.flush()
    _, status = os.waitpid(process, 0)
    sys.stdout.write(f"{os.waitstatus_to_exitcode(status)}\n")
    sys.stdout.flush()
