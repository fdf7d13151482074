"""Options of several commands that choose points and parcels, and the parsing of their values."""

from __future__ import annotations

import math
from typing import Final

import click

from furrowmap.cli.options import FILE
from furrowmap.core.runtime.errors import UsageError

CLASSES: Final = frozenset(range(256))

bbox_option = click.option("--bbox", metavar="W,S,E,N", help="Keep points in this box, in the CRS of the output.")
bbox_crs_option = click.option("--bbox-crs", metavar="CRS", help="CRS of --bbox, if it differs.")
within_option = click.option(
    "--within", type=FILE, metavar="POLYGONS", help="Keep points in these polygons: a vector file, or a CSV of corners."
)
classes_option = click.option(
    "--class",
    "classes",
    metavar="N,N",
    help="Keep points of these classes [default: all but noise and, in furrowmap's own clouds, the machine].",
)
every_option = click.option("--every", type=click.IntRange(1), default=1, metavar="N", help="Keep every N-th point.")
crs_option = click.option("--crs", metavar="CRS", help="CRS of input files without one.")
dst_crs_option = click.option(
    "--dst-crs", metavar="CRS", help="CRS of the output, in metres [default: that of the input]."
)
net_inset_option = click.option(
    "--net-inset",
    metavar="ENDS,SIDES",
    help="Width in metres of the strip between gross and net parcel off each end, and off each side [default: none].",
)
net_option = click.option(
    "--net", type=FILE, metavar="FILE", help="Net parcels with the same identifiers, instead of an inset."
)


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


def widths_of(text: str | None, option: str) -> tuple[float, float]:
    """Two widths in metres given by an option; zeros without one.

    Raises:
        UsageError: if the text is not two numbers, or one is below zero.
    """
    widths = _numbers(text, option, 2) or [0.0, 0.0]
    if not all(0.0 <= width < math.inf for width in widths):
        raise _no_list(option, text, "two widths in metres")
    return widths[0], widths[1]


def _numbers(text: str | None, option: str, count: int | None = None) -> list[float] | None:
    """The numbers given by an option."""
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
    return UsageError("usage.no-list", option=option, text=text, wanted=wanted)
