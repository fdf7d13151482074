"""Settings of the process: threads, language, what a user allows of foreign files, and the folder of scratch files."""

import os
from collections import ChainMap
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Literal, get_args

from furrowmap.core.runtime.errors import UsageError
from furrowmap.core.runtime.languages.texts import ENGLISH, LANGUAGES, Text

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
        language: one of :data:`~furrowmap.core.runtime.languages.texts.LANGUAGES`.
        scratch_folder: of temporary files; by default the system's, which may be kept in memory.
    """

    threads: int | None = None
    allowed: frozenset[Allowance] = frozenset()
    language: str | None = None
    scratch_folder: Path | None = None


_changes: list[dict[str, Any]] = []
"""What each `using` in force states, the innermost last."""


def settings() -> Settings:
    """The settings in force."""
    return Settings(**ChainMap(*reversed(_changes)))


@contextmanager
def using(
    *,
    threads: int | None = None,
    allowed: frozenset[Allowance] | None = None,
    language: str | None = None,
    scratch_folder: Path | None = None,
) -> Iterator[None]:
    """Within it, settings are as stated; None changes nothing. Threads started within see them as well."""
    stated = {"threads": threads, "allowed": allowed, "language": language, "scratch_folder": scratch_folder}
    change = {name: value for name, value in stated.items() if value is not None}
    _changes.append(change)
    try:
        yield
    finally:
        # Several threads may end in any order: each takes back its own change.
        _changes[:] = [other for other in _changes if other is not change]


def using_threads(count: int | None, *, by_default: bool = False) -> AbstractContextManager[None]:
    """Within it, furrowmap uses at most `count` threads at once, at least 1; None changes nothing.

    The setting is the process's: threads started within see it as well. One by default gives way to a count in force,
    so that an option of the command line wins over a session.
    """
    return using(threads=None if by_default and settings().threads is not None else count)


def allowing(*what: Allowance) -> AbstractContextManager[None]:
    """Within it, what is named is allowed: "large" content of small files, "damaged" files without their damaged parts.

    The setting is the process's: threads started within see it as well.
    """
    return using(allowed=settings().allowed | {*what})


def threads() -> int:
    """Number of threads that a stage may use at once.

    The count in force; else that of the environment variable FURROWMAP_THREADS; else the processors that this process
    may use, 8 at most. UsageError if the environment variable is not an integer of at least 1.
    """
    count = settings().threads
    if count is not None:
        return count
    stated = os.environ.get(THREADS_VARIABLE)
    if not stated:
        return min(available_processors(), MAX_DEFAULT_THREADS)
    if not stated.isdecimal() or int(stated) < 1:
        wanted = Text("an integer of at least 1")
        raise UsageError("usage.environment", variable=THREADS_VARIABLE, value=stated, wanted=wanted)
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
        wanted = Text("{allowances:or}, or both separated by a comma", allowances=tuple(ALLOWANCES))
        value = os.environ[ALLOW_VARIABLE]
        raise UsageError("usage.environment", variable=ALLOW_VARIABLE, value=value, wanted=wanted)
    return what in stated | settings().allowed


def language_of_user(stated: str | None = None) -> str:
    """The language in force; else the stated one; else that of the environment variable FURROWMAP_LANG; else English.

    UsageError if the environment names one that there is not.
    """
    language = settings().language or stated or os.environ.get(LANGUAGE_VARIABLE) or ENGLISH
    if language not in LANGUAGES:
        wanted = Text("one of {choices:or}", choices=LANGUAGES)
        raise UsageError("usage.environment", variable=LANGUAGE_VARIABLE, value=language, wanted=wanted)
    return language
