"""What ``make demo`` does: a recording is simulated, furrowmap makes a cloud of it, and the result is shown.

Everything lands in ``demo/``, which is made anew each time.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

from rich.console import Console
from rich.table import Table

from furrowmap.exporters.picture import draw_map

CHECKOUT = Path(__file__).resolve().parents[1]
DEMO = CHECKOUT / "demo"


def furrowmap(*arguments: str) -> None:
    """Run a command as a user would type it, and show it."""
    print(f"\n$ furrowmap {' '.join(arguments)}", flush=True)
    program = Path(sys.executable).with_name("furrowmap")
    status = subprocess.run([program, *arguments], cwd=CHECKOUT, check=False).returncode
    if status:
        sys.exit(status)


def summary(result: Path, seconds: float) -> Table:
    """The result in a few figures."""
    report = json.loads((result / "report.json").read_text(encoding="utf-8"))
    table = Table("figure", "value", title=report["session"]["name"], title_justify="left")
    for name, value in report["figures"].items():
        if isinstance(value, int | float):
            table.add_row(name, f"{value:,}" if isinstance(value, int) else f"{value:,.3f}")
    for path in sorted(result.iterdir()):
        table.add_row(str(path.relative_to(CHECKOUT)), f"{path.stat().st_size / 1e6:,.2f} MB")
    table.add_row("whole demo", f"{seconds:.0f} s")
    return table


def main() -> None:
    """Simulate, run, draw, tell."""
    start = time.perf_counter()
    shutil.rmtree(DEMO, ignore_errors=True)
    furrowmap("simulate", "demo", "-o", "demo/recording")
    furrowmap("run", "demo/recording/session.toml", "-o", "demo/result")
    picture = DEMO / "result" / "map.png"
    draw_map(DEMO / "result", picture, "The ground of the demo, and the way over it")
    print()
    Console().print(summary(DEMO / "result", time.perf_counter() - start))
    print(f"The map: {picture}")
    screen = os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    if screen and (viewer := shutil.which("xdg-open")):
        subprocess.Popen([viewer, picture])


if __name__ == "__main__":
    main()
