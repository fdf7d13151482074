"""The share of steps that are known ahead."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from furrowmap.core.runtime.progress import Step, WholeShare

STEPS = (
    Step("reading", 1.0),
    Step("matching", 3.0),
    Step("cloud", 4.0, beside=True),
    Step("surfaces", 2.0, beside=True),
)


def test_whole__is_what_is_done_by_the_usual_time_of_the_steps() -> None:
    whole = WholeShare(STEPS)
    assert whole.take("reading", 0.5) == pytest.approx(0.05)
    assert whole.take("matching", 0.0) == pytest.approx(0.1)
    assert whole.take("surfaces", 0.5) == pytest.approx(0.5)
    assert whole.take("cloud", 0.25) == pytest.approx(0.6)
    assert whole.take("of another program", 0.9) == pytest.approx(0.6)
    assert whole.take("surfaces", 1.0) == pytest.approx(0.7)
    assert whole.take("cloud", 1.0) == pytest.approx(1.0)


@given(
    st.lists(st.tuples(st.sampled_from([*(step.name for step in STEPS), "another"]), st.floats(0.0, 1.5)), min_size=1)
)
def test_whole__never_falls_and_is_never_more_than_all(told: list[tuple[str, float]]) -> None:
    whole = WholeShare(STEPS)
    shares = [whole.take(stage, share) for stage, share in told]
    assert shares == sorted(shares)
    assert 0.0 <= shares[0] <= shares[-1] <= 1.0
