"""All dates of a field at once: the moves that fit the ties between them, by least squares."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from furrowmap.core.dates.pair_tie import NAMES, PairTie
from furrowmap.core.estimation.robust import huber_weight

FloatArray = NDArray[np.float64]

SIZE: Final = len(NAMES)
ROUNDS: Final = 5


@dataclass(frozen=True)
class Network:
    """The moves of n dates.

    Attributes:
        moves: (n, 6) what moves each surface, in the order of :data:`NAMES`.
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
        a, b = slice(SIZE * one, SIZE * (one + 1)), slice(SIZE * other, SIZE * (other + 1))
        c = self.covariance
        return self.moves[other] - self.moves[one], c[a, a] + c[b, b] - c[a, b] - c[b, a]


def network(ties: Mapping[tuple[int, int], PairTie], prior: FloatArray) -> Network:
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
    for _ in range(ROUNDS):
        normal, right = np.diag(1.0 / prior.ravel() ** 2), np.zeros(SIZE * n)
        for (one, other), tie in ties.items():
            a, b = slice(SIZE * one, SIZE * (one + 1)), slice(SIZE * other, SIZE * (other + 1))
            information = tie.information * shares[one, other] * weights[one, other]
            normal[a, a] += information
            normal[b, b] += information
            normal[a, b] -= information
            normal[b, a] -= information
            right[b] += information @ tie.move
            right[a] -= information @ tie.move
        scale = np.sqrt(np.diag(normal))
        covariance = np.linalg.inv(normal / np.outer(scale, scale)) / np.outer(scale, scale)
        moves = (covariance @ right).reshape(n, SIZE)
        tension = {pair: _tension(tie, moves[pair[1]] - moves[pair[0]]) for pair, tie in ties.items()}
        weights = {pair: float(huber_weight(np.array([value]))[0]) for pair, value in tension.items()}
    return Network(moves, covariance, _groups(ties, n), tension)


def _sharing(pair: tuple[int, int], ties: Mapping[tuple[int, int], PairTie], n: int) -> int:
    """How many dates are tied with both of a pair, these included."""
    one, other = pair
    return 2 + sum(
        (min(one, k), max(one, k)) in ties and (min(other, k), max(other, k)) in ties for k in range(n) if k not in pair
    )


def _tension(tie: PairTie, move: FloatArray) -> float:
    off = tie.move - move
    freedom = max(int(np.linalg.matrix_rank(tie.information, hermitian=True)), 1)
    return math.sqrt(max(float(off @ tie.information @ off), 0.0) / freedom)


def _groups(ties: Mapping[tuple[int, int], PairTie], n: int) -> NDArray[np.intp]:
    one, other = (np.array([pair[k] for pair in ties], np.intp) for k in (0, 1))
    _, group = connected_components(coo_matrix((np.ones(len(ties)), (one, other)), (n, n)), directed=False)
    return np.asarray(group, np.intp)
