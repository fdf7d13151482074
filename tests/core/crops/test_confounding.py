"""Confounded factors: degrees of freedom against ranks by numpy, tests against those of statsmodels."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from statsmodels.formula.api import ols
from statsmodels.stats.anova import anova_lm

from furrowmap.core.crops.trial_variance import TrialFactors, Variance, analysis_of_variance

DOSE = np.tile(["0", "60", "120", "180"], 6).tolist()
BLOCK = np.repeat(["1", "2", "3", "4", "5", "6"], 4).tolist()
VALUE = np.random.default_rng(7).normal(8.0, 1.0, 24)


def analysed(
    factors: dict[str, list[str]], block: list[str] | None = BLOCK, covariates: dict[str, np.ndarray] | None = None
) -> Variance:
    found = analysis_of_variance(VALUE, TrialFactors(factors, block, covariates or {}))
    assert found is not None
    return found


def freedom(found: Variance) -> dict[str, int]:
    return {row.source: row.freedom for row in found.rows}


def rank(*columns: list[str]) -> int:
    """Of a design with a constant and the levels of each column."""
    dummies = [np.ones((len(VALUE), 1)), *(pd.get_dummies(pd.Series(each)).to_numpy(float) for each in columns)]
    return int(np.linalg.matrix_rank(np.hstack(dummies)))


def test_a_factor_constant_within_blocks__is_confounded_with_them() -> None:
    variety = ["A" if block in "135" else "B" for block in BLOCK]
    found = analysed({"dose": DOSE, "variety": variety})
    assert [(each.term, each.others, each.is_partly) for each in found.confounded] == [("variety", ("block",), False)]
    without = analysed({"dose": DOSE})
    assert found.rows == without.rows
    assert found.means == without.means
    assert sum(freedom(found).values()) == len(VALUE) - 1


def test_a_factor_aliased_with_the_dose__has_no_test() -> None:
    product = ["none" if dose == "0" else f"product {dose}" for dose in DOSE]
    found = analysed({"dose": DOSE, "product": product})
    assert [(each.term, each.others) for each in found.confounded] == [("product", ("dose",))]
    assert freedom(found) == {"dose": 3, "block": 5, "residual": 15}
    assert {each.factor for each in found.means} == {"dose"}


def test_a_factor_of_which_a_part_can_be_told__is_tested_by_that() -> None:
    """Four doses in pairs: two factors take two of their three degrees of freedom."""
    one = ["a" if dose in ("0", "60") else "b" for dose in DOSE]
    two = ["a" if dose in ("0", "120") else "b" for dose in DOSE]
    found = analysed({"one": one, "two": two, "dose": DOSE}, block=None)
    partly, pair = found.confounded
    assert (partly.term, partly.others, partly.is_partly) == ("dose", ("one", "two"), True)
    assert (pair.term, pair.others, pair.is_partly) == ("one × two", ("dose",), False)
    assert rank(one, two) == 3
    assert rank(one, two, DOSE) == 4
    assert freedom(found)["residual"] == len(VALUE) - rank(one, two, DOSE)
    assert freedom(found)["dose"] == 1
    assert found.means == ()


def test_a_factor_that_two_others_span__is_confounded_with_both() -> None:
    """An effect of columns that is the sum of those of blocks and doses has nothing of its own."""
    half = ["1" if block in "123" else "2" for block in BLOCK]
    two = ["a" if dose in ("0", "60") else "b" for dose in DOSE]
    spanned = np.array([float(h) + 3.0 * (d == "a") for h, d in zip(half, two, strict=True)])
    found = analysed({"half": half, "two": two}, block=None, covariates={"x": spanned})
    assert [(each.term, each.others, each.is_partly) for each in found.confounded] == [("two", ("x", "half"), False)]
    assert sum(freedom(found).values()) == len(VALUE) - 1


def test_a_covariate_constant_within_blocks__is_confounded_with_them() -> None:
    soil = np.array([10.0 * int(block) ** 2 for block in BLOCK])
    found = analysed({"dose": DOSE}, covariates={"soil": soil})
    assert [(each.term, each.others) for each in found.confounded] == [("soil", ("block",))]
    assert sum(freedom(found).values()) == len(VALUE) - 1


def test_treatments_constant_within_blocks__leave_blocks_alone() -> None:
    found = analysed({"treatment": ["A" if block in "135" else "B" for block in BLOCK]})
    assert freedom(found) == {"block": 5, "residual": 18}
    assert found.means == ()


@pytest.mark.parametrize("seed", range(8))
def test_rows__are_those_of_statsmodels_where_the_design_has_full_rank(seed: int) -> None:
    rng = np.random.default_rng(seed)
    count = 60
    table = pd.DataFrame(
        {
            "value": rng.normal(5.0, 1.0, count),
            "one": rng.choice(["a", "b", "c"], count),
            "two": rng.choice(["u", "v"], count),
            "block": rng.choice(["1", "2", "3", "4"], count),
            "x": rng.normal(2000.0, 300.0, count),
        }
    )
    factors = {"one": table["one"].tolist(), "two": table["two"].tolist()}
    trial = TrialFactors(factors, table["block"].tolist(), {"x": table["x"].to_numpy()})
    found = analysis_of_variance(table["value"].to_numpy(), trial)
    assert found is not None
    formula = "value ~ C(one) + C(two) + C(one):C(two) + C(block) + x"
    expected = anova_lm(ols(formula, table).fit(), typ=2)
    names = {"C(one)": "one", "C(two)": "two", "C(block)": "block", "C(one):C(two)": "one × two", "x": "x"}
    rows = {row.source: row for row in found.rows}
    assert found.confounded == ()
    assert list(rows) == [*names.values(), "residual"]
    for source, name in names.items():
        assert rows[name].freedom == expected.loc[source, "df"]
        assert rows[name].sum_squares == pytest.approx(expected.loc[source, "sum_sq"])
        assert rows[name].f == pytest.approx(expected.loc[source, "F"])
        assert rows[name].p == pytest.approx(expected.loc[source, "PR(>F)"])
