"""Reads each file it is given within the memory it is given, and prints what came of it, one JSON line a file."""

from __future__ import annotations

import json
import resource
import sys
import time
from pathlib import Path

from furrowmap.core.readers.las.cloud import open_cloud, survey
from furrowmap.core.runtime.errors import InputError


def outcome(path: Path) -> dict[str, object]:
    try:
        cloud = open_cloud(path)
        found = survey(cloud)
    except InputError as error:
        return {"error": error.code, "lines": error.lines}
    notices = (*cloud.notices, *found.notices())
    return {
        "points": found.points,
        "promised": cloud.points,
        "notices": [notice.code for notice in notices],
        "texts": [notice.text for notice in notices],
    }


def peak_kb() -> int:
    """The most memory that this program has held; `getrusage` would count that of the process which started it."""
    status = Path("/proc/self/status").read_text()
    return int(status.split("VmHWM:")[1].split()[0])


if __name__ == "__main__":
    limit = int(sys.argv[1])
    resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
    for name in sys.argv[2:]:
        start = time.process_time()
        found = outcome(Path(name))
        spent_s = time.process_time() - start
        answer = {"name": Path(name).name, "spent_s": spent_s, "peak_kb": peak_kb(), **found}
        sys.stdout.write(json.dumps(answer) + "\n")
        sys.stdout.flush()
