"""Places for readers: few for each address, and given to others where a reader hangs."""

import math
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from threading import Lock


@dataclass(eq=False)
class ReaderPlace:
    """The place of a connection.

    Attributes:
        close: ends the connection, from any thread.
        due_s: until when, by the monotonic clock, the reader has to send or take something; infinite where it need not.
    """

    address: str
    close: Callable[[], None]
    due_s: float = math.inf

    def expect(self, within_s: float) -> None:
        """Let the connection be ended unless `expect_nothing` follows within a time."""
        self.due_s = time.monotonic() + within_s

    def expect_nothing(self) -> None:
        """The reader sent or took what was expected."""
        self.due_s = math.inf


@dataclass
class Places:
    """At most so many places, and so many for one address.

    Where all are taken, an address that has at least two more than that of a new reader loses its oldest one: so many
    connections of a few addresses keep nobody out.
    """

    most: int
    most_of_one: int
    _taken: dict[ReaderPlace, None] = field(default_factory=dict)
    _lock: Lock = field(default_factory=Lock)

    def __len__(self) -> int:
        return len(self._taken)

    def take(self, address: str, close: Callable[[], None]) -> ReaderPlace | None:
        """A place for a connection of an address; None if there is none."""
        with self._lock:
            counts = Counter(place.address for place in self._taken)
            if counts[address] >= self.most_of_one:
                return None
            removed: ReaderPlace | None = None
            if len(self._taken) >= self.most:
                heaviest, count = counts.most_common(1)[0]
                if count < counts[address] + 2:
                    return None
                removed = next(place for place in self._taken if place.address == heaviest)
                del self._taken[removed]
            place = ReaderPlace(address, close)
            self._taken[place] = None
        if removed is not None:
            removed.close()
        return place

    def leave(self, place: ReaderPlace) -> None:
        """A connection has ended."""
        with self._lock:
            self._taken.pop(place, None)

    def close_overdue(self) -> None:
        """End the connections of readers that neither send nor take what they should."""
        now_s = time.monotonic()
        for place in list(self._taken):
            if place.due_s < now_s:
                place.close()
