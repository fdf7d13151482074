"""Numbers, durations and margins of error of pages, as texts that are shown in any language."""

import math
from typing import Final

from furrowmap.core.runtime.languages.texts import Text, Words, figure_text
from furrowmap.core.values.margins import margin, with_margin

NOT_KNOWN: Final = Text("unknown")
_SECONDS: Final = " s"
"""The unit that other languages write differently."""


def number(value: float | None, form: str) -> Words:
    """A value in a format such as "{:.1f} cm"; "unknown" for None and what is not finite."""
    return figure_text(form.format(value)) if value is not None and math.isfinite(value) else NOT_KNOWN


def days_words(first: str, last: str) -> str:
    """The days from a first to a last one, in any language: "2026-06-11 – 2026-06-18"."""
    return first if first == last else f"{first} – {last}"


def duration_words(length_s: float) -> Text:
    """Seconds, minutes or hours."""
    whole = round(length_s)
    if whole >= 3600:
        return Text("{hours} h {minutes:02d} min", hours=whole // 3600, minutes=whole // 60 % 60)
    if whole >= 60:
        return Text("{minutes} min {seconds:02d} s", minutes=whole // 60, seconds=whole % 60)
    return Text("{seconds} s", seconds=whole)


def margin_words(sigma: float | None, unit: str = "", factor: float = 1.0) -> Words:
    """A margin of error, see :func:`~furrowmap.core.values.margins.margin`."""
    return _words(margin(sigma, unit, factor), unit)


def with_margin_words(
    value: float | None,
    sigma: float | None,
    unit: str = "",
    factor: float = 1.0,
    digits: int = 1,
    *,
    sign: bool = False,
) -> Words:
    """A value with its margin of error, see :func:`~furrowmap.core.values.margins.with_margin`."""
    return _words(with_margin(value, sigma, unit, factor, digits, sign=sign), unit)


def _words(said: str, unit: str) -> Words:
    """Figures in any language."""
    if said == NOT_KNOWN.template:
        return NOT_KNOWN
    return Text("{seconds} s", seconds=figure_text(said.removesuffix(unit))) if unit == _SECONDS else figure_text(said)
