"""Pages as PDF, printed by the browser of the computer.

A Chromium embeds the glyphs of the fonts it uses, draws SVG completely, and is on most computers under one of its
names: Edge comes with Windows.
"""

import os
import shutil
import subprocess
import tempfile
from pathlib import Path
from typing import Final

from furrowmap.core.runtime.errors import RefusedError
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


def browser() -> str | None:
    """The path of a browser that prints; None if there is none."""
    stated = os.environ.get(BROWSER_VARIABLE)
    names = (stated,) if stated else BROWSERS
    return next((found for name in names if (found := shutil.which(name)) is not None), None)


def write_pdf(path: Path, page: str) -> None:
    """Print a page of ours to a PDF on A4; RefusedError if no browser is installed, or it does not print."""
    program = browser()
    if program is None:
        raise RefusedError("browser-missing")
    confined = ["--no-sandbox"] if hasattr(os, "geteuid") and os.geteuid() == 0 else []  # root cannot have one
    with tempfile.TemporaryDirectory(prefix="furrowmap-print-") as folder, atomic_output(path) as unfinished:
        source, printed = Path(folder, "page.html"), Path(folder, "page.pdf")
        source.write_text(page, encoding="utf-8", errors="xmlcharrefreplace")
        arguments = [
            program, "--headless", *confined, "--disable-gpu", "--no-first-run",
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
            raise RefusedError("browser-missing.write-pdf", program=program, failure=failure)
        shutil.copyfile(printed, unfinished)
