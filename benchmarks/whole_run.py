"""The whole way, `furrowmap run`, and its stages: points per second, and peak memory at one and five times the length.

Of flights, the sample `uav_wheat` where it is beside the checkout, and ten minutes of GNSS and IMU without a scanner.

The recordings are simulated once and kept in the user's cache folder. Decoding is set against velodyne-decoder in the
same run; the whole is measured from outside, as a process of its own, start included. Beside the time that passed
stands the processors' own, which other work on the machine stretches less.

`whole_run.py PROGRAM` runs the long recording and the flight in turn with another `furrowmap`, as of the last release,
prints the ratios, and fails where one is beyond WORSE (`make bench-release`).
"""

from __future__ import annotations

import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import velodyne_decoder

from furrowmap.core.pointclouds.placed_scans import Placer, place_scans
from furrowmap.core.session.opened import open_session
from furrowmap.core.simulator.scenario import scenario_from
from furrowmap.core.simulator.simulate import simulate
from furrowmap.core.trajectory.located import locate

ROUNDS = 3
WORSE = 1.05
OWN = Path(sys.executable).with_name("furrowmap")
PASSES = {"1x": 4, "5x": 19}
SCENARIO = """
name = "bench_{passes}"
seed = 11
[field]
size_e_m = 60.0
size_n_m = 60.0
[drive]
start_xy_m = [15.0, 20.0]
passes = {passes}
pass_m = [14.0]
"""


FLIGHT = Path(__file__).resolve().parents[2] / "shared" / "data" / "uav_wheat" / "session.toml"
INERTIAL = """
name = "bench_inertial"
seed = 5
[place]
lon_lat_deg = [11.3885, 55.328]
height_m = 70.0
geoid_m = 36.621
crs = "EPSG:25832"
[flight]
strips = 12
strip_m = 192.0
spacing_m = 8.0
cross_strips = 0
speed_mps = 4.0
[gnss.rtk]
white_m = 0.008
white_h_m = 0.015
[imu]
[lidar]
start_s = 1e6
"""
"""Ten minutes at 200 Hz."""


def main() -> None:
    if len(sys.argv) > 1:
        sys.exit(compared(Path(sys.argv[1])))
    folders = {label: recording(passes) for label, passes in PASSES.items()}
    print(f"{'':28}{'points':>12}{'seconds':>10}{'M points/s':>12}{'peak MB':>10}")
    for label, folder in folders.items():
        session = folder / "session.toml"
        if label == "1x":
            points = stages(session)
            row("velodyne-decoder, decode", points, median(partial(peer, folder / "recording.pcap")))
        runs = sorted((whole(session) for _ in range(ROUNDS)), key=lambda run: run.seconds)
        middle = runs[len(runs) // 2]
        row(f"whole, {label}", counted(session), middle.seconds, middle.peak_mb)
        print(f"{'':4}processor {middle.processor_s:.1f} s; of the time, in s: {middle.stages}", flush=True)
    flights()


def compared(other: Path) -> int:
    """Medians of this program's figures over another's; 1 if one is beyond WORSE."""
    found = 0
    sessions = [recording(PASSES["5x"]) / "session.toml", FLIGHT]
    for session in filter(Path.exists, sessions):
        for program in (OWN, other):  # compiles kernels
            whole(session, program)
        pairs = [(whole(session), whole(session, other)) for _ in range(ROUNDS)]
        for name in ("seconds", "processor_s", "peak_mb"):
            ratio = statistics.median(getattr(own, name) / getattr(before, name) for own, before in pairs)
            print(f"{session.parent.name:16}{name:14}{ratio:6.2f}{'  worse' if ratio > WORSE else ''}", flush=True)
            found |= ratio > WORSE
    return found


def flights() -> None:
    """The sample flight, and GNSS and IMU alone."""
    for label, session in (("flight", FLIGHT), ("GNSS and IMU, 600 s", inertial())):
        if not session.exists():
            print(f"{label}: {session} is not there")
            continue
        middle = sorted((whole(session) for _ in range(ROUNDS)), key=lambda run: run.seconds)[ROUNDS // 2]
        if middle.points:
            row(label, middle.points, middle.seconds, middle.peak_mb)
        else:
            print(f"{label:40}{middle.seconds:10.2f}{'':12}{middle.peak_mb:10.0f}")
        print(f"{'':4}processor {middle.processor_s:.1f} s; of the time, in s: {middle.stages}", flush=True)


@dataclass(frozen=True)
class Whole:
    """One run: seconds, those of all processors, peak memory, seconds of each stage, and points of the cloud."""

    seconds: float
    processor_s: float
    peak_mb: float
    stages: str
    points: int


def recording(passes: int) -> Path:
    """The recording of a drive."""
    return simulated(f"run_{passes}", SCENARIO.format(passes=passes))


def inertial() -> Path:
    """The session of a flight without a scanner, simulated at the first call."""
    session = simulated("inertial", INERTIAL) / "session.toml"
    text = session.read_text(encoding="utf-8").replace('lidar = ["recording.pcap"]\n', "")
    session.write_text(text, encoding="utf-8")
    return session


def simulated(name: str, scenario: str) -> Path:
    """The recording of a scenario, simulated at the first call."""
    cache = Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "furrowmap" / "benchmarks"
    folder = cache / name
    if not (folder / "truth" / "figures.json").exists():
        print(f"simulating {name}, once …", file=sys.stderr)
        simulate(scenario_from(scenario, "whole_run"), folder)
    return folder


def stages(session_file: Path) -> int:
    """Reading alone, then reading and placing; in this process, kernels compiled."""
    opened = open_session(session_file)
    session = opened.session
    trajectory = locate(opened.positions(), session, opened.frame).trajectory
    near_s = float(np.mean(trajectory.t_s[[0, -1]]))
    placer = Placer(trajectory, session.lidar.mounting, (0.0, 0.0, 0.0))
    points = 0

    def read() -> None:
        nonlocal points
        points = sum(len(scan) for scan in opened.lidar(near_s).scans())

    def place() -> None:
        place_scans(opened.lidar(near_s).scans(), placer, standing=True, sink=lambda _: None)

    read()
    row("reading", points, median(read))
    row("reading and placing", points, median(place))
    return points


def peer(capture: Path) -> None:
    """The field's decoder on the same capture."""
    config = velodyne_decoder.Config(model=velodyne_decoder.Model.VLP16)
    for _ in velodyne_decoder.read_pcap(str(capture), config):
        pass


def whole(session: Path, program: Path = OWN) -> Whole:
    """`furrowmap run` as a process."""
    with tempfile.TemporaryDirectory(dir=recording(PASSES["1x"])) as folder:
        start = time.perf_counter()
        process = subprocess.Popen(
            [program, "run", str(session), "-o", f"{folder}/out", "-q"],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        _, status, usage = os.wait4(process.pid, 0)
        seconds = time.perf_counter() - start
        if status != 0:
            raise SystemExit(f"furrowmap run {session} failed")
        report = json.loads(Path(folder, "out", "report.json").read_text())
        stages = ", ".join(f"{stage} {value:.1f}" for stage, value in report["timings"].items())
        points = int(report["figures"].get("points") or 0)
        return Whole(seconds, usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1024, stages, points)


def counted(session: Path) -> int:
    """Returns in the recording, by the simulator's own count."""
    figures = json.loads((session.parent / "truth" / "figures.json").read_text())
    return int(figures["lidar"]["points"])


def median(work: Callable[[], None]) -> float:
    seconds = []
    for _ in range(ROUNDS):
        start = time.perf_counter()
        work()
        seconds.append(time.perf_counter() - start)
    return statistics.median(seconds)


def row(label: str, points: int, seconds: float, peak_mb: float | None = None) -> None:
    memory = f"{peak_mb:10.0f}" if peak_mb is not None else ""
    print(f"{label:28}{points:12,}{seconds:10.2f}{points / seconds / 1e6:12.2f}{memory}", flush=True)


if __name__ == "__main__":
    main()
