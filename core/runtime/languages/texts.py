"""Texts of the product within messages, pages and layers: an English template and values, shown in any language.

A language is one file, such as `ja.toml`, with its own `name`. English has only the sentences of messages
(:mod:`~furrowmap.core.runtime.languages.messages`); others also have texts by their English templates, as with gettext:

    [texts]
    "line {line} names {name!r}" = "{line} 行目に {name} があります"

A template that a language lacks is shown in English. `[words]` holds words that come as plain strings, `[share]`
and `[live]` the texts of places that have other words for some of them, as contexts of gettext do. `[numbers]` has the
marks of a language that writes numbers otherwise than English: `decimal`, `thousands`, and `between` those of a list.
"""

import re
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any, Final, TypeAlias

from furrowmap.core.runtime.languages.templates import FIGURES, Figures, Hole, Part, fill, holes_of, parts_of, shown
from furrowmap.core.runtime.urls import without_passwords

ENGLISH: Final = "en"
_CATALOGUES: Final = files("furrowmap.core.runtime.languages")
_PRESENT: Final = {file.name[:-5] for file in _CATALOGUES.iterdir() if file.name.endswith(".toml")}
LANGUAGES: Final = (ENGLISH, *sorted(_PRESENT - {ENGLISH}))
"""ISO 639-1 codes, one of each file; English, in which the texts are written, is the first."""
TEXT_TABLE: Final = "texts"
WORDS: Final = "words"
"""The table of a language with :func:`words_of`."""


@dataclass(frozen=True, init=False)
class Text:
    """A text of the product: an English template and its values.

    >>> str(Text("line {line} has no {names:or}", line=3, names=("id", "name", "place")))
    'line 3 has no id, name or place'
    """

    template: str
    values: "tuple[tuple[str, Value], ...]"

    def __init__(self, template: str, /, **values: object) -> None:
        object.__setattr__(self, "template", template)
        object.__setattr__(self, "values", tuple((name, plain_value(value)) for name, value in values.items()))

    def __str__(self) -> str:
        return self.in_language(ENGLISH)

    def in_language(self, language: str) -> str:
        """The text in a language; a template that its catalogue lacks in English."""
        template = texts_of(language).get(self.template, self.template)
        return filled(parts_of(template), shown_values([parts_of(self.template)], self.values, language), language)


Words: TypeAlias = str | Text
"""What can stand in a sentence: a name that is the same in every language, or a text of the product."""
Value: TypeAlias = str | bool | int | float | Text | tuple[str | int | float | Text, ...] | None
"""A value of a text: a number in the unit that its name states, a text, a list, or the condition of a choice."""
MOST_REASON: Final = 200
"""Characters of what another library says."""
CLAUSE: Final = "clause"
"""The format of a hole for a sentence without its full stop."""
LIST_STYLES: Final = {
    "": (", ", ", "),
    ";": ("; ", "; "),
    ".": (" ", " "),
    "and": (", ", " and "),
    "or": (", ", " or "),
}
"""What stands between the items of a list, and before its last, by the format that its hole states."""
SHARE: Final = "share"
"""The place of the texts of shared results, among them the words for classes of points."""
LIVE: Final = "live"
"""The place of the texts of the live page."""
PLACES_WITH_OWN_WORDS: Final = (SHARE, LIVE)
NUMBERS: Final = "numbers"
"""The table of a language with its marks in numbers."""
_NO_MESSAGES: Final = (TEXT_TABLE, WORDS, NUMBERS, *PLACES_WITH_OWN_WORDS)
_ENGLISH_MARK: Final = re.compile(r"(?<=\d)[.,](?=\d)|, (?=[-+−]?\d)")
_ONLY_FIGURES: Final = f"{{figures:{FIGURES}}}"


def shown_values(
    parts: Iterable[tuple[Part, ...]], values: Iterable[tuple[str, Value]], language: str
) -> dict[str, str | bool | None]:
    """Values as templates with these English parts show them in a language."""
    wanted = holes_of(parts)
    found: dict[str, str | bool | None] = {}
    for name, value in values:
        hole = wanted[name]
        if isinstance(hole, Hole) and hole.spec == CLAUSE:
            found[name] = str(in_language(value, language)).rstrip(".。")
            continue
        if isinstance(hole, Hole) and (isinstance(value, tuple) or (hole.spec in LIST_STYLES and hole.spec)):
            found[name] = joined(value if isinstance(value, tuple) else (value,), hole.spec, language)
        else:
            said = shown(in_language(value, language), hole)
            found[name] = str(said) if isinstance(value, Text) and isinstance(hole, Hole) else said
    return found


def joined(items: Sequence[Value], style: str, language: str) -> str:
    """A list in a language, with the separators of a style; empty for none."""
    between, last = (texts_of(language).get(mark, mark) for mark in LIST_STYLES[style])
    said = [
        in_marks(str(item), language) if isinstance(item, float) else str(in_language(item, language)) for item in items
    ]
    return last.join([between.join(said[:-1]), said[-1]]) if len(said) > 1 else "".join(said)


def in_language(value: Value, language: str) -> object:
    """A value, with a text of the product in a language."""
    return value.in_language(language) if isinstance(value, Text) else value


def reason(error: BaseException) -> Words:
    """What an exception was raised with, in words; a text of the product stays one, others are short."""
    said = error.args[0] if len(error.args) == 1 else None
    if isinstance(said, Text):
        return said
    named = error.strerror if isinstance(error, OSError) else None
    return " ".join((named or str(error) or type(error).__name__).split())[:MOST_REASON]


def filled(parts: tuple[Part, ...], values: Mapping[str, str | bool | None], language: str) -> str:
    """A template with values; words of the product among them, such as names of kinds, are in the language."""
    words = words_of(language)
    return fill(parts, values, lambda v: in_marks(v, language) if isinstance(v, Figures) else words.get(v, v))


def figure_text(text: str) -> Text:
    """A string with numbers in English notation, such as "33.43 ± 0.21 m²", as a text in any language."""
    return Text(_ONLY_FIGURES, figures=text)


def in_marks(text: str, language: str) -> str:
    """A string with numbers in English notation in that of a language."""
    marks = marks_of(language)
    return _ENGLISH_MARK.sub(lambda mark: marks[mark[0]], text) if marks else text


@cache
def marks_of(language: str) -> Mapping[str, str]:
    """The marks of a language by those of English; none where they are the same."""
    own: Mapping[str, str] = catalogue(language).get(NUMBERS, {})
    return {".": own["decimal"], ",": own["thousands"], ", ": own["between"]} if own else {}


def plain_value(value: Any) -> Value:
    """A value as one of Python's own numbers, a text, a string without passwords of URLs, or a tuple of these."""
    if hasattr(value, "dtype"):  # a scalar of numpy, which `--help` does not import
        value = value.item()
    if value is None or isinstance(value, bool | Text):
        return value
    if isinstance(value, list | tuple):
        return tuple(str(item) if isinstance(item, Path) else item for item in value)
    if isinstance(value, int):
        return int(value)
    return float(value) if isinstance(value, float) else without_passwords(str(value))


def label_text(label: str) -> Text:
    """A text of a table of labels, such as names of columns, which tests hold against the catalogues."""
    return Text(label)


def in_every_language(text: Words) -> dict[str, str]:
    """A text by language, for what is read in another one than that of its writer."""
    return {language: str(in_language(text, language)) for language in LANGUAGES}


@cache
def templates(language: str) -> Mapping[str, Mapping[str, str]]:
    """The templates of every key of a language, by part; those of a variant with the parts of its code."""
    found: dict[str, Mapping[str, str]] = {}
    for code, table in catalogue(language).items():
        if code in _NO_MESSAGES or isinstance(table, str):
            continue
        own = {part: template for part, template in table.items() if isinstance(template, str)}
        if own:
            found[code] = own
        for name, each in table.items():
            if isinstance(each, dict):
                found[f"{code}.{name}"] = (own if ("text" in own) == ("text" in each) else {}) | each
    return found


@cache
def words_of(language: str) -> Mapping[str, str]:
    """Words that come as plain strings, such as names of kinds and what the operating system says; none in English."""
    words: Mapping[str, str] = catalogue(language).get(WORDS, {})
    return words


@cache
def texts_of(language: str, place: str = "") -> Mapping[str, str]:
    """The texts of a language by their English templates, parts of messages too; none for English.

    `place` is one of :data:`PLACES_WITH_OWN_WORDS`; "" are all others. ValueError for an unknown language.
    """
    if language not in LANGUAGES:
        message = f"there is no catalogue of {language!r}"
        raise ValueError(message)
    if place:
        of_place: Mapping[str, str] = catalogue(language).get(place, {})
        return of_place
    if language == ENGLISH:
        return {}
    own = templates(language)
    texts: Mapping[str, str] = catalogue(language)[TEXT_TABLE]
    parts = {english: own[key][part] for key, of in templates(ENGLISH).items() for part, english in of.items()}
    return {**parts, **texts, **words_of(language)}


def texts_by_language(place: str) -> dict[str, dict[str, Any]]:
    """Name, texts of a place and marks in numbers of each language, for a page that chooses its language itself."""
    names = {one: catalogue(one)["name"] for one in LANGUAGES}
    return {one: {"name": names[one], "texts": texts_of(one, place), "marks": marks_of(one)} for one in LANGUAGES}


@cache
def catalogue(language: str) -> Mapping[str, Any]:
    """The content of the file of a language."""
    return tomllib.loads(_CATALOGUES.joinpath(f"{language}.toml").read_text("utf-8"))
