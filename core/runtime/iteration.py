"""Generators that say at their end what they found, also if the caller takes no more of their items."""

from collections.abc import Callable, Iterator
from typing import TypeVar

Item = TypeVar("Item")


def concluded(items: Iterator[Item], conclude: Callable[[], None]) -> Iterator[Item]:
    """`items`, and then `conclude`, both when they have ended and when the caller closes the generator before.

    It is not called if `items` raise. What it raises itself is raised by `next`, or by `close`.
    """
    try:
        yield from items
    except GeneratorExit:
        conclude()
        raise
    conclude()


def close(items: Iterator[Item]) -> None:
    """End a generator where it is; other iterators have nothing to end."""
    ending = getattr(items, "close", None)
    if ending is not None:
        ending()
