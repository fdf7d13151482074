"""Reads files as their kind, within the memory it is given: JSON lines of limit, way and path on standard input.

A JSON line on standard output says what came of each.
"""

from __future__ import annotations

import json
import os
import resource
import sys
import time
from collections import deque
from contextlib import suppress
from pathlib import Path
from typing import Any

from furrowmap.core.readers.image_pixels import read_pixels
from furrowmap.core.readers.las.cloud import open_cloud, survey
from furrowmap.core.readers.text_table import read_table
from furrowmap.core.runtime.errors import FurrowmapError, InputError
from furrowmap.core.session.session_file import load_session
from tests.fuzz.reading import inspect_recording, read_recording


def unreadable(why: str) -> InputError:
    return InputError("treatments-unreadable", path="table", why=why)


def read_both(path: Path) -> None:
    """As `inspect` and as a run do."""
    with suppress(FurrowmapError):
        inspect_recording(path)
    read_recording(path)


WAYS = {
    "recording": read_both,
    "cloud": lambda path: survey(open_cloud(path)),
    "session": load_session,
    "table": lambda path: read_table(path, unreadable),
    "sheet": lambda path: read_table(path, unreadable),
    "image": lambda path: deque([read_pixels(path, 1)], maxlen=0),
}


def outcome(way: str, path: Path) -> str:
    """The code of the error; "read" without one."""
    try:
        WAYS[way](path)
    except FurrowmapError as error:
        return error.code if all(error.lines) else "without its three sentences"
    except ValueError as error:
        return f"not read: {error}" if way == "image" else f"{type(error).__name__}: {error}"
    except BaseException as error:  # noqa: BLE001 (whatever ends a command)
        return f"{type(error).__name__}: {error}"
    return "read"


def read_within(limit: int, way: str, path: Path) -> dict[str, Any]:
    """What came of a file, the peak of resident memory and the processor time, with an address space of `limit`."""
    resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
    Path("/proc/self/clear_refs").write_text("5", encoding="ascii")  # the peak counts from here
    start_s = time.process_time()
    came = outcome(way, path)
    peak_kb = int(Path("/proc/self/status").read_text(encoding="ascii").split("VmHWM:")[1].split()[0])
    return {"came": came, "peak_kb": peak_kb, "spent_s": time.process_time() - start_s}


if __name__ == "__main__":
    with suppress(FurrowmapError):
        read_both(Path(__file__))  # as whatever kind: all readers are imported
    for line in sys.stdin:
        limit, way, path = json.loads(line)
        process = os.fork()  # each in a process of its own, with everything imported once
        if process == 0:
            try:
                sys.stdout.write(json.dumps(read_within(limit, way, Path(path))) + "\n")
                sys.stdout.flush()
            finally:
                os._exit(0)
        status = os.waitstatus_to_exitcode(os.waitpid(process, 0)[1])
        if status:
            sys.stdout.write(json.dumps({"came": f"ended with {status}"}) + "\n")
            sys.stdout.flush()
