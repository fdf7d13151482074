"""The parts: columns of the range image, thinned recordings, fits of a side view."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numba import njit

from furrowmap.core.implement import learning
from furrowmap.core.implement.learning import Found
from furrowmap.core.implement.near_scans import IMAGE_COLUMNS, MAX_NEAR_SCANS, NearScans, column_of, median_image
from furrowmap.core.implement.seen_implement import CELL_Z_M, Hint, SideTemplate, SideViewGrid, fit_height
from furrowmap.core.values.rotation import Mounting
from furrowmap.core.values.scan import Scan
from furrowmap.core.values.tool_states import ToolState
from tests.core.implement.conftest import HINT, Scene

GRID = SideViewGrid(-3.0, 0.15, 20, 150)


@njit
def _columns(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    out = np.empty(len(x), np.int64)
    for i in range(len(x)):
        out[i] = column_of(x[i], y[i])
    return out


def test_column__is_that_of_the_azimuth() -> None:
    azimuth = np.linspace(0.0, 2 * np.pi, 100_003)[:-1]
    column = _columns(3.0 * np.cos(azimuth), -3.0 * np.sin(azimuth))
    exact = azimuth * IMAGE_COLUMNS / (2 * np.pi)
    assert np.all(np.abs(column + 0.5 - exact) < 0.5 + 2e-3)
    assert _columns(np.zeros(1), np.zeros(1)).tolist() == [0]


def test_median_image__needs_half_of_the_images() -> None:
    images = np.array([[[1.0, np.nan]], [[3.0, np.nan]], [[2.0, 5.0]]], np.float32)
    assert np.array_equal(median_image(images), np.array([[2.0, np.nan]], np.float32), equal_nan=True)


def _scan(number: int) -> Scan:
    n = 4
    xyz = np.array([[-2.0, 0.1, -2.0]] * n, np.float32)
    ones = np.ones(n, np.uint8)
    t_s = 100.0 + 0.1 * number + np.linspace(0.0, 0.09, n)
    return Scan(number, t_s, xyz, ones, ones, ones.astype(np.uint16), ones, ones)


@given(st.integers(0, 6 * MAX_NEAR_SCANS))
def test_near_scans__keep_pairs_spread_over_any_recording(count: int) -> None:
    near = NearScans(Mounting((0.0, 0.0, 2.0)))
    for number in range(count):
        near.add(_scan(number))
    index = np.array([scan.index for scan in near.scans])
    assert len(index) <= MAX_NEAR_SCANS
    assert len(index) >= min(count, MAX_NEAR_SCANS // 2)
    assert np.all(np.diff(index) > 0)
    if count:
        stride = np.diff(index[::2])
        assert np.all(stride == stride[:1])  # evenly spread
        assert np.all(index[1::2] - index[: len(index) // 2 * 2 : 2] == 1)
        assert count - index[-1] <= max(stride[:1].tolist(), default=2)


def test_near_scans__pass_over_cut_scans() -> None:
    near = NearScans(Mounting())
    near.add(Scan(**{**_scan(0).__dict__, "whole": False}))
    assert near.scans == []


def _tool(seed: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    x = np.concatenate([rng.uniform(-2.5, -2.0, 300), rng.uniform(-2.0, -1.5, 300)])
    z = np.concatenate([np.full(300, 0.60), np.full(300, 0.75)]) + rng.normal(0.0, 0.008, 600)
    return x.astype(np.float32), z.astype(np.float32)


@given(st.floats(-0.3, 1.0), st.integers(0, 50))
def test_fit__finds_by_how_much_a_tool_was_lifted(lifted_m: float, seed: int) -> None:
    template = SideTemplate.from_views(GRID, GRID.side_view(*_tool(1000)).astype(np.float64))
    x, z = _tool(seed)
    dust = np.random.default_rng(seed).uniform((-3.0, 0.2), (-1.0, 2.0), (150, 2)).astype(np.float32)
    view = GRID.side_view(np.append(x, dust[:, 0]), np.append(z + np.float32(lifted_m), dust[:, 1]))
    fit, scores = fit_height(view, template, -0.4, 1.2)
    assert fit.height_m == pytest.approx(lifted_m, abs=0.004)
    assert 550 < fit.explained < 750
    assert fit.gain == scores.max()
    assert len(scores) == round(1.6 / CELL_Z_M) + 1


def test_fit__of_nothing_is_none() -> None:
    template = SideTemplate.from_views(GRID, GRID.side_view(*_tool(1)).astype(np.float64))
    nothing = np.zeros((GRID.columns, GRID.rows), np.float32)
    assert np.isnan(fit_height(nothing, template, -0.4, 1.2)[0].height_m)
    empty = SideTemplate.from_views(GRID, nothing.astype(np.float64))
    assert np.isnan(fit_height(GRID.side_view(*_tool(1)), empty, -0.4, 1.2)[0].height_m)


def test_learning__does_not_need_much_memory(watch: Callable[..., Any]) -> None:
    implement = watch(kept=lambda scan: scan.number < 90).learned.implement
    region, images = implement.region, implement.images
    arrays = (region.columns, region.still_m, implement.template.odds, images.up_m, images.down_m, images.implement)
    assert sum(a.nbytes for a in arrays) < 500_000


def test_by_travel__positions_that_were_laid_over_each_other_wrongly_are_set_right() -> None:
    scene = Scene(duration_s=17.0, lift_m=0.5)
    near = NearScans(scene.mounting)
    for scan in scene.scans():
        near.add(scan)
    views = learning.views_of(near.scans, (0.0, 0.0, 0.0), HINT.region_m)
    right = learning._find(views)
    assert right is not None
    heights, levels = right.outcome.heights, right.levels
    lifted = heights.height_m > 0.5 * (levels.low_m + levels.high_m)
    wrong_m = 0.24
    moved = replace(heights, height_m=heights.height_m - wrong_m * lifted)
    wrong = Found(replace(right.outcome, heights=moved), replace(levels, high_m=levels.high_m - wrong_m))
    set_right = learning._by_travel(wrong)
    assert set_right is not None
    travel_m = set_right.levels.high_m - set_right.levels.low_m
    assert travel_m == pytest.approx(0.5, abs=0.06)
    assert learning._by_travel(right) is None


def test_region__is_the_stated_one_or_lies_around_the_tool() -> None:
    box = (-4.0, -1.0, -2.0, 2.0)
    assert Hint((-2.0, 0.1), 1.7, box).region_m == box
    assert Hint((-2.0, 0.1), 1.7).region_m == pytest.approx((-4.0, -0.8, 0.1 - 1.35, 0.1 + 1.35))


@pytest.mark.parametrize(
    ("hidden", "lift_m", "words"),
    [
        (ToolState.DOWN, 0.4, "its working position 0.4 m below the lifted one (from the session)"),
        (ToolState.DOWN, None, "below the lifted one (a default; set [implement] lift_m)"),
        (ToolState.UP, None, "It is taken as up where it is out of view."),
        (ToolState.UNKNOWN, None, ""),
    ],
)
def test_tool__that_is_out_of_view_in_one_state_is_told(hidden: ToolState, lift_m: float | None, words: str) -> None:
    found = learning._out_of_view(hidden, lift_m)
    assert [notice.code for notice in found] == ["implement-out-of-view"] * bool(words)
    assert all(words in notice.text for notice in found)


@pytest.mark.parametrize("count", [0, 4])
def test_too_few_scans__show_no_tool_and_no_ground(count: int) -> None:
    near = NearScans(Mounting((0.0, 0.0, 2.0)))
    for number in range(count):
        near.add(_scan(number))
    views = learning.views_of(near.scans, (0.0, 0.0, 0.0), HINT.region_m)
    assert learning._find(views) is None
    learned = learning.learn_implement(near.scans, HINT)
    assert learned.implement is None
    assert [notice.code for notice in learned.notices] == ["implement-not-seen"]
    assert [notice.code for notice in learning.learn_implement(near.scans, None).notices] == ["implement-never-moves"]
