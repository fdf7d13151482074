"""A flight's scanner that is read as another model is told by the ground; one that is read rightly is not doubted."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from furrowmap.core.matching.laser_elevations import raised
from furrowmap.core.strips.boresight import boresight
from furrowmap.core.strips.model_by_strips import likelier_model
from furrowmap.core.strips.strips import strip_returns
from furrowmap.core.values.rotation import Mounting
from tests.core.strips.test_boresight import Scene, flown

TRUE = Mounting((0.0, 0.0, -0.3), (-90.0, 34.0, -90.0))
PUCK = np.arange(-15.0, 16.0, 2.0)
HI_RES = PUCK * 2.0 / 3.0


def test_model__with_which_the_ground_coincides_is_named() -> None:
    trajectory = flown()
    right = strip_returns(Scene(TRUE).scans(trajectory), trajectory)
    sensor_m = raised(right.sensor_m.astype(np.float64), (HI_RES - PUCK)[right.beam])
    wrong = replace(right, sensor_m=sensor_m.astype(np.float32))
    found = boresight(wrong, trajectory, TRUE)
    assert found is not None
    other = likelier_model(wrong, trajectory, TRUE, None, found, {"Puck Hi-Res": HI_RES, "VLP-16": PUCK})
    assert other is not None
    assert (other.name, other.read_as) == ("VLP-16", "Puck Hi-Res")
    assert other.scatter_m[1] < 0.01 < other.scatter_m[0]
    assert other.notice.key == "contradiction.elevations-of-another"
    as_it_is = boresight(right, trajectory, TRUE)
    assert as_it_is is not None
    # Even where it is asked for.
    rough = replace(as_it_is, scatter_m=(0.03, 0.0101))
    assert likelier_model(right, trajectory, TRUE, None, rough, {"VLP-16": PUCK, "Puck Hi-Res": HI_RES}) is None
    assert likelier_model(right, trajectory, TRUE, None, as_it_is, {}) is None
