"""Damaged inputs to a reader, in a process of its own that may die, with bounds on time and memory."""

from __future__ import annotations

import gc
import json
import mmap
import os
import pickle
import resource
import shutil
import signal
import struct
import traceback
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from random import Random

from furrowmap.core.runtime.errors import FurrowmapError
from tests.fuzz.mutations import Files, mutant

LONGEST_S = 10.0
"""Of processor time; of time on the wall, which also passes while others work, six times as much."""
MOST_BYTES = 1 << 30
"""Address space that a reader may take beyond that of the process when it begins."""
_STATE = struct.Struct("<qq")
_UNSOUND = 70


@dataclass(frozen=True)
class Entry:
    """A reader, or anything else that takes what others wrote.

    Attributes:
        name: of the format.
        seeds: makes valid inputs, small ones, in an empty folder that it may use.
        ways: how an input is read, given the path of its first file; inputs go to each of them in turn.
        mend: makes the checksums of a damaged file right again.
        trials: number of inputs of a round.
    """

    name: str
    seeds: Callable[[Path], Sequence[Files]]
    ways: Callable[[Path], object] | Sequence[Callable[[Path], object]]
    mend: Callable[[bytes], bytes] | None = None
    trials: int = 100

    def read(self, path: Path, number: int) -> None:
        """Read the input of a number."""
        ways = [self.ways] if callable(self.ways) else self.ways
        ways[number % len(ways)](path)


@dataclass(frozen=True)
class Finding:
    """An input that ended in anything but an answer or an error of furrowmap's.

    Attributes:
        entry: of the reader.
        number: of the input; it makes the same input again.
        kind: "crash", "hang", "memory" or "exception".
        what: the signal, or the exception and where it was raised.
    """

    entry: str
    number: int
    kind: str
    what: str


@dataclass
class Result:
    """What came of the inputs to a reader.

    Attributes:
        trials: number of inputs.
        refused: those that ended in an error of furrowmap's.
        findings: those that ended otherwise.
    """

    trials: int
    refused: int
    findings: list[Finding]


def files_of(entry: Entry, seeds: Sequence[Files], number: int) -> dict[str, bytes]:
    """The input of a number, the same in every process."""
    return mutant(seeds, entry.mend, Random(f"{entry.name} {number}"))


def lay(folder: Path, files: Files) -> Path:
    """Write an input; the path of its first file."""
    folder.mkdir(parents=True)
    for name, data in files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data)
    return folder / next(iter(files))


def seeds_of(entry: Entry, folder: Path) -> Sequence[Files]:
    """The valid inputs of a reader, made in a process of its own: threads of libraries do not outlive a fork."""
    made = folder / "seeds"
    made.mkdir()
    pid = os.fork()
    if pid == 0:
        try:
            (folder / "seeds.pickle").write_bytes(pickle.dumps([dict(seed) for seed in entry.seeds(made)]))
            os._exit(0)
        except BaseException:  # noqa: BLE001
            traceback.print_exc()
        finally:
            os._exit(_UNSOUND)
    _, status = os.waitpid(pid, 0)
    assert status == 0, f"no seeds for {entry.name}"
    seeds: Sequence[Files] = pickle.loads((folder / "seeds.pickle").read_bytes())
    return seeds


def run(entry: Entry, seeds: Sequence[Files], first: int, count: int, folder: Path) -> Result:
    """Give a reader the inputs `first` to `first + count - 1`."""
    state = mmap.mmap(-1, _STATE.size)
    said = folder / "findings"
    said.unlink(missing_ok=True)
    findings: list[Finding] = []
    _STATE.pack_into(state, 0, first, 0)
    start = first
    while start < first + count:
        pid = os.fork()
        if pid == 0:
            try:
                _child(entry, seeds, range(start, first + count), state, folder)
                os._exit(0)
            except BaseException:  # noqa: BLE001
                traceback.print_exc()
            finally:
                os._exit(_UNSOUND)
        _, status = os.waitpid(pid, 0)
        number, _ = _STATE.unpack_from(state)
        start = number + 1
        if os.WIFSIGNALED(status):
            name = signal.Signals(os.WTERMSIG(status)).name
            findings.append(Finding(entry.name, number, "hang" if name in ("SIGPROF", "SIGALRM") else "crash", name))
        else:
            assert os.WEXITSTATUS(status) == 0, f"a seed of {entry.name} cannot be read"
    if said.exists():
        findings += [Finding(**json.loads(line)) for line in said.read_text().splitlines()]
    _, refused = _STATE.unpack_from(state)
    return Result(count, refused, sorted(findings, key=lambda finding: finding.number))


def _child(entry: Entry, seeds: Sequence[Files], numbers: range, state: mmap.mmap, folder: Path) -> None:
    """Read inputs, one after the other; the process may die of any of them."""
    for number, seed in enumerate(seeds):  # kernels are loaded, and the seeds are seen to be sound
        for way in (0, 1):
            entry.read(lay(folder / f"sound{os.getpid()}-{number}-{way}", seed), way)
    null = os.open(os.devnull, os.O_RDWR)
    for stream in (0, 1, 2):
        os.dup2(null, stream)
    for kind in (signal.SIGPROF, signal.SIGALRM):
        signal.signal(kind, signal.SIG_DFL)
    held = int(Path("/proc/self/statm").read_text().split()[0]) * mmap.PAGESIZE
    resource.setrlimit(resource.RLIMIT_AS, (held + MOST_BYTES, held + MOST_BYTES))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    gc.freeze()
    _, refused = _STATE.unpack_from(state)
    place = folder / "input"
    for number in numbers:
        _STATE.pack_into(state, 0, number, refused)
        files = files_of(entry, seeds, number)
        shutil.rmtree(place, ignore_errors=True)
        path = lay(place, files)
        signal.setitimer(signal.ITIMER_PROF, LONGEST_S)
        signal.setitimer(signal.ITIMER_REAL, 6 * LONGEST_S)
        found = _read(entry, path, number)
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.setitimer(signal.ITIMER_REAL, 0)
        if isinstance(found, Finding):
            with (folder / "findings").open("a") as said:
                said.write(json.dumps(asdict(found)) + "\n")
        else:
            refused += found
        _STATE.pack_into(state, 0, number, refused)


def _read(entry: Entry, path: Path, number: int) -> Finding | bool:
    """Whether an input was refused, with an error in three parts; what else it ended in."""
    try:
        entry.read(path, number)
    except FurrowmapError as error:
        if all(error.lines) and error.code not in ("failed", "fault"):
            return True
        return Finding(entry.name, number, "exception", f"an error without parts: {error.lines}")
    except MemoryError as error:
        return Finding(entry.name, number, "memory", _where(error))
    except BaseException as error:  # noqa: BLE001 (panics of native libraries are not Exceptions)
        return Finding(entry.name, number, "exception", _where(error))
    return False


def _where(error: BaseException) -> str:
    frames = traceback.extract_tb(error.__traceback__)[-3:]
    places = " < ".join(f"{Path(frame.filename).name}:{frame.lineno} {frame.name}" for frame in reversed(frames))
    return f"{type(error).__name__}: {str(error)[:120]} ({places})"
