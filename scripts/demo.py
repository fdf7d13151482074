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

from rich.console import Console
from rich.table import Table

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


def summary(result: Path, seconds: float) -> Table:
    """A table of the main results."""
    report = json.loads((result / "report.json").read_text(encoding="utf-8"))
    figures, whole_s = report["figures"], report["timings"]["whole"]
    east, north, up = (margin(report["accuracy"][f"sigma_{axis}_m"]["median"], " cm", 100) for axis in "enh")
    table = Table("", "", title=report["session"]["name"], title_justify="left", show_header=False)
    table.add_row("points", f"{figures['points']:,} in {figures['scans']} scans")
    table.add_row("distance", f"{figures['distance_m']:.0f} m in {figures['duration_s']:.0f} s")
    twice_m2, missed_m2 = figures["overlap_area_m2"], figures["missed_area_m2"]
    table.add_row("worked ground", f"{figures['worked_area_m2']:.1f} m² in {figures['passes']} passes")
    table.add_row("worked twice, missed", f"{twice_m2:.1f} m², {missed_m2:.1f} m²")
    table.add_row("map frame", f"{figures['crs']}, {figures['heights']} heights")
    table.add_row("positions (95 %, median)", f"{east} east, {north} north, {up} up")
    table.add_row("furrowmap run", f"{whole_s:.1f} s")
    table.add_row("whole demo", f"{seconds:.0f} s")
    table.add_section()
    for path in sorted(result.iterdir()):
        table.add_row(path.name, f"{path.stat().st_size / 1e6:,.2f} MB")
    return table


def main() -> None:
    """Simulate, run, draw the map, print the summary."""
    start = time.perf_counter()
    shutil.rmtree(DEMO, ignore_errors=True)
    furrowmap("simulate", "demo", "-o", "demo/recording")
    furrowmap("run", "demo/recording/session.toml", "-o", "demo/result")
    picture = DEMO / "result" / "map.png"
    draw_map(DEMO / "result", picture, "Three passes beside the barn: worked ground")
    print()
    Console().print(summary(DEMO / "result", time.perf_counter() - start))
    print(f"Map: {picture}")
    print(f"Open next: {DEMO / 'result' / 'report.html'} in a browser: figures, graphs and warnings of the run")
    screen = os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    if screen and (viewer := shutil.which("xdg-open")):
        subprocess.Popen([viewer, picture])


if __name__ == "__main__":
    main()
