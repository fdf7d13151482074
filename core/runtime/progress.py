"""Progress of long work."""

from typing import Protocol


class Progress(Protocol):
    """A callback for progress. It may raise :class:`~furrowmap.core.runtime.errors.Cancelled` to stop the work."""

    def __call__(self, stage: str, share: float) -> None:
        """Called when `share` (0 to 1) of `stage` is done."""
        ...


def silent(stage: str, share: float) -> None:
    """Ignores progress."""
