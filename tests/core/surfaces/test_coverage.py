"""Points of strips counted by blocks, against numpy's own counting."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from furrowmap.core.coverage.strip_outlines import COVERAGE_BLOCK, MIN_STRIP_POINTS, coverage
from furrowmap.core.surfaces.grid import Grid
from furrowmap.core.surfaces.spool import TilePoints

BEGIN_S = 1.7e9


@dataclass(frozen=True)
class Span:
    begin_s: float
    end_s: float


def test_counts__are_those_of_a_histogram() -> None:
    random = np.random.default_rng(1)
    strips = [
        Span(BEGIN_S + 10.0, BEGIN_S + 20.0),
        Span(BEGIN_S + 25.0, BEGIN_S + 40.0),
        Span(BEGIN_S + 90.0, BEGIN_S + 99.0),
    ]
    grid = Grid(0.05, -256, 512, (256, 256))
    t = np.sort(random.uniform(0.0, 50.0, 20_000)) + random.normal(0.0, 0.05, 20_000)  # packets come out of order
    cell = (random.beta(2.0, 5.0, 20_000) * 65_535).astype(np.uint16)
    found = coverage(TilePoints(grid, cell, np.zeros(20_000, np.float32), t.astype(np.float32), 0.0, BEGIN_S), strips)
    row, column = cell // 256 // COVERAGE_BLOCK, cell % 256 // COVERAGE_BLOCK

    def counted(chosen: np.ndarray) -> np.ndarray:
        return np.histogram2d(row[chosen], column[chosen], bins=(np.arange(33), np.arange(33)))[0]

    seconds = t.astype(np.float32)
    assert found.number.tolist() == [1, 2]
    for k, (begin, end) in enumerate([(10.0, 20.0), (25.0, 40.0)]):
        np.testing.assert_array_equal(found.by_strip[k], counted((seconds >= begin) & (seconds <= end)))
    np.testing.assert_array_equal(found.points, counted(np.ones(20_000, bool)))
    seen = found.points > 0
    np.testing.assert_allclose(found.density_m2[seen], found.points[seen] / (0.05 * COVERAGE_BLOCK) ** 2, rtol=1e-6)
    np.testing.assert_array_equal(found.strips[seen], (found.by_strip >= MIN_STRIP_POINTS).sum(axis=0)[seen])
    assert np.isnan(found.density_m2[~seen]).all()
    assert found.grid.bounds_m == grid.bounds_m
