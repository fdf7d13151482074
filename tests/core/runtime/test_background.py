"""Items made ahead come in order, with their errors, and leave no thread behind."""

from __future__ import annotations

import threading
from collections.abc import Iterator

import pytest

from furrowmap.core.runtime.background import ahead, behind, beside
from furrowmap.core.runtime.errors import Cancelled
from furrowmap.core.runtime.progress import Progress
from furrowmap.core.runtime.settings import using_threads


def threads() -> set[str]:
    return {thread.name for thread in threading.enumerate() if thread.is_alive()}


def test_all_items_in_their_order() -> None:
    assert list(ahead(iter(range(1000)), 4)) == list(range(1000))
    assert "ahead" not in threads()


def test_an_error_comes_where_it_arose() -> None:
    def failing() -> Iterator[int]:
        yield 1
        yield 2
        raise OSError("disk")

    items = ahead(failing(), 8)
    assert [next(items), next(items)] == [1, 2]
    with pytest.raises(OSError, match="disk"):
        next(items)


def test_stopping_early_ends_the_thread() -> None:
    made: list[int] = []

    def endless() -> Iterator[int]:
        k = 0
        while True:
            made.append(k)
            yield k
            k += 1

    items = ahead(endless(), 3)
    assert next(items) == 0
    items.close()  # type: ignore[attr-defined]
    assert "ahead" not in threads()
    assert len(made) <= 6


def test_a_sink_behind_gets_all_in_order_before_the_context_ends() -> None:
    got: list[int] = []
    with behind(got.append, 3) as put:
        for item in range(1000):
            put(item)
    assert got == list(range(1000))


def test_what_a_sink_behind_raises_is_raised_where_the_items_come_from() -> None:
    got: list[int] = []
    made = 0

    def take(item: int) -> None:
        if item == 5:
            raise OSError("disk full")
        got.append(item)

    with pytest.raises(OSError, match="disk full"), behind(take, 2) as put:
        for made in range(1000):
            put(made)
    assert made < 999
    with pytest.raises(OSError, match="disk full"), behind(take, 2) as put:
        put(5)  # the last one: raised at the end
    assert got == [0, 1, 2, 3, 4]


def test_a_sink_behind_is_given_up_when_the_items_end_with_an_error() -> None:
    before = threading.active_count()
    with pytest.raises(KeyError), behind(lambda _: None, 2) as put:
        put(1)
        raise KeyError
    assert threading.active_count() == before


@pytest.mark.parametrize("count", [1, 2])
def test_work_beside__has_its_result_at_the_end_and_reports_after_the_body(count: int) -> None:
    reported: list[str] = []

    def work(progress: Progress) -> int:
        for k in range(5):
            progress("beside", k / 4)
        return 7

    def report(stage: str, share: float) -> None:
        assert 0.0 <= share <= 1.0
        assert threading.current_thread() is threading.main_thread()
        reported.append(stage)

    with using_threads(count), beside(work, report) as found:
        reported.append("body")
    assert found.result() == 7
    assert reported[0] == "body"
    assert set(reported[1:]) <= {"beside"}


@pytest.mark.parametrize("count", [1, 2])
def test_work_beside__that_fails_raises_at_the_end(count: int) -> None:
    def work(progress: Progress) -> None:
        raise OSError("disk")

    body = []
    with pytest.raises(OSError, match="disk"), using_threads(count), beside(work, lambda *_: None):
        body.append("whole")
    assert body == ["whole"]


def test_work_beside__stops_where_the_body_fails_or_the_report_is_refused() -> None:
    def endless(progress: Progress) -> None:
        while True:
            progress("beside", 0.5)

    with pytest.raises(ValueError, match="body"), using_threads(2), beside(endless, lambda *_: None):
        raise ValueError("body")

    def refuse(stage: str, share: float) -> None:
        raise Cancelled

    with pytest.raises(Cancelled), using_threads(2), beside(endless, refuse):
        pass
