"""Tables of the tool's states: what they say, and what is wrong with them by its line."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from furrowmap.core.readers.reader import ReadOptions, Recognised
from furrowmap.core.readers.states_csv import StatesCsv
from furrowmap.core.runtime.errors import InputError
from furrowmap.core.values.tool_states import ToolState, ToolStates

TABLE = """time,state
2026-06-11T08:00:00Z,up
2026-06-11T08:00:10.5Z,down
2026-06-11T17:01:00+09:00,unknown
2026-06-11T08:02:00,down
"""
BEGIN_S = 1_781_164_800.0


def read(folder: Path, text: str) -> ToolStates:
    path = folder / "states.csv"
    path.write_text(text, encoding="utf-8")
    assert Recognised.by_content(path).reader is StatesCsv
    return StatesCsv([path], ReadOptions()).states()


def test_states__last_until_the_next_row(tmp_path: Path) -> None:
    states = read(tmp_path, TABLE)
    assert (states.begin_s - BEGIN_S).tolist() == [0.0, 10.5, 120.0]
    assert (states.end_s - BEGIN_S).tolist() == [10.5, 60.0, np.inf]
    assert states.state.tolist() == [ToolState.UP, ToolState.DOWN, ToolState.DOWN]
    assert np.all(states.confidence == 1.0)
    assert np.isnan(states.begin_sigma_s).all()


def test_columns__in_any_order_with_what_else_there_is(tmp_path: Path) -> None:
    states = read(tmp_path, "note;sigma_s;STATE_OF;state;t_s\nx;0.1;;Down;100.25\n;;;up;200\n;0.3;;unknown;300\n")
    assert states.begin_s.tolist() == [100.25, 200.0]
    assert states.end_s.tolist() == [200.0, 300.0]
    assert np.array_equal(states.begin_sigma_s, [0.1, np.nan], equal_nan=True)
    assert np.array_equal(states.end_sigma_s, [np.nan, 0.3], equal_nan=True)


@pytest.mark.parametrize(
    ("row", "code", "word"),
    [
        ("2026-06-11T08:03:00Z,lowered", "states-unreadable", "line 6: the state is 'lowered'"),
        ("yesterday,down", "states-unreadable", "line 6: the time is 'yesterday'"),
        ("2026-06-11T08:01:30Z,up", "rows-out-of-order", "line 6"),
        ("2026-06-11T08:02:00Z,up", "rows-out-of-order", "line 6"),
    ],
)
def test_a_bad_row__is_reported_with_its_line(tmp_path: Path, row: str, code: str, word: str) -> None:
    with pytest.raises(InputError) as error:
        read(tmp_path, f"{TABLE}{row}\n")
    assert error.value.code == code
    assert word in error.value.what


def test_inspect__reports_times_of_each_state(tmp_path: Path) -> None:
    path = tmp_path / "states.csv"
    path.write_text(TABLE)
    facts = Recognised.by_content(path).inspect().facts
    assert (facts["down_s"], facts["up_s"], facts["intervals"]) == (49.5, 10.5, 3)
