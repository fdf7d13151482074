"""Treatments in another order than parcels: heights of equal treatments that differ, and agree in that order.

Identifiers that were counted from the other end of a trial, a list that begins a row too late, and rows that were
numbered to and fro exchange treatments. Parcels of equal treatment then have different crops. In the order that was
meant they are alike, which no other order makes them by chance.
"""

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.runtime.arrays import FloatArray

MIN_FREEDOM: Final = 6
"""Parcels beyond the number of treatments."""
MIN_RATIO: Final = 3.0
"""By how much more crops of equal treatment differ as stated."""
MIN_EXPLAINED: Final = 0.8
"""Share of the variance that treatments explain in the order that is meant."""

REVERSED: Final = "reversed"
REVERSED_IN_BLOCKS: Final = "reversed-in-blocks"
LATER: Final = "later"
EARLIER: Final = "earlier"


def mistaken_order(treatment: Sequence[object], height_m: FloatArray, block: Sequence[object]) -> str | None:
    """The order in which parcels of equal treatment are alike, as those of the stated order are not; None for none.

    Args:
        treatment: of n parcels in the order of their identifiers; NaN or None where unknown.
        height_m: (n,) of their crops, nan where unknown.
        block: of each parcel.
    """
    n = len(height_m)
    number = np.arange(n)
    of_block = np.unique([str(one) for one in block], return_inverse=True)[1]
    orders = {
        REVERSED: number[::-1],
        REVERSED_IN_BLOCKS: _reversed_in_blocks(of_block),
        LATER: np.roll(number, -1),
        EARLIER: np.roll(number, 1),
    }
    names = np.array([str(one) for one in treatment])
    stated, _ = _differences(names, height_m)
    best: tuple[float, str] | None = None
    for name, order in orders.items():
        left, explained = _differences(names[order], height_m)
        if explained > MIN_EXPLAINED and stated > MIN_RATIO * left and (best is None or left < best[0]):
            best = left, name
    return best[1] if best is not None else None


def _reversed_in_blocks(of_block: NDArray[np.intp]) -> NDArray[np.intp]:
    order = np.arange(len(of_block))
    for block in np.unique(of_block):
        own = np.flatnonzero(of_block == block)
        order[own] = own[::-1]
    return order


def _differences(treatment: NDArray[np.str_], height_m: FloatArray) -> tuple[float, float]:
    """Standard deviation of heights (n,) within treatments (n,), and the share of the variance that these explain."""
    known = np.isfinite(height_m) & ~np.isin(treatment, ("nan", "None"))
    names, index = np.unique(treatment[known], return_inverse=True)
    freedom = int(known.sum()) - len(names)
    if freedom < MIN_FREEDOM or len(names) < 2:
        return 0.0, 0.0
    own = height_m[known]
    mean = np.bincount(index, own) / np.bincount(index)
    squares = float(((own - mean[index]) ** 2).sum())
    whole = float(((own - own.mean()) ** 2).sum())
    return float(np.sqrt(squares / freedom)), 1.0 - squares / max(whole, 1e-12)
