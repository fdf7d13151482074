"""The texts of a page, and the numbers in them."""

from __future__ import annotations

import html
import re
from collections import Counter

from furrowmap.exporters.reports.area_units import HECTARE, in_area_unit
from furrowmap.exporters.reports.page_language import in_language, map_texts

SAME = re.compile(
    r"\d\d:\d\d:\d\d\.\d+|furrowmap \d+\.\d+\.\d+\S*|[\w.-]+\.(?:json|gpkg|tif|csv|html|laz|pcap|nmea|toml)\b|`[^`]*`"
)
"""Times, versions, names of files and code, whose points are the same in every language."""
NUMBER = re.compile(r"\d[\d.,]*\d|\d")
_POINT = re.compile(r"(?<![\d.])0\.\d|\d\.(?!\d{3}(?!\d))\d")
"""A decimal point; a point before three digits is a thousands mark."""
_GERMAN = str.maketrans({".": ",", ",": "."})


def in_german(number: str) -> str:
    """An English number as Germans write it."""
    return number.translate(_GERMAN)


def numbers(page: str) -> Counter[str]:
    """The numbers that a page shows, but in :data:`SAME`."""
    plain = [SAME.sub("", html.unescape(re.sub("<[^>]*>", "", text))) for text in texts(page)]
    return Counter(number for text in plain for number in NUMBER.findall(text))


def decimal_points(text: str) -> list[str]:
    """Numbers of a text with a decimal point, but in :data:`SAME`."""
    return _POINT.findall(SAME.sub("", html.unescape(re.sub("<[^>]*>", "", text))))


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
