"""Errors with three parts and an exit status, and notices."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Final, Self

CONTRADICTION: Final = "contradiction"
"""Code of the notice that stands before all others."""


class FurrowmapError(Exception):
    """An error that a user can act on, in three parts.

    Args:
        what: what is wrong and where (file, byte, line, time or key).
        meaning: what that means for the requested work.
        remedy: what to do about it.
        code: a stable kebab-case name, the same in terminal, JSON and QGIS.
    """

    exit_status: ClassVar[int] = 1

    def __init__(self, what: str, meaning: str, remedy: str, *, code: str = "failed") -> None:
        super().__init__(what, meaning, remedy)
        self.what = what
        self.meaning = meaning
        self.remedy = remedy
        self.code = code

    @property
    def lines(self) -> tuple[str, str, str]:
        """The three parts as they are printed, without line breaks and control characters."""
        return printable(self.what), printable(self.meaning), printable(self.remedy)

    def __str__(self) -> str:
        return "\n".join(self.lines)


class UsageError(FurrowmapError):
    """An argument or option is invalid."""

    exit_status = 2


class InputError(FurrowmapError):
    """A file or its content is invalid."""

    exit_status = 3


class RefusedError(FurrowmapError):
    """The work is possible, but its result would be wrong or misleading."""

    exit_status = 4


class Cancelled(FurrowmapError):
    """The user cancelled the command."""

    exit_status = 130

    def __init__(self) -> None:
        super().__init__(
            "Cancelled.",
            "No incomplete files remain; the products of an earlier run are unchanged.",
            "Run the same command again to get the result.",
            code="cancelled",
        )


@dataclass(frozen=True)
class Notice:
    """A warning about an input or a result that does not stop the work.

    Attributes:
        code: a stable kebab-case name.
        text: one or two sentences with the figures.
    """

    code: str
    text: str

    @classmethod
    def of(cls, error: FurrowmapError) -> Self:
        """A notice with the complete text of an error that does not stop the work."""
        return cls(error.code, " ".join(error.lines))


def printable(text: str) -> str:
    """`text` on one line, with control characters (terminal escapes too) shown as escapes."""
    flat = " ".join(text.split())
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode("ascii") for c in flat)
