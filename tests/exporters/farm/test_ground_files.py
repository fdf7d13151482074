"""The virtual raster and the virtual point cloud beside a farm map: what QGIS shows of the ground of all sessions."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import rasterio
import shapely

from furrowmap.core.surfaces.grid import Grid
from furrowmap.exporters.files.provenance import Origin
from furrowmap.exporters.rasters.cog import HEIGHT_BAND
from furrowmap.workflows.farm.farm import add_to_farm_map, remove_from_farm_map
from tests.exporters.farm.result_folders import JAPAN, field, write_result
from tests.exporters.rasters.written_cogs import write_cog


def test_ground__of_all_sessions_is_in_two_files_that_hold_none_of_it(tmp_path: Path) -> None:
    west, south, east, north = shapely.bounds(shapely.MultiPoint(field()[0].xyz_m)).tolist()
    grid = Grid.of_bounds(0.5, (west, south, east, north))
    folders = [write_result(tmp_path / f"{k}", name=f"{k}", recording=f"{k}" * 64, day=k) for k in range(3)]
    for k, folder in enumerate(folders[:2]):
        heights = np.full(grid.shape, 10.0 + k, np.float32)
        heights[: grid.rows // 2] = np.nan if k else 10.0
        write_cog(folder / "dsm.tif", grid, JAPAN, [HEIGHT_BAND], [heights], Origin("surface"))
        (folder / "cloud.copc.laz").write_bytes(b"")
    add_to_farm_map(tmp_path / "farm.gpkg", folders)
    moved = tmp_path / "elsewhere"
    moved.mkdir()
    for path in [*folders, *tmp_path.glob("farm*")]:
        shutil.move(path, moved)
    with rasterio.open(moved / "farm_surface.vrt") as raster:
        heights = raster.read(1)
    assert set(np.unique(heights[: grid.rows // 2])) == {10.0}
    assert set(np.unique(heights[grid.rows // 2 :])) == {11.0}  # the later session is on top
    clouds = json.loads((moved / "farm_clouds.vpc").read_text("utf-8"))["features"]
    assert [item["assets"]["data"]["href"] for item in clouds] == ["./0/cloud.copc.laz", "./1/cloud.copc.laz"]
    box = clouds[0]["properties"]["proj:bbox"]
    assert np.allclose([*box[:2], *box[3:5]], [west, south, east, north])
    assert clouds[0]["properties"]["pc:count"] == 1000
    remove_from_farm_map(moved / "farm.gpkg", ["0", "1"])
    assert list(moved.glob("farm_*")) == []
