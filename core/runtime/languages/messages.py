"""Messages of errors and warnings: a key and values, and their sentences in every language.

`en_messages.toml` and `ja_messages.toml` have a table for each key: a code, or a code and a variant such as
`[no-such-file.folder]`. A variant takes the parts that it lacks from its code. Parts are `what`, `meaning` and `remedy`
of errors, `text` of warnings; each is a template (:mod:`~furrowmap.core.runtime.languages.templates`).
"""

from collections.abc import Iterator, Mapping
from functools import cache
from itertools import product
from typing import Any, Final

from furrowmap.core.runtime.languages.templates import Choice, Hole, Part, holes_of, parts_of, walk
from furrowmap.core.runtime.languages.texts import ENGLISH, Value, plain_value, shown_values, templates

ERROR_PARTS: Final = ("what", "meaning", "remedy")
"""Parts of an error, as they are printed below each other."""


@cache
def sentences(language: str, key: str) -> Mapping[str, tuple[Part, ...]]:
    """The parsed templates of a key in a language; of a key of another package, the texts that it passes."""
    found = templates(language).get(key, {part: f"{{{part}}}" for part in (*ERROR_PARTS, "text")})
    return {part: parts_of(template) for part, template in found.items()}


@cache
def holes(key: str) -> Mapping[str, Hole | Choice]:
    """The names of the values of a key; a name of a hole and of a choice counts as a hole."""
    return holes_of(sentences(ENGLISH, key).values())


def plain_values(key: str, values: Mapping[str, Any]) -> dict[str, Value]:
    """Values of a key as Python's own numbers and texts; URLs in them have no passwords.

    A key that is not in the catalogue, such as of a reader in another package, takes its sentences themselves: `what`,
    `meaning` and `remedy`, or `text`. KeyError if a value is missing or belongs to no hole.
    """
    sentences_themselves = key not in templates("en") and values.keys() in ({*ERROR_PARTS}, {"text"})
    if not sentences_themselves and holes(key).keys() != values.keys():
        message = f"{key}: values {sorted(values)} for {sorted(holes(key))}"
        raise KeyError(message)
    return {name: plain_value(value) for name, value in values.items()}


def printed(key: str, values: Mapping[str, Value], language: str = ENGLISH) -> dict[str, str | bool | None]:
    """Values of a key as its sentences show them in a language."""
    return shown_values(sentences(ENGLISH, key).values(), values.items(), language)


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
