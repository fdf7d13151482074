"""All dates of a field at once: the moves that fit the ties between them, by least squares, and what they leave."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_solve
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from furrowmap.core.coregistration.pair_tie import LEVEL_TERMS, MOVE_NAMES, PairTie
from furrowmap.core.crops.bare_soil import SoilCells, least_squares, plane_design
from furrowmap.core.runtime.arrays import FloatArray

MOVE_SIZE: Final = len(MOVE_NAMES)
MAX_PLACES: Final = 300
"""Cells that the error of a mean change is interpolated at."""
TENSION_LIMIT: Final = 3.0
"""Ties that depart from the moves by more of their standard deviations lose weight (Huber)."""


@dataclass(frozen=True)
class Network:
    """The moves of n dates.

    Attributes:
        moves: (n, 6) what moves each surface, in the order of :data:`MOVE_NAMES`.
        covariance: (6 n, 6 n) of all of them.
        group: (n,) dates of one number are tied to each other.
        tension: by pair, what a tie departs from the moves over what its sigmas let expect (RMS; 1 where they hold).
    """

    moves: FloatArray
    covariance: FloatArray
    group: NDArray[np.intp]
    tension: Mapping[tuple[int, int], float]

    def between(self, one: int, other: int) -> tuple[FloatArray, FloatArray]:
        """The move of one date less that of another (6,), and its covariance (6, 6)."""
        a = slice(MOVE_SIZE * one, MOVE_SIZE * (one + 1))
        b = slice(MOVE_SIZE * other, MOVE_SIZE * (other + 1))
        c = self.covariance
        return self.moves[other] - self.moves[one], c[a, a] + c[b, b] - c[a, b] - c[b, a]


def adjust_network(ties: Mapping[tuple[int, int], PairTie], prior: FloatArray) -> Network:
    """Adjust the moves of all dates.

    Ties between k dates of the same ground are k (k − 1) / 2, but each date's errors are in k − 1 of them: as if the
    heights of k dates had been fitted to one unknown ground, each tie counts 2 / k. Ties that contradict the others
    count less (Huber).

    Args:
        ties: by pair of dates, the earlier one first.
        prior: (n, 6) standard deviations of the moves without any tie: those of the receivers, or of a reference.
    """
    n = len(prior)
    shares = {pair: 2.0 / _sharing(pair, ties, n) for pair in ties}
    weights = dict.fromkeys(ties, 1.0)
    for _ in range(5):
        normal = np.diag(1.0 / prior.ravel() ** 2)
        right = np.zeros(MOVE_SIZE * n)
        for (one, other), tie in ties.items():
            a = slice(MOVE_SIZE * one, MOVE_SIZE * (one + 1))
            b = slice(MOVE_SIZE * other, MOVE_SIZE * (other + 1))
            information = tie.information * shares[one, other] * weights[one, other]
            normal[a, a] += information
            normal[b, b] += information
            normal[a, b] -= information
            normal[b, a] -= information
            right[b] += information @ tie.move
            right[a] -= information @ tie.move
        scale = np.sqrt(np.diag(normal))
        covariance = np.linalg.inv(normal / np.outer(scale, scale)) / np.outer(scale, scale)
        moves = (covariance @ right).reshape(n, MOVE_SIZE)
        tension = {}
        for (one, other), tie in ties.items():
            off = tie.move - (moves[other] - moves[one])
            freedom = max(int(np.linalg.matrix_rank(tie.information, hermitian=True)), 1)
            tension[one, other] = math.sqrt(max(float(off @ tie.information @ off), 0.0) / freedom)
        weights = {pair: TENSION_LIMIT / max(value, TENSION_LIMIT) for pair, value in tension.items()}
    first, second = (np.array([pair[k] for pair in ties], np.intp) for k in (0, 1))
    _, group = connected_components(coo_matrix((np.ones(len(ties)), (first, second)), (n, n)), directed=False)
    return Network(moves, covariance, np.asarray(group, np.intp), tension)


def _sharing(pair: tuple[int, int], ties: Mapping[tuple[int, int], PairTie], n: int) -> int:
    """How many dates are tied with both of a pair, these included."""
    return 2 + sum(all((min(a, k), max(a, k)) in ties for a in pair) for k in range(n) if k not in pair)


def interpolate_left_error(
    xy_m: FloatArray, middle_m: FloatArray, move: FloatArray, covariance: FloatArray, tie: PairTie | None
) -> tuple[float, float]:
    """What is left of the error of a mean change when the moves are applied, and its standard deviation.

    The differences of untouched ground depart from the moves; under the changed ground, departures are interpolated
    from those around it (universal kriging of the mean of a block: Cressie 1993, section 3.4).

    Args:
        xy_m: (n, 2) places of the cells whose mean is taken.
        middle_m: (2,) of the field.
        move: (6,) of the second date less that of the first.
        covariance: (6, 6) of it.
        tie: of the two dates; None where they are tied by others only.

    Returns:
        The mean error to subtract, and the standard deviation of what remains, both in m.
    """
    places = xy_m[:: max(1, len(xy_m) // MAX_PLACES)]
    design = plane_design(places, middle_m)
    mean = design.mean(axis=0)
    variance = float(mean @ covariance[np.ix_(LEVEL_TERMS, LEVEL_TERMS)] @ mean)
    if tie is None:
        return 0.0, math.sqrt(variance)
    at_cells = plane_design(tie.departures.xy_m, middle_m)
    moved = at_cells @ (move[LEVEL_TERMS] - tie.move[LEVEL_TERMS])
    cells = SoilCells(tie.departures.xy_m, tie.departures.height_m + moved, tie.departures.sigma_m)
    plane, of_plane, factor = least_squares(cells, tie.departure, at_cells)
    near = tie.departure.between(places, cells.xy_m).mean(axis=0)
    seen = cho_solve(factor, near)
    lacking = mean - at_cells.T @ seen
    variance = float(tie.departure.between(places, places).mean() - near @ seen + lacking @ of_plane @ lacking)
    return float(mean @ plane + seen @ (cells.height_m - at_cells @ plane)), math.sqrt(max(variance, 0.0))
