"""The one family of errors: three sentences and an exit status."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self


class FurrowmapError(Exception):
    """Something a user can act on, told in three sentences.

    Args:
        what: what is wrong and where (file, byte, line, time or key).
        meaning: what that means for the work asked for.
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
        """The three lines as they are printed: no line breaks, no control characters."""
        return printable(self.what), printable(self.meaning), printable(self.remedy)

    def __str__(self) -> str:
        return "\n".join(self.lines)


class UsageError(FurrowmapError):
    """The command was called wrongly."""

    exit_status = 2


class InputError(FurrowmapError):
    """A file, or what stands in it, is at fault."""

    exit_status = 3


class RefusedError(FurrowmapError):
    """The work could be done, but its result would not be what it claims to be."""

    exit_status = 4


class Cancelled(FurrowmapError):
    """The user stopped the work."""

    exit_status = 130

    def __init__(self) -> None:
        super().__init__(
            "Stopped before the end.",
            "Nothing half-written is left; products of an earlier run are as they were.",
            "Run the same command again when you want the result.",
            code="cancelled",
        )


@dataclass(frozen=True)
class Notice:
    """Something worth knowing about an input or a result that did not stop the work.

    Attributes:
        code: a stable kebab-case name.
        text: one or two sentences with the figures.
    """

    code: str
    text: str

    @classmethod
    def of(cls, error: FurrowmapError) -> Self:
        """An error that does not stop the work at hand, told whole."""
        return cls(error.code, " ".join(error.lines))


def printable(text: str) -> str:
    """`text` on one line, with control characters (terminal escapes too) shown instead of obeyed."""
    flat = " ".join(text.split())
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode("ascii") for c in flat)
