"""Live scan matching replayed: how soon after a scan its pose is out, how good it is, and whether memory stays flat.

Scans and positions are handed over in the order of time, in one thread. *Latency* is the time from a whole scan to its
pose, waiting for the one before included, at recording speed; *processor* is the processor's time of it, which other
processes disturb less; *busy* is all work on a scan, with the positions that
came before it and what is put away after its pose is out. Decoding (about a millisecond a scan) is not counted.
Recordings are simulated once and kept in the user's cache folder.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from sessions import line, over_sigma, print_over_sigma, simulated
from trajectory_error import Poses, judge, load_simulation
from whole_run import recording as long_recording

from furrowmap.core.geodesy.projection import map_frame
from furrowmap.core.matching.adjustment import Tool
from furrowmap.core.matching.live import LiveMatching, LivePose
from furrowmap.core.readers.reader import GivesTrack
from furrowmap.core.session.file import load_session
from furrowmap.core.session.inputs import Inputs, LidarReader, open_lidar, open_positions
from furrowmap.core.values.rotation import quaternion_to_attitude

FloatArray = NDArray[np.float64]

DENSE: Mapping[str, object] = {
    "seed": 131,
    "lidar": {"rpm": 300},
    "walls": [[5.0, 5.0, 0.0, 34.0, 0.2, 3.0, 9], [5.0, 30.0, 0.0, 34.0, 0.2, 3.0, 9]],
    "field": {"size_e_m": 46.0, "size_n_m": 36.0},
    "drive": {"start_xy_m": [13.5, 10.0], "passes": 2, "pass_m": [10.0]},
}
"""Five turns a second between walls: scans of twice the usual size."""
LEVEL_KNOWN_DEG = 0.3
"""Shapes are judged from where the stated sigma of the roll is below this: a straight start does not show it."""
MEMORY_EVERY_S = 60.0
HEAD = """\
                       points               latency, ms    processor, ms     busy    memory, MB
                       a scan    median     p95    most   median     p95      p95   first  last"""


@dataclass(frozen=True)
class Replay:
    """What a replay gave, and what it took.

    Attributes:
        poses: of the scans that have one.
        points: (n,) of each scan after the start.
        out_s: (n,) latency.
        work_s: (n,) processor time of it.
        busy_s: (n,) whole work on each scan.
        memory_mb: (time in the recording, resident memory) now and then.
    """

    poses: list[LivePose]
    points: FloatArray
    out_s: FloatArray
    work_s: FloatArray
    busy_s: FloatArray
    memory_mb: list[tuple[float, float]]


def main() -> int:
    options = _options()
    folders = [Path(folder) for folder in options.recordings] or [
        simulated("live_dense", DENSE),
        long_recording(16),
    ]
    sigmas = {}
    print(HEAD)
    judged = []
    for folder in folders:
        found = replay(folder)
        ms, work, busy = 1e3 * found.out_s, 1e3 * found.work_s, 1e3 * found.busy_s
        columns = [f"{folder.name:20}{np.median(found.points):9,.0f}{np.median(ms):10.1f}{np.percentile(ms, 95):8.1f}"]
        columns += [
            f"{ms.max():8.1f}{np.median(work):9.1f}{np.percentile(work, 95):8.1f}{np.percentile(busy, 95):9.1f}"
        ]
        columns += [f"{found.memory_mb[0][1]:8.0f}{found.memory_mb[-1][1]:6.0f}"]
        print("".join(columns), flush=True)
        poses, stated = as_poses(found.poses)
        level = int(np.argmax(stated[:, 3] < LEVEL_KNOWN_DEG))
        simulation = load_simulation(folder)
        known = Poses(poses.t_s[level:], poses.xyz_m[level:], poses.rph_deg[level:])
        errors, ratios = judge(known, stated[level:], simulation)
        sigmas[folder.name] = over_sigma(ratios)
        judged.append(f"{folder.name:20} from {known.t_s[0] - simulation.t0_s:5.1f} s {line(errors)}")
    print("\n".join(["", *judged]))
    print_over_sigma(sigmas)
    return 0


def replay(folder: Path) -> Replay:
    """A recording, scan by scan, the positions that came before the end of each scan first."""
    session_file = folder / "session.toml"
    session = load_session(session_file)
    inputs, frame = Inputs.of(session_file, session), map_frame(session.crs)
    reader = open_positions(inputs, session)
    assert isinstance(reader, GivesTrack)
    track = reader.track()
    implement = session.implement
    tool = Tool(implement.xy_m, 0.5 * implement.width_m) if implement is not None else None
    lever_m = session.antenna.xyz_m if session.antenna is not None else (0.0, 0.0, 0.0)
    offset_s = session.recording.lidar_minus_gnss_s
    live = LiveMatching(session.lidar.mounting, lever_m, tool, frame, offset_s)
    poses: list[LivePose] = []
    points: list[float] = []
    out_s: list[float] = []
    work_s: list[float] = []
    busy_s: list[float] = []
    memory = [(0.0, resident_mb())]
    heard, free_s = 0, -np.inf
    begin_s = end_s = float("nan")
    lidar: LidarReader = open_lidar(inputs, session, float(np.mean(track.t_s)))
    for scan in lidar.scans():
        if not len(scan):
            continue
        end_s = float(scan.t_s[-1]) - offset_s
        begin_s = end_s if np.isnan(begin_s) else begin_s
        begin = time.perf_counter()
        now = int(np.searchsorted(track.t_s, end_s, side="right"))
        if now > heard:
            live.hear(track[heard:now])
            heard = now
        start, start_work = time.perf_counter(), time.process_time()
        pose = live.see(scan)
        given, work = time.perf_counter() - start, time.process_time() - start_work
        live.settle()
        busy = time.perf_counter() - begin
        if pose is not None:
            waits = max(0.0, free_s - end_s)
            if poses:  # the first pose takes a dozen steps, and compiles
                points.append(len(scan))
                out_s.append(waits + given)
                work_s.append(work)
                busy_s.append(busy)
                free_s = end_s + waits + busy
            poses.append(pose)
        if end_s - begin_s - memory[-1][0] >= MEMORY_EVERY_S or len(poses) == 100:
            memory.append((end_s - begin_s, resident_mb()))
    memory.append((end_s - begin_s, resident_mb()))
    return Replay(poses, np.array(points, float), np.array(out_s), np.array(work_s), np.array(busy_s), memory[1:])


def as_poses(live: list[LivePose]) -> tuple[Poses, FloatArray]:
    """The poses as the judge takes them, and their sigmas (n, 6)."""
    rph_deg = np.column_stack(quaternion_to_attitude(np.array([pose.quaternion for pose in live])))
    poses = Poses(np.array([pose.t_s for pose in live]), np.array([pose.xyz_m for pose in live]), rph_deg)
    return poses, np.array([pose.sigma for pose in live])


def resident_mb() -> float:
    """Memory that this process holds now."""
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("recordings", nargs="*", metavar="FOLDER", help="simulated recordings instead of the usual two")
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
