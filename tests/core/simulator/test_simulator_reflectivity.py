"""Reflectivities of simulated returns."""

from __future__ import annotations

import msgspec
import pytest

from furrowmap.core.simulator.rays import _BRIGHTNESS_STEP, Met
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
