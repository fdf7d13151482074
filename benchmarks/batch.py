"""Batches of short simulated sessions: overhead, speed-up of two workers, memory, repetition, kills.

`python benchmarks/batch.py speed 60` compares two workers with one, `season 1000` has two workers only,
`repetition 1000` has nothing to do, `kills 6 50` kills workers and the batch 50 times. docs/decisions/batches.md
records what they print. The sessions are one simulated recording of five seconds under different names, linked, not
copied; each run has one thread.
"""

from __future__ import annotations

import json
import os
import random
import shutil
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import psutil
import shapely

import furrowmap
from furrowmap.core.runtime.settings import Settings
from furrowmap.exporters.files.batch_state import STATE, SessionOutcome, batch_state
from furrowmap.workflows.batch.batch import input_stamps
from furrowmap.workflows.batch.batch_sources import find_sources
from furrowmap.workflows.batch.jobs import Job, identity, key_of, open_job

SCENARIO = Path(__file__).parents[1] / "tests" / "app" / "one_pass.toml"


def season(folder: Path, count: int) -> Path:
    """`count` sessions of one simulated recording."""
    drive = furrowmap.simulate(SCENARIO, folder / "drive").folder
    for k in range(count):
        home = folder / "season" / f"s{k:05}"
        home.mkdir(parents=True)
        for name in ("recording.pcap", "gnss.nmea", "boundary.geojson"):
            os.link(drive / name, home / name)
        text = (drive / "session.toml").read_text().replace('name = "One pass"', f'name = "Session {k}"')
        (home / "session.toml").write_text(text)
    return folder / "season"


def command(sessions: Path, results: Path, *options: str) -> list[str]:
    program = [sys.executable, "-m", "furrowmap", "batch", str(sessions), "-o", str(results), "--quiet"]
    return [*program, *options, "--threads", "1"]


@contextmanager
def counting(results: Path, step_s: float = 60.0) -> Iterator[None]:
    """Within it, the number of results is printed every minute."""
    ended, begin = threading.Event(), time.perf_counter()

    def count() -> None:
        while not ended.wait(step_s):
            done = sum(1 for _ in results.glob("*/report.json"))
            print(f"  {time.perf_counter() - begin:.0f} s: {done} results", flush=True)

    thread = threading.Thread(target=count, daemon=True)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()


def timed(sessions: Path, results: Path, workers: int) -> tuple[float, list[SessionOutcome]]:
    """Wall time of a batch, and what became of its sessions."""
    begin = time.perf_counter()
    with counting(results):
        subprocess.run(command(sessions, results, "--workers", str(workers)), check=True, stdout=subprocess.DEVNULL)
    took = time.perf_counter() - begin
    with batch_state(results / STATE) as state:
        return took, list(state.outcomes().values())


def figures(outcomes: list[SessionOutcome], wall_s: float, workers: int) -> str:
    """What a batch took; outcomes are in the order in which they ended."""
    runs, processor = sum(o.seconds for o in outcomes), sum(o.processor_s for o in outcomes)
    quarter = max(1, len(outcomes) // 4)
    peaks = [o.peak_mb for o in outcomes]
    return (
        f"{workers} workers: {len(outcomes)} sessions in {wall_s:.1f} s; sum of the runs {runs:.1f} s, "
        f"{processor:.1f} s of processor; overhead {100 * (wall_s * workers / runs - 1):.1f} %; peak memory "
        f"{statistics.median(peaks[:quarter]):.0f} MB in the first quarter, "
        f"{statistics.median(peaks[-quarter:]):.0f} MB in the last"
    )


def speed(folder: Path, count: int) -> None:
    """Two workers against one."""
    sessions, walls = season(folder, count), {}
    for workers in (1, 2):
        wall, outcomes = timed(sessions, folder / f"results{workers}", workers)
        walls[workers] = wall
        print(figures(outcomes, wall, workers), flush=True)
    print(f"speed-up {walls[1] / walls[2]:.2f}")
    again, _ = timed(sessions, folder / "results2", 2)
    print(f"again: {again:.2f} s")


def whole_season(folder: Path, count: int) -> None:
    """Two workers alone."""
    sessions = season(folder, count)
    wall, outcomes = timed(sessions, folder / "results", 2)
    print(figures(outcomes, wall, 2))


def repetition(folder: Path, count: int) -> None:
    """The time of a batch in which all is done; its state is written here, without the runs."""
    sessions, results = season(folder, count), folder / "repeated"
    results.mkdir()
    with batch_state(results / STATE) as state:
        state._database.execute("PRAGMA synchronous = OFF")  # 2,000 transactions in a row
        for source in find_sources([sessions], results):
            text = source.file.read_text(encoding="utf-8")
            job = Job(source.parts[0], str(source.file), text, str(results), Settings(language="en"))
            state.keep_names({identity(job.file, None): job.name})
            outcome: Any = SessionOutcome(key_of(job), input_stamps(open_job(job)), seconds=1.0, processor_s=1.0)
            outcome = SessionOutcome(**{**vars(outcome), "footprint": FOOTPRINT, "track": TRACK})
            state.keep(job.name, outcome)
            job.folder.mkdir()
            (job.folder / "report.json").touch()
    first, _ = timed(sessions, results, 2)  # writes the tables
    again, outcomes = timed(sessions, results, 2)
    print(f"nothing to do in {len(outcomes)} sessions: {again:.2f} s; with tables to write {first:.2f} s")


FOOTPRINT = shapely.to_wkb(shapely.box(140.0, 36.0, 140.001, 36.001), hex=True)
TRACK = shapely.to_wkb(shapely.MultiLineString([[(140.0, 36.0), (140.001, 36.001)]]), hex=True)


def spawned(process: int) -> list[psutil.Process]:
    """The worker processes below a process: Dask's nannies and furrowmap's own engine start them by `spawn`."""
    found = []
    for child in psutil.Process(process).children(recursive=True):
        try:
            if "spawn_main" in " ".join(child.cmdline()):
                found.append(child)
        except psutil.NoSuchProcess:
            continue
    return found


def verdict(sessions: Path, results: Path) -> str:
    """What is in a folder of results after the last call: all sessions are the same drive, and so are their figures."""
    with batch_state(results / STATE) as state:
        outcomes = state.outcomes()
    wanted = {path.name for path in sessions.iterdir()}
    reports = {path.parent.name: json.loads(path.read_text()) for path in results.glob("*/report.json")}
    whole = [name for name in reports if len(furrowmap.open_result(results / name).layers) > 0]
    different = {json.dumps(report["figures"], sort_keys=True) for report in reports.values()}
    failed = [name for name, outcome in outcomes.items() if outcome.failure is not None]
    left = [path.name for path in results.glob("**/.furrowmap-*")]
    return (
        f"{len(whole)} whole results of {len(wanted)} sessions, lost {sorted(wanted - set(whole))}, failed {failed}, "
        f"{len(different)} different sets of figures, left behind: {left}"
    )


def kills(folder: Path, count: int, wanted: int, longest_s: int = 9) -> None:
    """Workers, and the batch with its scheduler, are killed at random; then it is called to the end."""
    chance, killed, calls = random.Random(1), {"worker": 0, "batch": 0}, 0
    sessions, results = season(folder, count), folder / "killed"
    call = command(sessions, results, "--workers", "2")
    while sum(killed.values()) < wanted:
        calls += 1
        with subprocess.Popen(call, stdout=subprocess.DEVNULL) as batch:
            while batch.poll() is None and sum(killed.values()) < wanted:
                what = "worker" if chance.random() < 0.7 else "batch"
                time.sleep(chance.uniform(1.0, longest_s))
                try:
                    while what == "worker" and batch.poll() is None and not spawned(batch.pid):
                        time.sleep(0.1)
                    (chance.choice(spawned(batch.pid)) if what == "worker" else batch).kill()
                except (psutil.NoSuchProcess, IndexError):
                    continue  # it has ended by itself
                killed[what] += 1
                print(f"  call {calls}: {killed}, {len(list(results.glob('*/report.json')))} results", flush=True)
        if batch.returncode == 0 and sum(killed.values()) < wanted:
            print(f"  done: {verdict(sessions, results)}", flush=True)
            shutil.rmtree(results)  # done before it was killed often enough
    timed(sessions, results, 2)
    print(f"{killed} in {calls} calls: {verdict(sessions, results)}")


DOES: dict[str, Callable[..., None]] = {
    "speed": speed,
    "season": whole_season,
    "repetition": repetition,
    "kills": kills,
}

if __name__ == "__main__":
    with tempfile.TemporaryDirectory(prefix="furrowmap-batch-") as place:
        DOES[sys.argv[1]](Path(place), *map(int, sys.argv[2:]))
