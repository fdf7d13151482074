"""States from elsewhere beside those seen: how they agree, and when they are none of the drive."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from furrowmap.core.coverage.field_work import with_external_states, with_ground
from furrowmap.core.implement.external_states import compare_states, external_states
from furrowmap.core.runtime.errors import InputError
from furrowmap.core.values.session import Implement
from furrowmap.core.values.tool_states import ToolState, ToolStates
from furrowmap.exporters.vectors.field_layers import write_states
from tests.core.implement.drives_with_tool import FRAME, states_of, trajectory_of
from tests.core.trajectory.drives import drive
from tests.exporters.vectors.worked_field import DOWN_S, LEGS, TILLER, worked_field

TRAJECTORY = trajectory_of(drive(*LEGS), sigma=(0.01, 0.01, 0.02, 0.1, 0.1, 0.2))
BEGIN_S = TRAJECTORY.span_s[0]


def tool(use: str = "replace", ahead_s: float = 0.0) -> Implement:
    return Implement(
        width_m=TILLER.width_m,
        xy_m=TILLER.xy_m,
        working_depth_m=TILLER.working_depth_m,
        states=("states.csv",),
        states_use=use,
        states_minus_gnss_s=ahead_s,
    )


def shifted(states: ToolStates, by_s: float) -> ToolStates:
    return replace(states, begin_s=states.begin_s + by_s, end_s=states.end_s + by_s)


down_times = st.lists(st.floats(0.5, 79.5), min_size=2, max_size=12, unique=True).map(sorted)


@settings(max_examples=50)
@given(down_times, st.floats(0.0, 1.0), st.booleans())
def test_table__gives_back_the_states_it_was_written_from(
    tmp_path_factory: pytest.TempPathFactory, cuts: list[float], sigma_s: float, gap: bool
) -> None:
    spans = [(a, b) for a, b in zip(cuts[::2], cuts[1::2], strict=False) if b - a > 1e-3]
    unknown = (40.0, 41.0) if gap else (0.0, 0.0)
    states = replace(states_of(TRAJECTORY, *spans, sigma_s=sigma_s, unknown_s=unknown), common_share=0.3)
    path = tmp_path_factory.mktemp("table") / "states.csv"
    write_states(path, states)
    found = external_states([path], tool(), None, TRAJECTORY)
    assert found[0] is not None
    known = states.state != ToolState.UNKNOWN
    assert found[0].common_share == 0.3
    for name in ("begin_s", "end_s", "state", "confidence", "begin_sigma_s", "end_sigma_s"):
        assert np.array_equal(getattr(found[0], name), getattr(states, name)[known], equal_nan=True), name


def test_table__gives_the_same_polygons_as_the_states_seen(tmp_path: Path) -> None:
    _, work = worked_field()
    assert work.ground is not None
    assert work.states is not None
    write_states(tmp_path / "states.csv", work.states)
    found = external_states([tmp_path / "states.csv"], tool(), None, TRAJECTORY)
    assert found[0] is not None
    unseen = replace(work, seen=None, history=None, ground=None)
    again = with_ground(replace(unseen, external=found[0]), TILLER, TRAJECTORY, FRAME).ground
    assert again is not None
    assert shapely.equals_exact(again.coverage, work.ground.coverage)
    assert [p.ground.wkb for p in again.passes] == [p.ground.wkb for p in work.ground.passes]
    assert [(o.pass_a, o.pass_b, o.ground.wkb) for o in again.overlaps] == [
        (o.pass_a, o.pass_b, o.ground.wkb) for o in work.ground.overlaps
    ]
    assert [m.ground.wkb for m in again.misses] == [m.ground.wkb for m in work.ground.misses]
    assert again.figures.worked == work.ground.figures.worked


def test_last_state__ends_with_the_drive(tmp_path: Path) -> None:
    path = tmp_path / "states.csv"
    path.write_text(f"t_s,state\n{BEGIN_S + 5.0!r},down\n")
    found = external_states([path], tool(), None, TRAJECTORY)
    assert found[0] is not None
    assert found[0].end_s.tolist() == [TRAJECTORY.span_s[1]]


def test_agreement__of_states_with_themselves_is_whole() -> None:
    states = states_of(TRAJECTORY, *DOWN_S)
    found = compare_states(states, states)
    assert found.share == 1.0
    assert len(found.differing_s) == 0
    assert found.notices(replaced=True) == []


def test_agreement__tells_when_they_differ() -> None:
    seen, told = states_of(TRAJECTORY, (2.0, 18.0), (31.0, 46.0)), states_of(TRAJECTORY, (2.2, 18.0), (60.0, 70.0))
    found = compare_states(seen, told)
    assert found.compared_s == pytest.approx(TRAJECTORY.span_s[1] - BEGIN_S)
    assert (found.differing_s - BEGIN_S) == pytest.approx(np.array([[2.0, 2.2], [31.0, 46.0], [60.0, 70.0]]))
    assert found.seen_down.tolist() == [True, True, False]
    assert found.share == pytest.approx(1.0 - 25.2 / found.compared_s)
    (notice,) = found.notices(replaced=False)
    assert "at 2 times" in notice.text  # a fifth of a second is a matter of the moment
    assert "those seen are used" in notice.text


def test_use__says_which_states_the_ground_comes_from() -> None:
    _, work = worked_field()
    told = states_of(TRAJECTORY, (5.0, 15.0))
    replaced = with_external_states(work, told, tool())
    checked = with_external_states(work, told, tool("check"))
    assert (replaced.states, checked.states) == (told, work.states)
    assert replaced.state_comparison is not None
    assert checked.state_comparison is not None
    assert [p.begin_s for p in replaced.passes] == [BEGIN_S + 5.0]


def test_a_clock_that_is_off__is_refused_with_what_would_fit(tmp_path: Path) -> None:
    path = tmp_path / "states.csv"
    write_states(path, shifted(states_of(TRAJECTORY, *DOWN_S), 9 * 3600.0))
    with pytest.raises(InputError) as error:
        external_states([path], tool(), None, TRAJECTORY)
    assert error.value.code == "no-common-time"
    assert "states_minus_gnss_s = 32400.0" in error.value.remedy
    found = external_states([path], tool(ahead_s=32_400.0), None, TRAJECTORY)
    assert found[0] is not None
    assert found[0].begin_s == pytest.approx(states_of(TRAJECTORY, *DOWN_S).begin_s, abs=1e-5)


def test_a_file_without_states__is_refused(tmp_path: Path) -> None:
    path = tmp_path / "gnss.nmea"
    path.write_bytes(b"$GPGGA,120000.00,3500.0,N,13500.0,E,4,12,0.8,10.0,M,37.0,M,,*5A\r\n" * 20)
    with pytest.raises(InputError) as error:
        external_states([path], tool(), None, TRAJECTORY)
    assert error.value.code in ("wrong-kind-of-file", "unknown-format")
