"""Progress of long work."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol


@dataclass(frozen=True)
class Step:
    """A step of long work, and its usual share of the time, in any unit; `beside`: others run at the same time."""

    name: str
    usual: float
    beside: bool = False


class WholeShare:
    """The share of steps that are known ahead, from the progress of each. It never falls.

    >>> whole = WholeShare([Step("reading", 1.0), Step("matching", 3.0)])
    >>> whole.take("matching", 0.5)
    0.625
    """

    def __init__(self, steps: Sequence[Step]) -> None:
        self._steps = {step.name: step for step in steps}
        self._done = dict.fromkeys(self._steps, 0.0)
        self._share = 0.0

    def take(self, stage: str, share: float) -> float:
        """Take the progress of a stage, which need not be a step; the share of all steps that is done, 0 to 1."""
        if stage in self._steps:
            self._finish_before(self._steps[stage])
            self._done[stage] = max(self._done[stage], min(share, 1.0))
        whole = sum(step.usual for step in self._steps.values())
        done = sum(self._done[step.name] * step.usual for step in self._steps.values())
        self._share = max(self._share, done / whole)
        return self._share

    def _finish_before(self, begun: Step) -> None:
        """A step that begins ends those before it, but for those beside it."""
        for step in self._steps.values():
            if step is begun:
                return
            if not (step.beside and begun.beside):
                self._done[step.name] = 1.0


class Progress(Protocol):
    """A callback for progress. It may raise :class:`~furrowmap.core.runtime.errors.Cancelled` to stop the work."""

    def __call__(self, stage: str, share: float) -> None:
        """Called when `share` (0 to 1) of `stage` is done."""
        ...


def silent(stage: str, share: float) -> None:
    """Ignores progress."""
