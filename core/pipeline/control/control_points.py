"""Control points of a session: what is read, whether they lie where the drive goes, and what they showed."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Any, Final

import numpy as np
import pyproj
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from furrowmap.core.pipeline.control.seen_points import TargetPicture, Unseen
from furrowmap.core.pointclouds.survey_targets import GROUND_ALONE, NO_SIZES, Target, TargetSizes, targets_of
from furrowmap.core.readers.surveyed_points import SurveyedPoints, read_points
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import InputError, Notice

SURVEYED_SIGMA_M: Final = 0.01
"""Standard deviation of surveyed coordinates whose file states none."""
SIGHT_M: Final = 150.0
"""Points farther from the trajectory are not seen by the scanner."""
_CONTROL_ROLES: Final = frozenset(
    {"", "control", "gcp", "control point", "ground control", "3d gcp", "基準点", "標定点"}
)
_CHECK_ROLES: Final = frozenset({"check", "cp", "checkpoint", "check point", "検証点"})
"""Values of the column of roles, in any case."""


class PointState(StrEnum):
    """What a point did in the adjustment."""

    USED = "used"
    LEFT_OUT = "left-out"
    CONTRADICTS = "contradicts"
    NOT_OBSERVED = "not-observed"
    CHECK = "check"


@dataclass(frozen=True)
class GroundControl:
    """n surveyed points in the map frame.

    Attributes:
        is_check: (n,) those that judge the result and correct nothing.
        sigma_m: (n, 3) of the survey; SURVEYED_SIGMA_M where none is stated.
        target: what lies at each.
    """

    file: str
    name: tuple[str, ...]
    xyz_m: FloatArray
    sigma_m: FloatArray
    is_check: NDArray[np.bool_]
    target: tuple[Target, ...]
    notices: tuple[Notice, ...] = ()

    def __len__(self) -> int:
        return len(self.name)


@dataclass(frozen=True)
class ControlledPoint:
    """A point and what the corrected cloud has there.

    Attributes:
        before_m: (3,) cloud less survey without the correction; nan where not observed.
        residual_m: (3,) cloud less survey with it.
        sigma_m: (3,) standard deviation of the residual: of a point that is not used, of its prediction as well.
        normalised: (3,) residuals that data snooping tests, of variance 1.
        visits: in which its height was seen.
        picture: of a target and what lies round it; None of ground alone, or where nothing was seen.
    """

    name: str
    state: PointState
    surveyed_m: tuple[float, float, float]
    before_m: FloatArray
    residual_m: FloatArray
    sigma_m: FloatArray
    normalised: FloatArray
    visits: int = 0
    why_not: Unseen = Unseen.NOTHING
    target: Target = GROUND_ALONE
    picture: TargetPicture | None = None

    @property
    def worst(self) -> float:
        """The greatest normalised residual, without its sign; nan where nothing is observed."""
        known = np.abs(self.normalised[np.isfinite(self.normalised)])
        return float(known.max()) if len(known) else float("nan")


@dataclass(frozen=True)
class ControlResult:
    """What control points did to a run.

    Attributes:
        shift_m: (3,) mean of what was added to the positions; 0 along axes that nothing observes.
        sigma_m: (3,) its standard deviation after; nan along such axes.
        range_m: (3,) by how much it changes during the recording.
        axes: (3,) along which positions are corrected.
    """

    file: str
    points: tuple[ControlledPoint, ...]
    shift_m: FloatArray
    sigma_m: FloatArray
    range_m: FloatArray
    axes: NDArray[np.bool_]

    def count(self, state: PointState) -> int:
        """Points of a state."""
        return sum(point.state is state for point in self.points)

    def plain(self) -> dict[str, Any]:
        """For JSON; null where unknown."""
        return {
            "file": self.file,
            "control": sum(point.state is not PointState.CHECK for point in self.points),
            **{state.value.replace("-", "_"): self.count(state) for state in PointState},
            "corrected": [bool(axis) for axis in self.axes],
            "shift_m": _plain(self.shift_m, 4),
            "sigma_m": _plain(self.sigma_m, 4),
            "range_m": _plain(self.range_m, 4),
            "points": [
                {
                    "name": point.name,
                    "state": point.state.value,
                    "target": point.target.kind.value,
                    "why_not": point.why_not.value or None,
                    "visits": point.visits,
                    "before_m": _plain(point.before_m, 4),
                    "residual_m": _plain(point.residual_m, 4),
                    "sigma_m": _plain(point.sigma_m, 4),
                    "normalised": _plain(point.normalised, 2),
                }
                for point in self.points
            ],
        }


def _plain(values: FloatArray, digits: int) -> list[float | None]:
    return [round(value, digits) + 0.0 if np.isfinite(value) else None for value in values.tolist()]


def read_control(
    path: Path, crs: pyproj.CRS, sizes: TargetSizes = NO_SIZES, check_file: Path | None = None
) -> GroundControl:
    """The control points of a file, and its points that are only to check.

    Args:
        crs: of the map, with that of heights.
        sizes: of the targets on the points.
        check_file: of the session's check points; those of the same file have the role of each in a column.

    Raises:
        InputError: if the file cannot be read, states another role or target, or has no control point.
        RefusedError: if its heights are of another system, or PROJ has no exact transformation.
    """
    survey = read_points(path, crs)
    is_check = checks_among(path, survey)
    if check_file is not None and check_file == path and not survey.role:
        raise InputError("ground-control-both", path=path)
    if is_check.all():
        raise InputError("ground-control-none", path=path, count=len(survey))
    sigma = np.where(np.isfinite(survey.sigma_m), survey.sigma_m, SURVEYED_SIGMA_M)
    targets = targets_of(path, survey, sizes)
    return GroundControl(path.name, survey.name, survey.xyz_m, sigma, is_check, targets, survey.notices)


def checks_among(path: Path, survey: SurveyedPoints) -> NDArray[np.bool_]:
    """Which points (n,) of a file its column of roles keeps for checking; none without such a column.

    Raises:
        InputError: if a role is neither control nor check.
    """
    roles = [" ".join(role.casefold().replace("_", " ").replace("-", " ").split()) for role in survey.role]
    for name, role, known in zip(survey.name, survey.role, roles, strict=False):
        if known not in _CONTROL_ROLES | _CHECK_ROLES:
            raise InputError("ground-control-role", path=path, name=name, role=role)
    return np.array([role in _CHECK_ROLES for role in roles] or [False] * len(survey), np.bool_)


def expect_in_sight(control: GroundControl, track_m: FloatArray) -> None:
    """Refuse points of which none of control lies near a track (n, 3).

    Raises:
        InputError: likewise.
    """
    points = control.xyz_m[~control.is_check, :2]
    tree = cKDTree(track_m[np.isfinite(track_m).all(axis=1), :2])
    away_m: FloatArray = np.asarray(tree.query(points)[0], np.float64)
    if away_m.min() <= SIGHT_M:
        return
    swapped = int(np.count_nonzero(np.asarray(tree.query(points[:, ::-1])[0]) <= SIGHT_M))
    nearest = int(np.argmin(away_m))
    raise InputError(
        "ground-control-nowhere",
        file=control.file,
        count=len(points),
        nearest=[name for name, check in zip(control.name, control.is_check, strict=True) if not check][nearest],
        away_m=float(away_m.min()),
        swapped=swapped or None,
    )
