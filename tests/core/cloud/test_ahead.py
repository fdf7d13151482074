"""Items made ahead come in order, with their errors, and leave no thread behind."""

from __future__ import annotations

import threading
from collections.abc import Iterator

import pytest

from furrowmap.core.cloud.ahead import ahead


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
