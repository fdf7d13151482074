"""Programs under watch: what they and all that they start connect to, listen on, start, unpickle and make in TMPDIR.

Python reports these events to audit hooks (PEP 578); the hook is in `sitecustomize`, which each Python that is started
imports. strace reports the calls of native libraries as well, where there is one.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from types import MappingProxyType
from typing import Any

HOOK = """
import os, sys

def install(folder=os.environ["WATCHED"], temporary=os.environ["TMPDIR"]):
    import json

    file = os.open(os.path.join(folder, f"{os.getpid()}.jsonl"), os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o600)
    here = sys._getframe().f_code.co_filename

    def put(event, **what):
        os.write(file, (json.dumps({"pid": os.getpid(), "event": event, **what}) + "\\n").encode())

    def caller():
        frame = sys._getframe(2)
        while frame is not None and os.path.basename(frame.f_code.co_filename) in ("pickle.py", "cloudpickle.py"):
            frame = frame.f_back
        return "" if frame is None else frame.f_code.co_filename

    def watch(event, arguments):
        if event in ("socket.connect", "socket.bind", "socket.sendto"):
            put(event, address=str(arguments[1]) if not isinstance(arguments[1], tuple) else list(arguments[1][:2]),
                socket=id(arguments[0]))
        elif event in ("socket.getaddrinfo", "socket.gethostbyname", "socket.gethostbyaddr"):
            put(event, address=[os.fsdecode(arguments[0] or ""), 0])
        elif event == "subprocess.Popen":
            put(event, program=os.fsdecode(arguments[0] or arguments[1][0]))
        elif event in ("os.system", "os.startfile", "webbrowser.open"):
            put(event, program=os.fsdecode(arguments[0]))
        elif event in ("os.exec", "os.posix_spawn"):
            put(event, program=os.fsdecode(arguments[0]))
        elif event == "pickle.find_class":
            put(event, caller=caller(), name=f"{arguments[0]}.{arguments[1]}")
        elif event in ("sqlite3.enable_load_extension", "sqlite3.load_extension"):
            put(event, name=str(arguments[1]))
        elif event in ("open", "os.mkdir") and isinstance(arguments[0], str):
            if os.path.dirname(arguments[0]) == temporary:
                put(event, path=arguments[0], mode=arguments[1],
                    flags=arguments[2] if event == "open" else 0)

    put("start")
    sys.addaudithook(watch)

install()
del install
"""
"""No part of it may raise, nor leave names to the program."""
CALL = re.compile(r"^(\d+) +(connect|bind)\((\d+), \{sa_family=AF_INET6?, (.*)")
EXECUTION = re.compile(r'^(\d+) +execve\("((?:[^"\\]|\\.)*)"(.*)$')
RESUMED = re.compile(r"^(\d+) +<\.\.\. execve resumed>.* = 0$")
PORT = re.compile(r"sin6?_port=htons\((\d+)\)")
ADDRESS = re.compile(r'inet_(?:addr\(|pton\(AF_INET6, )"([^"]+)"')


@dataclass(frozen=True)
class Seen:
    """What was seen of a program and all that it started.

    Attributes:
        status: its exit status.
        said: standard output and error.
        connected: hosts and ports of TCP or UDP; port 0 where a host was looked up.
        bound: addresses and ports.
        programs: paths of what was started, its own interpreter as well.
        unpickled: names of classes and functions that were unpickled, by the file whose code did it.
        extensions: calls to load extensions of SQLite.
        imported: for whom hostile modules are put somewhere: what they noted.
        shared: what was made directly in TMPDIR so that another user could have made it before, or write to it.
    """

    status: int
    said: str
    connected: set[tuple[str, int]] = field(default_factory=set)
    bound: set[tuple[str, int]] = field(default_factory=set)
    programs: set[str] = field(default_factory=set)
    unpickled: dict[str, set[str]] = field(default_factory=dict)
    extensions: set[str] = field(default_factory=set)
    imported: str = ""
    shared: set[str] = field(default_factory=set)


@cache
def strace() -> str | None:
    """The path of an strace that works here."""
    program = shutil.which("strace") if sys.platform == "linux" else None
    if program is None:
        return None
    probe = [program, "-f", "--seccomp-bpf", "-e", "trace=bind", "true"]
    return program if subprocess.run(probe, capture_output=True, check=False).returncode == 0 else None


def watched(
    words: Sequence[str | Path],
    folder: Path,
    scratch: Path,
    given: str = "",
    variables: Mapping[str, str] = MappingProxyType({}),
) -> Seen:
    """Run a program in `folder` with an input and variables of the environment; TMPDIR and notes are in `scratch`."""
    start, notes, temporary = (scratch / name for name in ("start", "notes", "temporary"))
    for made in (start, notes, temporary):
        shutil.rmtree(made, ignore_errors=True)
        made.mkdir(parents=True)
    (start / "sitecustomize.py").write_text(HOOK)
    trace = scratch / "trace"
    trace.write_text("")
    options = ["-f", "-qq", "--seccomp-bpf", "-e", "trace=connect,bind,execve", "-s", "4096", "-o", trace]
    done = subprocess.run(
        [*([strace(), *options] if strace() else ()), *words],
        cwd=folder,
        env=os.environ | {"PYTHONPATH": str(start), "WATCHED": str(notes), "TMPDIR": str(temporary), **variables},
        input=given.encode(),
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        timeout=600.0,
        check=False,
    )
    seen = Seen(done.returncode, done.stdout.decode(errors="replace"))
    events = [json.loads(line) for path in notes.iterdir() for line in path.read_text().splitlines()]
    for number, event in enumerate(events):
        if not _is_source(event, events[number + 1 :]):
            _add_event(seen, event)
    if sum(event["event"] == "start" for event in events) > 1:
        seen.programs.add(sys.executable)
    seen.shared.difference_update(_own(event) for event in events)
    _add_calls(seen, trace.read_text(errors="replace").splitlines())
    return seen


def _is_source(event: dict[str, Any], later: Sequence[dict[str, Any]]) -> bool:
    """Whether a socket is bound only to connect from there: nothing listens at it.

    Other threads of the process may do something in between.
    """
    if event["event"] != "socket.bind":
        return False
    own = (event["pid"], event["socket"])
    following = (other for other in later if (other["pid"], other.get("socket")) == own)
    return next(following, {}).get("event") == "socket.connect"


def _add_event(seen: Seen, event: dict[str, Any]) -> None:
    """What an audit hook noted."""
    if isinstance(address := event.get("address"), list):
        to = seen.bound if event["event"] == "socket.bind" else seen.connected
        to.add((str(address[0]), int(address[1])))
    elif "program" in event:
        seen.programs.add(event["program"])
    elif "caller" in event:
        seen.unpickled.setdefault(event["caller"], set()).add(event["name"])
    elif "path" in event:
        if event["event"] == "os.mkdir" or event["flags"] & (os.O_WRONLY | os.O_RDWR | os.O_CREAT):
            seen.shared.add(event["path"])
    elif event["event"] != "start":
        seen.extensions.add(event["event"])


def _own(event: dict[str, Any]) -> str | None:
    """The path of what was made new and for this user alone: no other user had made it before."""
    is_own = event["mode"] == 0o700 if event["event"] == "os.mkdir" else event.get("flags", 0) & os.O_EXCL
    return event.get("path") if is_own else None


def _add_calls(seen: Seen, lines: Sequence[str]) -> None:
    """What strace noted."""
    begun: dict[str, str] = {}
    bound: list[tuple[str, int]] = []
    not_connected: dict[tuple[str, str], tuple[str, int]] = {}
    for line in lines:
        if found := CALL.match(line):
            place = ADDRESS.search(found[4])
            port = PORT.search(found[4])
            if place and port and found[2] == "bind":
                bound.append((place[1], int(port[1])))
                not_connected[found[1], found[3]] = bound[-1]
            elif place and port:
                seen.connected.add((place[1], int(port[1])))
                if source := not_connected.pop((found[1], found[3]), None):  # it was bound only to connect from there
                    bound.remove(source)
        elif found := EXECUTION.match(line):
            if found[3].endswith(" = 0"):
                seen.programs.add(found[2])
            begun[found[1]] = found[2]
        elif found := RESUMED.match(line):
            seen.programs.add(begun[found[1]])
    seen.bound.update(bound)
