"""Rasters as others read them: GDAL, rio-cogeo and QGIS."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
import rasterio
from pyproj import CRS
from pyproj.exceptions import CRSError
from rio_cogeo import cog_validate

from furrowmap.core.surfaces.grid import Grid
from furrowmap.exporters.cloud.copc_file import las_wkt
from furrowmap.exporters.files.provenance import Origin
from furrowmap.exporters.rasters.cog import COUNT_BAND, FILLED_BAND, HEIGHT_BAND, Bands, cog_output, with_heights
from tests.exporters.rasters.written_cogs import write_cog

if TYPE_CHECKING:
    from conftest import QgisRoot

GRID = Grid(0.05, 332_692, 1_931_559, (700, 900))
MAP = CRS("EPSG:6677")
ORIGIN = Origin("Surface", "North field", [("a.pcap", "0" * 64)], (1.78e9, 1.78e9 + 60.0), {"statistic": "median"})


def bands() -> Bands:
    rng = np.random.default_rng(0)
    height = 270.0 + rng.normal(0.0, 0.02, GRID.shape)
    height[:100, :200] = np.nan
    return [height, np.isfinite(height) * 7]


@pytest.fixture(scope="module")
def raster(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("cog") / "dsm.tif"
    write_cog(path, GRID, with_heights(MAP), [HEIGHT_BAND, COUNT_BAND], bands(), ORIGIN)
    return path


def test_cog__is_one_and_nothing_lies_beside_it(raster: Path) -> None:
    assert cog_validate(raster, strict=True) == (True, [], [])
    assert [path.name for path in raster.parent.iterdir()] == ["dsm.tif"]


def test_cog__holds_what_was_given_to_a_tenth_of_a_millimetre(raster: Path) -> None:
    with rasterio.open(raster) as file:
        assert tuple(file.transform)[:6] == GRID.transform
        assert file.shape == GRID.shape
        height, count = file.read()
        assert np.allclose(height, bands()[0], atol=1e-4, equal_nan=True)
        assert np.array_equal(count, bands()[1])
        assert np.isnan(file.nodata)
        assert file.overviews(1)


def test_cog__tells_what_where_when_and_of_what(raster: Path) -> None:
    with rasterio.open(raster) as file:
        assert file.descriptions == ("height", "returns")
        assert file.units == ("m", "1")
        tags = file.tags()
        assert tags["SESSION"] == "North field"
        assert tags["INPUT_1"] == f"a.pcap sha256:{'0' * 64}"
        assert tags["TIFFTAG_SOFTWARE"].startswith("furrowmap ")
        assert tags["TIME_START"] == "2026-05-28T20:26:40.000Z"
        assert tags["MEASURED_EPOCH"] == "2026.405"
        told, height = file.tags(1), bands()[0]
        for name, value in (
            ("MINIMUM", np.nanmin),
            ("MAXIMUM", np.nanmax),
            ("MEAN", np.nanmean),
            ("STDDEV", np.nanstd),
        ):
            assert float(told[f"STATISTICS_{name}"]) == pytest.approx(float(value(height)), abs=2e-4)
        assert float(told["STATISTICS_VALID_PERCENT"]) == pytest.approx(100.0 * np.isfinite(height).mean(), abs=0.01)
        assert file.crs.to_epsg() == 6677  # which QGIS and all others know
    with rasterio.Env(GTIFF_REPORT_COMPD_CS=True), rasterio.open(raster) as file:
        crs = CRS.from_wkt(file.crs.to_wkt())
    assert crs.is_compound
    flat, vertical = crs.sub_crs_list
    assert flat.equals(MAP, ignore_axis_order=True)
    assert vertical.name == "JGD2011 ellipsoidal height"


def test_cog__twice_is_the_same_and_tile_by_tile_as_well(raster: Path, tmp_path: Path) -> None:
    for rows in (700, 256):
        again = tmp_path / f"{rows}.tif"
        with cog_output(again, GRID, with_heights(MAP), [HEIGHT_BAND, COUNT_BAND], ORIGIN) as write:
            for top in range(-30, 700, rows):
                tile = Grid(0.05, GRID.west - 10, GRID.north - top, (rows, 920))
                padded = [np.full((rows, 920), np.nan), np.zeros((rows, 920))]
                there = slice(max(top, 0), min(top + rows, 700))
                for band, values in zip(padded, bands(), strict=True):
                    band[there.start - top : there.stop - top, 10:910] = values[there]
                write(tile, padded)
        assert rasterio.open(again).checksum(1) == rasterio.open(raster).checksum(1)
        assert again.read_bytes() == raster.read_bytes()


def test_cog__that_fails_leaves_the_old_one_and_no_scratch(raster: Path, tmp_path: Path) -> None:
    path = tmp_path / "dsm.tif"
    path.write_bytes(b"old")
    with (
        pytest.raises(RuntimeError, match="on the way"),
        cog_output(path, GRID, MAP, [HEIGHT_BAND, FILLED_BAND], ORIGIN) as write,
    ):
        write(GRID, bands())
        raise RuntimeError("on the way")
    assert path.read_bytes() == b"old"
    assert [file.name for file in tmp_path.iterdir()] == ["dsm.tif"]
    with (
        pytest.raises(ValueError, match="cells of"),
        cog_output(path, GRID, MAP, [HEIGHT_BAND, FILLED_BAND], ORIGIN) as write,
    ):
        write(Grid(0.1, 0, 1, (1, 1)), [np.zeros((1, 1))] * 2)


def test_heights__that_are_not_ellipsoidal_or_told_already_leave_the_crs() -> None:
    assert with_heights(MAP, "GSIGEO2011") == MAP
    told = CRS("EPSG:6677+6695")
    assert with_heights(told) == told


def test_crs__that_wkt_1_cannot_express_is_written_as_wkt_2(tmp_path: Path) -> None:
    """The urban grid of Bogotá has a projection that WKT 1 does not know."""
    crs = CRS("EPSG:6247")
    with pytest.raises(CRSError):
        crs.to_wkt("WKT1_GDAL")
    assert with_heights(crs) == crs
    write_cog(tmp_path / "a.tif", GRID, crs, [HEIGHT_BAND], bands()[:1], ORIGIN)
    with rasterio.open(tmp_path / "a.tif") as file:
        assert CRS.from_wkt(file.crs.to_wkt()).coordinate_operation.method_name == "Colombia Urban"
    assert las_wkt(crs) == crs.to_wkt("WKT2_2019")
    assert las_wkt(MAP) == MAP.to_wkt("WKT1_GDAL")


@pytest.mark.parametrize(("heights", "code"), [("EPSG:6695", 10170), ("EPSG:3855", 6677)])
def test_crs__is_told_by_a_code(tmp_path: Path, heights: str, code: int) -> None:
    write_cog(tmp_path / "dsm.tif", GRID, CRS(f"EPSG:6677+{heights[5:]}"), [HEIGHT_BAND], bands()[:1], ORIGIN)
    with rasterio.open(tmp_path / "dsm.tif") as file:
        assert file.crs.to_epsg() == code
    with rasterio.Env(GTIFF_REPORT_COMPD_CS=True), rasterio.open(tmp_path / "dsm.tif") as file:
        assert CRS.from_wkt(file.crs.to_wkt()).sub_crs_list[1].equals(CRS(heights))


def test_qgis__opens_it_in_its_place(raster: Path, qgis: QgisRoot) -> None:
    (layer,) = qgis.open_layers(raster)
    assert (layer["valid"], layer["kind"]) == (True, "raster")
    assert layer["extent"] == pytest.approx(GRID.bounds_m)
