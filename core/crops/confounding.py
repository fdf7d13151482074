"""Which terms of a design add nothing to those before them, by ranks of its columns."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from furrowmap.core.runtime.arrays import FloatArray


@dataclass(frozen=True)
class Confounding:
    """A term whose effects cannot be told from those of others.

    Attributes:
        term: its name.
        others: the fewest terms before it that have the same columns.
        is_partly: whether some of its effects can be told apart.
    """

    term: str
    others: tuple[str, ...]
    is_partly: bool


def confounded_terms(terms: Mapping[str, FloatArray]) -> tuple[Confounding, ...]:
    """The terms, columns (n, k) without the constant, that add nothing or not all to those before them."""
    found: list[Confounding] = []
    kept: list[str] = []
    for name, columns in terms.items():
        own = _degrees([columns])
        gained = _degrees([*(terms[each] for each in kept), columns]) - _degrees([terms[each] for each in kept])
        if gained < own:
            found.append(Confounding(name, _fewest(terms, kept, name, gained), is_partly=gained > 0))
        if gained:
            kept.append(name)
    return tuple(found)


def factor_columns(levels: Sequence[str]) -> FloatArray:
    """Columns (n, k) that are one at each level but the first."""
    names = list(dict.fromkeys(levels))
    return np.array([[float(level == name) for name in names[1:]] for level in levels]).reshape(len(levels), -1)


def interaction_columns(one: FloatArray, other: FloatArray) -> FloatArray:
    """Products (n, k) of each column of one factor with each of another."""
    return np.asarray((one[:, :, None] * other[:, None, :]).reshape(len(one), -1))


def _fewest(terms: Mapping[str, FloatArray], kept: Sequence[str], name: str, gained: int) -> tuple[str, ...]:
    for size in range(1, len(kept)):
        for some in combinations(kept, size):
            columns = [terms[each] for each in some]
            if _degrees([*columns, terms[name]]) - _degrees(columns) == gained:
                return some
    return tuple(kept)


def _degrees(columns: Sequence[FloatArray]) -> int:
    """Rank of columns beside the constant."""
    if not columns:
        return 0
    whole = np.hstack(columns)
    whole = whole - whole.mean(axis=0)
    length = np.sqrt((whole**2).sum(axis=0))
    return int(np.linalg.matrix_rank(whole[:, length > 0.0] / length[length > 0.0])) if (length > 0.0).any() else 0
