"""What lies at surveyed points that the scanner can find: the ground alone, a disc, a checkerboard, a corner."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.pointclouds.flat_targets import SEARCH_DIAMETERS
from furrowmap.core.pointclouds.local_plane import PLANE_RADIUS_M
from furrowmap.core.pointclouds.plane_corners import CORNER_REACH_M
from furrowmap.core.readers.surveyed_points import SurveyedPoints
from furrowmap.core.runtime.errors import InputError


class TargetKind(StrEnum):
    """What a point is."""

    GROUND = "ground"
    DISC = "disc"
    CHECKERBOARD = "checkerboard"
    CORNER = "corner"


_KINDS: Final = {
    "": None,
    "ground": TargetKind.GROUND,
    "none": TargetKind.GROUND,
    "disc": TargetKind.DISC,
    "disk": TargetKind.DISC,
    "checkerboard": TargetKind.CHECKERBOARD,
    "chessboard": TargetKind.CHECKERBOARD,
    "corner": TargetKind.CORNER,
}
"""Values of the column of targets, in any case; None for what the session or the command states."""


@dataclass(frozen=True)
class TargetSizes:
    """Diameter of discs and side of checkerboards, as they are stated; None for kinds without one."""

    disc_m: float | None = None
    checkerboard_m: float | None = None


@dataclass(frozen=True)
class Target:
    """A kind of target and its size, 0 where it has none."""

    kind: TargetKind = TargetKind.GROUND
    size_m: float = 0.0

    @property
    def search_m(self) -> float:
        """Distance from the survey within which its middle lies."""
        return SEARCH_DIAMETERS * self.size_m

    @property
    def reach_m(self) -> float:
        """Distance from the survey of the returns that show it."""
        if self.kind is TargetKind.CORNER:
            return CORNER_REACH_M
        return max(self.search_m + self.size_m, PLANE_RADIUS_M)


GROUND_ALONE: Final = Target()
NO_SIZES: Final = TargetSizes()


def targets_of(path: Path, survey: SurveyedPoints, sizes: TargetSizes) -> tuple[Target, ...]:
    """The target of each point of a file: as its column `target` says, else the one whose size the session states.

    Raises:
        InputError: if a target is not known, or the session does not state its size.
    """
    usual: TargetKind | None = TargetKind.GROUND
    if sizes.disc_m is not None and sizes.checkerboard_m is not None:
        usual = None
    elif sizes.disc_m is not None:
        usual = TargetKind.DISC
    elif sizes.checkerboard_m is not None:
        usual = TargetKind.CHECKERBOARD
    size_m = {TargetKind.DISC: sizes.disc_m, TargetKind.CHECKERBOARD: sizes.checkerboard_m}
    out = []
    for name, stated in zip(survey.name, stated_kinds(path, survey), strict=True):
        kind = stated or usual
        if kind is None:
            raise InputError("ground-control-target.either", path=path, name=name)
        size = size_m.get(kind, 0.0)
        if size is None:
            raise InputError("ground-control-target.size", path=path, name=name, is_disc=kind is TargetKind.DISC)
        out.append(Target(kind, size))
    return tuple(out)


def stated_kinds(path: Path, survey: SurveyedPoints) -> tuple[TargetKind | None, ...]:
    """What the column `target` of a file says of each point; None where it says nothing.

    Raises:
        InputError: if a target is not known.
    """
    for name, word in zip(survey.name, survey.target, strict=False):
        if word.strip().casefold() not in _KINDS:
            raise InputError("ground-control-target", path=path, name=name, target=word)
    return tuple(_KINDS[word.strip().casefold()] for word in survey.target or [""] * len(survey))


def corners_among(survey: SurveyedPoints) -> NDArray[np.bool_]:
    """Which points (n,) the column `target` calls corners of planes, whatever it says of the others."""
    kinds = [_KINDS.get(word.strip().casefold()) for word in survey.target or [""] * len(survey)]
    return np.array([kind is TargetKind.CORNER for kind in kinds], np.bool_)
