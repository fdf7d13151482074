"""Settings of the process: threads, language, what a user allows of foreign files, and the folder of scratch files."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final, Literal, get_args

from furrowmap.core.runtime.errors import UsageError
from furrowmap.core.runtime.languages.catalogue import ENGLISH, LANGUAGES

Allowance = Literal["large", "damaged"]
ALLOWANCES: Final[tuple[Allowance, ...]] = get_args(Allowance)
THREADS_VARIABLE: Final = "FURROWMAP_THREADS"
LANGUAGE_VARIABLE: Final = "FURROWMAP_LANG"
ALLOW_VARIABLE: Final = "FURROWMAP_ALLOW"
MAX_DEFAULT_THREADS: Final = 8
"""More threads gain little and take more memory, because each has its own surfaces."""


@dataclass(frozen=True)
class Settings:
    """What is set for the process; None leaves it to the environment.

    Attributes:
        allowed: "large" content of small files, "damaged" files without their damaged parts.
        language: one of :data:`~furrowmap.core.runtime.languages.catalogue.LANGUAGES`.
        scratch_folder: of temporary files; by default the system's, which may be kept in memory.
    """

    threads: int | None = None
    allowed: frozenset[Allowance] = frozenset()
    language: str | None = None
    scratch_folder: Path | None = None


_in_force = Settings()


def settings() -> Settings:
    """The settings in force."""
    return _in_force


@contextmanager
def using(
    *,
    threads: int | None = None,
    allowed: frozenset[Allowance] | None = None,
    language: str | None = None,
    scratch_folder: Path | None = None,
) -> Iterator[None]:
    """Within it, settings are as stated; None changes nothing. Threads started within see them as well."""
    global _in_force
    before = _in_force
    changes: dict[str, Any] = {
        "threads": threads,
        "allowed": allowed,
        "language": language,
        "scratch_folder": scratch_folder,
    }
    _in_force = replace(before, **{name: value for name, value in changes.items() if value is not None})
    try:
        yield
    finally:
        _in_force = before


def using_threads(count: int | None, *, by_default: bool = False) -> AbstractContextManager[None]:
    """Within it, furrowmap uses at most `count` threads at once.

    The setting is the process's: threads started within see it as well.

    Args:
        count: at least 1; None changes nothing.
        by_default: a count that is in force already wins, so that an option of the command line wins over a session.
    """
    return using(threads=None if by_default and _in_force.threads is not None else count)


def allowing(*what: Allowance) -> AbstractContextManager[None]:
    """Within it, what is named is allowed: "large" content of small files, "damaged" files without their damaged parts.

    The setting is the process's: threads started within see it as well.
    """
    return using(allowed=_in_force.allowed | {*what})


def threads() -> int:
    """Number of threads that a stage may use at once.

    The count in force; else that of the environment variable FURROWMAP_THREADS; else the processors that this process
    may use, 8 at most.

    Raises:
        UsageError: if the environment variable is not an integer of at least 1.
    """
    if _in_force.threads is not None:
        return _in_force.threads
    stated = os.environ.get(THREADS_VARIABLE)
    if not stated:
        return min(available_processors(), MAX_DEFAULT_THREADS)
    if not stated.isdecimal() or int(stated) < 1:
        raise UsageError("usage.threads", stated=stated)
    return int(stated)


def available_processors() -> int:
    """Processors that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def allows(what: Allowance) -> bool:
    """Whether the user allows large content ("large") or the undamaged parts of damaged files ("damaged").

    By the settings in force, or by the environment variable FURROWMAP_ALLOW, words separated by commas; others raise
    UsageError.
    """
    stated = {word.strip() for word in os.environ.get(ALLOW_VARIABLE, "").split(",")} - {""}
    if not stated <= set(ALLOWANCES):
        raise UsageError("usage.allows", environ=os.environ[ALLOW_VARIABLE], all=" or ".join(ALLOWANCES))
    return what in stated | _in_force.allowed


def language_of_user(stated: str | None = None) -> str:
    """The language in force; else the stated one; else that of the environment variable FURROWMAP_LANG; else English.

    Raises:
        UsageError: if the environment names one that there is not.
    """
    language = _in_force.language or stated or os.environ.get(LANGUAGE_VARIABLE) or ENGLISH
    if language not in LANGUAGES:
        raise UsageError("usage.language-of-user", language=language, languages=", ".join(LANGUAGES))
    return language
