"""Reflectivities and counts of simulated returns."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest

from furrowmap.core.simulator.rays import _BRIGHTNESS_STEP, Met, Returns
from furrowmap.core.simulator.recording import _ReturnCounts
from tests.core.simulator.test_simulator_rays import BARE, fired


@pytest.mark.parametrize("brightness", [1.0, 7.0, 18.0])
def test_wall__reflects_as_much_on_average_as_its_brightness_says(brightness: float) -> None:
    """Each return has noise and is rounded to a whole number, which changes no mean."""
    wall = (10.0, 15.0, 0.0, 18.0, 0.3, 3.0, brightness)
    returns = fired(msgspec.structs.replace(BARE, walls=(wall,)), 2880)
    seen = returns.reflectivity[0][returns.met[0] == Met.OBJECT]
    assert len(seen) > 2000
    assert seen.mean() == pytest.approx(brightness * _BRIGHTNESS_STEP, abs=0.15)
    assert 0.3 < seen.std() < 3.0


def test_counts__second_returns_are_those_that_differ_from_the_first() -> None:
    """Two firings of three lasers: in dual mode a return counts twice only where there are two."""
    ticks = np.array([[[500, 600, 0], [700, 800, 900]], [[500, 650, 0], [700, 800, 950]]], np.uint16)
    met = np.where(ticks > 0, Met.SOIL, 0).astype(np.uint8)
    met[1][ticks[0] != ticks[1]] = Met.OBJECT
    returns = Returns(ticks, np.ones(ticks.shape, np.uint8), met, np.full(ticks.shape, -1, np.int32))
    found = {}
    for mode in ("strongest", "last", "dual"):
        counts = _ReturnCounts()
        counts.add(returns, mode)
        found[mode] = (counts.second, int(counts.met[Met.SOIL]), int(counts.met[Met.OBJECT]))
    assert found == {"strongest": (0, 5, 0), "last": (0, 3, 2), "dual": (2, 5, 2)}
