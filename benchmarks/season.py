"""A season of many sessions: time, and peak memory of the command and of its worker, which must not grow.

The result of a run (`python -m benchmarks.season RESULT`) is copied to many places side by side: its surface and change
are moved, its cloud and trajectory are the same files.
"""

from __future__ import annotations

import datetime as dt
import json
import math
import os
import resource
import subprocess
import sys
import tempfile
from pathlib import Path
from time import perf_counter
from typing import Final

import rasterio

import furrowmap

SESSIONS: Final = (3, 12, 30)
A_DAY: Final = 10
SPACING_M: Final = 32.0


def main(result: Path, numbers: tuple[int, ...]) -> int:
    print("| sessions | tiles | points | processor time | again | peak, command | peak, worker | mosaics | points |")
    print("| ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: |")
    for number in numbers:
        with tempfile.TemporaryDirectory() as folder:
            copy(result, Path(folder) / "results", number)
            subprocess.run([sys.executable, "-m", "benchmarks.season", "--one", folder], check=True)
    return 0


def copy(result: Path, results: Path, number: int) -> None:
    """The result at many places, so many a day."""
    report = json.loads((result / "report.json").read_text(encoding="utf-8"))
    begin = dt.datetime.fromisoformat(report["figures"]["start"])
    side = math.ceil(math.sqrt(number))
    for k in range(number):
        folder = results / f"{k:04d}"
        folder.mkdir(parents=True)
        for name in ("cloud.copc.laz", "field.gpkg"):
            os.link(result / name, folder / name)
        start = begin + dt.timedelta(days=k // A_DAY, seconds=10 * (k % A_DAY))
        report["figures"] |= {"start": start.isoformat(), "end": (start + dt.timedelta(seconds=5)).isoformat()}
        (folder / "report.json").write_text(json.dumps(report), encoding="utf-8")
        for name in ("dsm.tif", "change.tif"):
            if (result / name).is_file():
                moved(result / name, folder / name, *divmod(k, side))


def moved(source: Path, path: Path, east: int, north: int) -> None:
    """A raster so many spacings away."""
    path.write_bytes(source.read_bytes())
    with rasterio.open(path, "r+", IGNORE_COG_LAYOUT_BREAK="YES") as raster:
        at = raster.transform
        x, y = (round(SPACING_M / at.a) * at.a * steps for steps in (east, north))
        raster.transform = rasterio.Affine(at.a, 0.0, at.c + x, 0.0, at.e, at.f + y)


def one(root: Path) -> int:
    """A season, in this process with one worker."""
    settings = furrowmap.SeasonSettings(workers=1)
    made = furrowmap.season([root / "results"], root / "season", settings)
    usage = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    took_s = sum(one.ru_utime + one.ru_stime for one in usage)
    begin = perf_counter()
    furrowmap.season([root / "results"], root / "season", settings)
    again_s = perf_counter() - begin
    own, worker = (one.ru_maxrss / 1024 for one in usage)
    sizes = [
        sum(f.stat().st_size for f in (root / "season" / name).rglob("*.*")) / 1e6 for name in ("mosaics", "points")
    ]
    print(f"| {made.sessions} | {made.tiles} | {made.points:,} | {took_s:.0f} s | {again_s:.1f} s | {own:.0f} MB "
          f"| {worker:.0f} MB | {sizes[0]:.0f} MB | {sizes[1]:.0f} MB |", flush=True)  # fmt: skip
    return 0


if __name__ == "__main__":
    if sys.argv[1] == "--one":
        sys.exit(one(Path(sys.argv[2])))
    sys.exit(main(Path(sys.argv[1]), tuple(map(int, sys.argv[2:])) or SESSIONS))
