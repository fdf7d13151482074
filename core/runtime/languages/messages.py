"""Messages of errors and warnings: a key and values, and their sentences in every language.

`en_messages.toml` and `ja_messages.toml` have a table for each key: a code, or a code and a variant such as
`[no-such-file.folder]`. A variant takes the parts that it lacks from its code. Parts are `what`, `meaning` and `remedy`
of errors, `text` of warnings. In them, `{name}` is a value, `{name:.1f}` a value with its format (English alone states
formats), and `{name:one|other}` is a choice: `one` where the value is neither None, False nor empty.
"""

import re
import tomllib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from itertools import product
from typing import Any, Final, TypeAlias

from furrowmap.core.runtime.urls import without_passwords

Part: TypeAlias = "str | Hole | Choice"
ERROR_PARTS: Final = ("what", "meaning", "remedy")
"""Parts of an error, as they are printed below each other."""
Value: TypeAlias = str | bool | int | float | None
"""A value of a message: a number in the unit that its name states, a text, or the condition of a choice."""
_TOKEN: Final = re.compile(r"\{\{|\}\}|[{}|]")
_HOLE_NAME: Final = re.compile(r"([a-z_0-9]+)(![rs])?(:)?")


@dataclass(frozen=True)
class Hole:
    """A place for a value; `spec` is a format specification."""

    name: str
    spec: str
    conversion: str


@dataclass(frozen=True)
class Choice:
    """One of two texts."""

    name: str
    yes: tuple[Part, ...]
    no: tuple[Part, ...]


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
        if text.startswith("{{", at) or (not stops and text.startswith("}}", at)):
            literal = literal + text[at]
            at = at + 2
        elif text[at] == "{":
            part, at = _named_part(text, at + 1)
            found += [literal, part] if literal else [part]
            literal = ""
        else:
            literal = literal + text[at]
            at = at + 1
    return (*found, literal) if literal else tuple(found), at


def _named_part(text: str, start: int) -> tuple[Part, int]:
    named = _HOLE_NAME.match(text, start)
    if named is None:
        message = f"a name is missing behind a brace: {text!r}"
        raise ValueError(message)
    name, conversion, colon = named.groups()
    if not colon:
        return Hole(name, "", (conversion or "")[1:]), named.end() + 1
    plain = _TOKEN.search(text, named.end())
    if plain is not None and plain[0].startswith("}"):
        return Hole(name, text[named.end() : plain.start()], (conversion or "")[1:]), plain.start() + 1
    yes, bar = _parse(text, named.end(), "|")
    no, end = _parse(text, bar + 1, "}")
    return Choice(name, yes, no), end + 1


@cache
def templates(language: str) -> Mapping[str, Mapping[str, str]]:
    """The templates of every key of a language, by part; those of a variant with the parts of its code."""
    text = files("furrowmap.core.runtime.languages").joinpath(f"{language}_messages.toml").read_text("utf-8")
    found: dict[str, Mapping[str, str]] = {}
    for code, table in tomllib.loads(text).items():
        own = {part: template for part, template in table.items() if isinstance(template, str)}
        if own:
            found[code] = own
        for name, each in table.items():
            if isinstance(each, dict):
                found[f"{code}.{name}"] = (own if ("text" in own) == ("text" in each) else {}) | each
    return found


@cache
def sentences(language: str, key: str) -> Mapping[str, tuple[Part, ...]]:
    """The parsed templates of a key in a language; of a key of another package, the texts that it passes."""
    found = templates(language).get(key, {part: f"{{{part}}}" for part in (*ERROR_PARTS, "text")})
    return {part: parts_of(template) for part, template in found.items()}


def walk(parts: tuple[Part, ...]) -> Iterator[Hole | Choice]:
    """Every hole and choice, also those within choices."""
    for part in parts:
        if isinstance(part, str):
            continue
        yield part
        if isinstance(part, Choice):
            yield from walk(part.yes)
            yield from walk(part.no)


@cache
def holes(key: str) -> Mapping[str, Hole | Choice]:
    """The names of the values of a key; a name of a hole and of a choice counts as a hole."""
    found: dict[str, Hole | Choice] = {}
    for parts in sentences("en", key).values():
        for part in walk(parts):
            if isinstance(part, Hole) or part.name not in found:
                found[part.name] = part
    return found


def plain_values(key: str, values: Mapping[str, Any]) -> dict[str, Value]:
    """Values of a key as Python's own numbers and texts; URLs in them have no passwords.

    A key that is not in the catalogue, such as of a reader in another package, takes its sentences themselves: `what`,
    `meaning` and `remedy`, or `text`. KeyError if a value is missing or belongs to no hole.
    """
    sentences_themselves = key not in templates("en") and values.keys() in ({*ERROR_PARTS}, {"text"})
    if not sentences_themselves and holes(key).keys() != values.keys():
        message = f"{key}: values {sorted(values)} for {sorted(holes(key))}"
        raise KeyError(message)
    return {name: _plain_value(value) for name, value in values.items()}


def _plain_value(value: Any) -> Value:
    if hasattr(value, "dtype"):  # a scalar of numpy, which `--help` does not import
        value = value.item()
    if value is None or isinstance(value, bool):
        return value
    if isinstance(value, int):
        return int(value)
    return float(value) if isinstance(value, float) else without_passwords(str(value))


def printed(key: str, values: Mapping[str, Value]) -> dict[str, Value]:
    """Values of a key as its sentences show them: a string for each hole, a bool for each choice alone."""
    wanted = holes(key)
    found: dict[str, Value] = {}
    for name, value in values.items():
        hole = wanted[name]
        if isinstance(hole, Choice):
            found[name] = bool(value)
        elif value is None or value is False:
            found[name] = value
        else:
            shown = repr(value) if hole.conversion == "r" else value
            found[name] = format(shown, hole.spec) if hole.spec else str(shown)
    return found


def fill(
    parts: tuple[Part, ...], values: Mapping[str, Value], said: Callable[[str], str] = str, before: str = ""
) -> str:
    """The text of a template with values, after the text before it.

    `said` translates them, but for those in backticks.
    """
    text = before
    for part in parts:
        if isinstance(part, str):
            text += part
        elif isinstance(part, Hole):
            value = str(values[part.name])
            text += value if text.count("`") % 2 else said(value)
        else:
            chosen = values[part.name]
            text = fill(part.no if chosen is None or chosen is False or chosen == "" else part.yes, values, said, text)
    return text


def expansions(english: str, other: str) -> Iterator[tuple[str, str]]:
    """Every text that a template can be, with … for its values, and the other language's with {1}, {2}, … for them."""
    ours = parts_of(english)
    theirs = parts_of(other)
    choices = sorted({part.name for part in walk(ours) if isinstance(part, Choice)})
    for picked in product((True, False), repeat=len(choices)):
        pick = dict(zip(choices, picked, strict=True))
        text = ""
        number = 0
        numbers: dict[int, list[str]] = {}
        for part in _chosen(ours, pick):
            if isinstance(part, str):
                text += part
            elif text.endswith("…"):
                numbers.setdefault(number, []).append(part.name)
            else:
                number += 1
                numbers[number] = [part.name]
                text += "…"
        target = "".join(part if isinstance(part, str) else "\0" + part.name + "\0" for part in _chosen(theirs, pick))
        for k, names in numbers.items():
            target = target.replace("".join(f"\0{name}\0" for name in names), f"{{{k}}}")
        yield " ".join(text.split()), target


def _chosen(parts: tuple[Part, ...], pick: Mapping[str, bool]) -> Iterator[str | Hole]:
    for part in parts:
        if isinstance(part, Choice):
            yield from _chosen(part.yes if pick[part.name] else part.no, pick)
        else:
            yield part
