"""Messages of errors and warnings: a key and values, and their sentences in every language.

The file of a language, such as `en.toml`, has a table for each key: a code, or a code and a variant such as
`[no-such-file.folder]`. A variant takes the parts that it lacks from its code. Parts are `what`, `meaning` and `remedy`
of errors, `text` of warnings; each is a template (:mod:`~furrowmap.core.runtime.languages.templates`).
"""

from collections.abc import Mapping
from functools import cache
from typing import Any, Final

from furrowmap.core.runtime.languages.templates import Choice, Hole, Part, holes_of, parts_of
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
