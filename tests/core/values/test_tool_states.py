"""The history of a tool's states."""

from __future__ import annotations

import numpy as np
import pytest

from furrowmap.core.values.tool_states import ToolState, ToolStates


def states(*intervals: tuple[float, float, ToolState]) -> ToolStates:
    begin, end, state = (np.array(column) for column in zip(*intervals, strict=True))
    zero = np.zeros(len(begin))
    return ToolStates(begin.astype(float), end.astype(float), state.astype(np.int8), zero + 0.9, zero, zero)


def test_at__is_the_intervals_state_and_unknown_between_and_outside() -> None:
    history = states((0, 2, ToolState.UP), (2, 5, ToolState.DOWN), (7, 8, ToolState.UP))
    state, confidence = history.at([-1.0, 0.0, 1.9, 2.0, 4.9, 5.0, 6.0, 7.5, 8.0, 9.0])
    up, down, unknown = ToolState.UP, ToolState.DOWN, ToolState.UNKNOWN
    assert state.tolist() == [unknown, up, up, down, down, unknown, unknown, up, up, unknown]
    assert confidence.tolist() == [0.9 if s != unknown else 0.0 for s in state]


def test_at__knows_nothing_where_nothing_is_known() -> None:
    none = np.zeros(0)
    state, confidence = ToolStates(none, none, none.astype(np.int8), none, none, none).at([1.0])
    assert (state.tolist(), confidence.tolist()) == ([ToolState.UNKNOWN], [0.0])


@pytest.mark.parametrize("intervals", [[(0, 2, 1), (1, 3, 0)], [(2, 2, 1)], [(3, 2, 1)], [(5, 6, 1), (0, 1, 0)]])
def test_intervals__that_overlap_or_run_backwards_are_none(intervals: list[tuple[float, float, ToolState]]) -> None:
    with pytest.raises(ValueError, match="ToolStates"):
        states(*intervals)


def test_labels__are_the_words_of_files() -> None:
    assert [state.label for state in ToolState] == ["unknown", "up", "down"]
