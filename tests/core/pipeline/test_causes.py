"""Causes of warnings: each stands before what follows from it."""

from __future__ import annotations

from graphlib import TopologicalSorter
from typing import Final

import pytest
from hypothesis import given
from hypothesis import strategies as st

from furrowmap.core.pipeline.causes import AT_TOP, CONTRADICTING_CODES, FOLLOWS, by_cause, cause_of, findings
from furrowmap.core.runtime.errors import Notice
from furrowmap.core.runtime.languages.texts import ENGLISH, templates

KEYS: Final = sorted(templates(ENGLISH))


def notice(key: str) -> Notice:
    return Notice.from_values(key, {})


def test_table__names_keys_and_codes_that_there_are() -> None:
    known = {*KEYS, *(key.partition(".")[0] for key in KEYS)}
    named = {*AT_TOP, *CONTRADICTING_CODES, *FOLLOWS, *(name for names in FOLLOWS.values() for name in names)}
    assert named <= known


def test_table__has_no_circle() -> None:
    """Codes stand for all their keys."""
    graph: dict[str, set[str]] = {}
    for cause, names in FOLLOWS.items():
        for above in (key for key in KEYS if cause in (key, key.partition(".")[0])):
            for below in (key for key in KEYS if not {key, key.partition(".")[0]}.isdisjoint(names)):
                graph.setdefault(below, set()).add(above)
    list(TopologicalSorter(graph).static_order())


@given(st.lists(st.sampled_from(KEYS), unique=True, max_size=12))
def test_findings__hold_each_warning_once_and_causes_first(chosen: list[str]) -> None:
    notices = [notice(key) for key in chosen]
    found = findings(notices)
    assert sorted(one.key for one in by_cause(notices)) == sorted(chosen)
    for finding in found:
        assert cause_of(finding.notice, notices) is None
        assert all(cause_of(one, notices) is finding.notice for one in finding.follows)


@pytest.mark.parametrize("key", ["mounting-identity", "mounting-identity.and-antenna"])
def test_findings__of_a_session_that_was_not_filled_in_are_one(key: str) -> None:
    """Its yaw was assumed, ground and wheels disagree, the implement is not where it would be."""
    seen = [
        "contradiction.scans-and-positions",
        "mounting-off",
        "mounting-height",
        key,
        "antenna-unknown",
        "lever-assumed",
        "implement-no-ground",
        "machine-not-known",
        "clock-recorder",
    ]
    first, other = findings([notice(one) for one in seen])
    assert first.notice.key == key
    assert {one.key for one in first.follows} == {*seen} - {key, "clock-recorder"}
    assert other.notice.key == "clock-recorder"


def test_findings__of_other_causes_stay_apart() -> None:
    """A boundary elsewhere has nothing to do with the clock; the contradiction is acted on first."""
    seen = ["boundary-apart", "gnss-quality", "contradiction.positions-late"]
    assert [one.notice.key for one in findings([notice(key) for key in seen])] == [
        "contradiction.positions-late",
        "boundary-apart",
        "gnss-quality",
    ]


def test_findings__of_one_tool_explain_nothing_of_another() -> None:
    height = notice("mounting-height").about("harrow")
    lost = notice("machine-not-known").about("roller")
    assert len(findings([height, lost])) == 2
    assert len(findings([notice("mounting-height"), lost])) == 1
