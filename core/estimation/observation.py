"""The interface of observations, and the normal equations that a list of them makes."""

from __future__ import annotations

from collections.abc import Iterable
from typing import ClassVar, Protocol, Self

from furrowmap.core.estimation.banded import NormalEquations
from furrowmap.core.estimation.knots import Knots
from furrowmap.core.estimation.states import State


class Observation(Protocol):
    """Measurements of one kind, or prior knowledge, of the states at the knots.

    What an implementation keeps to:

    * :meth:`add` linearises its residuals at `state` and adds them to the equations. It reads neither what the
      equations hold nor other observations.
    * The unknowns are the step of :meth:`State.moved`. Column ``c`` of knot ``k`` is unknown
      ``k * state.layout.size + c``; `ROTATION` and ``state.layout.column(block)`` state the columns.
    * One equation links at most `linked` consecutive knots of one chain (`knots.linked`, `knots.inner`).
    * Weights are inverse variances, so that covariances of the solution hold. What lasts for several measurements, as
      a correlated error, is an added block or a larger standard deviation.
    * It is immutable. Robust weights are part of it: :meth:`reweighted` gives it with those at another state.

    Attributes:
        linked: consecutive knots that one equation links at most; the largest of all observations is the bandwidth of
            the normal equations.
    """

    linked: ClassVar[int] = 2

    def add(self, equations: NormalEquations, knots: Knots, state: State) -> None:
        """Add the linearised measurements to the equations of all knots."""
        ...

    def reweighted(self, knots: Knots, state: State) -> Self:  # noqa: ARG002
        """The observation with robust weights by its residuals at a state; itself where it has none."""
        return self


def normal_equations(observations: Iterable[Observation], knots: Knots, state: State) -> NormalEquations:
    """The equations of all knots at a state."""
    size, every = state.layout.size, tuple(observations)
    equations = NormalEquations(len(knots) * size, max(one.linked for one in every) * size)
    for observation in every:
        observation.add(equations, knots, state)
    return equations
