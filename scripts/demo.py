"""``make demo``: simulate a recording, run furrowmap on it, and show the result.

All files are in ``demo/``, which is replaced each time.
"""

from __future__ import annotations

import os
import runpy
import shutil
import subprocess
import sys
import time
from pathlib import Path

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


def main() -> None:
    """Simulate, run, draw the map."""
    start = time.perf_counter()
    shutil.rmtree(DEMO, ignore_errors=True)
    furrowmap("simulate", "demo", "-o", "demo/recording")
    furrowmap("run", "demo/recording/session.toml", "-o", "demo/result")
    picture = DEMO / "result" / "map.png"
    draw_map(DEMO / "result", picture, "Three passes beside the barn: worked ground")
    print(f"\nThe demo took {time.perf_counter() - start:.0f} s. Its map: {picture}")
    screen = os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    if screen and (viewer := shutil.which("xdg-open")):
        subprocess.Popen([viewer, picture])


if __name__ == "__main__":
    main()
