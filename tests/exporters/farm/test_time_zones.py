"""The time zone of a session in a farm map: the one stated, else that of the place."""

from __future__ import annotations

from typing import Any

import pytest
import shapely
from pyproj import CRS

from furrowmap.exporters.farm.farm_results import zone_of

BERLIN = shapely.Point(391_000.0, 5_819_000.0)
UTM = CRS.from_epsg(25833)


@pytest.mark.parametrize("name", ["Asia/Tokyo", "UTC"])
def test_zone__is_the_one_stated(name: str) -> None:
    assert zone_of({"figures": {"time_zone": name}}, BERLIN, UTM).key == name


NO_ZONES = (None, 5, "", "Mars/Crater", "America", "x" * 300, "../x")


@pytest.mark.parametrize("report", [{}, {"figures": None}, *({"figures": {"time_zone": name}} for name in NO_ZONES)])
def test_zone__that_is_none_is_that_of_the_place(report: dict[str, Any]) -> None:
    assert zone_of(report, BERLIN, UTM).key == "Europe/Berlin"
