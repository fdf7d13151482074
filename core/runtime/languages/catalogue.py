"""Texts in the language of the user: a catalogue of templates of English texts, and of the same in the language.

Texts of pages and layers are English in the code, and in the data: files such as `report.json` hold them, whatever the
language. A catalogue is made of TOML files of tables: `[all]` for texts of any place, and one for each code of errors
and warnings that have such texts as values; the texts of messages themselves come from
:mod:`~furrowmap.core.runtime.languages.messages`. A key is an English text, with … for what varies; its value has {1},
{2}, … in their places:

    "Straight passes: …" = "直線の行程：{1}"
"""

import re
import tomllib
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache, cached_property, lru_cache
from importlib.resources import files
from typing import Final

from furrowmap.core.runtime.languages.messages import expansions
from furrowmap.core.runtime.languages.texts import ENGLISH, LANGUAGES, templates

HOLE: Final = "…"
BETWEEN_BRACES: Final = re.compile(r"\{[^}]*\}")
NAMED: Final = re.compile(r"\{[a-z_]")
SPECIFIC: Final = 8
"""Letters that a template needs to be looked for in any text; others are looked for in texts of their own code."""
_COMMON: Final = "all"
MAX_DEPTH: Final = 5
"""Texts in holes of texts in holes: a cause within a warning within a list."""
_SENTENCE: Final = re.compile(r"(?<=[.!?]) (?=\S)")
_BETWEEN_ENTRIES: Final = re.compile("; ")
_BETWEEN_ITEMS: Final = re.compile(", ")
_TWO_WORDS: Final = re.compile(r"[A-Za-z]{2,} [A-Za-z]{2,}")


@dataclass(frozen=True)
class Template:
    """A text with holes, and the same in another language, where {1} is what stands in the first hole."""

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
    """All templates of a language: English text → text, by code; "all" are those of any text."""

    tables: Mapping[str, Mapping[str, str]]

    @cached_property
    def exact(self) -> Mapping[str, str]:
        """The texts without holes, of all codes."""
        return {k: v for table in list(self.tables.values())[::-1] for k, v in table.items() if HOLE not in k}

    def templates(self, code: str = "") -> Iterator[Template]:
        """Those of a code with letters, the most specific first; all that are specific enough; those of holes alone."""
        own = self._of_code.get(code, ())
        yield from (template for template in own if template.letters)
        yield from self._specific
        yield from (template for template in own if not template.letters)

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
    """The catalogue of a language; an empty one for English. Raises ValueError for another one."""
    if language not in LANGUAGES:
        message = f"there is no catalogue of {language!r}"
        raise ValueError(message)
    tables: dict[str, dict[str, str]] = {}
    folder = files("furrowmap.core.runtime.languages")
    for name in sorted(f.name for f in folder.iterdir() if f.name.startswith(f"{language}_")):
        if name != f"{language}_messages.toml":
            for code, table in tomllib.loads(folder.joinpath(name).read_text("utf-8")).items():
                for source, target in table.items():
                    if not any(map(str.isalpha, BETWEEN_BRACES.sub("", source))):
                        continue  # what stands between the items of a list
                    tables.setdefault(code, {}).update(_backwards(source, target))
    if language != ENGLISH:
        for key, parts in templates(ENGLISH).items():
            table = tables.setdefault(key.partition(".")[0], {})
            for part, template in parts.items():
                table.update(expansions(template, templates(language)[key][part]))
    return Catalogue(tables)


def _backwards(source: str, target: str) -> dict[str, str]:
    """Entries of a text with … for its values."""
    return dict(expansions(source, target)) if NAMED.search(source) else {source: target}


def translated(text: str, language: str, code: str = "") -> str:
    """A text of the product in another language; what the catalogue does not know stays as it is.

    Texts of the error or warning with that code are looked for first. ValueError if there is no such language.
    """
    return text if language == ENGLISH else _translated(text, language, code, MAX_DEPTH)


@lru_cache(maxsize=4096)
def _translated(text: str, language: str, code: str, depth: int) -> str:
    whole = _whole(text, language, code, depth)
    if whole is not None or depth == 0:
        return whole or text
    sentences = _SENTENCE.split(text)
    if len(sentences) > 1:
        return _sentences(sentences, language, code, depth)
    for mark, other in ((_BETWEEN_ENTRIES, "；"), (_BETWEEN_ITEMS, "、")):
        if mark.search(text):
            parts = mark.split(text)
            found = [_translated(part, language, "", depth - 1) for part in parts]
            # Half a translation, with words of English left, is worse than none.
            left = any(part == new and _TWO_WORDS.search(part) for part, new in zip(parts, found, strict=True))
            if found != parts and not left:
                return other.join(found)
    head, colon, rest = text.partition(": ")
    if colon and _TWO_WORDS.search(rest):
        found = [_translated(part, language, "", depth - 1) for part in (head, rest)]
        if found[1] != rest:
            return "：".join(found)
    return text


def _sentences(sentences: list[str], language: str, code: str, depth: int) -> str:
    """Sentence by sentence; the longest rows of sentences that the catalogue has as one text come first."""
    done = []
    first = 0
    while first < len(sentences):
        for behind in range(len(sentences), first, -1):
            if first == 0 and behind == len(sentences):
                continue
            row = " ".join(sentences[first:behind])
            found = (
                _whole(row, language, code, depth) if behind > first + 1 else _translated(row, language, code, depth)
            )
            if found is not None:
                done.append(found)
                first = behind
                break
    return "".join(f" {part}" if k and part[:1].isascii() else part for k, part in enumerate(done))


def _whole(text: str, language: str, code: str, depth: int) -> str | None:
    """A text that is in the catalogue as a whole."""
    known = catalogue(language)
    exact = next((table[text] for table in map(known.tables.get, (code, _COMMON)) if table and text in table), None)
    exact = exact or known.exact.get(text)
    if exact is not None:
        return exact
    for template in known.templates(code):
        values = template.values(text)
        if values is None:
            continue
        if depth and template.source.startswith(HOLE):
            for mark, other, shown in (
                (_SENTENCE, "", values),
                (_BETWEEN_ENTRIES, "；", values),
                (_BETWEEN_ITEMS, "、", values[:1]),
            ):
                if any(mark.search(value) for value in shown):
                    # The holes took in sentences, or entries of a list: each may have a translation of its own.
                    parts = mark.split(text)
                    found = [_translated(part, language, "", depth - 1) for part in parts]
                    if all(part != new for part, new in zip(parts, found, strict=True)):
                        return other.join(found)
        return template.filled(_translated(value, language, "", depth - 1) if depth else value for value in values)
    return None
