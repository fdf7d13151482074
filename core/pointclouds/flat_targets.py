"""Flat targets on the ground, discs and checkerboards, by the brightness of the returns around a point."""

from typing import Final, Literal

from furrowmap.core.pointclouds.checkerboards import find_checkerboard
from furrowmap.core.pointclouds.disc_targets import find_disc
from furrowmap.core.runtime.arrays import FloatArray

TargetShape = Literal["disc", "checkerboard"]

SEARCH_DIAMETERS: Final = 3.0
"""Search radius of a target, in its diameters or sides."""


def find_target(
    shape: TargetShape, xy_m: FloatArray, brightness: FloatArray, size_m: float, search_m: float
) -> FloatArray | None:
    """The middle (2,) of a target; None where none is found. Arguments as of the functions of each shape."""
    if shape == "disc":
        return find_disc(xy_m, brightness, size_m, search_m)
    board = find_checkerboard(xy_m, brightness, size_m, search_m)
    return board.middle_m if board is not None else None
