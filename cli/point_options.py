"""Which points are wanted: what the options of a box and of classes say."""

from __future__ import annotations

from typing import Final

from furrowmap.core.values.errors import UsageError

CLASSES: Final = frozenset(range(256))


def box_of(text: str | None) -> tuple[float, float, float, float] | None:
    """West, south, east, north of a box; None where none is given.

    Raises:
        UsageError: if they are not.
    """
    box = _numbers(text, "--bbox", 4)
    if box is None:
        return None
    west, south, east, north = box
    if not (west < east and south < north):
        raise _no_list("--bbox", text, "west, south, east, north, each side less than the one across from it")
    return west, south, east, north


def classes_of(text: str | None, option: str) -> frozenset[int] | None:
    """Classes of points; None where none are given.

    Raises:
        UsageError: if they are none.
    """
    numbers = _numbers(text, option)
    if numbers is None:
        return None
    if not CLASSES.issuperset(numbers):
        raise _no_list(option, text, "classes, whole numbers from 0 to 255,")
    return frozenset(int(number) for number in numbers)


def _numbers(text: str | None, option: str, count: int | None = None) -> list[float] | None:
    """The numbers of an option.

    Raises:
        UsageError: if they are none, or of another number.
    """
    if text is None:
        return None
    try:
        numbers = [float(part) for part in text.split(",")]
    except ValueError:
        numbers = []
    if not numbers or (count is not None and len(numbers) != count):
        raise _no_list(option, text, f"{count} numbers" if count is not None else "numbers")
    return numbers


def _no_list(option: str, text: str | None, wanted: str) -> UsageError:
    return UsageError(
        f"{option} {text!r}: that is not {wanted} with commas between them.",
        "Nothing was done.",
        "Such as --bbox 500000,5000000,500100,5000100, or --class 2,9.",
        code="usage",
    )
