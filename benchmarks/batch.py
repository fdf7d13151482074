"""Batches of short simulated sessions: overhead, speed-up of two workers, memory, repetition, kills.

`python benchmarks/batch.py [SESSIONS] [KILLS] [--quick]` prints what docs/explanation/batch.md records. The
sessions are one simulated recording of five seconds under different names, linked, not copied; each run has one thread.
"""

from __future__ import annotations

import os
import random
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import psutil
import shapely

import furrowmap
from furrowmap.exporters.files.batch_state import STATE, Outcome, batch_state
from furrowmap.workflows.batch_jobs import Job, identity, key_of, open_job
from furrowmap.workflows.batch_sources import find_sources
from furrowmap.workflows.batch_task import input_stamps

SCENARIO = """title = "One pass"
seed = 5
[field]
size_e_m = 20.0
size_n_m = 16.0
[drive]
passes = 1
pass_m = [3.2]
speed_work_mps = 1.3
accel_mps2 = 1.5
stand_start_s = 0.4
stand_end_s = 0.3
lead_in_m = 0.4
"""


def season(folder: Path, count: int) -> Path:
    """`count` sessions of one simulated recording."""
    (folder / "scenario.toml").write_text(SCENARIO)
    drive = furrowmap.simulate(folder / "scenario.toml", folder / "drive").folder
    for k in range(count):
        home = folder / "season" / f"s{k:05}"
        home.mkdir(parents=True)
        for name in ("recording.pcap", "gnss.nmea", "boundary.geojson"):
            os.link(drive / name, home / name)
        text = (drive / "session.toml").read_text().replace('name = "One pass"', f'name = "Session {k}"')
        (home / "session.toml").write_text(text)
    return folder / "season"


def command(sessions: Path, results: Path, workers: int) -> list[str]:
    program = [sys.executable, "-m", "furrowmap", "batch", str(sessions), "-o", str(results), "--quiet"]
    return [*program, "--workers", str(workers), "--threads", "1"]


def timed(sessions: Path, results: Path, workers: int) -> tuple[float, list[Outcome]]:
    """Wall time of a batch, and what became of its sessions."""
    begin = time.perf_counter()
    subprocess.run(command(sessions, results, workers), check=True, stdout=subprocess.DEVNULL)
    took = time.perf_counter() - begin
    with batch_state(results / STATE) as state:
        return took, list(state.outcomes().values())


def speed(sessions: Path, folder: Path) -> None:
    walls = {}
    for workers in (1, 2):
        wall, outcomes = timed(sessions, folder / f"results{workers}", workers)
        runs, processor = sum(o.seconds for o in outcomes), sum(o.processor_s for o in outcomes)
        quarter = max(1, len(outcomes) // 4)
        peaks = [o.peak_mb for o in outcomes]
        walls[workers] = wall
        print(
            f"{workers} workers: {len(outcomes)} sessions in {wall:.1f} s; sum of the runs {runs:.1f} s, "
            f"{processor:.1f} s of processor; overhead {100 * (wall * workers / runs - 1):.1f} %; peak memory "
            f"{statistics.median(peaks[:quarter]):.0f} MB in the first quarter, "
            f"{statistics.median(peaks[-quarter:]):.0f} MB in the last",
            flush=True,
        )
    print(f"speed-up {walls[1] / walls[2]:.2f}")
    again, _ = timed(sessions, folder / "results2", 2)
    print(f"again: {again:.2f} s")


def repetition(sessions: Path, folder: Path) -> None:
    """The time of a batch in which all is done; its state is written here, without the runs."""
    results = folder / "repeated"
    results.mkdir()
    with batch_state(results / STATE) as state:
        state._database.execute("PRAGMA synchronous = OFF")  # 2,000 transactions in a row
        for source in find_sources([sessions], results):
            text = source.file.read_text(encoding="utf-8")
            job = Job(source.parts[0], str(source.file), text, str(results), language="en")
            state.keep_names({identity(job.file, None): job.name})
            outcome: Any = Outcome(key_of(job), input_stamps(open_job(job)), seconds=1.0, processor_s=1.0)
            outcome = Outcome(**{**vars(outcome), "footprint": FOOTPRINT, "track": TRACK})
            state.keep(job.name, outcome)
            job.folder.mkdir()
            (job.folder / "report.json").touch()
    first, _ = timed(sessions, results, 2)  # writes the tables
    again, outcomes = timed(sessions, results, 2)
    print(f"nothing to do in {len(outcomes)} sessions: {again:.2f} s; with tables to write {first:.2f} s")


FOOTPRINT = shapely.to_wkb(shapely.box(140.0, 36.0, 140.001, 36.001), hex=True)
TRACK = shapely.to_wkb(shapely.MultiLineString([[(140.0, 36.0), (140.001, 36.001)]]), hex=True)


def kills(sessions: Path, folder: Path, count: int) -> None:
    """Workers, and the batch with its scheduler, are killed at random; then it is called to the end."""
    chance, killed = random.Random(1), {"worker": 0, "batch": 0}
    results = folder / "killed"
    while sum(killed.values()) < count:
        with subprocess.Popen(command(sessions, results, 2), stdout=subprocess.DEVNULL) as batch:
            while batch.poll() is None and sum(killed.values()) < count:
                time.sleep(chance.uniform(1.0, 9.0))
                try:
                    children = psutil.Process(batch.pid).children(recursive=True)
                    workers = [c for c in children if "spawn_main" in " ".join(c.cmdline())]
                    if workers and chance.random() < 0.7:
                        chance.choice(workers).kill()
                        killed["worker"] += 1
                    elif batch.poll() is None:
                        batch.kill()
                        killed["batch"] += 1
                except psutil.NoSuchProcess:
                    continue
        if batch.returncode == 0 and sum(killed.values()) < count:
            shutil.rmtree(results)  # done before it was killed often enough
    _, outcomes = timed(sessions, results, 2)
    whole = sum(len(furrowmap.open_result(path.parent).layers) > 0 for path in results.glob("*/report.json"))
    left = [path.name for path in results.glob("*/.furrowmap-*")]
    failed = [o.failure for o in outcomes if o.failure is not None]
    print(f"{killed}: {whole} whole results of {len(outcomes)} sessions, {len(failed)} failed, left behind: {left}")


if __name__ == "__main__":
    quick = "--quick" in sys.argv
    numbers = [int(word) for word in sys.argv[1:] if word.isdigit()] or [20, 50]
    with tempfile.TemporaryDirectory(prefix="furrowmap-batch-") as place:
        home = Path(place)
        sessions = season(home, numbers[0])
        speed(sessions, home)
        if len(numbers) > 1:
            kills(sessions, home, numbers[1])
        if not quick:
            (home / "many").mkdir()
            repetition(season(home / "many", 1000), home)
