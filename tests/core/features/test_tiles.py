"""What crosses the borders of tiles is one: a wall, a fence of wires, a wire, a ditch."""

from __future__ import annotations

import math
from pathlib import Path

import laspy
import numpy as np
import pyproj
import pytest
import shapely

from furrowmap.core.features import cloud_features
from furrowmap.core.features.cloud_features import FoundFeatures, classify_features
from furrowmap.core.features.objects import LineObject, is_rim, join_planes
from furrowmap.core.pointclouds.cleaning_steps import Cleaning
from furrowmap.core.pointclouds.joined_clouds import open_clouds

LENGTH_M = 44.0
CELL_M = 0.06


@pytest.fixture
def cloud(tmp_path: Path) -> Path:
    """Ground with a ditch, and along it a wall, a wire that sags, and a fence of four wires; squares are 16 m."""
    rng = np.random.default_rng(5)
    x, y = rng.uniform([0.0, 0.0], [LENGTH_M, 16.0], (40_000, 2)).T
    dip = np.where(np.abs(y - 13.0) < 1.0, -0.25 * (1.0 + np.cos(math.pi * (y - 13.0))), 0.0)
    parts = [np.column_stack([x, y, dip])]
    s, up = (a.ravel() for a in np.meshgrid(np.arange(2.0, LENGTH_M - 2.0, 0.1), np.arange(0.1, 2.0, 0.1)))
    parts.append(np.column_stack([s, np.full(len(s), 3.0), up]))
    s = np.arange(2.0, LENGTH_M - 2.0, 0.05)
    parts.append(np.column_stack([s, 7.0 + 0.0 * s, 5.0 + 0.001 * (s - 22.0) ** 2]))
    parts += [
        np.column_stack([s, np.full(len(s), 10.0), np.full(len(s), height)]) for height in (0.5, 0.72, 0.94, 1.16)
    ]
    xyz = np.concatenate(parts)
    turned = math.radians(11.0)
    xy = xyz[:, :2] @ [[math.cos(turned), math.sin(turned)], [-math.sin(turned), math.cos(turned)]]
    xyz = np.column_stack([xy, xyz[:, 2]]) + rng.normal(0.0, 0.008, xyz.shape) + [500_000.0, 4_000_000.0, 50.0]
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales, header.offsets = [0.001] * 3, np.floor(xyz.min(axis=0))
    header.add_crs(pyproj.CRS("EPSG:32634"))
    las = laspy.LasData(header)
    las.x, las.y, las.z = xyz.T
    las.classification = np.where(np.arange(len(xyz)) < 40_000, 2, 1)
    las.write(tmp_path / "cloud.las")
    return tmp_path / "cloud.las"


def test_lines_and_planes__across_tiles_are_one_each(
    cloud: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cloud_features, "TILE_POINTS", 1000)  # a tile for each square
    tiles = 0
    found = FoundFeatures()
    for _ in classify_features(open_clouds([cloud], None, None), Cleaning(), CELL_M, tmp_path, found):
        tiles += 1
    assert tiles >= 5
    planes = join_planes(found.planes)
    lines = found.all_lines(planes)
    walls = [plane for plane in planes if plane.vertical and not plane.is_open]
    assert len(walls) == 1
    assert walls[0].area_m2 == pytest.approx(40.0 * 1.9, rel=0.12)
    for kind, length in (("wire", 40.0), ("fence", 40.0), ("wall", 40.0), ("ditch", LENGTH_M)):
        (line,) = [each for each in lines if each.kind == kind and each.length_m > 10.0]
        assert line.length_m == pytest.approx(length, abs=1.5), kind
    (wire,) = [line for line in lines if line.kind == "wire" and line.length_m > 10.0]
    assert wire.height_m == pytest.approx(5.0 + 0.001 * 20.0**2 / 3.0, abs=0.25)
    assert wire.points == pytest.approx(800, abs=20), "each point counts once"
    assert [each.height_m for each in lines if each.kind == "ditch"] == pytest.approx([0.5], abs=0.15)


@pytest.mark.parametrize(("height_m", "aside_m", "rim"), [(1.2, 0.03, True), (1.9, 0.03, False), (1.2, 0.5, False)])
def test_the_upper_edge_of_a_wall__is_no_wire(height_m: float, aside_m: float, rim: bool) -> None:
    wall = LineObject("wall", shapely.LineString([(0.0, 0.0, 10.0), (5.0, 0.0, 10.0)]), 1.2, 900)
    edge = shapely.LineString([(0.2, aside_m, 10.0 + height_m), (4.7, aside_m, 10.0 + height_m)])
    assert is_rim(LineObject("wire", edge, height_m, 40), wall) is rim
    assert not is_rim(LineObject("pole", edge, height_m, 40), wall)
