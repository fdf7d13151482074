"""Texts in the language of the user."""

from __future__ import annotations

import re
from functools import lru_cache
from typing import Final

from furrowmap.core.runtime.languages.catalogue import ENGLISH, HOLE, catalogue

DEEPEST: Final = 5
"""Texts in holes of texts in holes: a cause within a warning within a list."""
_SENTENCE: Final = re.compile(r"(?<=[.!?]) (?=\S)")
_LIST: Final = (("; ", "；"), (", ", "、"))
_WORDS: Final = re.compile(r"[A-Za-z]{2,} [A-Za-z]{2,}")


def translated(text: str, language: str, code: str = "") -> str:
    """A text of the product in another language; what the catalogue does not know stays as it is.

    Args:
        text: English, as the product wrote it.
        language: one of :data:`~furrowmap.core.runtime.languages.catalogue.LANGUAGES`.
        code: of the error or warning; its own texts are looked for first.

    Raises:
        ValueError: if there is no such language.
    """
    return text if language == ENGLISH else _translated(text, language, code, DEEPEST)


@lru_cache(maxsize=4096)
def _translated(text: str, language: str, code: str, depth: int) -> str:
    whole = _whole(text, language, code, depth)
    if whole is not None or depth == 0:
        return whole or text
    sentences = _SENTENCE.split(text)
    if len(sentences) > 1:
        return _sentences(sentences, language, code, depth)
    for mark, other in _LIST:
        if mark in text:
            parts = text.split(mark)
            found = [_translated(part, language, "", depth - 1) for part in parts]
            if found != parts and not _left(parts, found):
                return other.join(found)
    head, colon, rest = text.partition(": ")
    if colon and _WORDS.search(rest):
        found = [_translated(part, language, "", depth - 1) for part in (head, rest)]
        if found[1] != rest:
            return "：".join(found)
    return text


def _begins_with_list(source: str, values: tuple[str, ...]) -> bool:
    """Whether the first hole of a template, at its beginning, took in more than one entry of a list."""
    return source.startswith(HOLE) and ", " in values[0]


def _listed(text: str, language: str, depth: int) -> str | None:
    """A list of which each entry has a translation of its own."""
    parts = text.split(", ")
    found = [_translated(part, language, "", depth - 1) for part in parts] if depth else parts
    return "、".join(found) if all(part != new for part, new in zip(parts, found, strict=True)) else None


def _left(parts: list[str], found: list[str]) -> bool:
    """Whether words of English are left in a list; half a translation is worse than none."""
    return any(part == same and _WORDS.search(part) for part, same in zip(parts, found, strict=True))


def _sentences(sentences: list[str], language: str, code: str, depth: int) -> str:
    """Sentence by sentence; the longest rows of sentences that the catalogue has as one text come first."""
    done, first = [], 0
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
    exact = known.of_code(code).get(text) or known.exact.get(text)
    if exact is not None:
        return exact
    for template in known.templates(code):
        values = template.values(text)
        if values is not None:
            listed = _listed(text, language, depth) if _begins_with_list(template.source, values) else None
            return listed or template.filled(
                _translated(value, language, "", depth - 1) if depth else value for value in values
            )
    return None
