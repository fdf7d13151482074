"""`furrowmap canopy` on layers of leaves whose gaps are known: gap fraction, profile, percentiles and heights."""

from __future__ import annotations

import csv
from pathlib import Path

import geopandas as gpd
import laspy
import numpy as np
import pyogrio
import pyproj
import pytest
import rasterio
import shapely

import furrowmap
from furrowmap.cli.main import command_line
from furrowmap.core.runtime.errors import InputError, UsageError
from tests.app.told_progress import Told

CRS = "EPSG:6677"
EAST, NORTH = -21_500.0, 16_880.0
SIDE_M = 30.0
LAYERS = {3.25: 0.6, 2.25: 0.5, 1.25: 0.8}
"""Height of each layer of leaves, from the top, and the share of vertical pulses that pass it."""
GAP = 0.6 * 0.5 * 0.8
WEST_M = 15.0
"""East of this there are no leaves."""


@pytest.fixture(scope="module")
def cloud(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Vertical pulses, one return each, through layers of random leaves over a slope."""
    rng = np.random.default_rng(3)
    xy = rng.uniform(0.001, SIDE_M - 0.001, (90_000, 2))
    height = np.zeros(len(xy))
    falling = xy[:, 0] < WEST_M - 0.01
    for top, passed in LAYERS.items():
        hit = falling & (rng.random(len(xy)) > passed)
        height[hit] = top
        falling &= ~hit
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales, header.offsets = np.full(3, 0.001), np.array([EAST, NORTH, 0.0])
    header.add_crs(pyproj.CRS(CRS))
    las = laspy.LasData(header)
    las.x, las.y = xy[:, 0] + EAST, xy[:, 1] + NORTH
    las.z = 120.0 + 0.05 * xy[:, 0] + height + 0.01 * rng.standard_normal(len(xy))
    las.return_number[:] = las.number_of_returns[:] = 1
    path = tmp_path_factory.mktemp("canopy") / "stand.laz"
    las.write(path)
    return path


@pytest.fixture(scope="module")
def by_cell(cloud: Path) -> tuple[Path, dict[str, object]]:
    settings = furrowmap.CanopySettings(cell_m=5.0, pixel_m=0.25)
    return cloud.parent / "cells", furrowmap.canopy([cloud], cloud.parent / "cells", settings, progress=Told())


def test_canopy__a_layer_of_few_stands_has_no_spatial_index(by_cell: tuple[Path, dict[str, object]]) -> None:
    capabilities = pyogrio.read_info(by_cell[0] / "canopy.gpkg", layer="canopy")["capabilities"]
    assert not capabilities["fast_spatial_filter"]


def test_canopy__gap_fraction_is_that_of_the_leaves(by_cell: tuple[Path, dict[str, object]]) -> None:
    layer = gpd.read_file(by_cell[0] / "canopy.gpkg", layer="canopy")
    assert len(layer) == 36
    assert (layer.returns.sum(), layer.area_m2.sum()) == (90_000, pytest.approx(900.0, rel=0.01))
    west = layer[layer.geometry.centroid.x < EAST + WEST_M]
    assert len(west) == 18
    chance = np.sqrt(GAP * (1.0 - GAP) / west.returns)
    assert (np.abs(west.gap_fraction - GAP) < 4.0 * chance).all()
    assert np.average(west.gap_fraction, weights=west.returns) == pytest.approx(GAP, abs=0.01)
    east = layer[layer.geometry.centroid.x > EAST + WEST_M]
    assert (east.gap_fraction == 1.0).all()
    assert east.p95_m.isna().all()
    assert (east.top_height_m == 0.0).all()
    assert west.p99_m.to_numpy() == pytest.approx(np.full(18, 3.25), abs=0.05)
    assert west.p50_m.to_numpy() == pytest.approx(np.full(18, 3.25), abs=0.05)  # 0.4 of 0.76 returns are of the top
    assert west.p25_m.to_numpy() == pytest.approx(np.full(18, 2.25), abs=0.05)
    mean = (0.4 * 3.25 + 0.3 * 2.25 + 0.06 * 1.25) / 0.76
    assert west.mean_height_m.mean() == pytest.approx(mean, abs=0.02)


def test_canopy__profile_is_that_of_the_layers(by_cell: tuple[Path, dict[str, object]]) -> None:
    with (by_cell[0] / "canopy_profile.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    of: dict[str, dict[float, float]] = {}
    for row in rows:
        of.setdefault(row["id"], {})[float(row["from_m"])] = float(row["share"])
        assert float(row["to_m"]) - float(row["from_m"]) == pytest.approx(0.5)
    assert [sum(profile.values()) for profile in of.values()] == pytest.approx([1.0] * 36, abs=1e-4)
    leafy = [profile for profile in of.values() if len(profile) > 1]
    assert len(leafy) == 18
    mean = {height: np.mean([profile[height] for profile in leafy]) for height in leafy[0]}
    assert mean == pytest.approx({0.0: GAP, 0.5: 0.0, 1.0: 0.06, 1.5: 0.0, 2.0: 0.3, 2.5: 0.0, 3.0: 0.4}, abs=0.01)


def test_canopy__height_model_holds_the_highest_returns(by_cell: tuple[Path, dict[str, object]]) -> None:
    with rasterio.open(by_cell[0] / "canopy_height.tif") as raster:
        heights = raster.read(1)
        assert raster.res == (0.25, 0.25)
    west = heights[:, : heights.shape[1] // 2 - 4]
    assert np.nanmax(west) == pytest.approx(3.25, abs=0.08)
    # six returns a pixel: the top layer is not among them in 0.6 ** n of all, n of Poisson's distribution
    n = 100.0 * 0.25**2
    known = np.isfinite(west)
    expected = (1.0 - np.exp(-0.4 * n)) / (1.0 - np.exp(-n))
    assert (west[known] > 3.0).mean() == pytest.approx(expected, abs=0.02)
    assert (by_cell[0] / "canopy_height.qml").is_file()


def test_canopy__of_polygons_by_command(cloud: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    hole = shapely.box(5, 5, 8, 8)
    stands = {
        "leafy": shapely.box(2, 2, 14, 14) - hole,
        "bare": shapely.box(16, 2, 28, 14),
        "far": shapely.box(60, 0, 70, 9),
    }
    shapes = [shapely.transform(shape, lambda en: en + np.array([EAST, NORTH])) for shape in stands.values()]
    gpd.GeoDataFrame({"id": list(stands), "species": ["oak", None, None]}, geometry=shapes, crs=CRS).to_file(
        tmp_path / "stands.gpkg"
    )
    words = ["canopy", str(cloud), "--polygons", str(tmp_path / "stands.gpkg"), "-o", str(tmp_path / "out")]
    assert command_line([*words, "--pixel", "0.25"]) == 0
    shown = capsys.readouterr().out
    assert "gap fraction" in shown
    with (tmp_path / "out" / "canopy.csv").open(encoding="utf-8", newline="") as file:
        rows = {row["id"]: row for row in csv.DictReader(file)}
    assert float(rows["leafy"]["gap_fraction"]) == pytest.approx(GAP, abs=0.015)
    assert float(rows["leafy"]["area_m2"]) == pytest.approx(144.0 - 9.0, rel=0.02)
    assert rows["leafy"]["species"] == "oak"
    assert float(rows["bare"]["gap_fraction"]) == 1.0
    assert (rows["far"]["returns"], rows["far"]["gap_fraction"]) == ("0", "")


def test_canopy__wants_cells_or_polygons(cloud: Path, tmp_path: Path) -> None:
    for wrong in ({}, {"cell_m": 5.0, "polygons": "x"}, {"cell_m": 0.0}, {"cell_m": 5.0, "ground_m": -1.0}):
        with pytest.raises(UsageError):
            furrowmap.CanopySettings(**wrong)  # type: ignore[arg-type]
    shape = shapely.transform(shapely.box(200, 0, 230, 30), lambda en: en + np.array([EAST, NORTH]))
    gpd.GeoDataFrame({"id": ["far"]}, geometry=[shape], crs=CRS).to_file(tmp_path / "far.gpkg")
    with pytest.raises(InputError, match="None of 90,000 points"):
        furrowmap.canopy([cloud], tmp_path / "out", furrowmap.CanopySettings(polygons=tmp_path / "far.gpkg"))
