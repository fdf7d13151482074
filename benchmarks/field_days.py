"""Worked ground of real harvest days, from the machine's own log: 19 fields in ISO 11783-10 task data, without a lidar.

The task data (1 Hz: position, working state, width, counter of the area; positions were shifted by their publisher) lie
beside the checkout; `UNION_M2` is what an independent decoder found, as their README tells.
"""

from __future__ import annotations

import sys
from pathlib import Path
from time import process_time

import numpy as np

from furrowmap.core.coverage.task_work import task_works
from furrowmap.core.readers.isoxml.log import read_tasks

HARVEST = Path(__file__).resolve().parents[2] / "shared" / "data" / "isoxml" / "field_days" / "harvest_21_fields"
UNION_M2 = {
    "TSK1": 43145, "TSK2": 36437, "TSK3": 17454, "TSK4": 26690, "TSK5": 15860, "TSK6": 2132 + 40158, "TSK7": 57386,
    "TSK8": 42497, "TSK10": 44990, "TSK11": 43058, "TSK12": 69342, "TSK13": 10557, "TSK14": 26093 + 13759,
    "TSK15": 14834, "TSK16": 52575, "TSK17": 12059, "TSK18": 23290, "TSK19": 19683, "TSK20": 6178,
}  # fmt: skip


def main() -> int:
    if not HARVEST.is_dir():
        print(f"the sample task data are not there: {HARVEST}", file=sys.stderr)
        return 1
    read_tasks(HARVEST, "TSK20")  # compiles
    begin = process_time()
    tasks = read_tasks(HARVEST)[1]
    reading_s = process_time() - begin
    begin = process_time()
    works = task_works(HARVEST).works
    seconds = process_time() - begin
    print(
        "| task | positions | passes | worked m² | union by the other decoder | difference | width × way m² | "
        "of it at the width logged | counter | overlap m² | field m² |"
    )
    print("|---|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|")
    total = np.zeros(7)
    for work in works:
        assert work.work.ground is not None
        figures, expected = work.work.ground.figures, UNION_M2[work.task.id]
        row = np.array(
            [
                figures.worked.ellipsoid_m2,
                expected,
                figures.swept_m2,
                work.logged_swept_m2,
                work.task.counted_m2,
                figures.overlap.ellipsoid_m2,
                work.boundary_area_m2,
            ]
        )
        total += row
        print(line(work.task.id, f"{len(work.task.track):,}", str(figures.passes), row))
    print(line("all", f"{sum(len(work.task.track) for work in works):,}", "", total))
    records = sum(len(task.track) for task in tasks)
    print(f"\nCPU: {reading_s:.2f} s to read {records:,} records of 26 values; {seconds:.1f} s in all.")
    return 0


def line(name: str, positions: str, passes: str, row: np.ndarray) -> str:
    worked, expected, *others = row.tolist()
    told = " | ".join(f"{value:,.0f}" for value in others)
    areas = f"{worked:,.0f} | {expected:,.0f} | {worked / expected - 1:+.2%}"
    return f"| {name} | {positions} | {passes} | {areas} | {told} |"


if __name__ == "__main__":
    sys.exit(main())
