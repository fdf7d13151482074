"""Templates of texts: literal text, places for values, and choices between two texts.

In a template `{name}` is a value, `{name:.1f}` a value with its format (English alone states formats), and
`{name:one|other}` is a choice: `one` where the value is neither None, False nor empty. `{{` and `}}` are braces.
`{name#point|points}` is a choice by a number that stands in a hole of the English template: the first text for 1.
`{name:figures}` is a string with numbers in English notation, such as "33.43 ± 0.21 m²", which follow the language.
"""

import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Final, TypeAlias

Part: TypeAlias = "str | Hole | Choice"
_TOKEN: Final = re.compile(r"\{\{|\}\}|[{}|]")
_HOLE_NAME: Final = re.compile(r"([a-z_0-9]+)(![rs])?([:#])?")
FIGURES: Final = "figures"
"""The format of a hole for a string with numbers."""


class Figures(str):
    """Numbers in English notation: they get the marks of a language, but not in code, where they can be typed."""

    __slots__ = ()


@dataclass(frozen=True)
class Hole:
    """A place for a value; `spec` is a format specification."""

    name: str
    spec: str
    conversion: str


@dataclass(frozen=True)
class Choice:
    """One of two texts; `by_number` if the first is for 1."""

    name: str
    yes: tuple[Part, ...]
    no: tuple[Part, ...]
    by_number: bool


@lru_cache(maxsize=4096)
def parts_of(template: str) -> tuple[Part, ...]:
    """The literal texts, holes and choices of a template. Raises ValueError if its braces do not match."""
    found, end = _parse(template, 0, "")
    if end != len(template):
        message = f"unbalanced braces: {template!r}"
        raise ValueError(message)
    return found


def _parse(text: str, start: int, stops: str) -> tuple[tuple[Part, ...], int]:
    found: list[Part] = []
    literal = ""
    at = start
    while at < len(text) and text[at] not in stops:
        is_doubled = text.startswith("{{", at) or (not stops and text.startswith("}}", at))
        if text[at] == "{" and not is_doubled:
            part, at = _named_part(text, at + 1)
            found += [literal, part] if literal else [part]
            literal = ""
        else:
            literal = literal + text[at]
            at = at + 1 + is_doubled
    return (*found, literal) if literal else tuple(found), at


def _named_part(text: str, start: int) -> tuple[Part, int]:
    named = _HOLE_NAME.match(text, start)
    if named is None:
        message = f"a name is missing behind a brace: {text!r}"
        raise ValueError(message)
    name, conversion, mark = named.groups()
    if not mark:
        return Hole(name, "", (conversion or "")[1:]), named.end() + 1
    plain = _TOKEN.search(text, named.end())
    if mark == ":" and plain is not None and plain[0].startswith("}"):
        return Hole(name, text[named.end() : plain.start()], (conversion or "")[1:]), plain.start() + 1
    yes, bar = _parse(text, named.end(), "|")
    no, end = _parse(text, bar + 1, "}")
    return Choice(name, yes, no, mark == "#"), end + 1


def walk(parts: tuple[Part, ...]) -> Iterator[Hole | Choice]:
    """Every hole and choice, also those within choices."""
    for part in parts:
        if isinstance(part, str):
            continue
        yield part
        if isinstance(part, Choice):
            yield from walk(part.yes)
            yield from walk(part.no)


def holes_of(templates: Iterable[tuple[Part, ...]]) -> Mapping[str, Hole | Choice]:
    """The names of the values of templates; a name of a hole and of a choice counts as a hole."""
    found: dict[str, Hole | Choice] = {}
    for parts in templates:
        for part in walk(parts):
            if isinstance(part, Hole) or part.name not in found:
                found[part.name] = part
    return found


def shown(value: object, hole: Hole | Choice) -> str | bool | None:
    """A value as a template shows it: a string in a hole, a bool for a choice alone; None and False stay."""
    if isinstance(hole, Choice):
        return bool(value)
    if value is None or value is False:
        return value
    if hole.spec == FIGURES:
        return Figures(value)
    if hole.conversion == "r":
        return format(repr(value), hole.spec)
    return Figures(format(value, hole.spec)) if isinstance(value, int | float) else format(value, hole.spec)


def fill(
    parts: tuple[Part, ...],
    values: Mapping[str, str | bool | None],
    said: Callable[[str], str] = str,
    before: str = "",
) -> str:
    """The text of a template with values as :func:`shown` gives them, after the text before it."""
    text = before
    for part in parts:
        if isinstance(part, str):
            text += part
        elif isinstance(part, Hole):
            given = values[part.name]
            value = given if isinstance(given, str) else str(given)
            text += value if text.count("`") % 2 else said(value)
        else:
            chosen = values[part.name]
            is_no = chosen != "1" if part.by_number else chosen in (None, False, "")
            text = fill(part.no if is_no else part.yes, values, said, text)
    return text
