"""States of a tool from heights in closed form."""

from __future__ import annotations

import numpy as np
import pytest

from furrowmap.core.implement.heights import ToolHeights
from furrowmap.core.implement.model import DepthImages, Implement, Levels, Region
from furrowmap.core.implement.states import tool_history
from furrowmap.core.implement.template import SideViewGrid, Template
from furrowmap.core.values.tool_states import ToolState

TURN_S = 0.1
LIFT_M = 0.5
_NONE = np.zeros((0, 0), np.float32)
TILLER = Implement(
    region=Region((0.0, 0.0, 0.0), (-3.0, -1.0, -1.0, 1.0), np.ones(4, bool), _NONE, 0, clockwise=True, turn_s=TURN_S),
    template=Template(SideViewGrid(-3.0, 0.0, 0, 0), _NONE),
    levels=Levels(0.0, LIFT_M, ToolState.UNKNOWN, 0.005, 0.01),
    working_m=0.0,
    points=100.0,
    gain=1.0,
    images=DepthImages(_NONE, _NONE, np.zeros((0, 0), bool), np.zeros(0)),
)


def heights(every_s: float, length_s: float = 60.0) -> ToolHeights:
    """A tool that is lowered and lifted every so many seconds."""
    begin_s = 1000.0 + np.arange(0.0, length_s, TURN_S)
    t_s = begin_s + 0.5 * TURN_S
    n = len(t_s)
    up = (t_s - 1000.0) // every_s % 2 == 1
    return ToolHeights(
        t_s,
        np.where(up, LIFT_M, 0.0),
        np.ones(n),
        np.full(n, 1000.0),
        np.ones(n, bool),
        np.zeros(n),
        np.arange(n, dtype=np.int64),
        begin_s,
        begin_s + TURN_S,
    )


@pytest.mark.parametrize(("every_s", "clear"), [(10.0, True), (2.0, True), (0.5, False)])
def test_tool__that_moves_faster_than_any_lift_has_no_state(every_s: float, *, clear: bool) -> None:
    history = tool_history(heights(every_s), TILLER, None)
    if clear:
        assert history.notices == ()
        assert len(history.states) == 60.0 / every_s
        np.testing.assert_allclose(np.diff(history.states.begin_s), every_s, atol=TURN_S)
        return
    assert [notice.code for notice in history.notices] == ["implement-unclear"]
    assert len(history.states) == 0
    assert set(history.state) == {ToolState.UNKNOWN}
