"""The page of a result: its size, and how long a browser needs for the first picture and for the cloud.

    python benchmarks/share.py RESULT [RESULT...]

Headless Chromium loads the page from a local server, without a cache, at the sizes of a desktop and of a phone; WebGL
is drawn by the processor. Beside the time on the clock stands the processor time of all processes of Chromium, which
a busy machine hardly changes. Requests to other hosts are counted.
"""

from __future__ import annotations

import functools
import http.server
import os
import shutil
import subprocess
import sys
import threading
from pathlib import Path
from tempfile import TemporaryDirectory
from time import process_time
from typing import Any, Final

from playwright.sync_api import Browser, sync_playwright

import furrowmap

SIZES: Final = ((1280, 800), (360, 740))
ROUNDS: Final = 3
TICK_S: Final = 1.0 / os.sysconf("SC_CLK_TCK")


class Quiet(http.server.SimpleHTTPRequestHandler):
    """A server of files that prints nothing."""

    def log_message(self, *args: Any) -> None:
        """Nothing."""


def main() -> None:
    """Measure and print."""
    print(
        "| result | MB | files | CPU s to write | window | first picture s: least | its CPU s | cloud CPU s | outside |"
    )
    print("| --- | ---: | ---: | ---: | --- | ---: | ---: | ---: | ---: |")
    with TemporaryDirectory() as scratch, sync_playwright() as playwright:
        options = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
        browser = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=options)
        for number, result in enumerate(sys.argv[1:]):
            begin = process_time()
            shared = furrowmap.share(result, Path(scratch) / str(number))
            seconds = process_time() - begin
            for size in SIZES:
                pictures, processor, cloud, outside = loaded(browser, shared.folder, size)
                print(
                    f"| {Path(result).name} | {shared.size_bytes / 1e6:.1f} | {len(shared.files)} | {seconds:.1f} | "
                    f"{size[0]} x {size[1]} | {min(pictures):.2f} | {min(processor):.2f} | {cloud:.1f} | {outside} |"
                )
        browser.close()


def chromium_s() -> float:
    """Processor time of all processes of Chromium below this one."""
    parents, times = {}, {}
    for place in Path("/proc").glob("[0-9]*"):
        try:
            fields = (place / "stat").read_text().rpartition(")")[2].split()
        except OSError:
            continue  # has ended
        parents[int(place.name)], times[int(place.name)] = int(fields[1]), int(fields[11]) + int(fields[12])
    total = 0
    for pid in times:
        above = pid
        while above in parents and above != os.getpid():
            above = parents[above]
        total += times[pid] if above == os.getpid() and pid != os.getpid() else 0
    return total * TICK_S


def loaded(browser: Browser, folder: Path, size: tuple[int, int]) -> tuple[list[float], list[float], float, int]:
    """Seconds to the first picture of each round, on the clock and of the processor; to the cloud; requests outside."""
    handler = functools.partial(Quiet, directory=str(folder))
    pictures, processor, asked, cloud = [], [], [], 0.0
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        base = f"http://127.0.0.1:{server.server_port}/"
        for _ in range(ROUNDS):
            context = browser.new_context(viewport={"width": size[0], "height": size[1]})
            page = context.new_page()
            page.on("request", lambda request: asked.append(request.url))
            page.goto("about:blank")
            begin = chromium_s()
            page.goto(base)
            page.wait_for_selector("body[data-map=shown]")
            processor.append(chromium_s() - begin)
            pictures.append(page.evaluate("performance.getEntriesByName('first-picture')[0].startTime") / 1000)
            if len(pictures) == ROUNDS:
                begin = chromium_s()
                page.click("#solid")
                page.wait_for_selector("body[data-cloud=shown]", timeout=120_000)
                cloud = chromium_s() - begin
            context.close()
        server.shutdown()
    return pictures, processor, cloud, len([url for url in asked if not url.startswith((base, "data:"))])


if __name__ == "__main__":
    tools = Path(__file__).parents[1] / "scripts" / "tools_of_tests.py"
    subprocess.run([sys.executable, tools, "chromium"], check=True, stdout=subprocess.DEVNULL)
    main()
