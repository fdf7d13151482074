"""States, transitions and heights of a tool in scenes whose truth is a closed form."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from furrowmap.core.implement.learning import learn_implement
from furrowmap.core.implement.near_scans import NearScans
from furrowmap.core.values.rotation import Mounting
from furrowmap.core.values.tool_states import ToolState

PLOUGH = (
    (-2.7, -1.1, -0.06, 0.06, 0.55, 0.68),
    (-1.5, -1.2, -0.65, -0.30, 0.00, 0.62),
    (-2.0, -1.7, -0.18, 0.18, 0.00, 0.62),
    (-2.6, -2.3, 0.30, 0.65, 0.00, 0.62),
    (-1.2, -1.1, -0.45, 0.45, 0.35, 1.05),
)
MOWER = ((-2.2, -1.0, -0.85, 0.85, 0.10, 0.38), (-1.7, -1.3, -0.2, 0.2, 0.38, 0.62))
SCREEN = ((-1.1, -1.0, 0.0, 1.0, 1.3, 2.2),)


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"hint": None},
        {"hint": None, "tool": PLOUGH, "mirrored": (8.5, 99.0)},  # a reversible plough
        {"swing_deg": 30.0},  # trailed
        {"tilt_deg": 12.0},  # a three-point linkage
        {"still": SCREEN, "dropout": 0.2, "dust": 0.05},  # half of it hidden
        {"dust": 0.2},
        {"turn_s": 0.2},
        {"begin_deg": 350.0, "clockwise": False},
        {"begin_deg": 190.0, "lasers": 48},
        {"mounting": Mounting((-0.5, 0.6, 2.3), (1.0, 42.0, 160.0))},
    ],
    ids=str,
)
def test_history__finds_every_transition_and_no_other(watch: Callable[..., Any], changes: dict[str, Any]) -> None:
    seen = watch(**changes)
    wanted, found = seen.truth.passages(0.12), seen.passages()
    assert [down for _, down, _ in found] == [down for _, down in wanted]
    late = np.array([at for at, _, _ in found]) - np.array([at for at, _ in wanted])
    assert np.abs(late).max() < 0.05
    sigma = np.array([sigma for _, _, sigma in found])
    assert np.sqrt(np.mean((late / sigma) ** 2)) < 3.0
    assert not seen.learned.notices


def test_history__states_and_heights_of_scans_are_true(watch: Callable[..., Any]) -> None:
    seen = watch()
    t_s = seen.history.t_s - seen.history.states.begin_s[0]
    height = seen.truth.height_m(t_s)
    clear = np.min(np.abs(seen.history.t_s[:, None] - [at for at, _ in seen.truth.passages(0.12)]), axis=1) > 0.1
    down = seen.history.state == ToolState.DOWN
    assert np.array_equal(down[clear], height[clear] < 0.12)
    assert not (seen.history.state == ToolState.UNKNOWN).any()
    assert np.abs(seen.history.tool_height_m - height).max() < 0.03
    assert np.sqrt(np.mean((seen.history.tool_height_m - height) ** 2)) < 0.006
    assert seen.history.confidence[clear].min() > 0.9
    assert abs(seen.history.lifted_m - seen.truth.lift_m) < 0.006
    assert np.nanmax(np.abs(seen.history.soil_height_m)) < 0.02  # the scene's ground is a plane


def test_history__without_a_working_depth_the_tool_is_down_below_half_its_travel(watch: Callable[..., Any]) -> None:
    seen = watch(depth_m=None)
    wanted = [at for at, _ in seen.truth.passages(0.5 * seen.truth.lift_m)]
    assert [at for at, _, _ in seen.passages()] == pytest.approx(wanted, abs=0.03)


def test_history__a_tool_that_dances_at_the_threshold_does_not_chatter(watch: Callable[..., Any]) -> None:
    seen = watch(jitter_m=0.03, depth_m=0.05)
    assert len(seen.truth.passages(0.05)) > 4
    assert [down for _, down, _ in seen.passages()] == [True, False, True, False]


def test_history__is_unknown_where_scans_are_missing(watch: Callable[..., Any]) -> None:
    seen = watch(kept=lambda scan: not 45 <= scan.number < 65)
    begin_s = seen.history.states.begin_s[0]
    state, confidence = seen.history.states.at(begin_s + np.array([4.4, 5.5, 6.6]))
    assert state.tolist() == [ToolState.DOWN, ToolState.UNKNOWN, ToolState.DOWN]
    assert confidence[1] == 0.0


@pytest.mark.parametrize("changes", [{}, {"hint": None}], ids=["hint", "none"])
@pytest.mark.parametrize("stays", [{"lowered_s": (), "lifted_s": ()}, {"lowered_s": (-9.0,), "lifted_s": (99.0,)}])
def test_learning__a_tool_that_never_moves_gets_no_states(
    watch: Callable[..., Any], stays: dict[str, Any], changes: dict[str, Any]
) -> None:
    seen = watch(**stays, **changes, dust=0.1)
    assert seen.learned.implement is None
    assert [notice.code for notice in seen.learned.notices] == ["implement-never-moves"]


def test_learning__a_scanner_that_looks_away_says_that_it_does_not_see_the_implement(
    watch: Callable[..., Any],
) -> None:
    seen = watch(mounting=Mounting((1.0, 0.0, 2.4), (0.0, 35.0, 0.0)))
    assert [notice.code for notice in seen.learned.notices] == ["implement-not-seen"]


def test_learning__a_mounting_that_puts_the_ground_elsewhere_is_told(watch: Callable[..., Any]) -> None:
    truth = watch().truth
    near = NearScans(Mounting((*truth.mounting.xyz_m[:2], 0.6), truth.mounting.rpy_deg))
    for scan in truth.scans():
        near.add(scan)
    learned = learn_implement(near.scans, None)
    assert learned.implement is None
    assert [notice.code for notice in learned.notices] == ["implement-no-ground"]


def test_history__a_tool_out_of_view_at_work_is_down_there_and_says_so(watch: Callable[..., Any]) -> None:
    seen = watch(tool=MOWER, mounting=Mounting((-0.63, 0.04, 2.42), (0.3, 33.0, 180.0)))
    assert [notice.code for notice in seen.learned.notices] == ["implement-out-of-view"]
    assert seen.learned.implement.levels.hidden == ToolState.DOWN
    wanted, found = seen.truth.passages(0.12), seen.passages()
    assert [down for _, down, _ in found] == [down for _, down in wanted]
    late = np.array([at for at, _, _ in found]) - np.array([at for at, _ in wanted])
    sigma = np.array([sigma for _, _, sigma in found])
    assert np.all(np.abs(late) < 2.0 * sigma)
    assert np.isnan(seen.history.tool_height_m[seen.history.state == ToolState.DOWN]).mean() > 0.5


def test_images__show_the_implement_nearer_when_it_is_up(watch: Callable[..., Any]) -> None:
    images = watch().learned.implement.images
    assert images.up_m.shape == images.down_m.shape == images.implement.shape
    assert images.azimuth_deg.shape == images.up_m.shape[1:]
    both = images.implement & np.isfinite(images.up_m) & np.isfinite(images.down_m)
    assert np.median(images.down_m[both] - images.up_m[both]) > 0.2


def test_learn__a_tool_seen_only_near_its_highest_place_has_states(watch: Callable[..., Any]) -> None:
    seen = watch(mounting=Mounting((-0.6, 0.0, 2.5), (0.5, 27.0, 181.0)), lift_m=0.6)
    assert [notice.code for notice in seen.learned.notices] == ["implement-out-of-view"]
    wanted, found = seen.truth.passages(0.12), seen.passages()
    assert [down for _, down, _ in found] == [down for _, down in wanted]
    late = np.array([at for at, _, _ in found]) - np.array([at for at, _ in wanted])
    sigma = np.array([sigma for _, _, sigma in found])
    assert np.abs(late).max() < 0.4
    assert np.sqrt(np.mean((late / sigma) ** 2)) < 2.0
