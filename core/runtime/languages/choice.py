"""The language that the user chose for this process."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Final

from furrowmap.core.runtime.errors import UsageError
from furrowmap.core.runtime.languages.catalogue import ENGLISH, LANGUAGES

VARIABLE: Final = "FURROWMAP_LANG"
"""Variable of the environment with the language, for whom it is the same every day."""
_CHOSEN: ContextVar[str | None] = ContextVar("language", default=None)


@contextmanager
def using_language(language: str | None) -> Iterator[None]:
    """Within it, texts are in a language; None leaves it to the environment.

    Args:
        language: one of :data:`~furrowmap.core.runtime.languages.catalogue.LANGUAGES`.
    """
    token = _CHOSEN.set(language if language is not None else _CHOSEN.get())
    try:
        yield
    finally:
        _CHOSEN.reset(token)


def language_of_user(stated: str | None = None) -> str:
    """The language of :func:`using_language`; else the stated one; else that of the environment; else English.

    Args:
        stated: such as by a session.

    Raises:
        UsageError: if the environment names one that there is not.
    """
    language = _CHOSEN.get() or stated or os.environ.get(VARIABLE) or ENGLISH
    if language not in LANGUAGES:
        raise UsageError("usage.language-of-user", language=language, languages=", ".join(LANGUAGES))
    return language
