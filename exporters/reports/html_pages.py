"""HTML pages from the templates of this package: single files without external resources."""

import base64
import hashlib
import os
import re
import shutil
import subprocess
from collections.abc import Mapping
from functools import cache
from importlib.metadata import version
from importlib.resources import files
from pathlib import Path
from typing import Final
from zoneinfo import ZoneInfo

from jinja2 import Environment, FunctionLoader, StrictUndefined

from furrowmap.core.geodesy.local_time import clock_words, in_local_time
from furrowmap.core.runtime.errors import Notice, RefusedError, printable
from furrowmap.core.runtime.languages.texts import LANGUAGES, Text, Words
from furrowmap.core.runtime.programs import program_on_path
from furrowmap.core.runtime.settings import language_of_user
from furrowmap.core.runtime.write_errors import scratch_directory, writing_scratch
from furrowmap.exporters import work_colours
from furrowmap.exporters.files.atomic import atomic_output
from furrowmap.exporters.reports.area_units import HECTARE, area, in_area_unit, work_rate
from furrowmap.exporters.reports.page_language import in_language, in_page, said, unbroken
from furrowmap.exporters.reports.quantity_words import (
    days_words,
    duration_words,
    margin_words,
    number,
    with_margin_words,
)

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


def write_html(path: Path, page: str, language: str | None = None, area_unit: str = HECTARE) -> None:
    """Write a page of ours in a language, by default the user's, and with areas in a unit."""
    text = unbroken(in_area_unit(in_language(page, language or language_of_user()), area_unit))
    with atomic_output(path) as unfinished:
        unfinished.write_text(text, encoding="utf-8", errors="xmlcharrefreplace", newline="")


def notice_in_page(notice: Notice, zone: ZoneInfo) -> str:
    """The text of a warning in a page, with the times of a zone."""
    return said({language: in_local_time(notice.text_in(language), zone) for language in LANGUAGES})


def warning_in_page(warning: Mapping[str, str]) -> str:
    """The text of a warning of a report in a page."""
    return said({language: warning.get(f"text_{language}", warning["text"]) for language in LANGUAGES})


def sentences(*texts: Words | tuple[Words, ...]) -> Text:
    """Sentences, alone or several, one after the other, but for empty ones."""
    several = [text if isinstance(text, tuple) else (text,) for text in texts]
    return Text("{sentences:.}", sentences=tuple(text for part in several for text in part if text))


_FOLDERS: Final = ("reports/templates", "share")
_POLICY: Final = 'content="POLICY"'
"""Where a template has its Content-Security-Policy."""


def render(template: str, *sources: str, **values: object) -> str:
    """A page, or a part of one, as HTML with escaped texts; `sources` extend the Content-Security-Policy.

    It has no language until :func:`~furrowmap.exporters.reports.page_language.in_language` gives it one.
    """
    page = _environment().get_template(template).render(values)
    return page.replace(_POLICY, f'content="{_policy(page, sources)}"', 1)


def compile_templates(*templates: str) -> None:
    """Compile templates before they are rendered: half a second for those of a run."""
    for template in templates:
        _environment().get_template(template)


def _policy(page: str, sources: tuple[str, ...]) -> str:
    """The Content-Security-Policy of a page: its own style sheet, embedded images, `sources`, and nothing else."""
    sheet = page.partition("<style>")[2].partition("</style>")[0]
    named = {part.split()[0] for part in sources}
    digest = base64.b64encode(hashlib.sha256(sheet.encode()).digest()).decode("ascii")
    own = ("img-src data:", f"style-src 'sha256-{digest}'", "base-uri 'none'", "form-action 'none'")
    return "; ".join(("default-src 'none'", *sources, *(part for part in own if part.split()[0] not in named)))


@cache
def _environment() -> Environment:
    """Escapes all texts, and shows their control characters; a name that a template does not know is an error."""
    environment = Environment(
        loader=FunctionLoader(_source),
        autoescape=True,
        undefined=StrictUndefined,
        extensions=["jinja2.ext.do"],
        trim_blocks=True,
        finalize=_shown,
    )
    # As in Jinja2's own extension for gettext, _("…") is a text of the catalogues.
    environment.globals |= {
        "_": Text,
        "sentences": sentences,
        "software": f"furrowmap {version('furrowmap')}",
        "work_colours": work_colours,
        "zip": zip,
    }
    environment.filters |= {
        "area": area,
        "clock": clock_words,
        "days": days_words,
        "duration": duration_words,
        "margin": margin_words,
        "number": number,
        "rate": work_rate,
        "warning": warning_in_page,
        "with_margin": with_margin_words,
    }
    return environment


def _shown(value: object) -> object:
    """What a template shows for a value."""
    if isinstance(value, Text):
        return in_page(value)
    return printable(value) if type(value) is str else value


def _source(template: str) -> str | None:
    """A template; a line that begins with spaces goes on with the one before it, so that a text has no line break."""
    for folder in _FOLDERS:
        file = files("furrowmap.exporters").joinpath(folder, template)
        if file.is_file():
            return re.sub(r"\n +", " ", file.read_text("utf-8"))
    return None
