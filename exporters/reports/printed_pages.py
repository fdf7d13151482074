"""Pages of ours printed to PDF by a browser."""

import os
import shutil
import subprocess
from pathlib import Path
from typing import Final

from furrowmap.core.runtime.errors import RefusedError
from furrowmap.core.runtime.programs import program_on_path
from furrowmap.core.runtime.write_errors import scratch_directory, writing_scratch
from furrowmap.exporters.files.atomic import atomic_output

BROWSER_VARIABLE: Final = "FURROWMAP_BROWSER"
"""Variable of the environment with the path of a browser of the Chromium family."""
BROWSERS: Final = (
    "chromium",
    "chromium-browser",
    "google-chrome",
    "google-chrome-stable",
    "microsoft-edge",
    "msedge",
    "/Applications/Google Chrome.app/Contents/MacOS/Google Chrome",
    "/Applications/Microsoft Edge.app/Contents/MacOS/Microsoft Edge",
    "C:/Program Files (x86)/Microsoft/Edge/Application/msedge.exe",
    "C:/Program Files/Google/Chrome/Application/chrome.exe",
)
MAX_PRINT_S: Final = 120.0
_ASKS_NO_SERVER: Final = (
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--disable-default-apps",
    "--no-pings",
    "--host-resolver-rules=MAP * ~NOTFOUND",
)
"""A browser asks its maker's servers for updates when it starts; a page of ours has everything in it."""


def browser() -> str | None:
    """The path of a browser that prints; None if there is none."""
    stated = os.environ.get(BROWSER_VARIABLE)
    if stated:
        return shutil.which(stated)
    return next((found for name in BROWSERS if (found := _browser_at(name)) is not None), None)


def _browser_at(place: str) -> str | None:
    return shutil.which(place) if Path(place).is_absolute() else program_on_path(place)


def write_pdf(path: Path, page: str) -> None:
    """Print a page of ours to a PDF on A4; RefusedError if no browser is installed, or it does not print."""
    program = browser()
    if program is None:
        raise RefusedError("browser-missing")
    confined = ["--no-sandbox"] if hasattr(os, "geteuid") and os.geteuid() == 0 else []  # root cannot have one
    with scratch_directory() as folder, atomic_output(path) as unfinished:
        source = Path(folder, "page.html")
        printed = Path(folder, "page.pdf")
        with writing_scratch():
            source.write_text(page, encoding="utf-8", errors="xmlcharrefreplace")
        arguments = [
            program, "--headless", *confined, *_ASKS_NO_SERVER, "--disable-gpu", "--no-first-run",
            f"--user-data-dir={Path(folder, 'profile')}", "--no-pdf-header-footer", f"--print-to-pdf={printed}",
            source.as_uri(),
        ]  # fmt: skip
        failure = ""
        try:
            done = subprocess.run(arguments, capture_output=True, timeout=MAX_PRINT_S, check=False)  # noqa: S603 (no shell)
            if not printed.is_file() or not printed.read_bytes().startswith(b"%PDF"):
                failure = f"exit status {done.returncode}"
        except subprocess.TimeoutExpired:
            failure = f"no end after {MAX_PRINT_S:.0f} s"
        except OSError as error:
            failure = error.strerror or type(error).__name__
        if failure:
            raise RefusedError("browser-missing.page-not-printed", program=program, failure=failure)
        shutil.copyfile(printed, unfinished)
