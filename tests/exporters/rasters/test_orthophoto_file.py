"""True orthophotos as files, against the ground that their frames show."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import rasterio
from pyproj import CRS
from rasterio.enums import ColorInterp

from furrowmap.core.images.colouring import ColourMaker
from furrowmap.core.runtime.errors import InputError
from furrowmap.core.surfaces.grid import Grid
from furrowmap.exporters.files.provenance import Origin
from furrowmap.exporters.rasters.cog import HEIGHT_BAND, with_heights
from furrowmap.exporters.rasters.orthophoto_file import write_orthophoto
from tests.core.images.scenes import cloud, frames_above, texture
from tests.exporters.rasters.written_cogs import write_cog

ORIGIN = Origin("field", "field", [], None, {})
CORNER_M = (500_000.0, 5_900_000.0, 70.0)


def test_orthophoto__is_a_cog_in_true_colours_with_a_mask(tmp_path: Path) -> None:
    frames = frames_above(tmp_path, np.array([[-1.5, 1.0], [1.5, -1.0]]), np.zeros(2))
    frames = replace(frames, poses=replace(frames.poses, xyz_m=frames.poses.xyz_m + CORNER_M))
    maker = ColourMaker(frames, CORNER_M)
    maker.add(np.concatenate(cloud()))
    colours = maker.finish()
    grid = Grid.of_bounds(0.05, (499_988.0, 5_899_992.0, 500_012.0, 5_900_008.0))
    height = np.full(grid.shape, CORNER_M[2], np.float32)
    height[:, :200] = np.nan
    surface, shares = tmp_path / "dsm.tif", list[float]()
    write_cog(surface, grid, with_heights(CRS("EPSG:25832")), [HEIGHT_BAND], [height], ORIGIN)
    photo = tmp_path / "orthophoto.tif"
    area_m2 = write_orthophoto(photo, surface, colours, CORNER_M, ORIGIN, lambda _, share: shares.append(share))
    with rasterio.open(photo) as raster:
        assert raster.tags(ns="IMAGE_STRUCTURE")["LAYOUT"] == "COG"
        assert raster.colorinterp == (ColorInterp.red, ColorInterp.green, ColorInterp.blue)
        assert (raster.crs.to_epsg(), raster.res) == (25832, (0.05, 0.05))
        assert raster.bounds == pytest.approx(grid.bounds_m)
        rgb, seen = raster.read(), raster.dataset_mask() > 0
    assert area_m2 == pytest.approx(seen.sum() * 0.05**2)
    assert not seen[:, :200].any()
    xy = grid.positions_m().reshape(*grid.shape, 2) - CORNER_M[:2]
    beside = seen & (np.abs(xy[..., 0]) > 1.5)
    assert beside.sum() > 6_000
    assert np.sqrt(((rgb[:, beside].T - texture(xy[beside])) ** 2).mean()) < 4.0  # noise, blur of pixels, JPEG
    assert shares[-1] == 1.0


def test_orthophoto__of_no_surface_is_refused(tmp_path: Path) -> None:
    (tmp_path / "dsm.tif").write_text("no surface", encoding="utf-8")
    frames = frames_above(tmp_path, np.zeros((1, 2)), np.zeros(1))
    colours = ColourMaker(frames, CORNER_M).finish()
    with pytest.raises(InputError) as refused:
        write_orthophoto(tmp_path / "o.tif", tmp_path / "dsm.tif", colours, CORNER_M, ORIGIN)
    assert refused.value.code == "not-a-surface"
