"""The error of a trajectory that control points show: least-squares collocation, and data snooping of the points.

The error is that of the frame and that of the positions. The frame is moved, by the coordinates of the base station,
the height of the antenna or the geoid, and turned by small angles about a point on the ground: scans that see their own
ground again do not show that. The error of the positions is, on each axis, a process of zero mean as large as they
state; part of it lasts, and the rest is a first-order Gauss-Markov process. With the covariance C of what the
observations y see of all this and R of their own errors, the estimate of a quantity with covariances c is ``cᵀ S⁻¹ y``
with ``S = C + R``, and what it leaves of a variance c₀ is ``c₀ − cᵀ S⁻¹ c`` (Moritz 1980, Advanced Physical Geodesy,
equations 14-27 and 14-35). It is the adjustment of the observations together with frame and process at every time,
after elimination of the latter.

An error of a point shows in all its observations along a component alike, with coefficients b. Its normalised residual
is ``bᵀ S⁻¹ y / √(bᵀ S⁻¹ b)``, of variance 1 without it (Baarda 1968, A testing procedure for use in geodetic networks,
section 7); half its square is by how much the error raises the logarithm of the likelihood.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from furrowmap.core.runtime import arrays
from furrowmap.core.runtime.arrays import FloatArray, IntArray
from furrowmap.core.values.gnss import DRIFT_CORRELATION_S

CRITICAL_RESIDUAL: Final = 3.29
"""Normalised residual beyond which a point is in error: one right point in a thousand is (Baarda's α₀ = 0.1 %)."""
FRAME_SIGMA_M: Final = 0.10
"""Standard deviation before of a move of the frame: base stations, antenna heights and geoid models."""
CLEAR_DIFFERENCE: Final = 4.0
"""Of the squares of normalised residuals: that one point is in error is e² = 7 times likelier than another."""
MIN_AGREEING: Final = 3
"""Points of which one in error can be told from the others."""
UP: Final = 2
PLAN: Final = (0, 1)


@dataclass(frozen=True)
class ControlObservations:
    """m observations of the error at points; each holds at several epochs, of e in all.

    Attributes:
        point: (m,) number of the point.
        component: (m,) 0 for easting, 1 for northing, 2 for height of the point.
        direction: (m, 3) how much of an error along each axis an observation sees.
        place_m: (m, 3) of the point.
        off_m: (m,) what has to be added to the cloud there: surveyed less seen.
        sigma_m: (m,) standard deviation of what is seen, by itself.
        survey_sigma_m: (m,) of what was surveyed, which all observations of a component of a point share.
        share: (m, e) weights of the epochs, of sum 1.
        t_s: (e,) UTC of the epochs.
        gnss_sigma_m: (e, 3) standard deviations that the positions state there.
    """

    point: IntArray
    component: IntArray
    direction: FloatArray
    place_m: FloatArray
    off_m: FloatArray
    sigma_m: FloatArray
    survey_sigma_m: FloatArray
    share: FloatArray
    t_s: FloatArray
    gnss_sigma_m: FloatArray

    def __len__(self) -> int:
        return len(self.point)

    def where(self, chosen: NDArray[np.bool_]) -> ControlObservations:
        """Some of the observations."""
        of_all = ("t_s", "gnss_sigma_m")
        return replace(self, **{name: value[chosen] for name, value in vars(self).items() if name not in of_all})

    @property
    def own_covariance(self) -> FloatArray:
        """(m, m) R: errors of each observation, and of the survey, which those of a component of a point share."""
        same = (self.point[:, None] == self.point) & (self.component[:, None] == self.component)
        out: FloatArray = same * np.outer(self.survey_sigma_m, self.survey_sigma_m)
        out[np.diag_indices(len(self))] += self.sigma_m**2
        return out


@dataclass(frozen=True)
class ErrorModel:
    """What is known before of the error.

    Attributes:
        pivot_m: (3,) about which the frame turns, on the ground.
        move_sigma_m: (3,) of the move of the frame.
        turn_sigma_rad: (3,) of its turns about the axes to the east, to the north and upwards.
        drift_share: share of the variance of the positions that changes with time, the rest lasts.
        correlation_s: over which it changes.
    """

    pivot_m: FloatArray
    move_sigma_m: FloatArray
    turn_sigma_rad: FloatArray
    drift_share: float
    correlation_s: float = DRIFT_CORRELATION_S

    @property
    def common_sigma_deg(self) -> tuple[float, float]:
        """Standard deviations of tilt (mean of both axes) and heading that all poses share."""
        lasting = np.degrees(self.turn_sigma_rad) * np.sqrt(1.0 - self.drift_share)
        return float(np.sqrt(np.mean(lasting[:UP] ** 2))), float(lasting[UP])

    def position_covariance(
        self, t_s: FloatArray, sigma_m: FloatArray, other_s: FloatArray, other_sigma_m: FloatArray
    ) -> FloatArray:
        """(n, k) covariance of positions along an axis between times (n,) and (k,), where they state deviations."""
        kept = np.exp(-np.abs(t_s[:, None] - other_s) / self.correlation_s)
        out: FloatArray = np.outer(sigma_m, other_sigma_m) * (1.0 - self.drift_share + self.drift_share * kept)
        return out

    def turned(self, direction: FloatArray, place_m: FloatArray) -> FloatArray:
        """(n, 3) derivatives by the turns of what directions (n, 3) see of the frame at places (n, 3)."""
        return np.asarray(np.cross(place_m - self.pivot_m, direction), np.float64)


@dataclass(frozen=True)
class FrameError:
    """The error of a trajectory by the observations that are used."""

    observed: ControlObservations
    model: ErrorModel

    @cached_property
    def _turned(self) -> FloatArray:
        """(m, 3) derivatives of the observations by the turns."""
        return self.model.turned(self.observed.direction, self.observed.place_m)

    @cached_property
    def _factor(self) -> tuple[FloatArray, bool]:
        """Cholesky factor of S."""
        seen = self.observed
        model = self.model
        whole = seen.own_covariance
        whole = whole + (self._turned * model.turn_sigma_rad**2) @ self._turned.T
        whole = whole + (seen.direction * model.move_sigma_m**2) @ seen.direction.T
        for axis in range(3):
            sigma = seen.gnss_sigma_m[:, axis]
            weighted = seen.direction[:, axis, None] * seen.share
            whole = whole + weighted @ model.position_covariance(seen.t_s, sigma, seen.t_s, sigma) @ weighted.T
        factor: tuple[FloatArray, bool] = scipy.linalg.cho_factor(whole, lower=True)
        return factor

    def _solve(self, right: FloatArray) -> FloatArray:
        """S⁻¹ of a vector (m,) or of several (m, k)."""
        solved: FloatArray = scipy.linalg.cho_solve(self._factor, right)
        return solved

    @property
    def axes(self) -> NDArray[np.bool_]:
        """(3,) along which the error is estimated: those whose component is observed."""
        return np.isin(np.arange(3), self.observed.component)

    @property
    def turns(self) -> NDArray[np.bool_]:
        """(3,) about which axes a turn is estimated: by heights a tilt, by places a heading."""
        level = UP in self.observed.component
        return np.array([level, level, bool(np.isin(PLAN, self.observed.component).any())])

    @cached_property
    def turn_rad(self) -> tuple[FloatArray, FloatArray]:
        """(3,) by which the frame has to be turned about the axes, and the variances after; as before where unseen."""
        seen = self._turned.T * (self.model.turn_sigma_rad**2)[:, None]
        turn = np.where(self.turns, seen @ self._solve(self.observed.off_m), 0.0)
        after = self.model.turn_sigma_rad**2 - np.einsum("ij,ji->i", seen, self._solve(seen.T))
        return turn, np.where(self.turns, np.maximum(after, 0.0), self.model.turn_sigma_rad**2)

    def at(self, t_s: FloatArray, place_m: FloatArray, gnss_sigma_m: FloatArray) -> tuple[FloatArray, FloatArray]:
        """What has to be added at places at times (n,), and its variance after, (n, 3) each.

        Along axes that nothing observes it is zero, and the variance that of the positions.

        Args:
            place_m: (n, 3) in the map frame.
            gnss_sigma_m: (n, 3) that the positions state.
        """
        shift = np.zeros((len(t_s), 3))
        variance = gnss_sigma_m**2
        solved = self._solve(self.observed.off_m)
        for axis in np.flatnonzero(self.axes).tolist():
            for part in arrays.parts(len(t_s), max(1, arrays.ROWS_AT_ONCE // (1 + len(self.observed)))):
                seen, before = self._seen(axis, t_s[part], place_m[part], gnss_sigma_m[part, axis])
                shift[part, axis] = seen @ solved
                variance[part, axis] = before - np.einsum("ij,ji->i", seen, self._solve(seen.T))
        return shift, np.maximum(variance, 0.0)

    def _seen(
        self, axis: int, t_s: FloatArray, place_m: FloatArray, sigma_m: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """(n, m) covariance of the error along an axis with what the observations see, and its variance (n,) before."""
        seen = self.observed
        model = self.model
        direction = np.broadcast_to(np.eye(3)[axis], place_m.shape)
        turned = model.turned(direction, place_m) * model.turn_sigma_rad
        epochs = model.position_covariance(t_s, sigma_m, seen.t_s, seen.gnss_sigma_m[:, axis])
        moved = model.move_sigma_m[axis] ** 2
        out = epochs @ (seen.direction[:, axis, None] * seen.share).T + moved * seen.direction[:, axis]
        out = out + turned @ (self._turned * model.turn_sigma_rad).T
        return out, moved + sigma_m**2 + np.sum(turned**2, axis=1)

    def normalised(self) -> dict[tuple[int, int], float]:
        """Normalised residual of surveyed less seen, by point and component."""
        seen = self.observed
        pairs = sorted(set(zip(seen.point.tolist(), seen.component.tolist(), strict=True)))
        columns = np.array([(seen.point == point) & (seen.component == part) for point, part in pairs], np.float64).T
        solved = self._solve(columns)
        residuals = (solved.T @ seen.off_m) / np.sqrt(np.einsum("ij,ij->j", columns, solved))
        return dict(zip(pairs, residuals.tolist(), strict=True))

    def doubted(self) -> tuple[int, ...]:
        """The point that is likeliest in error; further ones if these may be it as well; none if no point is."""
        worst = dict[int, float]()
        for (point, _), value in self.normalised().items():
            worst[point] = max(worst.get(point, 0.0), value**2)
        most = max(worst.values())
        if most <= CRITICAL_RESIDUAL**2:
            return ()
        return tuple(sorted(point for point, square in worst.items() if square > most - CLEAR_DIFFERENCE))


@dataclass(frozen=True)
class Snooped:
    """The error of positions without the points that are in error.

    Attributes:
        error: None where no point is left, or most contradict each other.
        left_out: numbers of the points that the others contradict, the worst first.
        unclear: those of them one of which is in error, and it cannot be told which.
        contradicting: all points, where most contradict each other.
        residual: normalised residual of each point left out when it was, by point and component.
    """

    error: FrameError | None
    left_out: tuple[int, ...]
    unclear: tuple[int, ...]
    contradicting: tuple[int, ...]
    residual: dict[tuple[int, int], float]


def snooped(observed: ControlObservations, model: ErrorModel) -> Snooped:
    """The error by observations of one point at least: one point in error after the other is left out.

    Where one of several is in error, and it cannot be told which, all of these are. More points left out than used
    contradict each other: nothing is estimated. Points that agree on a larger move than
    is usual are believed: with what they find as its standard deviation it is hardly drawn towards zero.
    """
    left_out: list[int] = []
    unclear: list[int] = []
    residual: dict[tuple[int, int], float] = {}
    used = observed
    points = set(observed.point.tolist())
    while len(used):
        error = FrameError(used, replace(model, move_sigma_m=_move_sigma_m(used, model.move_sigma_m)))
        worst = error.doubted()
        if not worst:
            break
        found = error.normalised()
        residual |= {key: value for key, value in found.items() if key[0] in worst}
        left_out += worst
        unclear += worst if len(worst) > 1 else ()
        used = used.where(~np.isin(used.point, worst))
    if not len(used) or len(left_out) > len(points) - len(left_out):
        return Snooped(None, (), (), tuple(sorted(points)), residual)
    return Snooped(error, tuple(left_out), tuple(unclear), (), residual)


def _move_sigma_m(observed: ControlObservations, usual_m: FloatArray) -> FloatArray:
    """(3,) standard deviations before of the move of the frame; a single point cannot be told from one in error."""
    out = usual_m.copy()
    if len(np.unique(observed.point)) < MIN_AGREEING:
        return out
    for axis in range(3):
        off_m = observed.off_m[observed.component == axis]
        if len(off_m):
            out[axis] = max(usual_m[axis], abs(float(np.median(off_m))))
    return out
