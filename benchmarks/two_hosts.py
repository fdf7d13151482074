"""A batch on two hosts made of network namespaces: speed-up of two hosts, kills of all that takes part.

`python benchmarks/two_hosts.py 30` runs a batch on the worker of one host and then on those of both;
`python benchmarks/two_hosts.py 6 50` kills workers, hosts, the scheduler and the batch 50 times. It needs root and
Linux. Each host has a network address, a name and numbers of processes of its own; Dask's scheduler runs on the first,
as the batch does, one worker on each. What ends is started again, as a service manager does. docs/decisions/batches.md
records what it prints.
"""

from __future__ import annotations

import random
import shutil
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import psutil
from batch import command, counting, figures, season, spawned, verdict

from furrowmap.exporters.files.batch_state import STATE, SessionOutcome, batch_state

ADDRESSES = {"north": "10.97.0.1", "south": "10.97.0.2"}
PREFIX = "furrowmap-"
SCHEDULER = f"tcp://{ADDRESSES['north']}:8786"
DASK = [sys.executable, "-m", "dask"]
WORKER = [*DASK, "worker", SCHEDULER, "--nthreads", "1", "--nworkers", "1", "--no-dashboard"]
SERVICES = {
    "scheduler": ("north", [*DASK, "scheduler", "--host", ADDRESSES["north"], "--port", "8786", "--no-dashboard"]),
    "worker of north": ("north", WORKER),
    "worker of south": ("south", WORKER),
}


def ip(*words: str) -> None:
    subprocess.run(["ip", *words], check=True)


@contextmanager
def hosts() -> Iterator[None]:
    """Two network namespaces with a cable between them."""
    with ExitStack() as stack:
        for name in ADDRESSES:
            ip("netns", "add", PREFIX + name)
            stack.callback(ip, "netns", "delete", PREFIX + name)
        first, second = (PREFIX + name for name in ADDRESSES)
        ip("link", "add", "cable", "netns", first, "type", "veth", "peer", "name", "cable", "netns", second)
        for name, address in ADDRESSES.items():
            ip("-n", PREFIX + name, "address", "add", f"{address}/24", "dev", "cable")
            ip("-n", PREFIX + name, "link", "set", "cable", "up")
            ip("-n", PREFIX + name, "link", "set", "lo", "up")
        yield


def on_host(name: str, program: list[str]) -> list[str]:
    """A command line that runs a program on a host; all its processes end with the first."""
    inside = ["sh", "-c", 'hostname "$0"; exec "$@"', name, *program]
    return ["ip", "netns", "exec", PREFIX + name, "unshare", *SPACES, *inside]


SPACES = ("--uts", "--pid", "--fork", "--mount-proc", "--kill-child")


@dataclass
class Services:
    """Scheduler and workers, which are started again when they end."""

    names: tuple[str, ...]
    log: Path
    running: dict[str, subprocess.Popen[bytes]] = field(default_factory=dict)
    stopped: threading.Event = field(default_factory=threading.Event)

    def __enter__(self) -> Services:
        self._thread = threading.Thread(target=self._keep, daemon=True)
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.stopped.set()
        self._thread.join()
        for name in self.names:
            self.running[name].kill()
            self.running[name].wait()

    def _keep(self) -> None:
        while not self.stopped.wait(0.5):
            for name in self.names:
                if name not in self.running or self.running[name].poll() is not None:
                    with self.log.open("ab") as log:
                        self.running[name] = subprocess.Popen(on_host(*SERVICES[name]), stdout=log, stderr=log)


def call(sessions: Path, results: Path) -> list[str]:
    return on_host("north", command(sessions, results, "--scheduler", SCHEDULER))


def outcomes(results: Path) -> list[SessionOutcome]:
    with batch_state(results / STATE) as state:
        return list(state.outcomes().values())


def speed(folder: Path, count: int) -> None:
    """The worker of one host, and those of both."""
    sessions, walls = season(folder, count), []
    for names in (tuple(SERVICES)[:2], tuple(SERVICES)):
        results = folder / f"results{len(names) - 1}"
        with Services(names, folder / "log"), counting(results):
            time.sleep(15.0)  # until all are there
            begin = time.perf_counter()
            subprocess.run(call(sessions, results), check=True, stdout=subprocess.DEVNULL)
            walls.append(time.perf_counter() - begin)
        print(f"{figures(outcomes(results), walls[-1], len(names) - 1)}: {verdict(sessions, results)}", flush=True)
    print(f"speed-up {walls[0] / walls[1]:.2f}")


def kills(folder: Path, count: int, wanted: int, longest_s: int = 9) -> None:
    """Anything is killed at random; then the batch is called to the end."""
    chance, killed, calls = random.Random(1), dict.fromkeys(("worker", "host", "scheduler", "batch"), 0), 0
    sessions, results = season(folder, count), folder / "killed"
    with Services(tuple(SERVICES), folder / "log") as services:
        while True:
            calls += 1
            with subprocess.Popen(call(sessions, results), stdout=subprocess.DEVNULL) as batch:
                while batch.poll() is None and sum(killed.values()) < wanted:
                    what = chance.choice(list(killed))
                    time.sleep(chance.uniform(1.0, longest_s))
                    try:
                        kill(what, chance.choice(["north", "south"]), services, batch)
                    except (psutil.NoSuchProcess, IndexError):
                        continue  # it was not there
                    killed[what] += 1
                    results_there = len(list(results.glob("*/report.json")))
                    print(f"  call {calls}: {killed}, {results_there} results", flush=True)
            if batch.returncode == 0:
                print(f"  done after {killed}: {verdict(sessions, results)}", flush=True)
                if sum(killed.values()) >= wanted:
                    break
                shutil.rmtree(results)
    print(f"{killed} in {calls} calls: {verdict(sessions, results)}")


def kill(what: str, host: str, services: Services, batch: subprocess.Popen[bytes]) -> None:
    """Kill a worker process, all processes of a worker's host at once, the scheduler, or the batch."""
    if what == "worker":
        spawned(services.running[f"worker of {host}"].pid)[0].kill()
    elif what == "host":
        services.running[f"worker of {host}"].kill()
    elif what == "scheduler":
        services.running["scheduler"].kill()
    else:
        batch.kill()


if __name__ == "__main__":
    numbers = [int(word) for word in sys.argv[1:]]
    with tempfile.TemporaryDirectory(prefix="furrowmap-batch-") as place, hosts():
        (kills if len(numbers) > 1 else speed)(Path(place), *numbers)
