"""Pages in the language of the reader, and in any other one later.

A page is made once. Each text of the product in it is a mark that holds the text in every language, as :func:`in_page`
makes it, until :func:`in_language` chooses one. The page keeps the others, so that it can be shown in them when poses
and clouds from which it was made are no longer at hand.
"""

import html
import json
import re
from collections.abc import Callable, Mapping
from typing import Final

import msgspec

from furrowmap.core.runtime.errors import printable
from furrowmap.core.runtime.languages.texts import ENGLISH, LANGUAGES, Text, Words, in_every_language

KEPT: Final = "furrowmap-texts"
"""Name of the <meta> with the texts that languages have differently: by number in the page, as HTML by language."""
_PIECES: Final = re.compile(r"(<style>.*?</style>|<(?!/?data\b)[^>]*>)", re.DOTALL)
_TEXT_ATTRIBUTE: Final = re.compile(r'\b(alt|aria-label)="([^"]*)"')
_META: Final = re.compile(rf'<meta name="{KEPT}" content="([^"]*)">\n')
_SAID: Final = re.compile(r"⟦said (.*?)⟧")
_AREA: Final = re.compile(r"⟦(?:area|rate) [^⟧]*⟧")
_NO_BREAK: Final = "\u00a0"
_UNITS_OF_FIGURES: Final = (
    "%|mm²?|cm|m[²³]?|km|ha|acres?|a|(?:k?m|ha|a|acres?)/h|m/s|ms|s|min|h|kg/ha|k?Hz|[kMG]B|点|秒|分|時間|行程"
)
_INSIDE_FIGURE: Final = re.compile(rf"(?<=\d) (?=±)|(?<=±) (?=\d)|(?<=\d) (?=(?:{_UNITS_OF_FIGURES})(?![A-Za-z0-9/]))")
"""The spaces of a figure, between value, ± and unit."""
_FIGURE: Final = re.compile(r'<data class="(area|rate)" value="([^"]*)"(?: data-sigma="([^"]*)")?>[^<]*</data>')


def in_page(text: Words) -> str:
    """A text as it stands in a page before :func:`in_language`; names are the same in every language."""
    if not isinstance(text, Text):
        return text
    texts = in_every_language(text)
    return said(texts) if len(set(texts.values())) > 1 else printable(texts[ENGLISH])


def said(texts: Mapping[str, str]) -> str:
    """The mark of a text that is given by language."""
    return f"⟦said {_json(dict(texts))}⟧"


def chosen(page: str, language: str) -> str:
    """A page, or a drawing, with the texts of a language in place of its marks."""

    def text(found: re.Match[str]) -> str:
        try:
            texts = msgspec.json.decode(html.unescape(found[1]), type=dict[str, str])
        except (msgspec.MsgspecError, UnicodeEncodeError):
            return found[0]  # a name of the user's own that looks like a mark
        return html.escape(printable(texts.get(language, texts.get(ENGLISH, ""))))

    return _SAID.sub(text, page)


def in_language(page: str, language: str) -> str:
    """A page of ours in a language, which it states; areas in sentences may be marks.

    Raises ValueError if there is no such language.
    """
    if language not in LANGUAGES:
        message = f"there is no catalogue of {language!r}"
        raise ValueError(message)
    kept = _kept(page)

    def shown(number: int, piece: str) -> str:
        if _SAID.search(piece):
            texts = {one: chosen(piece, one) for one in LANGUAGES}
            if len(set(texts.values())) > 1:
                own = {one: text for one, text in texts.items() if text != texts[ENGLISH]}
                kept[number] = {ENGLISH: texts[ENGLISH], **own}
            return texts[language]
        texts = kept.get(number, {})
        figures = {_mark(*figure.groups()): figure[0] for figure in _FIGURE.finditer(piece)}
        text = texts.get(language, texts.get(ENGLISH, piece))
        return _AREA.sub(lambda area: figures.get(area[0], area[0]), text)

    page = map_texts(_META.sub("", page, count=1), shown)
    page = re.sub(r'<html lang="[a-z]+">', f'<html lang="{language}">', page, count=1)
    if not kept:
        return page
    content = html.escape(_json(sorted(kept.items())))
    return page.replace("</head>", f'<meta name="{KEPT}" content="{content}">\n</head>', 1)


def unbroken(page: str) -> str:
    """A page whose figures stay on one line: "33.43 ± 0.21 m²", "95 %"."""
    pieces = _PIECES.split(page)
    return "".join(piece if k % 2 else _INSIDE_FIGURE.sub(_NO_BREAK, piece) for k, piece in enumerate(pieces))


def has_other_languages(page: str) -> bool:
    """Whether a finished page keeps its texts in other languages."""
    return _META.search(page) is not None


def language_of(page: str) -> str:
    """The language of a page of ours."""
    found = re.search(r'<html lang="([a-z]+)">', page)
    return found[1] if found is not None else ENGLISH


def map_texts(page: str, change: Callable[[int, str], str]) -> str:
    """A page with each text between its tags, or in an attribute, replaced: from its number and itself."""
    number = 0

    def changed(text: str) -> str:
        nonlocal number
        number += 1
        return change(number, text)

    def attribute(found: re.Match[str]) -> str:
        return f'{found[1]}="{changed(found[2])}"'

    pieces = _PIECES.split(page)
    return "".join(_TEXT_ATTRIBUTE.sub(attribute, piece) if k % 2 else changed(piece) for k, piece in enumerate(pieces))


def _kept(page: str) -> dict[int, dict[str, str]]:
    """The texts that a finished page keeps."""
    found = _META.search(page)
    if found is None:
        return {}
    return dict(msgspec.json.decode(html.unescape(found[1]), type=list[tuple[int, dict[str, str]]]))


def _json(value: object) -> str:
    """Compact JSON without the brackets of marks."""
    text = json.dumps(value, ensure_ascii=False, separators=(",", ":"))
    return text.replace("⟦", "\\u27e6").replace("⟧", "\\u27e7")


def _mark(kind: str, value: str, sigma: str | None) -> str:
    """The mark of an area or a work rate, as :mod:`~furrowmap.exporters.reports.area_units` makes it."""
    return f"⟦{kind} {value}{' ' + sigma if sigma else ''}⟧"
