"""How long work tells where it stands, without knowing who listens."""

from __future__ import annotations

from typing import Protocol


class Progress(Protocol):
    """A listener to long work. Raising :class:`~furrowmap.core.values.errors.Cancelled` from it ends the work."""

    def __call__(self, stage: str, share: float) -> None:
        """Take note that `stage` has done `share` (0 to 1) of its work."""
        ...


def silent(stage: str, share: float) -> None:
    """A listener who does not listen."""
