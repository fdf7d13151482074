"""The texts of a page."""

from __future__ import annotations

from furrowmap.exporters.reports.area_units import HECTARE, in_area_unit
from furrowmap.exporters.reports.page_language import in_language, map_texts


def shown(page: str, language: str = "en") -> str:
    """A page as it is written."""
    return in_area_unit(in_language(page, language), HECTARE)


def texts(page: str) -> list[str]:
    """The texts between the tags of a page, and those of its attributes."""
    found: list[str] = []

    def seen(_: int, text: str) -> str:
        found.append(text)
        return text

    map_texts(page, seen)
    return found
