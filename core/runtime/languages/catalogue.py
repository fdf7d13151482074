"""The catalogue of a language: templates of English texts, and what they are in that language.

Texts of pages and layers are English in the code, and in the data: files such as `report.json` hold them, whatever the
language. A catalogue is made of TOML files of tables: `[all]` for texts of any place, and one for each code of errors
and warnings that have such texts as values; the texts of messages themselves come from
:mod:`~furrowmap.core.runtime.languages.messages`. A key is an English text, with … for what varies; its value has {1},
{2}, … in their places:

    "Straight passes: …" = "直線の行程：{1}"
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache, cached_property
from importlib.resources import files
from typing import Final

from furrowmap.core.runtime.languages.messages import expansions, templates

ENGLISH: Final = "en"
LANGUAGES: Final = (ENGLISH, "ja")
"""ISO 639-1 codes; English is what the texts are written in."""
HOLE: Final = "…"
SPECIFIC: Final = 8
"""Letters that a template needs to be looked for in any text; others are looked for in texts of their own code."""
_COMMON: Final = "all"


@dataclass(frozen=True)
class Template:
    """A text with holes, and the same in another language.

    Attributes:
        source: English; … is a hole.
        target: {1} is what stands in the first hole.
    """

    source: str
    target: str

    @cached_property
    def literals(self) -> tuple[str, ...]:
        """What stands between the holes."""
        return tuple(self.source.split(HOLE))

    @cached_property
    def letters(self) -> int:
        """Number of letters outside the holes."""
        return sum(letter.isalpha() for letter in self.source)

    @cached_property
    def _pattern(self) -> re.Pattern[str]:
        return re.compile("(.+?)".join(map(re.escape, self.literals)), re.DOTALL)

    def values(self, text: str) -> tuple[str, ...] | None:
        """What stands in the holes of a text; None for another text."""
        if not (text.startswith(self.literals[0]) and text.endswith(self.literals[-1])):
            return None
        if any(part not in text for part in self.literals):
            return None
        found = self._pattern.fullmatch(text)
        return found.groups() if found is not None else None

    def filled(self, values: Iterable[str]) -> str:
        """The text in the other language with values in the holes."""
        values = tuple(values)
        return re.sub(r"\{(\d+)\}", lambda hole: values[int(hole[1]) - 1], self.target)


@dataclass(frozen=True)
class Catalogue:
    """All templates of a language.

    Attributes:
        tables: English text → text, by code; "all" are those of any text.
    """

    tables: Mapping[str, Mapping[str, str]]

    def of_code(self, code: str) -> Mapping[str, str]:
        """The texts of a code, and those of any."""
        return {**self.tables.get(_COMMON, {}), **self.tables.get(code, {})}

    @cached_property
    def exact(self) -> Mapping[str, str]:
        """The texts without holes, of all codes."""
        return {k: v for table in list(self.tables.values())[::-1] for k, v in table.items() if HOLE not in k}

    def templates(self, code: str = "") -> Iterator[Template]:
        """Those of a code, the most specific first; then all that are specific enough for any text."""
        yield from self._of_code.get(code, ())
        yield from self._specific

    @cached_property
    def _of_code(self) -> Mapping[str, tuple[Template, ...]]:
        return {code: _ordered(table) for code, table in self.tables.items()}

    @cached_property
    def _specific(self) -> tuple[Template, ...]:
        everything = {k: v for table in self.tables.values() for k, v in table.items()}
        common = self.tables.get(_COMMON, {})
        return tuple(t for t in _ordered(everything) if t.letters >= SPECIFIC or t.source in common)


def _ordered(table: Mapping[str, str]) -> tuple[Template, ...]:
    found = [Template(source, target) for source, target in table.items() if HOLE in source]
    return tuple(sorted(found, key=lambda template: -template.letters))


@cache
def catalogue(language: str) -> Catalogue:
    """The catalogue of a language; an empty one for English.

    Raises:
        ValueError: for another one.
    """
    if language not in LANGUAGES:
        message = f"there is no catalogue of {language!r}"
        raise ValueError(message)
    tables: dict[str, dict[str, str]] = {}
    folder = files("furrowmap.core.runtime.languages")
    for name in sorted(f.name for f in folder.iterdir() if f.name.startswith(f"{language}_")):
        if name != f"{language}_messages.toml":
            for code, table in tomllib.loads(folder.joinpath(name).read_text("utf-8")).items():
                tables.setdefault(code, {}).update(table)
    if language != ENGLISH:
        for key, parts in templates(ENGLISH).items():
            table = tables.setdefault(key.partition(".")[0], {})
            for part, template in parts.items():
                table.update(expansions(template, templates(language)[key][part]))
    return Catalogue(tables)
