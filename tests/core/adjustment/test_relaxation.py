"""Steps that come out too short, and what becomes of them."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from furrowmap.core.adjustment.knots import KNOT_STEP_S, Chain, Knots
from furrowmap.core.adjustment.relaxation import GROUND_ARM_M, MAX_LENGTHENED_M, MAX_STEP_FACTOR, Relaxation

COUNT = 600
KNOTS = Knots((Chain(0, COUNT, 0.0),), np.arange(COUNT, dtype=np.float64) * KNOT_STEP_S)


def steps_needed(share: float, *, lengthened: bool) -> int:
    """How many steps, each `share` of what is wrong, until a hundredth of it is left in the second half of the time.

    Headings are wrong by nine degrees there, about twice as much as a step is lengthened to.
    """
    wrong = np.zeros((COUNT, 9))
    wrong[COUNT // 2 :, 5] = 0.15
    relaxation = Relaxation()
    for number in range(1, 400):
        step = -share * wrong
        wrong = wrong + (relaxation.lengthened(step, KNOTS) if lengthened else step)
        if np.abs(wrong).max() < 0.0015:
            return number
    return 400


@pytest.mark.parametrize("share", [0.03, 0.1, 0.3, 0.7, 1.0])
def test_short_steps_reach_their_end_sooner(share: float) -> None:
    assert steps_needed(share, lengthened=True) <= max(4, 0.35 * steps_needed(share, lengthened=False))


@settings(max_examples=20)
@given(st.integers(0, 2**32 - 1))
def test_steps_without_a_direction_hardly_grow(seed: int) -> None:
    random = np.random.default_rng(seed)
    relaxation = Relaxation()
    for _ in range(3):
        step = random.normal(0.0, 0.001, (COUNT, 9))
        taken = relaxation.lengthened(step, KNOTS)
        assert np.linalg.norm(taken) < 1.2 * np.linalg.norm(step)


@settings(max_examples=20)
@given(st.integers(0, 2**32 - 1), st.floats(1e-9, 10.0))
def test_a_step_is_never_turned_nor_shortened(seed: int, size: float) -> None:
    random = np.random.default_rng(seed)
    relaxation = Relaxation()
    for _ in range(3):
        step = size * random.normal(0.0, 1.0, (COUNT, 9))
        taken = relaxation.lengthened(step, KNOTS)
        factor = taken / step
        np.testing.assert_allclose(factor, factor[:, :1] * np.ones(9), rtol=1e-9)
        assert factor.min() >= 1.0 - 1e-12
        assert factor.max() <= MAX_STEP_FACTOR + 1e-9
        weighed = np.column_stack([step[:, :2], GROUND_ARM_M * step[:, 5]])
        far = np.linalg.norm(weighed * factor[:, :1], axis=1)
        assert (far <= np.maximum(np.linalg.norm(weighed, axis=1), MAX_LENGTHENED_M) + 1e-9).all()
