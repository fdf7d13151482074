"""Ditches, ridges and edges of banks in ground whose profile is a closed form."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from furrowmap.core.features.breaklines import BreakPoints, break_points, breaklines

FloatArray = NDArray[np.float64]


def ground(height: FloatArray, xy: FloatArray) -> FloatArray:
    """Ground points with noise of 1.5 cm."""
    return np.column_stack([xy, height + np.random.default_rng(2).normal(0.0, 0.015, len(xy))])


@pytest.fixture(scope="module")
def xy() -> FloatArray:
    return np.random.default_rng(1).uniform([0.0, 0.0], [20.0, 16.0], (32_000, 2))


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_ditch_and_ridge__lie_where_they_are_with_their_depth(xy: FloatArray, sign: float) -> None:
    """A cosine of 0.4 m, 2 m wide, at 30 degrees to the cells, on a slope of 5 %."""
    away = (xy[:, 0] - 10.0) * math.cos(math.radians(30.0)) + (xy[:, 1] - 8.0) * math.sin(math.radians(30.0))
    dip = np.where(np.abs(away) < 1.0, 0.5 * (1.0 + np.cos(math.pi * away)), 0.0)
    found = breaklines(break_points(ground(0.05 * xy[:, 1] + sign * 0.4 * dip, xy)))
    middle = [line for line in found if line.kind == ("ditch" if sign < 0.0 else "ridge")]
    (line,) = middle
    off = (line.path_m[:, 0] - 10.0) * math.cos(math.radians(30.0)) + (line.path_m[:, 1] - 8.0) * math.sin(
        math.radians(30.0)
    )
    assert np.abs(off[1:-1]).max() < 0.15
    assert np.linalg.norm(line.path_m[-1] - line.path_m[0]) > 0.9 * 16.0 / math.cos(math.radians(30.0))
    assert line.depth_m == pytest.approx(0.4, abs=0.08)
    edges = [line for line in found if line.kind == "edge"]
    assert len(edges) == 2, "one rim on either side"


def test_bank__has_an_upper_and_a_lower_edge(xy: FloatArray) -> None:
    """A bank 1 m high and 2 m wide."""
    found = breaklines(break_points(ground(np.clip(0.5 * (xy[:, 0] - 9.0), 0.0, 1.0), xy)))
    assert [line.kind for line in found] == ["edge", "edge"]
    foot, top = sorted(found, key=lambda line: float(line.path_m[:, 2].mean()))
    assert np.median(foot.path_m[:, 0]) == pytest.approx(9.0, abs=0.2)
    assert np.median(top.path_m[:, 0]) == pytest.approx(11.0, abs=0.2)
    assert min(foot.path_m[:, 1].max(), top.path_m[:, 1].max()) > 15.0
    assert foot.depth_m == top.depth_m == 0.0


@pytest.mark.parametrize("height_m", [0.0, 271.0, 2500.0])
def test_even_ground_and_furrows__have_no_breaklines_at_any_height(xy: FloatArray, height_m: float) -> None:
    undulating = 0.1 * np.sin(0.6 * xy[:, 0]) * np.cos(0.5 * xy[:, 1])
    furrows = 0.08 * np.sin(2.0 * math.pi * xy[:, 0] / 0.7)
    assert breaklines(break_points(ground(height_m + undulating + furrows, xy))) == []


@pytest.mark.parametrize("count", [0, 1, 20])
def test_few_points__have_no_breaklines(count: int) -> None:
    points = break_points(np.random.default_rng(3).uniform(0.0, 9.0, (count, 3)))
    assert len(points) == 0
    assert breaklines(BreakPoints.joined([points, points])) == []
