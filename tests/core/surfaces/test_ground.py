"""Ground classification on scenes whose truth is known, for both methods."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TypeAlias, cast, get_args

import laspy
import numpy as np
import pyproj
import pytest
from numpy.typing import NDArray

from furrowmap.core.pointclouds.cleaning import clean_points
from furrowmap.core.pointclouds.cleaning_steps import Cleaning
from furrowmap.core.pointclouds.joined_clouds import open_clouds
from furrowmap.core.runtime.errors import InputError
from furrowmap.core.surfaces.ground_filter import GroundMethod, Smrf, classify_ground, ground_cells
from furrowmap.core.values.scan import PointClass

Scene: TypeAlias = tuple[NDArray[np.float64], NDArray[np.bool_]]


def relief(e: NDArray[np.float64], n: NDArray[np.float64]) -> NDArray[np.float64]:
    """A hill of 2 m on a slope of 3 %, nowhere steeper than 12 %."""
    hill: NDArray[np.float64] = 2.0 * np.exp(-((e - 30.0) ** 2 + (n - 20.0) ** 2) / 400.0)
    return 271.0 + 0.03 * e + hill


@pytest.fixture(scope="module")
def scene() -> Scene:
    """60 m by 40 m of relief with a roof, a fence and a tree on it, and which points are of the ground."""
    rng = np.random.default_rng(3)
    e, n = rng.uniform((0.0, 0.0), (60.0, 40.0), (60_000, 2)).T
    z = relief(e, n) + rng.normal(0.0, 0.01, len(e))
    roof = (np.abs(e - 15.0) < 5.0) & (np.abs(n - 10.0) < 4.0)
    fence = np.abs(n - 35.0) < 0.05
    tree = np.hypot(e - 45.0, n - 15.0) < 3.0
    z += np.where(roof, 3.0, 0.0) + np.where(fence, rng.uniform(0.4, 1.2, len(e)), 0.0)
    z += np.where(tree & (rng.random(len(e)) < 0.8), rng.uniform(1.0, 6.0, len(e)), 0.0)
    ground = np.abs(z - relief(e, n)) < 0.05
    return np.column_stack([e + 16_600.0, n - 96_500.0, z]), ground


@pytest.fixture(params=get_args(GroundMethod))
def method(request: pytest.FixtureRequest) -> GroundMethod:
    """Each method whose library is installed."""
    if request.param == "csf":
        pytest.importorskip("CSF")
    return cast("GroundMethod", request.param)


def test_classify_ground__tells_ground_from_roof_fence_and_tree(scene: Scene, method: GroundMethod) -> None:
    xyz, truth = scene
    found = classify_ground(xyz, method)
    assert (found & truth).sum() > 0.995 * truth.sum()
    assert (found & ~truth).sum() < 0.01 * (~truth).sum()


def test_classify_ground__survives_what_is_no_place(scene: Scene, method: GroundMethod) -> None:
    xyz, truth = scene[0][::4], scene[1][::4]
    strange = np.array([[np.nan, 0.0, 0.0], [0.0, np.inf, 0.0], [16_610.0, -96_490.0, 1e6]])
    found = classify_ground(np.concatenate([strange, xyz]), method)
    assert not found[:3].any()
    assert (found[3:] & truth).sum() > 0.98 * truth.sum()


@pytest.mark.parametrize(("width_m", "is_ground"), [(30, False), (49, False), (52, True), (60, True)])
def test_smrf__takes_objects_up_to_50_m_wide_from_the_ground(width_m: int, is_ground: bool) -> None:
    """Twice the window; a plateau wider than that is a terrace."""
    lowest_m = np.zeros((220, 220))
    side = slice(20, 20 + 2 * width_m)
    lowest_m[side, side] = 4.0
    middle = 20 + width_m
    assert ground_cells(lowest_m, Smrf())[middle, middle] == is_ground
    assert ground_cells(lowest_m, Smrf())[5, 5]


def test_smrf__does_not_follow_returns_from_below(scene: Scene) -> None:
    xyz, truth = scene[0][::4], scene[1][::4]
    pits = np.column_stack([xyz[:20, :2], xyz[:20, 2] - 20.0])
    found = classify_ground(np.concatenate([pits, xyz]))
    assert not found[:20].any()
    assert (found[20:] & truth).sum() > 0.98 * truth.sum()


def test_classify_ground__of_few_points_or_none_ends_well(method: GroundMethod) -> None:
    for points in (0, 1, 2, 11):
        xyz = np.column_stack([np.arange(points), np.zeros(points), np.zeros(points)])
        assert len(classify_ground(xyz, method)) == points


def test_clean_points__find_the_same_ground_wherever_the_windows_lie(scene: Scene, tmp_path: Path) -> None:
    """A border of windows (easting 16,640) goes through the scene, and through none that is moved."""
    found = [ground_of_clean_points(tmp_path, scene[0] + [east_m, 0.0, 0.0]) for east_m in (0.0, 100.0)]
    assert 0.1 < found[0].mean() < 0.99
    assert (found[0] != found[1]).mean() < 0.002


def ground_of_clean_points(folder: Path, xyz_m: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Which points of a file are ground, in the order of their point source IDs."""
    header = laspy.LasHeader(version="1.4", point_format=6)
    header.scales = np.full(3, 1e-3)
    header.add_crs(pyproj.CRS.from_epsg(6677))
    cloud = laspy.LasData(header)
    cloud.xyz = xyz_m
    cloud.point_source_id = np.arange(len(xyz_m))
    cloud.write(folder / "scene.las")
    clouds = open_clouds([folder / "scene.las"])
    records = np.concatenate(list(clean_points(clouds, Cleaning(ground="smrf"), folder)))
    order = np.argsort(records["point_source_id"])
    return np.asarray(records["classification"][order] == PointClass.GROUND)


def test_classify_ground__says_nothing_on_standard_output(
    scene: Scene, method: GroundMethod, capfd: pytest.CaptureFixture[str]
) -> None:
    classify_ground(scene[0][::10], method)
    assert capfd.readouterr().out == ""


def test_classify_ground__says_how_to_get_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "CSF", None)
    with pytest.raises(InputError, match="not installed") as raised:
        classify_ground(np.zeros((20, 3)), "csf")
    assert raised.value.code == "extra-missing"


def test_ground_cells__takes_off_what_is_narrower_than_the_window_only() -> None:
    height = np.zeros((80, 80))
    height[10:20, 10:20] = 3.0
    height[30:75, 30:75] = 3.0
    ground = ground_cells(height, Smrf(cell_m=1.0, window_m=10.0))
    assert not ground[10:20, 10:20].any()
    assert ground[35:70, 35:70].all()
    assert ground[height == 0.0].all()
