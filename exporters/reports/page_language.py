"""Pages in the language of the reader: the texts between the tags, by the catalogue of that language.

Drawings are part of a page, so the words in them are translated with it. A page keeps the English of each text that was
replaced, so that it can be shown in any other language later.
"""

import html
import json
import re
from collections.abc import Callable
from typing import Final

from furrowmap.core.runtime.languages.catalogue import translated
from furrowmap.core.runtime.languages.texts import ENGLISH

KEPT: Final = "furrowmap-english"
"""Name of the <meta> with the English texts: a list of pairs of the number of the text in the page, and its HTML."""
_PIECES: Final = re.compile(r"(<style>.*?</style>|<(?!/?data\b)[^>]*>)", re.DOTALL)
_FIGURE: Final = re.compile(r"<data\b[^>]*>.*?</data>")
_META: Final = re.compile(rf'<meta name="{KEPT}" content="([^"]*)">\n')
_SAID: Final = re.compile(r'\b(alt|aria-label)="([^"]*)"')
_MARK: Final = "⟦{}⟧"
_MARKED_FIGURE: Final = re.compile(r"⟦(\d+)⟧")
_NO_BREAK: Final = "\u00a0"
_UNITS_OF_FIGURES: Final = (
    "%|mm²?|cm|m[²³]?|km|ha|acres?|a|(?:k?m|ha|a|acres?)/h|m/s|ms|s|min|h|kg/ha|点|秒|分|時間|行程"
)
_INSIDE_FIGURE: Final = re.compile(rf"(?<=\d) (?=±)|(?<=±) (?=\d)|(?<=\d) (?=(?:{_UNITS_OF_FIGURES})(?![A-Za-z0-9/]))")
"""The spaces of a figure, between value, ± and unit."""


def in_language(page: str, language: str) -> str:
    """A page of ours in a language, its figures with plain spaces; ValueError if there is no such language."""
    page = _english(page.replace(_NO_BREAK, " "))
    if language == ENGLISH:
        return page
    kept: list[tuple[int, str]] = []

    def other(number: int, text: str) -> str:
        new = text_in(text, language)
        if new != text:
            kept.append((number, text))
        return new

    page = map_texts(page, other).replace('<html lang="en">', f'<html lang="{language}">', 1)
    texts = html.escape(json.dumps(kept, ensure_ascii=False, separators=(",", ":")))
    return page.replace("</head>", f'<meta name="{KEPT}" content="{texts}">\n</head>', 1)


def _english(page: str) -> str:
    """A page with the texts in which it was written."""
    found = _META.search(page)
    if found is None:
        return page
    kept = dict(json.loads(html.unescape(found[1])))
    page = page.replace(found[0], "", 1)
    page = re.sub(r'<html lang="[a-z]+">', '<html lang="en">', page, count=1)
    return map_texts(page, lambda number, text: str(kept.get(number, text)))


def unbroken(page: str) -> str:
    """A page whose figures stay on one line: "33.43 ± 0.21 m²", "95 %"."""
    pieces = _PIECES.split(page)
    return "".join(piece if k % 2 else _INSIDE_FIGURE.sub(_NO_BREAK, piece) for k, piece in enumerate(pieces))


def map_texts(page: str, change: Callable[[int, str], str]) -> str:
    """A page with each text between its tags, or in an attribute, replaced: from its number and itself.

    Texts without letters are left out, but counted.
    """
    number = 0

    def changed(text: str) -> str:
        nonlocal number
        number += 1
        return change(number, text) if any(c.isalpha() for c in html.unescape(text)) else text

    def attribute(found: re.Match[str]) -> str:
        return f'{found[1]}="{changed(found[2])}"'

    pieces = _PIECES.split(page)
    return "".join(_SAID.sub(attribute, piece) if k % 2 else changed(piece) for k, piece in enumerate(pieces))


def text_in(text: str, language: str) -> str:
    """The HTML of one text in a language; figures in <data> are taken over."""
    body = text.strip()
    figures = _FIGURE.findall(body)
    numbers = iter(range(len(figures)))
    plain = html.unescape(_FIGURE.sub(lambda _: _MARK.format(next(numbers)), body))
    new = html.escape(translated(plain, language))
    whole = _MARKED_FIGURE.sub(lambda found: figures[int(found[1])], new)
    return text.replace(body, whole, 1) if plain != html.unescape(new) else text


def language_of(page: str) -> str:
    """The language of a page of ours."""
    found = re.search(r'<html lang="([a-z]+)">', page)
    return found[1] if found is not None else ENGLISH
