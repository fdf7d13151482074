"""Areas of a page in the reader's unit: hectares, ares and 10 a as in Japan, or acres.

A page is written once; each area in it is an HTML element <data> with its value in SI units beside its text, so that
the unit can be changed in a page that was written long ago.
"""

import math
import re
from typing import Final

from furrowmap.core.runtime.languages.texts import Text, Words, figure_text, in_marks
from furrowmap.core.values.margins import with_margin
from furrowmap.exporters.reports.page_language import language_of
from furrowmap.exporters.reports.quantity_words import NOT_KNOWN

HECTARE: Final = "ha"
TEN_ARES: Final = "10a"
ACRE: Final = "acre"
AREA_UNITS: Final = (HECTARE, TEN_ARES, ACRE)
ACRE_M2: Final = 4046.8564224
"""The international acre, 1959."""
_UNITS: Final = {HECTARE: (10_000.0, 3, "ha"), TEN_ARES: (100.0, 2, "a"), ACRE: (ACRE_M2, 3, "acres")}
"""Size, decimals and name."""
_FINE_M2: Final = 10.0
_SMALL_M2: Final = {HECTARE: 1_000.0, TEN_ARES: 100.0, ACRE: 100.0}
"""Smaller areas are shown in square metres."""
_SI_VALUE: Final = r"[-+]?[0-9.]+(?:e[-+]?[0-9]+)?"
_AREA_MARK: Final = re.compile(rf"⟦(area|rate) ({_SI_VALUE})(?: ({_SI_VALUE}))?⟧")
_UNIT_META: Final = re.compile(r'(<meta name="furrowmap-area-unit" content=")(\w+)')
_AREA_ELEMENT: Final = re.compile(
    rf'<data class="(area|rate)" value="({_SI_VALUE})"(?: data-sigma="({_SI_VALUE})")?>[^<]*</data>'
)


def area(area_m2: float, sigma_m2: float | None = None) -> Words:
    """An area, with its margin of error where one is known, in a text of a page; :func:`in_area_unit` puts it there."""
    if not math.isfinite(area_m2):
        return NOT_KNOWN
    sigma = f" {sigma_m2:.6g}" if sigma_m2 is not None and math.isfinite(sigma_m2) else ""
    return f"⟦area {area_m2:.6g}{sigma}⟧"


def work_rate(rate_ha_h: float) -> Words:
    """A work rate in a text of a page."""
    return f"⟦rate {rate_ha_h:.6g}⟧" if math.isfinite(rate_ha_h) else NOT_KNOWN


def in_area_unit(page: str, unit: str) -> str:
    """A page with its areas and work rates in one of :data:`AREA_UNITS`, and in the notation of its language."""
    language = language_of(page)

    def element(found: re.Match[str]) -> str:
        kind, value, sigma = found.groups()
        sigma_m2 = float(sigma) if sigma else None
        words = rate_words(float(value), unit) if kind == "rate" else str(area_text(float(value), unit, sigma_m2))
        spread = f' data-sigma="{sigma}"' if sigma else ""
        return f'<data class="{kind}" value="{value}"{spread}>{in_marks(words, language)}</data>'

    page = _UNIT_META.sub(rf"\g<1>{unit}", page, count=1)
    return _AREA_ELEMENT.sub(element, _AREA_MARK.sub(element, page))


def area_unit_of(page: str) -> str:
    """The unit of a page of ours."""
    found = _UNIT_META.search(page)
    return found[2] if found is not None and found[2] in AREA_UNITS else HECTARE


def area_text(area_m2: float, unit: str, sigma_m2: float | None = None) -> Words:
    """An area: "0.542 ha", "54.2 a", "1.340 acres"; small ones in square metres; with its margin if known."""
    small = abs(area_m2) < _SMALL_M2[unit]
    unit_m2, digits, name = (1.0, 1 if abs(area_m2) >= _FINE_M2 else 2, "m²") if small else _UNITS[unit]
    if unit == ACRE and not small:
        return Text("{area} acres", area=figure_text(with_margin(area_m2, sigma_m2, "", 1.0 / unit_m2, digits)))
    return figure_text(with_margin(area_m2, sigma_m2, f" {name}", 1.0 / unit_m2, digits))


def rate_words(rate_ha_h: float, unit: str) -> str:
    """A work rate as text; for 10 a as the minutes that they take, as Japanese records of work have it."""
    if unit == TEN_ARES:
        return f"{6.0 / rate_ha_h:.1f} min/10 a" if rate_ha_h > 0.0 else "unknown"
    unit_m2, _, name = _UNITS[unit]
    return f"{rate_ha_h * 10_000.0 / unit_m2:.2f} {name}/h"
