"""Messages of bags whose content cannot be: each is left out with the reason, and a bag of nothing else is refused."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from furrowmap.core.readers.reader import ReadOptions
from furrowmap.core.readers.rosbag.bags import RosBag2
from furrowmap.core.runtime.errors import InputError
from tests.core.readers.small_bags import T0_NS, nav_sat_fix, point_cloud, revolution, write_bag2
from tests.core.readers.test_line_scanners import laser_scan


def without(name: str) -> Any:
    made = point_cloud(T0_NS, revolution(16))
    made.fields = [field for field in made.fields if field.name != name]
    return made


def cloud(**changes: int) -> Any:
    made = point_cloud(T0_NS, revolution(16))
    for name, more in changes.items():
        setattr(made, name, getattr(made, name) + more)
    return made


CLOUDS: list[tuple[Callable[[], Any], str]] = [
    (lambda: without("x"), "the cloud has no field 'x' (fields: y, z, intensity, ring, time)"),
    (lambda: without("z"), "the cloud has no field 'z' (fields: x, y, intensity, ring, time)"),
    (lambda: cloud(width=1), "17 × 1 points of 22 bytes do not match"),
    (lambda: cloud(height=1), "16 × 2 points of 22 bytes do not match"),
    (lambda: cloud(point_step=-10), "16 × 1 points of 12 bytes do not match"),
    (lambda: cloud(row_step=1), "16 × 1 points of 22 bytes do not match"),
    (
        lambda: laser_scan(T0_NS, np.ones(9), step=2.0),
        "9 ranges from an angle of -2.35619 rad in steps of 2 rad",
    ),
    (lambda: laser_scan(T0_NS, np.ones(9), first=np.nan), "9 ranges from an angle of nan rad"),
    (lambda: laser_scan(T0_NS, np.ones(9), step=-2.0), "in steps of -2 rad are no sweep"),
    (lambda: laser_scan(T0_NS, np.ones(9), each_s=-1e-6), "its time increment of -1e-06 s is not that of a sweep"),
    (lambda: laser_scan(T0_NS, np.ones(9), each_s=10.0), "its time increment of 10 s is not that of a sweep"),
]


@pytest.mark.parametrize(("make", "words"), CLOUDS, ids=[words[:40] for _, words in CLOUDS])
def test_scan__that_cannot_be_is_refused_with_its_reason(make: Callable[[], Any], words: str, tmp_path: Path) -> None:
    reader = RosBag2([write_bag2(tmp_path / "bag", [("/scan", T0_NS, make())])], ReadOptions())
    with pytest.raises(InputError) as refused:
        list(reader.scans())
    assert refused.value.code == "bag-undecodable"
    assert words in refused.value.what


@pytest.mark.parametrize(
    ("lat", "lon", "in_range"),
    [(90.0, 360.0, True), (-90.0, -360.0, True), (90.001, 141.0, False), (-91.0, 141.0, False), (43.0, 361.0, False)],
)
def test_position__out_of_range_is_no_position(lat: float, lon: float, in_range: bool, tmp_path: Path) -> None:
    odd = [("/fix", T0_NS, nav_sat_fix(T0_NS, lat_deg=lat, lon_deg=lon))]
    reader = RosBag2([write_bag2(tmp_path / "bag", odd)], ReadOptions())
    if in_range:  # a full turn is the same place
        assert reader.track().lon_deg.tolist() == [0.0]
        return
    with pytest.raises(InputError, match=rf"latitude {lat:g} or longitude {lon:g} is out of range"):
        reader.track()
