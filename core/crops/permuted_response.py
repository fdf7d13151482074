"""Whether a trial shows any response to its doses: permutations within blocks."""

from typing import Final

import numpy as np

from furrowmap.core.crops.response_models import MODELS
from furrowmap.core.runtime.arrays import FloatArray, IntArray

PERMUTATIONS: Final = 1999
"""The least probability is 1 in 2000."""
_AT_ONCE: Final = 250
_COARSE_NODES: Final[dict[int, int]] = {0: 1, 1: 24, 2: 12}
"""Nodes of each axis, by the number of parameters of a shape."""


def p_of_no_response(
    dose: FloatArray, value: FloatArray, block: IntArray, effects: FloatArray, trials: int = PERMUTATIONS
) -> float:
    """Probability of as good a curve of any shape where doses have no effect: values are permuted within blocks.

    The distribution of F does not hold here, since without an effect the parameters of a shape have no meaning (Davies
    1987, Biometrika 74:33-43); permutation does. Of values (n,) with effects (n, p) beside the dose the residuals are
    permuted (Freedman and Lane 1983, J. Bus. Econ. Stat. 1:292-298). The random numbers are the same every time.
    """
    rng = np.random.default_rng(20170523)
    scaled = (dose - dose.min()) / np.ptp(dose)
    unit = np.concatenate([model_curves(scaled, name) for name in MODELS])
    basis = np.linalg.qr(effects)[0]
    unit = unit - (unit @ basis) @ basis.T
    length = np.sqrt((unit**2).sum(axis=1))
    kept = length > 1e-9 * max(float(length.max()), 1e-300)
    unit = unit[kept] / length[kept, None]
    rest = value - basis @ (basis.T @ value)
    members = [np.flatnonzero(block == k) for k in np.unique(block)]
    explained = float(np.abs(unit @ rest).max(initial=0.0))
    as_good = 1
    for first in range(0, trials, _AT_ONCE):
        number = min(_AT_ONCE, trials - first)
        shuffled = np.zeros((len(rest), number))
        for rows in members:
            shuffled[rows] = rest[rows][np.argsort(rng.random((len(rows), number)), axis=0)]
        as_good += int((np.abs(unit @ shuffled).max(axis=0, initial=0.0) >= explained * (1.0 - 1e-9)).sum())
    return as_good / (trials + 1)


def model_curves(scaled: FloatArray, name: str) -> FloatArray:
    """Curves (k, n) of a shape at scaled doses (n,)."""
    model = next(each for each in MODELS.values() if each.name == name)
    axes = [np.linspace(low, high, _COARSE_NODES[model.parameters]) for low, high in model.box(np.unique(scaled))]
    mesh = np.meshgrid(*axes, indexing="ij")
    theta = np.column_stack([axis.ravel() for axis in mesh]) if axes else np.zeros((1, 0))
    return model.unit(theta, scaled)
