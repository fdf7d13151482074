"""Features of simulated fields: what stands there is found; crops are no wires, fences, walls, ditches or ridges."""

from __future__ import annotations

from functools import cache

import pytest

from benchmarks.fields import CROPS, field, judge
from benchmarks.yards import Kind, Yard
from furrowmap.core.features.ground_surface import heights_above_ground
from furrowmap.core.surfaces.ground_filter import classify_ground


@cache
def sown(crop: str) -> Yard:
    return field(31, CROPS[crop], 18.0)


@pytest.mark.parametrize("crop", ["wheat plots, 0.45 m", "potato ridges, 0.5 m", "maize, 2.5 m"])
@pytest.mark.parametrize("every", [1, 4])
def test_crops__are_no_lines_and_the_fence_beside_them_is_found(crop: str, every: int) -> None:
    found = judge(sown(crop), every)
    assert [line.kind for line in found.false if line.kind != "pole"] == []
    assert found.found["ditch"] > 0.9
    assert found.found["cable"] > 0.7
    assert found.found["fence"] > 0.5 or every > 1, "wires with a point every half metre"


def test_ground_under_crop__is_that_of_the_bare_soil_around() -> None:
    """Wheat of 0.45 m on plots, whose lower part the filter takes for ground."""
    seen = sown("wheat plots, 0.45 m")
    filtered = classify_ground(seen.xyz_m)
    heights = heights_above_ground(seen.xyz_m, filtered, 0.05)
    crop = seen.kind == Kind.SCATTER
    assert heights.ground[crop].mean() < 0.5 * filtered[crop].mean()
    assert heights.hidden[crop].mean() > 0.9
    true = seen.xyz_m[:, 2] - [seen.scene.ground_m(x, y) for x, y in seen.xyz_m[:, :2]]
    error = (heights.above_m - true)[crop]
    assert abs(error).mean() < 0.02
    assert heights.noise_m == pytest.approx(0.012, abs=0.004)
