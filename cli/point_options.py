"""Parsing of --bbox and of lists of classes."""

from __future__ import annotations

from typing import Final

from furrowmap.core.values.errors import UsageError

CLASSES: Final = frozenset(range(256))


def box_of(text: str | None) -> tuple[float, float, float, float] | None:
    """West, south, east, north of --bbox; None without it.

    Raises:
        UsageError: if the text is not four numbers in that order.
    """
    box = _numbers(text, "--bbox", 4)
    if box is None:
        return None
    west, south, east, north = box
    if not (west < east and south < north):
        raise _no_list("--bbox", text, "W,S,E,N with W < E and S < N")
    return west, south, east, north


def classes_of(text: str | None, option: str) -> frozenset[int] | None:
    """Point classes given by an option; None without one.

    Raises:
        UsageError: if the text is not a list of classes.
    """
    numbers = _numbers(text, option)
    if numbers is None:
        return None
    if not CLASSES.issuperset(numbers):
        raise _no_list(option, text, "a list of classes from 0 to 255 separated by commas")
    return frozenset(int(number) for number in numbers)


def _numbers(text: str | None, option: str, count: int | None = None) -> list[float] | None:
    """The numbers given by an option.

    Raises:
        UsageError: if the text is not a list of numbers, or not of `count` numbers.
    """
    if text is None:
        return None
    try:
        numbers = [float(part) for part in text.split(",")]
    except ValueError:
        numbers = []
    if not numbers or (count is not None and len(numbers) != count):
        raise _no_list(
            option,
            text,
            f"a list of {count} numbers separated by commas"
            if count is not None
            else "a list of numbers separated by commas",
        )
    return numbers


def _no_list(option: str, text: str | None, wanted: str) -> UsageError:
    return UsageError(
        f"{option} {text!r} is not {wanted}.",
        "Nothing was done.",
        "Examples: --bbox 500000,5000000,500100,5000100, --class 2,9.",
        code="usage",
    )
