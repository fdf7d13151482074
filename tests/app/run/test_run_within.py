"""`run(within=…)`: cloud and surface of the ground in polygons; the drive and the worked ground are whole."""

from __future__ import annotations

import tomllib
from pathlib import Path

import geopandas as gpd
import laspy
import numpy as np
import pytest
import rasterio
import shapely

import furrowmap
from furrowmap.core.runtime.errors import InputError
from furrowmap.exporters.files.result_folder import PREVIEW_DSM


def polygons(path: Path, *shapes: shapely.Geometry) -> Path:
    """A file in degrees, as GIS users have it."""
    gpd.GeoDataFrame({"name": range(len(shapes))}, geometry=list(shapes), crs=6677).to_crs(6668).to_file(path)
    return path


def test_run__maps_the_ground_in_the_polygons(
    simulated: furrowmap.Simulated, result: furrowmap.Result, tmp_path: Path
) -> None:
    whole = laspy.read(result.path / "cloud.copc.laz")
    east, north = (float(np.median(axis)) for axis in (whole.x, whole.y))
    parts = [
        shapely.box(east - 3.0, north - 3.0, east, north + 3.0),
        shapely.box(east + 1.0, north, east + 2.5, north + 1),
    ]
    chosen = furrowmap.run(
        simulated.session, tmp_path / "part", within=polygons(tmp_path / "part.gpkg", *parts), progress=lambda *_: None
    )
    cloud = laspy.read(chosen.path / "cloud.copc.laz")
    ground = shapely.union_all(parts)
    assert shapely.distance(ground, shapely.points(cloud.x, cloud.y)).max() < 0.002
    expected = int(np.count_nonzero(shapely.contains_xy(ground, whole.x, whole.y)))
    assert len(cloud.points) == pytest.approx(expected, rel=2e-3)  # at the edges coordinates are rounded
    figures, before = chosen.report["figures"], result.report["figures"]
    assert figures["points"] == len(cloud.points)
    assert figures["points_elsewhere_left_out"] == before["points"] - figures["points"]
    for key in ("worked_area_m2", "distance_m", "scans"):
        assert figures[key] == before[key]
    stated = tomllib.loads((chosen.path / "session.toml").read_text(encoding="utf-8"))["field"]["within"]
    assert Path(simulated.session.parent, stated).resolve() == (tmp_path / "part.gpkg").resolve()
    assert "part.gpkg" in {Path(record["name"]).name for record in chosen.report["inputs"]}


def test_preview__maps_the_ground_in_the_polygons(
    simulated: furrowmap.Simulated, result: furrowmap.Result, tmp_path: Path
) -> None:
    whole = laspy.read(result.path / "cloud.copc.laz")
    east, north = (float(np.median(axis)) for axis in (whole.x, whole.y))
    part = polygons(tmp_path / "part.gpkg", shapely.box(east - 3.0, north - 3.0, east, north + 3.0))
    seen = []
    for name, within in (("all", None), ("part", part)):
        furrowmap.preview(simulated.session, tmp_path / name, within=within, progress=lambda *_: None)
        with rasterio.open(tmp_path / name / PREVIEW_DSM) as raster:
            known = raster.read(1, masked=True).count()
            seen.append((known, raster.bounds))
    assert 0 < seen[1][0] < 0.7 * seen[0][0]
    assert seen[1][1].right <= east + 0.5
    with pytest.raises(InputError) as raised:
        furrowmap.preview(simulated.session, tmp_path / "none", within=tmp_path / "missing.gpkg")
    assert "missing.gpkg" in raised.value.what


def test_polygons_elsewhere__are_told_before_the_work(simulated: furrowmap.Simulated, tmp_path: Path) -> None:
    far = polygons(tmp_path / "far.geojson", shapely.transform(shapely.box(0.0, 0.0, 1.0, 1.0), lambda xy: xy + 9e6))
    with pytest.raises(InputError) as raised:
        furrowmap.run(simulated.session, tmp_path / "out", within=far)
    assert raised.value.code == "boundary-elsewhere"
    assert not (tmp_path / "out").exists()
