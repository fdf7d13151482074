"""Too little data to say anything: the answer says so instead of failing or inventing one."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import rasterio
from pyproj import CRS

from furrowmap.core.accuracy.point_check import surface_at_points
from furrowmap.core.accuracy.product_check import Component
from furrowmap.core.geodesy.coordinates import check_datum
from furrowmap.core.pointclouds.local_plane import local_plane
from furrowmap.core.runtime.errors import FurrowmapError
from furrowmap.core.trajectory.used_positions import jumps
from furrowmap.core.trajectory.vehicle_motion import _runs
from furrowmap.exporters.farm.surface_file import surface_file


def test_plane__of_returns_on_a_line_or_on_one_side_is_none() -> None:
    s = np.linspace(-0.2, 0.2, 30)
    assert local_plane(np.column_stack([s, 2.0 * s, 0.1 * s])) is None
    x, y = (axis.ravel() for axis in np.meshgrid(s, s))
    plane = np.column_stack([x, y, 1.0 + 0.1 * x - 0.2 * y])
    found = local_plane(plane)
    assert found is not None
    assert (found.height_m, *found.slope) == pytest.approx((1.0, 0.1, -0.2))
    assert local_plane(plane[x > 0.0]) is None


def test_bias__of_one_point_or_of_no_error_is_none() -> None:
    unstated = np.full(1, np.nan)
    assert not Component.from_errors(np.array([0.5]), unstated).biased
    assert not Component.from_errors(np.zeros(9), unstated).biased
    assert Component.from_errors(np.full(9, 0.5) + np.linspace(-0.1, 0.1, 9), unstated).biased
    assert not Component.from_errors(np.full(9, 0.0004), unstated).biased  # of coordinates to the millimetre


def test_jumps__of_fewer_than_seven_positions_are_not_looked_for() -> None:
    t_s, xyz_m = np.arange(7.0), np.zeros((7, 3))
    xyz_m[3] = 50.0
    sigma_m = np.full((7, 2), 0.01)
    assert np.flatnonzero(jumps(t_s, xyz_m, sigma_m)).tolist() == [3]
    assert not jumps(t_s[:6], xyz_m[:6], sigma_m[:6]).any()


def test_runs__of_equal_labels() -> None:
    assert _runs(np.zeros(0, np.int64), np.zeros(0, bool)) == []
    labels = np.array([1, 1, 2, 2, 2, 1])
    assert _runs(labels, np.ones(6, bool)) == [(0, 1), (2, 4), (5, 5)]
    assert _runs(labels, labels == 1) == [(0, 1), (5, 5)]


def test_datum__of_a_local_grid_is_not_judged() -> None:
    local = 'ENGCRS["site",EDATUM["site"],CS[Cartesian,2],AXIS["x",east],AXIS["y",north],LENGTHUNIT["metre",1]]'
    assert check_datum(CRS(local), "site", 140.0, 36.0, 1.78e9) == []


def test_rasters__without_a_crs_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "dsm.tif"
    place = rasterio.transform.from_origin(0, 2, 0.5, 0.5)
    shape = {"width": 4, "height": 4, "count": 1, "dtype": "float32", "transform": place}
    with rasterio.open(path, "w", driver="GTiff", **shape) as file:
        file.write(np.ones((1, 4, 4), np.float32))
    for read in (lambda: surface_file(path), lambda: surface_at_points(path, tmp_path / "points.csv")):
        with pytest.raises(FurrowmapError, match=r"(?i)no CRS"):
            read()
