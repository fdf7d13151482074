"""Errors with three parts and an exit status, and notices."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Final, Self

from furrowmap.core.runtime.languages.messages import ERROR_PARTS, plain_values, printed, sentences
from furrowmap.core.runtime.languages.templates import holes_of, parts_of
from furrowmap.core.runtime.languages.texts import ENGLISH, LANGUAGES, Text, Value, Words, filled, templates

CONTRADICTION: Final = "contradiction"
CHECK_POINTS_OFF: Final = "check-points-off"
"""Code of the notice that stands before all others."""
SETTING_REMEDIES: Final = {
    "imu-no-overlap": ("imu", "minus_gnss_s", "offset_s", "cause"),
    "imu-turned": ("imu", "rpy_deg", "right", "right"),
    "imu-turned.likely-forward": ("imu", "rpy_deg", "right", "right"),
    "imu-turned.likely-upright": ("imu", "rpy_deg", "right", "right"),
    "no-common-time.no-overlap": ("recording", "lidar_minus_gnss_s", "offset_s", "cause"),
    "no-common-time.expect-common-time": ("implement", "states_minus_gnss_s", "ahead_s", "likely"),
}
"""Messages whose remedy is one line of the session file: its table and key, the name of its value, and that of the
value without which there is no such remedy."""


class FurrowmapError(Exception):
    """An error that a user can act on: what is wrong and where, what that means for the work, and what to do about it.

    Args:
        key: of its sentences, see :mod:`~furrowmap.core.runtime.languages.messages`. The part before a dot is the
            code, the same in terminal, JSON and QGIS.
        values: for the holes of the sentences.

    Raises:
        KeyError: if the key is unknown, or the values are not those of its sentences.
    """

    exit_status: ClassVar[int] = 1

    def __init__(self, key: str, /, **values: object) -> None:
        self.key = key
        self.values = plain_values(key, values)
        super().__init__(key, self.values)

    def __reduce__(self) -> tuple[object, ...]:
        return _restored_error, (type(self), self.key, self.values)

    @property
    def code(self) -> str:
        """A stable kebab-case name."""
        return self.key.partition(".")[0]

    @property
    def lines(self) -> tuple[str, str, str]:
        """The three parts as they are printed, without line breaks and control characters."""
        return self.lines_in(ENGLISH)

    def lines_in(self, language: str) -> tuple[str, str, str]:
        """The three parts in a language."""
        what, meaning, remedy = (_sentence(language, self.key, part, self.values) for part in ERROR_PARTS)
        return what, meaning, remedy

    def words(self, part: str) -> Text:
        """A part, such as "what", as a value of another message."""
        template = templates(ENGLISH)[self.key][part]
        names = holes_of([parts_of(template)])
        return Text(template, **{name: value for name, value in self.values.items() if name in names})

    @property
    def setting(self) -> dict[str, Any] | None:
        """The table, key and value of the session file that remedy it; None for another remedy."""
        table, name, value, reason = SETTING_REMEDIES.get(self.key, ("", "", "", ""))
        if not self.values.get(reason):
            return None
        return {"table": table, "key": name, "value": json.loads(str(printed(self.key, self.values)[value]))}

    @property
    def what(self) -> str:
        """What is wrong, and where: file, byte, line, time or key."""
        return self.lines[0]

    @property
    def meaning(self) -> str:
        """What that means for the requested work."""
        return self.lines[1]

    @property
    def remedy(self) -> str:
        """What to do about it."""
        return self.lines[2]

    def __str__(self) -> str:
        return "\n".join(self.lines)


def _restored_error(kind: type[FurrowmapError], key: str, values: dict[str, Value]) -> FurrowmapError:
    """An error of another process, whose catalogue may have had keys of other packages."""
    error = kind.__new__(kind, key, values)
    error.key = key
    error.values = values
    return error


class UsageError(FurrowmapError):
    """An argument or option is invalid."""

    exit_status = 2


class OptionError(UsageError):
    """The value of an option is not what it takes.

    Args:
        option: its name, such as "--day".
        value: as it was given.
        wanted: what it takes.
        example: of such a value.
    """

    def __init__(self, option: str, value: object, wanted: Text, example: str) -> None:
        super().__init__("usage.option", option=option, text=value, wanted=wanted, example=f"{option} {example}")


class InputError(FurrowmapError):
    """A file or its content is invalid."""

    exit_status = 3


class MissingExtraError(InputError):
    """A package that only some uses need is not installed.

    Args:
        package: the names by which it is installed.
        extra: that has it, as in `pip install ".[extra]"`.
        needed_for: a sentence that says what for.
        otherwise: what to do without it.
        error: of its import.
    """

    def __init__(
        self, package: Words, extra: str, needed_for: Text, *, otherwise: Text | None = None, error: object = None
    ) -> None:
        super().__init__(
            "extra-missing", package=package, extra=extra, needed_for=needed_for, otherwise=otherwise, error=error
        )


class RefusedError(FurrowmapError):
    """The work is possible, but its result would be wrong or misleading."""

    exit_status = 4


class Cancelled(FurrowmapError):
    """The user cancelled the command."""

    exit_status = 130

    def __init__(self) -> None:
        super().__init__("cancelled")


@dataclass(frozen=True, init=False)
class Notice:
    """A warning about an input or a result that does not stop the work; KeyError as for an error."""

    key: str
    values: tuple[tuple[str, Value], ...]
    subject: str = ""

    def __init__(self, key: str, /, **values: object) -> None:
        object.__setattr__(self, "key", key)
        object.__setattr__(self, "values", tuple(plain_values(key, values).items()))

    def about(self, subject: str) -> "Notice":
        """The notice with a subject before its text, such as one of several tools."""
        notice = Notice.from_values(self.key, dict(self.values))
        object.__setattr__(notice, "subject", subject)
        return notice

    @classmethod
    def from_error(cls, error: FurrowmapError) -> Self:
        """A notice with the complete text of an error that does not stop the work."""
        return cls.from_values(error.key, error.values)

    @classmethod
    def from_values(cls, key: str, values: Mapping[str, Value]) -> Self:
        """A notice with the values of another one."""
        notice = cls.__new__(cls)
        object.__setattr__(notice, "key", key)
        object.__setattr__(notice, "values", tuple(values.items()))
        return notice

    @property
    def code(self) -> str:
        """A stable kebab-case name."""
        return self.key.partition(".")[0]

    @property
    def text(self) -> str:
        """One or two sentences with the figures."""
        return self.text_in(ENGLISH)

    @property
    def texts(self) -> dict[str, str]:
        """The text for JSON, by its key: `text` in English, and in every other language, such as `text_ja`."""
        return {"text": self.text, **{f"text_{language}": self.text_in(language) for language in LANGUAGES[1:]}}

    def text_in(self, language: str) -> str:
        """The text in a language."""
        parts = sentences(ENGLISH, self.key)
        of_error = ERROR_PARTS if "text" not in parts else ("text",)
        between = " " if language == ENGLISH else ""
        text = between.join(_sentence(language, self.key, part, dict(self.values)) for part in of_error)
        colon = ": " if language == ENGLISH else "："
        return f"{self.subject}{colon}{text}" if self.subject else text


def _sentence(language: str, key: str, part: str, values: Mapping[str, Value]) -> str:
    """A part of a message in a language; texts in its values are translated too."""
    return printable(filled(sentences(language, key)[part], printed(key, values, language), language))


def printable(text: str) -> str:
    """`text` on one line, with control characters (terminal escapes too) shown as escapes."""
    flat = " ".join(text.split())
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode("ascii") for c in flat)
