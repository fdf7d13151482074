"""Settings of the process."""

from __future__ import annotations

import os
import threading
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from furrowmap.core.runtime.background import in_threads, in_turn
from furrowmap.core.runtime.errors import UsageError
from furrowmap.core.runtime.settings import (
    THREADS_VARIABLE,
    Settings,
    available_processors,
    settings,
    threads,
    using,
    using_threads,
)


def test_threads__innermost_count_wins_then_the_environment_then_the_processors(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.delenv(THREADS_VARIABLE, raising=False)
    assert threads() == min(available_processors(), 8)
    monkeypatch.setenv(THREADS_VARIABLE, "3")
    assert threads() == 3
    with using_threads(5):
        assert threads() == 5
        with using_threads(6, by_default=True), using_threads(None):
            assert threads() == 5
        with using_threads(7):
            assert threads() == 7
    with using_threads(6, by_default=True):
        assert threads() == 6
    assert threads() == 3


@given(order=st.permutations(range(4)))
def test_using__ends_in_any_order_and_leaves_nothing_behind(order: list[int]) -> None:
    """Runs in several threads of a program end as they like; folders of those that ended are gone."""
    before = settings()
    folders = [Path(f"run_{k}") for k in range(4)]
    entered = [using(scratch_folder=folder) for folder in folders]
    for one in entered:
        one.__enter__()
    left = set(range(4))
    for k in order:
        entered[k].__exit__(None, None, None)
        left -= {k}
        assert settings().scratch_folder == (folders[max(left)] if left else before.scratch_folder)
    assert settings() == before == Settings()


def test_processors__are_those_of_the_process_where_the_system_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    there = sorted(os.sched_getaffinity(0))
    os.sched_setaffinity(0, there[:1])
    try:
        assert available_processors() == 1
    finally:
        os.sched_setaffinity(0, there)
    monkeypatch.delattr(os, "sched_getaffinity")
    assert available_processors() == os.cpu_count()
    monkeypatch.setattr(os, "cpu_count", lambda: None)
    assert available_processors() == 1


@pytest.mark.parametrize("stated", ["0", "-1", "many", "2.5"])
def test_threads__an_environment_that_states_no_count_is_refused(monkeypatch: pytest.MonkeyPatch, stated: str) -> None:
    monkeypatch.setenv(THREADS_VARIABLE, stated)
    with pytest.raises(UsageError, match=THREADS_VARIABLE):
        threads()


@given(items=st.lists(st.integers()), count=st.integers(1, 9))
def test_in_threads__gives_every_item_once_and_in_order(items: list[int], count: int) -> None:
    with using_threads(count):
        found = in_threads(list, items)
    assert [item for share in found for item in share] == items
    assert len(found) == min(count, len(items))


def test_in_threads__uses_as_many_threads_as_asked_for() -> None:
    together = threading.Barrier(3)

    def work(share: Sequence[int]) -> int:
        together.wait(timeout=20)
        return threading.get_ident()

    with using_threads(3):
        assert len(set(in_threads(work, range(3)))) == 3


def test_in_turn__gives_results_in_order_and_begins_few_ahead() -> None:
    begun = []

    def work(item: int) -> int:
        begun.append(item)
        return item * item

    with ThreadPoolExecutor(2) as pool:
        results = in_turn(pool, work, iter(range(7)), 2)
        assert next(results) == 0
        assert max(begun, default=0) <= 2
        assert list(results) == [k * k for k in range(1, 7)]
    assert sorted(begun) == list(range(7))
