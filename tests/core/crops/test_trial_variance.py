"""Analysis of variance of trials: textbook forms, letters, covariates, two-way tables, and whole trials."""

from __future__ import annotations

import sys

import numpy as np
import pytest
import shapely
from scipy import stats

from furrowmap.core.crops.trial import Trial, TrialPlan, analyse_trial
from furrowmap.core.crops.trial_tables import SITE
from furrowmap.core.crops.trial_variance import (
    TrialFactors,
    analysis_of_variance,
    comparison_letters,
    nested_probability,
)
from furrowmap.core.runtime.errors import InputError
from furrowmap.core.values.parcel import Attribute, Parcel

RATES = np.array([0.0, 50.0, 100.0, 150.0, 200.0, 250.0, 300.0])
DOSE = np.tile(RATES, 4)
BLOCK = np.repeat(np.arange(4), 7)
NAMES = [f"N{x:.0f}" for x in DOSE]
BLOCKS = [str(k) for k in BLOCK]


def heights(seed: int, sigma: float = 0.015) -> np.ndarray:
    curve = 0.34 + 0.24 * (1.0 - np.exp(-0.012 * DOSE))
    return curve + np.random.default_rng(seed).normal(0.0, sigma, len(DOSE))


def test_variance__of_a_complete_design_is_that_of_the_textbook() -> None:
    """Randomised complete blocks: sums of squares of the means, in closed form."""
    height = heights(9) + np.array([0.02, 0.0, -0.02, 0.0])[BLOCK]
    found = analysis_of_variance(height, TrialFactors({"treatment": NAMES}, BLOCKS))
    assert found is not None
    table = height.reshape(4, 7)
    mean = table.mean()
    treatment = 4 * ((table.mean(axis=0) - mean) ** 2).sum()
    block = 7 * ((table.mean(axis=1) - mean) ** 2).sum()
    rest = ((table - mean) ** 2).sum() - treatment - block
    rows = {row.source: row for row in found.rows}
    assert {name: row.freedom for name, row in rows.items()} == {"treatment": 6, "block": 3, "residual": 18}
    assert rows["treatment"].sum_squares == pytest.approx(treatment)
    assert rows["block"].sum_squares == pytest.approx(block)
    assert rows["treatment"].f == pytest.approx((treatment / 6) / (rest / 18))
    assert rows["residual"].f is None
    assert found.means[0].treatment == "N0"
    assert found.means[0].mean == pytest.approx(table[:, 0].mean())
    assert found.means[0].high - found.means[0].mean == pytest.approx(2.101 * np.sqrt(rest / 18 / 4), rel=1e-3)


def test_letters__tell_what_tukey_tells() -> None:
    """Pairs of equal numbers of parcels: the honest significant difference of a one-way layout, by scipy."""
    groups = [heights(3)[NAMES.index(name) :: 7] for name in NAMES[:7]]
    value = np.concatenate(groups)
    names = np.repeat(NAMES[:7], 4).tolist()
    found = analysis_of_variance(value, TrialFactors({"treatment": names}))
    assert found is not None
    p = stats.tukey_hsd(*groups).pvalue
    for k, one in enumerate(found.means):
        for j, other in enumerate(found.means):
            assert bool(set(one.letters) & set(other.letters)) == (k == j or p[k, j] > 0.05)
    best = max(found.means, key=lambda each: each.mean)
    assert "a" in best.letters


def test_letters__of_means_of_unequal_certainty_hold_for_every_pair() -> None:
    rng = np.random.default_rng(1)
    for _ in range(50):
        differs = np.triu(rng.random((6, 6)) < 0.5, 1)
        letters = comparison_letters(rng.normal(size=6), differs)
        for one in range(6):
            for other in range(one + 1, 6):
                assert bool(set(letters[one]) & set(letters[other])) != differs[one, other]


def test_two_factors__have_their_interaction_and_a_two_way_table() -> None:
    """A balanced two-way layout in closed form."""
    rng = np.random.default_rng(2)
    cells = rng.normal(5.0, 1.0, (3, 2))
    value = (cells[:, :, None] + rng.normal(0.0, 0.3, (3, 2, 4))).ravel()
    dose = np.repeat(["0", "60", "120"], 8).tolist()
    variety = np.tile(np.repeat(["A", "B"], 4), 3).tolist()
    found = analysis_of_variance(value, TrialFactors({"dose": dose, "variety": variety}))
    assert found is not None
    means = value.reshape(3, 2, 4).mean(axis=2)
    both = 4 * ((means - means.mean(axis=1, keepdims=True) - means.mean(axis=0) + means.mean()) ** 2).sum()
    rows = {row.source: row for row in found.rows}
    assert rows["dose × variety"].sum_squares == pytest.approx(both)
    assert rows["dose × variety"].freedom == 2
    assert [each.mean for each in found.cells] == pytest.approx(means.ravel())
    assert {(each.factors, each.parcels) for each in found.cells} == {("dose × variety", 4)}
    by_variety = [each.mean for each in found.means if each.factor == "variety"]
    assert by_variety == pytest.approx(means.mean(axis=0))


def test_a_covariate__adjusts_the_means() -> None:
    rng = np.random.default_rng(5)
    before = rng.normal(6.0, 1.0, 40)
    group = np.repeat(["A", "B"], 20)
    before[20:] += 2.0
    value = 1.0 + 0.5 * before + (group == "B") * 0.4 + rng.normal(0.0, 0.05, 40)
    found = analysis_of_variance(value, TrialFactors({"treatment": group.tolist()}, None, {"before": before}))
    assert found is not None
    first, second = found.means
    assert second.mean - first.mean == pytest.approx(0.4, abs=0.06)
    assert [row.source for row in found.rows] == ["treatment", "before", "residual"]


def test_variance__without_anything_left_over_is_none() -> None:
    assert analysis_of_variance(np.array([1.0, 2.0, 3.0]), TrialFactors({"treatment": ["a", "b", "c"]})) is None
    assert nested_probability(np.array([1.0, 2.0]), [["a", "b"]], ["a", "b"], ["", ""]) is None


def test_variance__needs_its_package(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "statsmodels.formula.api", None)
    with pytest.raises(InputError, match="package statsmodels is not installed") as refused:
        analysis_of_variance(heights(1), TrialFactors({"treatment": NAMES}))
    assert refused.value.code == "extra-missing"


def trial(value: np.ndarray, plan: TrialPlan, **columns: list[Attribute]) -> Trial:
    """Parcels with their dose, block and more."""
    nowhere = shapely.Polygon()
    parcels = [
        Parcel(
            str(k),
            nowhere,
            nowhere,
            BLOCKS[k % 28],
            {"n_kg_ha": float(DOSE[k % 28]), **{name: values[k] for name, values in columns.items()}},
        )
        for k in range(len(value))
    ]
    return analyse_trial(parcels, value, plan)


def test_a_factor_that_changes_the_response__is_told_and_read_alone() -> None:
    value = np.concatenate([heights(1), 0.34 + 0.5 * (heights(2) - 0.34)])
    start: list[Attribute] = ["no"] * 28 + ["JumpStart"] * 28
    found = trial(value, TrialPlan(factors=("Inoculant",)), inoculant=start)
    assert found.differs["Inoculant"] < 0.001
    assert "The response differs by Inoculant" in " ".join(map(str, found.sentences))
    assert [part.label for part in found.parts] == ["no", "JumpStart"]
    assert found.variance is not None
    assert "dose × Inoculant" in {row.source for row in found.variance.rows}
    same = trial(np.concatenate([heights(1), heights(2) + 0.05]), TrialPlan(factors=("inoculant",)), inoculant=start)
    assert same.differs["inoculant"] > 0.05
    assert same.response is not None
    assert same.response.models[0].sigma == pytest.approx(0.015, rel=0.3)


def test_split_doses__are_compared_at_equal_sums() -> None:
    late: list[Attribute] = [f"03-16: {x:g}" if k % 2 else f"04-20: {x:g}" for k, x in enumerate(np.tile(DOSE, 2))]
    value = np.concatenate([heights(1), heights(2)]) + 0.05 * (np.arange(56) % 2)
    found = trial(value, TrialPlan(), n_kg_ha_by_day=late)
    assert found.differs["split"] < 0.001
    assert "Equal sums of different single doses differ" in " ".join(map(str, found.sentences))
    none = trial(np.concatenate([heights(1), heights(2)]), TrialPlan(), n_kg_ha_by_day=late)
    assert none.differs["split"] > 0.05


def test_sites__are_read_together_and_alone() -> None:
    names: list[Attribute] = [f"site {k // 28}" for k in range(84)]
    alike = np.concatenate([heights(k) + 0.1 * k for k in range(3)])
    found = trial(alike, TrialPlan(blocks=True), **{SITE: names})
    assert found.differs[SITE] > 0.05
    assert [part.label for part in found.parts] == ["site 0", "site 1", "site 2"]
    assert found.response is not None
    assert len(found.response.blocks) == 12
    factor = np.repeat([0.3, 1.0, 2.0], 28)
    other = trial(0.34 + factor * (alike - 0.34), TrialPlan(blocks=True), **{SITE: names})
    assert other.differs[SITE] < 0.001
    assert other.response is not None
    assert other.response.models[0].freedom <= 21 - 3 - 2  # a mean of each dose at each site
    assert other.response.parcels == 84


def test_columns_that_are_not_there__are_refused() -> None:
    for plan in (TrialPlan(factors=("variety",)), TrialPlan(covariate="variety")):
        with pytest.raises(InputError, match="variety") as refused:
            trial(heights(1), plan)
        assert refused.value.code == "trial-column-unknown"
    with pytest.raises(InputError, match="No parcel has a number under 'kind'"):
        trial(heights(1), TrialPlan(covariate="kind"), kind=["a"] * 28)
