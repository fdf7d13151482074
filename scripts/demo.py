"""``make demo``: simulate a recording, run furrowmap on it, and show the result.

All files are in ``demo/``, which is replaced each time.
"""

from __future__ import annotations

import json
import os
import runpy
import shutil
import subprocess
import sys
import time
from pathlib import Path

from furrowmap.core.values.margins import margin

CHECKOUT = Path(__file__).resolve().parents[1]
DEMO = CHECKOUT / "demo"
draw_map = runpy.run_path(str(CHECKOUT / "scripts" / "picture.py"))["draw_map"]


def furrowmap(*arguments: str) -> None:
    """Print and run a command."""
    print(f"\n$ furrowmap {' '.join(arguments)}", flush=True)
    program = Path(sys.executable).with_name("furrowmap")
    status = subprocess.run([program, *arguments], cwd=CHECKOUT, check=False).returncode
    if status:
        sys.exit(status)


def summary(result: Path, seconds: float) -> str:
    """The main results, and the size of each product."""
    report = json.loads((result / "report.json").read_text(encoding="utf-8"))
    figures, whole_s = report["figures"], report["timings"]["whole"]
    east, north, up = (margin(report["accuracy"][f"sigma_{axis}_m"]["median"], " cm", 100) for axis in "enh")
    rows = {
        "points": f"{figures['points']:,} in {figures['scans']} scans",
        "distance": f"{figures['distance_m']:.0f} m in {figures['duration_s']:.0f} s",
        "worked ground": f"{figures['worked_area_m2']:.1f} m² in {figures['passes']} passes",
        "worked twice, missed": f"{figures['overlap_area_m2']:.1f} m², {figures['missed_area_m2']:.1f} m²",
        "map frame": f"{figures['crs']}, {figures['heights']} heights",
        "positions (95 %, median)": f"{east} east, {north} north, {up} up",
        "furrowmap run": f"{whole_s:.1f} s",
        "whole demo": f"{seconds:.0f} s",
        **{path.name: f"{path.stat().st_size / 1e6:,.2f} MB" for path in sorted(result.iterdir())},
    }
    return "\n".join([report["session"]["name"], *(f"  {name:<24} {text}" for name, text in rows.items())])


def main() -> None:
    """Simulate, run, draw the map, print the summary."""
    start = time.perf_counter()
    shutil.rmtree(DEMO, ignore_errors=True)
    furrowmap("simulate", "demo", "-o", "demo/recording")
    furrowmap("run", "demo/recording/session.toml", "-o", "demo/result")
    picture = DEMO / "result" / "map.png"
    draw_map(DEMO / "result", picture, "Three passes beside the barn: worked ground")
    print()
    print(summary(DEMO / "result", time.perf_counter() - start))
    print(f"Map: {picture}")
    print(f"Open next: {DEMO / 'result' / 'report.html'} in a browser: figures, graphs and warnings of the run")
    screen = os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    if screen and (viewer := shutil.which("xdg-open")):
        subprocess.Popen([viewer, picture])


if __name__ == "__main__":
    main()
