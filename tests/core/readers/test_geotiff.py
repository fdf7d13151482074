"""GeoTIFFs that are none, are damaged, or state what cannot be."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rasterio

from furrowmap.core.accuracy.point_check import surface_at_points
from furrowmap.core.readers.geotiff import open_geotiff
from furrowmap.core.runtime import memory
from furrowmap.core.runtime.errors import InputError, RefusedError
from furrowmap.exporters.farm.surface_file import surface_file
from furrowmap.results import read_raster


def unusable(path: Path, why: str) -> InputError:
    return InputError("test", what=f"{path} {why}.", meaning="It is not used.", remedy="Use another.")


def write(path: Path, transform: rasterio.Affine, **options: Any) -> Path:
    profile = {"driver": "GTiff", "width": 64, "height": 64, "count": 1, "dtype": "float32", "crs": "EPSG:6677"}
    with rasterio.open(path, "w", **{**profile, "transform": transform, **options}) as raster:
        raster.write(np.ones((1, 64, 64), np.float32))
    return path


SOUND = rasterio.Affine(0.5, 0, 1000, 0, -0.5, 2000)


@pytest.mark.parametrize(
    "transform",
    [
        rasterio.Affine(0.0, 0, 5, 0, 0.0, 5),
        rasterio.Affine(1, 1, 0, 1, 1, 0),
        rasterio.Affine(float("nan"), 0, 0, 0, -1, 0),
        rasterio.Affine(1e308, 0, float("inf"), 0, -1, 0),
    ],
)
def test_cells_without_an_extent__are_refused(transform: rasterio.Affine, tmp_path: Path) -> None:
    path = write(tmp_path / "flat.tif", transform)
    for read in (lambda: surface_file(path), lambda: read_raster(path), lambda: surface_at_points(path, path)):
        with pytest.raises(InputError, match="states cells without an extent"):
            read()


def test_promise_02__a_vrt_named_tif_is_not_followed(tmp_path: Path) -> None:
    secret = write(tmp_path / "secret.tif", SOUND)
    vrt = tmp_path / "innocent.tif"
    vrt.write_text(
        f'<VRTDataset rasterXSize="64" rasterYSize="64"><VRTRasterBand dataType="Float32" band="1"><SimpleSource>'
        f"<SourceFilename>{secret}</SourceFilename></SimpleSource></VRTRasterBand></VRTDataset>"
    )
    with rasterio.open(vrt) as followed:  # as rasterio does unasked
        assert followed.driver == "VRT"
    with pytest.raises(InputError, match="cannot be read as a GeoTIFF"), open_geotiff(vrt, unusable):
        pass


def test_promise_10__a_raster_larger_than_the_memory_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "huge.tif"
    profile = {"driver": "GTiff", "width": 10**6, "height": 10**6, "count": 1, "dtype": "uint8", "crs": "EPSG:6677"}
    with rasterio.open(
        path, "w", tiled=True, blockxsize=4096, blockysize=4096, BIGTIFF="YES", SPARSE_OK=True, **profile
    ):
        pass
    assert path.stat().st_size < 5_000_000
    with pytest.raises(RefusedError, match=r"(?s)needs 1 TB of memory.*--allow-large"):
        read_raster(path)
    monkeypatch.setattr(memory, "FREE_BYTES", 1)
    monkeypatch.setattr(memory, "free_memory_bytes", lambda: 4096 * 4096)
    with pytest.raises(RefusedError, match="A block of"), open_geotiff(path, unusable):
        pass
