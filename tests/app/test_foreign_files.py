"""Files under the name of another kind, through the functions that users call."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import rasterio
from pyproj import CRS

import furrowmap
from furrowmap.core.readers.boundary_file import read_fields
from furrowmap.core.runtime.errors import InputError
from furrowmap.core.surfaces.grid import Grid
from furrowmap.exporters.farm.surface_file import surface_file
from furrowmap.exporters.files.provenance import Origin
from furrowmap.exporters.rasters.cog import HEIGHT_BAND
from tests.exporters.rasters.written_cogs import write_cog

VECTORS = '<OGRVRTDataSource><OGRVRTLayer name="a"><SrcDataSource>{0}</SrcDataSource></OGRVRTLayer></OGRVRTDataSource>'


@pytest.fixture
def virtual(tmp_path: Path) -> Path:
    """A virtual raster that leads to a surface, named as a GeoTIFF."""
    grid = Grid(0.05, 332_692, 1_931_559, (64, 64))
    write_cog(tmp_path / "secret.tif", grid, CRS("EPSG:6677"), [HEIGHT_BAND], [np.ones(grid.shape)], Origin("Surface"))
    path = tmp_path / "dsm.tif"
    with rasterio.open(tmp_path / "secret.tif") as secret:
        rasterio.shutil.copy(secret, path.with_suffix(".vrt"), driver="VRT")
    path.with_suffix(".vrt").rename(path)
    with rasterio.open(path) as followed:
        assert followed.driver == "VRT", "GDAL follows it, whatever its name"
    return path


def surveyed(path: Path) -> Path:
    points = path.with_name("points.csv")
    points.write_text("name,e_m,n_m,h_m\nP1,16635,96576,1\n")
    return points


@pytest.mark.parametrize(
    "read",
    [lambda path: furrowmap.check(path, surveyed(path)), surface_file],
    ids=["check", "farm"],
)
def test_promise_02__virtual_rasters_are_not_followed(virtual: Path, read: Callable[[Path], object]) -> None:
    with pytest.raises(InputError, match=r"dsm\.tif"):
        read(virtual)


def test_promise_02__virtual_layers_are_not_followed(tmp_path: Path) -> None:
    path = tmp_path / "boundary.geojson"
    path.write_text(VECTORS.format("/etc/passwd"))
    with pytest.raises(InputError, match=r"boundary\.geojson: neither GeoJSON nor"):
        read_fields(path)


@pytest.mark.parametrize("name", ["cloud.pcap", "cloud.tif", "cloud"])
def test_promise_02__a_cloud_is_a_cloud_by_any_name(shared_data: Path, tmp_path: Path, name: str) -> None:
    shutil.copyfile(shared_data / "las/good/small.copc.laz", tmp_path / name)
    assert furrowmap.inspect(tmp_path / name).inspection.format == "las"
