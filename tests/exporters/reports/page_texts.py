"""The texts of a page."""

from __future__ import annotations

from furrowmap.exporters.reports.page_language import map_texts


def texts(page: str) -> list[str]:
    """The texts between the tags of a page, and those of its attributes."""
    found: list[str] = []

    def seen(_: int, text: str) -> str:
        found.append(text)
        return text

    map_texts(page, seen)
    return found
