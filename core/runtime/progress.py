"""Progress of long work."""

from dataclasses import dataclass
from typing import Protocol


@dataclass(frozen=True)
class Step:
    """A step of long work, and its usual share of the time, in any unit; `beside`: others run at the same time."""

    name: str
    usual: float
    beside: bool = False


class Progress(Protocol):
    """A callback for progress. It may raise :class:`~furrowmap.core.runtime.errors.Cancelled` to stop the work."""

    def __call__(self, stage: str, share: float) -> None:
        """Called when `share` (0 to 1) of `stage` is done."""
        ...


def silent(stage: str, share: float) -> None:
    """Ignores progress."""
