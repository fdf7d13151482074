"""A cloud with a few points far from all others."""

from __future__ import annotations

from pathlib import Path

import laspy
import numpy as np
import pytest
from pyproj import CRS

import furrowmap
from furrowmap.core.pointclouds.joined_clouds import near_box, open_clouds
from furrowmap.core.runtime.progress import silent
from furrowmap.core.values.session import FeatureSearch
from furrowmap.workflows.run.feature_tool import run_features
from tests.app.told_progress import Told


def cloud(path: Path, far_m: list[float], points: int = 20_000, side_m: float = 30.0) -> Path:
    chance = np.random.default_rng(1)
    header = laspy.LasHeader(version="1.4", point_format=6)
    header.scales = np.full(3, 0.01)
    header.add_crs(CRS("EPSG:6677"))
    las = laspy.LasData(header)
    las.x = np.r_[chance.uniform(0, side_m, points), far_m]
    las.y = np.r_[chance.uniform(0, side_m, points), far_m]
    las.z = np.r_[chance.normal(0, 0.02, points), np.zeros(len(far_m))]
    las.return_number = las.number_of_returns = np.ones(len(las.x), np.uint8)
    las.classification = np.ones(len(las.x), np.uint8)
    las.write(path)
    return path


def test_promise_14__one_far_point_is_left_out_and_counted(tmp_path: Path) -> None:
    path = cloud(tmp_path / "far.laz", [5_000_000.0])
    cleaned = furrowmap.clean([path], tmp_path / "clean.copc.laz", progress=Told())
    surface = furrowmap.surface([path], tmp_path / "surface", progress=Told())
    for account in (cleaned, surface):
        (warning,) = (w for w in account["warnings"] if w["code"] == "points-far")
        assert warning["text"].startswith("1 of 20,001 points lies more than 1000 m from all others")
    assert cleaned["figures"]["points"] == 20_000
    assert surface["figures"]["columns"] * surface["figures"]["cell_m"] < 32.0


@pytest.mark.parametrize(
    ("far_m", "left_out"), [([], 0), ([900.0], 0), ([4000.0] * 15, 15), ([4000.0] * 30, 0), ([-5e4, 7e4], 2)]
)
def test_far_points__are_few_and_behind_a_wide_gap(far_m: list[float], left_out: int, tmp_path: Path) -> None:
    clouds = open_clouds([cloud(tmp_path / "far.las", far_m)])
    box, notices = near_box(clouds)
    assert [notice.text.split()[0] for notice in notices] == ([str(left_out)] if left_out else [])
    assert box == ((0.0, 0.0, 100.0, 100.0) if left_out else None)


def test_features_of_a_run__are_looked_for_where_the_points_are(tmp_path: Path) -> None:
    found = run_features(cloud(tmp_path / "far.laz", [5_000_000.0]), FeatureSearch(ground="class"), silent)
    assert [notice.code for notice in found.notices] == ["points-far"]
