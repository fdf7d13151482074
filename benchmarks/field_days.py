"""Worked ground of real harvest days, from the machine's own log: 21 ISO 11783-10 time logs without a lidar.

The logs (1 Hz: position, working state, counter of the area; positions were shifted by their publisher) lie beside the
checkout; `expected_union_m2` is what an independent decoder found for each, as their README tells.
"""

from __future__ import annotations

import struct
import sys
import xml.etree.ElementTree as ET
from pathlib import Path
from time import perf_counter

import numpy as np
from numpy.typing import NDArray
from pyproj import CRS

from furrowmap.core.trajectory.projection import MapFrame
from furrowmap.core.values.session import Implement
from furrowmap.core.values.tool_states import ToolState, ToolStates
from furrowmap.core.values.trajectory import Motion, Trajectory, trajectory_from_attitude
from furrowmap.core.work.ground import WorkedGround, worked_ground
from furrowmap.core.trajectory.smoothing import smooth_path

FloatArray = NDArray[np.float64]

LOGS = Path(__file__).resolve().parents[2] / "shared" / "data" / "isoxml" / "field_days" / "harvest_21_fields"
EXPECTED_UNION_M2 = {
    1: 43145, 2: 36437, 3: 17454, 4: 26690, 5: 15860, 6: 2132, 7: 40158, 8: 57386, 9: 42497, 15: 44990, 16: 43058,
    17: 69342, 18: 10557, 19: 26093, 20: 13759, 21: 14834, 22: 52575, 23: 12059, 24: 23290, 25: 19683, 26: 6178,
}  # fmt: skip
WIDTH_M = 9.0
WORKING, COUNTER = 0x8D, 0x74
LONGEST_GAP_S = 15.0
CREEPING_MPS = 0.3
"""Slower than this, positions a second apart show no course."""


def main() -> int:
    if not LOGS.is_dir():
        print(f"the sample logs are not there: {LOGS}", file=sys.stderr)
        return 1
    print("| log | knots | passes | worked m² | expected | difference | swept m² | counter | overlap m² | seconds |")
    print("|---|---:|---:|---:|---:|---:|---:|---:|---:|---:|")
    total = np.zeros(5)
    for number, expected in EXPECTED_UNION_M2.items():
        records = read_log(LOGS / f"TLG{number:05d}")
        begin = perf_counter()
        ground, knots = work(records)
        seconds = perf_counter() - begin
        counted = np.nanmax(records[:, 4]) - np.nanmin(records[:, 4])
        figures = ground.figures
        row = [figures.worked.ellipsoid_m2, expected, figures.swept_m2, counted, figures.overlap.ellipsoid_m2]
        total += row
        print(line(str(number), f"{knots:,}", str(figures.passes), row, f"{seconds:.2f}"))
    print(line("all", "", "", total.tolist(), ""))
    return 0


def line(name: str, knots: str, passes: str, row: list[float], seconds: str) -> str:
    worked, expected, swept, counted, overlap = row
    areas = f"{worked:,.0f} | {expected:,.0f} | {worked / expected - 1:+.2%} | {swept:,.0f} | {counted:,.0f}"
    return f"| {name} | {knots} | {passes} | {areas} | {overlap:,.0f} | {seconds} |"


def read_log(stem: Path) -> FloatArray:
    """(n, 5): time of day as UTC, longitude, latitude, working state, counted m²; what a record leaves out stays."""
    header = ET.parse(stem.with_suffix(".xml")).getroot()
    entries = [int(entry.attrib["A"], 16) for entry in header.findall("DLV")]
    data = stem.with_suffix(".bin").read_bytes()
    latest = dict.fromkeys(entries, np.nan)
    rows, at = [], 0
    while at + 16 <= len(data):
        millis, day, lat, lon, _, count = struct.unpack_from("<IHiiBB", data, at)
        at += 16
        for _ in range(count):
            index, value = struct.unpack_from("<Bi", data, at)
            at += 5
            latest[entries[index]] = value
        t_s = 315_532_800 + 86_400 * day + millis / 1000.0
        rows.append((t_s, 1e-7 * lon, 1e-7 * lat, latest[WORKING], latest[COUNTER]))
    table = np.array(rows)
    return table[np.concatenate([[True], np.diff(np.maximum.accumulate(table[:, 0])) > 0])]


def work(records: FloatArray) -> tuple[WorkedGround, int]:
    """The ground worked, and how many positions it comes from."""
    zone = int((records[0, 1] + 180.0) // 6.0) + 1
    frame = MapFrame(CRS.from_epsg(32_600 + zone))
    trajectory = drive(records[:, 0], np.column_stack(frame.project(records[:, 1], records[:, 2])))
    tool = Implement(width_m=WIDTH_M, xy_m=(0.0, 0.0))
    return worked_ground(trajectory, states(records[:, 0], records[:, 3] == 1), tool, frame), len(trajectory)


def drive(t_s: FloatArray, en_m: FloatArray) -> Trajectory:
    """Forward along the course: a machine at work does not reverse, and where it does not work it does not matter."""
    heading, speed = np.zeros(len(t_s)), np.zeros(len(t_s))
    for part in np.split(np.arange(len(t_s)), 1 + np.flatnonzero(np.diff(t_s) > LONGEST_GAP_S)):
        if len(part) < 2:
            continue
        since = t_s[part] - t_s[part[0]]
        velocity = smooth_path(since, en_m[part] - en_m[part[0]])(since, 1)
        speed[part] = np.hypot(velocity[:, 0], velocity[:, 1])
        moves = speed[part] > CREEPING_MPS
        if moves.any():
            course = np.unwrap(np.arctan2(velocity[moves, 0], velocity[moves, 1]))
            heading[part] = np.degrees(np.interp(since, since[moves], course))
    return trajectory_from_attitude(
        t_s,
        np.column_stack([en_m, np.zeros(len(t_s))]),
        0.0,
        0.0,
        heading % 360.0,
        max_gap_s=LONGEST_GAP_S,
        speed_mps=speed,
        motion=np.where(speed > 0.05, Motion.FORWARD, Motion.STANDING).astype(np.int8),
    )


def states(t_s: FloatArray, working: NDArray[np.bool_]) -> ToolStates:
    """Each record's state until the next record's."""
    change = 1 + np.flatnonzero(np.diff(working))
    cuts = np.unique(np.concatenate([t_s[:1], t_s[change], t_s[-1:]]))
    state = np.where(working[np.searchsorted(t_s, cuts[:-1])], ToolState.DOWN, ToolState.UP).astype(np.int8)
    nowhere = np.full(len(state), np.nan)
    return ToolStates(cuts[:-1], cuts[1:], state, np.ones(len(state)), nowhere, nowhere)


if __name__ == "__main__":
    sys.exit(main())
