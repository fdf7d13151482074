"""Trials of sessions in processes that may die, with bounds on time, memory, files and the network."""

from __future__ import annotations

import ctypes
import faulthandler
import gc
import logging
import mmap
import os
import pickle
import platform
import resource
import shutil
import signal
import struct
import sys
import time
import traceback
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from random import Random
from typing import Any, Final

import msgspec

import furrowmap
from furrowmap.cli.main import COMMANDS
from furrowmap.core.runtime.errors import FurrowmapError
from furrowmap.core.runtime.settings import using_threads
from furrowmap.warm_up import warm_up
from tests.fuzz_sessions import judge
from tests.fuzz_sessions.commands import Outcome, do, lines
from tests.fuzz_sessions.grammar import SessionText, session_of, smaller
from tests.fuzz_sessions.material import Stock, make_stock
from tests.fuzz_sessions.place import Listing, Place, clear, lay, lay_outside, listing

LONGEST_S: Final = 60
"""Of processor time for a session; on the wall, where others work as well, five times as much."""
MOST_BYTES: Final = 2 << 30
"""Of memory that a session may take beyond that of the process, and of the largest file."""
BATCH: Final = 1000
"""Sessions by one process, before another one is forked."""
DEEP: Final = 0.01
"""Share of right sessions that a command of seconds is given for."""
Give = Callable[[Sequence[str]], Outcome]
SIGNALS: Final = {signal.SIGPROF: "hang", signal.SIGALRM: "hang", signal.SIGSYS: "network", signal.SIGKILL: "memory"}


@dataclass(frozen=True)
class Finding:
    """A session that ended against what must hold.

    Attributes:
        seed, number: of the session; they make it again.
        kind: such as "exception", "crash", "hang", "memory", "outside".
        what: happened, and where.
        line: the command line.
    """

    seed: str
    number: int
    kind: str
    what: str
    line: Sequence[str] = ()


@dataclass
class Tally:
    """What came of sessions.

    Attributes:
        sessions, commands: their numbers.
        ends: how often commands ended so, by the command and the code of its error.
        longest_s, most_bytes: the longest processor time and the most memory of a session, each with its number.
        findings: what must not be.
    """

    sessions: int = 0
    commands: int = 0
    ends: dict[str, int] = field(default_factory=dict)
    longest_s: tuple[float, int] = (0.0, 0)
    most_bytes: tuple[int, int] = (0, 0)
    findings: list[Finding] = field(default_factory=list)

    def add(self, other: Tally) -> None:
        """Those of another process, too."""
        self.sessions += other.sessions
        self.commands += other.commands
        for end, count in other.ends.items():
            self.ends[end] = self.ends.get(end, 0) + count
        self.longest_s = max(self.longest_s, other.longest_s)
        self.most_bytes = max(self.most_bytes, other.most_bytes)
        self.findings += other.findings


def made(stock: Stock, seed: str, number: int) -> tuple[list[SessionText], Random]:
    """The sessions of a trial, and the chance that decides all else."""
    chance = Random(f"{seed} {number}")
    count = chance.choices((1, 2, 3), (92, 5, 3))[0]
    return [session_of(stock, chance) for _ in range(count)], Random(f"{seed} {number} place")


def run(stock: Stock, seed: str, numbers: range, folder: Path, give: Give = do) -> Iterator[Tally]:
    """Try the sessions of these numbers, in one process after the other; `give` runs a command line."""
    state = mmap.mmap(-1, 8)
    first = numbers.start
    while first < numbers.stop:
        last = min(first + BATCH, numbers.stop)
        answer = folder / "tally"
        answer.unlink(missing_ok=True)
        gc.freeze()
        sys.stdout.flush()
        pid = os.fork()
        if pid == 0:
            _end_by(lambda: _work(stock, seed, range(first, last), folder, state, answer, give))  # noqa: B023
        _, status = os.waitpid(pid, 0)
        tally = msgspec.json.decode(answer.read_bytes(), type=Tally) if answer.exists() else Tally()
        first = last
        if status != 0:
            (number,) = struct.unpack("<q", state[:8])
            code = os.waitstatus_to_exitcode(status)
            where = (folder / "stack").read_text(errors="replace")[-3000:] if (folder / "stack").exists() else ""
            kind = SIGNALS.get(signal.Signals(-code), "crash") if code < 0 else "crash"
            tally.findings.append(Finding(seed, number, kind, f"ended by {code}\n{where}"))
            tally.sessions += 1
            first = number + 1
            for one in folder.glob("trials*"):
                one.rename(folder / f"found{number}")
        yield tally


def _end_by(work: Any) -> None:
    """Do the work of a forked process, and end it."""
    try:
        work()
        os._exit(0)
    except BaseException:  # noqa: BLE001
        traceback.print_exc()
    finally:
        os._exit(70)


def _work(stock: Stock, seed: str, numbers: range, folder: Path, state: mmap.mmap, answer: Path, give: Give) -> None:
    """What a forked process does; its tally is written after each session, as it may die in the next."""
    prepare(folder)
    root = folder / f"trials{numbers.start}"
    lay_outside(root, stock)
    tally = Tally()
    for number in numbers:
        struct.pack_into("<q", state, 0, number)
        texts, chance = made(stock, seed, number)
        found = trial(root, stock, texts, chance, (seed, number), tally, give)
        tally.sessions += 1
        if found:
            (root / "outside" / "new").unlink(missing_ok=True)
            root.rename(folder / f"found{number}")
            lay_outside(root, stock)
        else:
            clear(root)
        if found or number + 1 == numbers.stop or number % 10 == 0:
            answer.write_bytes(msgspec.json.encode(tally))
    shutil.rmtree(root)


def prepare(folder: Path) -> None:
    """Bounds and watches of this process: they cannot be taken back."""
    os.environ.update(
        {"HOME": str(folder / "home"), "OGR_SQLITE_SYNCHRONOUS": "OFF", "PROJ_NETWORK": "OFF", "FURROWMAP_THREADS": "1"}
    )
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    resource.setrlimit(resource.RLIMIT_FSIZE, (MOST_BYTES, MOST_BYTES))
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    size = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0]) * mmap.PAGESIZE
    resource.setrlimit(resource.RLIMIT_AS, (size + 2 * MOST_BYTES,) * 2)
    stack = (folder / "stack").open("w")
    faulthandler.enable(stack)
    for number in (signal.SIGPROF, signal.SIGALRM):
        signal.signal(number, signal.SIG_DFL)
        faulthandler.register(number, stack, chain=True)
    no_network()
    sys.addaudithook(judge.WATCH)
    os.fsync = lambda _: None
    raised = logging.getLogger("furrowmap.cli")
    raised.setLevel(logging.DEBUG)
    raised.propagate = False
    raised.addHandler(LAST)


class Last(logging.Handler):
    """Keeps the traceback of the last error."""

    def __init__(self) -> None:
        super().__init__()
        self.text = ""

    def emit(self, record: logging.LogRecord) -> None:
        """Keep it."""
        if record.exc_info and record.exc_info[1] is not None:
            error = record.exc_info[1]
            if not isinstance(error, FurrowmapError) or error.code in ("system", "fault", "out-of-memory"):
                self.text = "".join(traceback.format_exception(error)[-12:])


LAST: Final = Last()


def trial(
    root: Path,
    stock: Stock,
    texts: list[SessionText],
    chance: Random,
    number: tuple[str, int],
    tally: Tally,
    give: Give = do,
) -> bool:
    """One session: lay it, give the commands, judge; whether there is a finding."""
    place = lay(root, stock, texts, chance)
    before = listing(root)
    os.environ["FURROWMAP_MACHINES"] = str(root / "home" / "machines")
    judge.temporary_folder(place)
    right = all(text.wrong == 0 and not text.edits for text in texts)
    for line in lines(place, chance, right=right, deep=DEEP):
        tally.commands += 1
        found = [
            Finding(*number, kind, what, line) for kind, what in _judged(place, before, line, number[1], tally, give)
        ]
        if found:
            tally.findings += found[:3]
            return True
        before = listing(root)
    return False


def _judged(
    place: Place, before: Listing, line: Sequence[str], number: int, tally: Tally, give: Give
) -> Iterator[tuple[str, str]]:
    """Give one command, and tell what must not be."""
    memory = _Memory()
    LAST.text = ""
    judge.WATCH.seen.clear()
    signal.setitimer(signal.ITIMER_PROF, LONGEST_S)
    signal.setitimer(signal.ITIMER_REAL, 5 * LONGEST_S)
    begun_s = time.process_time()
    OPENED.begin(place.outside)
    with printed() as said:
        judge.WATCH.allowed = (str(place.root.resolve()), *judge.own_folders())
        try:
            status, error = give(line)
        finally:
            judge.WATCH.allowed = ()
    took_s = time.process_time() - begun_s
    names = OPENED.names()
    signal.setitimer(signal.ITIMER_PROF, 0)
    signal.setitimer(signal.ITIMER_REAL, 0)
    taken = memory.taken()
    end = f"{line[0]}{' --preview' if '--preview' in line else ''}: {error.code if error else status}"
    tally.ends[end] = tally.ends.get(end, 0) + 1
    tally.longest_s = max(tally.longest_s, (took_s, number))
    tally.most_bytes = max(tally.most_bytes, (taken, number))
    after = listing(place.root)
    if taken > MOST_BYTES:
        yield "memory", f"{taken >> 20} MB"
    yield from judge.faults(line, status, error, (said[0], said[1]), LAST.text)
    yield from judge.changes(place, before, after, failed=status not in (0, 4) and line[0] != "batch")
    yield from judge.opened(place, names, line)
    for event in judge.WATCH.seen[:3]:
        yield "outside", event
    if status == 0:
        yield from judge.products(before, after)


class _Memory:
    """The most memory that this process takes from now on."""

    def __init__(self) -> None:
        with suppress(OSError):
            Path("/proc/self/clear_refs").write_text("5", encoding="ascii")  # the highest mark begins anew
        self._children = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss
        self._before = _kilobytes("VmRSS")

    def taken(self) -> int:
        """Bytes beyond those of the beginning, or of a process that it started, if that took more."""
        children = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss
        grown = children if children > self._children else 0
        return max(_kilobytes("VmHWM") - self._before, grown) << 10


def _kilobytes(name: str) -> int:
    for line in Path("/proc/self/status").read_text(encoding="ascii").splitlines():
        if line.startswith(name):
            return int(line.split()[1])
    return 0


@contextmanager
def printed() -> Iterator[list[str]]:
    """What is printed within, by native libraries, too: standard output and standard error."""
    said: list[str] = []
    files = [os.memfd_create(name) for name in ("out", "err")]
    kept = [os.dup(number) for number in (1, 2)]
    for file, number in zip(files, (1, 2), strict=True):
        os.dup2(file, number)
    try:
        yield said
    finally:
        for stream in (sys.stdout, sys.stderr):
            stream.flush()
        for file, own, number in zip(files, kept, (1, 2), strict=True):
            os.dup2(own, number)
            os.close(own)
            os.lseek(file, 0, os.SEEK_SET)
            said.append(os.read(file, 1 << 22).decode("utf-8", "replace"))
            os.close(file)


_LIBC: Final = ctypes.CDLL(None, use_errno=True)
_IN_OPEN: Final = 0x20
_EVENT: Final = struct.Struct("iIII")


class Opened:
    """Sees which files of a folder are opened, by whatever library (inotify of Linux)."""

    def __init__(self) -> None:
        self._watch = -1
        self._folder = Path()

    def begin(self, folder: Path) -> None:
        """Look at a folder from now on; what came before is forgotten."""
        if self._folder != folder:
            self._watch = _LIBC.inotify_init1(os.O_NONBLOCK)
            self._folder = folder
            _LIBC.inotify_add_watch(self._watch, os.fsencode(folder), _IN_OPEN)
        self.names()

    def names(self) -> list[str]:
        """The names of those that were opened."""
        names: list[str] = []
        with suppress(BlockingIOError):
            data = os.read(self._watch, 1 << 16)
            at = 0
            while at < len(data):
                *_, length = _EVENT.unpack_from(data, at)
                name = data[at + _EVENT.size : at + _EVENT.size + length].rstrip(b"\0").decode()
                names += [name] if name else []
                at += _EVENT.size + length
        return names


OPENED: Final = Opened()

_SYSCALLS: Final = {"x86_64": (0xC000003E, 42), "aarch64": (0xC00000B7, 203)}
"""The number of an architecture in the kernel's audits, and that of the call `connect`."""


def no_network() -> None:
    """Let the kernel end this process, and any that it starts, with SIGSYS once it asks for a connection (seccomp)."""
    if platform.machine() not in _SYSCALLS:
        return
    architecture, connect = _SYSCALLS[platform.machine()]
    load = 0x20
    equal = 0x15
    give = 0x06
    allow = 0x7FFF0000
    kill = 0x80000000
    program = [
        (load, 0, 0, 4), (equal, 0, 3, architecture), (load, 0, 0, 0), (equal, 0, 1, connect), (give, 0, 0, kill),
        (give, 0, 0, allow),
    ]  # fmt: skip
    code = ctypes.create_string_buffer(b"".join(struct.pack("<HBBI", *one) for one in program))
    filled = struct.pack("<HxxxxxxQ", len(program), ctypes.addressof(code))
    _LIBC.prctl(38, 1, 0, 0, 0)  # no new privileges
    _LIBC.prctl(22, 2, ctypes.create_string_buffer(filled), 0, 0)  # filter


def stock_of(folder: Path) -> Stock:
    """The stock, made in a process of its own: threads of libraries do not outlive a fork."""
    answer = folder / "stock.pickle"
    (folder / "stock").mkdir()
    pid = os.fork()
    if pid == 0:
        _end_by(lambda: answer.write_bytes(pickle.dumps(make_stock(folder / "stock"))))
    _, status = os.waitpid(pid, 0)
    assert status == 0, "no stock was made"
    stock: Stock = pickle.loads(answer.read_bytes())
    shutil.rmtree(folder / "stock")
    return stock


def load() -> None:
    """Import everything and load the kernels, so that forked processes have them."""
    for name in furrowmap.__all__:
        getattr(furrowmap, name)
    for module in {*COMMANDS.values()}:
        import_module(f"furrowmap.cli.{module}")
    import_module("furrowmap.workflows.run.products")
    with using_threads(1):
        warm_up(["run"])


def shrunk(stock: Stock, finding: Finding, folder: Path) -> list[SessionText]:
    """The sessions of a finding with as little as shows the same kind, in processes of their own."""
    texts, _ = made(stock, finding.seed, finding.number)
    place = 0
    while place < len(texts):
        less = next((one for one in smaller(texts[place]) if _shows(stock, texts, place, one, finding, folder)), None)
        if less is None:
            place += 1
        else:
            texts[place] = less
    return texts


def _shows(
    stock: Stock, texts: list[SessionText], place: int, less: SessionText, finding: Finding, folder: Path
) -> bool:
    """Whether a trial with a smaller session has the same finding."""
    changed = [*texts[:place], less, *texts[place + 1 :]]
    answer = folder / "shown"
    answer.unlink(missing_ok=True)
    pid = os.fork()
    if pid == 0:
        _end_by(lambda: _try_again(stock, changed, finding, folder, answer))
    _, status = os.waitpid(pid, 0)
    shutil.rmtree(folder / "smaller", ignore_errors=True)
    return answer.exists() if status == 0 else finding.kind in ("crash", *SIGNALS.values())


def _try_again(stock: Stock, texts: list[SessionText], finding: Finding, folder: Path, answer: Path) -> None:
    prepare(folder)
    tally = Tally()
    chance = Random(f"{finding.seed} {finding.number} place")
    lay_outside(folder / "smaller", stock)
    trial(folder / "smaller", stock, texts, chance, (finding.seed, finding.number), tally)
    if any(one.kind == finding.kind for one in tally.findings):
        answer.touch()
