"""Treatments in another order are found by crops that differ; the right order is not doubted."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from furrowmap.core.crops.treatment_order import EARLIER, LATER, REVERSED, REVERSED_IN_BLOCKS, mistaken_order

DOSES = np.array([250, 0, 50, 100, 300, 150, 200, 100, 50, 300, 100, 0, 200, 250, 150, 150, 50, 0, 200, 250])
BLOCKS = np.repeat([1, 2, 3, 4], 5)


def heights(dose: np.ndarray, sigma_m: float = 0.015) -> np.ndarray:
    rise = 0.24 / (1.0 + np.exp(-0.028 * (dose - 85.0)))
    return np.asarray(0.34 + rise + np.random.default_rng(1).normal(0.0, sigma_m, len(dose)))


@pytest.mark.parametrize(
    ("order", "named"),
    [
        (np.arange(20), None),
        (np.arange(20)[::-1], REVERSED),
        (np.arange(20).reshape(4, 5)[:, ::-1].ravel(), REVERSED_IN_BLOCKS),
        (np.roll(np.arange(20), -1), LATER),
        (np.roll(np.arange(20), 1), EARLIER),
    ],
)
def test_order_that_is_meant__is_named(order: np.ndarray, named: str | None) -> None:
    # The crop of parcel k had the dose that the table gives to another one.
    assert mistaken_order(DOSES.tolist(), heights(DOSES[order]), BLOCKS.tolist()) == named


@pytest.mark.parametrize("sigma_m", [0.1, 1.0])
def test_crops_that_hardly_respond__name_none(sigma_m: float) -> None:
    assert mistaken_order(DOSES.tolist(), heights(DOSES, sigma_m), BLOCKS.tolist()) is None


def test_few_parcels__name_none() -> None:
    few = slice(0, 10)
    assert mistaken_order(DOSES[few].tolist(), heights(DOSES[few])[::-1], BLOCKS[few].tolist()) is None


@given(st.lists(st.tuples(st.integers(0, 4), st.floats(0.0, 2.0)), min_size=1, max_size=40))
def test_heights_that_follow_treatments_exactly__are_never_doubted(rows: list[tuple[int, float]]) -> None:
    treatment = [name for name, _ in rows]
    level = np.array([0.1, 0.3, 0.35, 0.8, 0.9])[treatment]
    assert mistaken_order(treatment, level, [1] * len(rows)) is None
