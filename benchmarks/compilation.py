"""Compilation of kernels: a first run with an empty cache, `furrowmap warm-up`, and what commands compile after it.

Fails if a command compiles anything then: app/kernels.toml lacks it. Needs the sample recordings.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from pathlib import Path
from time import perf_counter

DATA = Path(__file__).resolve().parents[2] / "shared" / "data"
COUNTING = """
import sys
from furrowmap.process import prepare_process
prepare_process()
from numba.core import event
from furrowmap.cli.main import command_line
with event.install_recorder("numba:compile") as recorder:
    status = command_line(sys.argv[1:])
begun = [each.data for _, each in recorder.buffer if each.is_start]
kernels = [f"{data['dispatcher'].py_func.__name__}{data['args']}" for data in begun]
print(*kernels, sep="\\n", file=sys.stderr)
print(len(kernels), file=sys.stderr)
sys.exit(status)
"""


def run(cache: Path, *arguments: str | Path) -> tuple[float, list[str]]:
    """Seconds of a command, and the last lines of its standard error: what it compiled, and how much that is."""
    start = perf_counter()
    done = subprocess.run(
        [sys.executable, "-c", COUNTING, *arguments],
        env=os.environ | {"NUMBA_CACHE_DIR": str(cache)},
        stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, check=True,
    )  # fmt: skip
    return perf_counter() - start, done.stderr.splitlines()


def main() -> None:
    """Print the figures."""
    tractor, flight = DATA / "tractor_loop" / "session.toml", DATA / "uav_wheat" / "session.toml"
    with tempfile.TemporaryDirectory() as name:
        out = Path(name)
        first_s, _ = run(out / "empty", "run", tractor, "-o", out / "tractor", "--quiet")
        second_s, _ = run(out / "empty", "run", tractor, "-o", out / "tractor", "--quiet")
        print(f"first run {first_s:.1f} s, second {second_s:.1f} s; bar {1.35 * second_s + 15.0:.1f} s")
        warm = out / "warm"
        warm_s, lines = run(warm, "warm-up")
        print(f"warm-up {warm_s:.1f} s; bar 60 s")
        cloud, crops = out / "tractor" / "cloud.copc.laz", out / "flight" / "cloud.copc.laz"
        bad = 0
        for arguments in (
            ("run", tractor, "-o", out / "tractor"),
            ("run", flight, "-o", out / "flight"),
            ("surface", cloud, "-o", out / "surface"),
            ("features", cloud, "-o", out / "features"),
            ("cloud", cloud, "-o", out / "again.copc.laz", "--outliers", "statistical", "--ground", "smrf"),
            ("parcels", crops, DATA / "uav_wheat" / "parcels.geojson", "-o", out / "parcels"),
            ("tie", out / "tractor", out / "tractor", "-o", out / "season"),
            ("simulate", "flight", "-o", out / "simulated"),
            ("calibrate", tractor),
            ("live", "--from", tractor, "--speed", "10", "--port", "0", "--nmea-port", "0"),
            ("fields", DATA / "isoxml" / "field_days" / "tillage_two_fields_holes.zip"),
        ):
            seconds, lines = run(warm, *arguments, "--quiet")
            compiled = int(lines[-1])
            bad += compiled
            print(f"{arguments[0]}: {seconds:.1f} s, {compiled} compilations", *lines[-1 - compiled : -1], sep="\n  ")
    if bad:
        sys.exit("app/kernels.toml lacks kernels")


if __name__ == "__main__":
    main()
