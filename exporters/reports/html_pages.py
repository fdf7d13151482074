"""HTML pages from the templates of this package: single files without external resources."""

import base64
import hashlib
import re
from collections.abc import Mapping
from functools import cache
from importlib.metadata import version
from importlib.resources import files
from pathlib import Path
from typing import Final
from zoneinfo import ZoneInfo

from jinja2 import Environment, FunctionLoader, StrictUndefined

from furrowmap.core.geodesy.local_time import clock_words, in_local_time
from furrowmap.core.runtime.errors import Notice, printable
from furrowmap.core.runtime.languages.texts import LANGUAGES, Text, Words, figure_text
from furrowmap.core.runtime.settings import language_of_user
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
        "figures": figure_text,
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
