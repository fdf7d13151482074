"""Treatments that are those of other parcels are told by the command for parcels."""

from __future__ import annotations

from pathlib import Path

import geopandas as gpd
import laspy
import numpy as np
import pyproj
import pytest
import shapely

import furrowmap

EAST = 651_500.0
NORTH = 6_133_880.0
CRS = "EPSG:25832"
DOSES = [0, 100, 200, 0, 100, 200, 200, 100, 0, 100, 200, 0]


@pytest.fixture(scope="module")
def trial(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Twelve parcels of 2 m by 1.2 m in a row, as high as their dose, on level soil."""
    folder = tmp_path_factory.mktemp("trial")
    rng = np.random.default_rng(5)
    gross = [shapely.box(3.0 * k, 0.0, 3.0 * k + 2.0, 1.2) for k in range(len(DOSES))]
    xy = rng.uniform((-1.0, -1.0), (36.0, 2.2), (60_000, 2))
    height = 70.0 + 0.01 * rng.standard_normal(len(xy))
    for shape, dose in zip(gross, DOSES, strict=True):
        inside = shapely.contains_xy(shape, *xy.T)
        height[inside] += 0.3 + 0.001 * dose - 0.03 * rng.weibull(1.3, int(inside.sum()))
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales = np.full(3, 0.001)
    header.offsets = np.array([EAST, NORTH, 0.0])
    header.add_crs(pyproj.CRS(CRS))
    las = laspy.LasData(header)
    las.x = xy[:, 0] + EAST
    las.y = xy[:, 1] + NORTH
    las.z = height
    las.return_number[:] = las.number_of_returns[:] = 1
    las.write(folder / "flight.laz")
    placed = [shapely.transform(shape, lambda en: en + np.array([EAST, NORTH])) for shape in gross]
    ids = range(1, len(gross) + 1)
    gpd.GeoDataFrame({"id": list(ids)}, geometry=placed, crs=CRS).to_file(folder / "parcels.gpkg")
    return folder


@pytest.mark.parametrize(("doses", "told"), [(DOSES, False), (DOSES[::-1], True), ([*DOSES[1:], DOSES[0]], True)])
def test_treatments_of_other_parcels__are_told(trial: Path, tmp_path: Path, doses: list[int], told: bool) -> None:
    plan = tmp_path / "plan.csv"
    plan.write_text("id,n_kg_ha\n" + "".join(f"{k},{dose}\n" for k, dose in enumerate(doses, start=1)))
    settings = furrowmap.ParcelSettings(net_inset_m=(0.2, 0.1), treatments=plan)
    account = furrowmap.parcels([trial / "flight.laz"], trial / "parcels.gpkg", tmp_path / "out", settings)
    assert ("treatments-order" in {warning["code"] for warning in account["warnings"]}) == told
