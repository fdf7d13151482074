"""What a mosaic takes of a GeoTIFF, and what it is not made of."""

from __future__ import annotations

from pathlib import Path

import geopandas as gpd
import numpy as np
import pytest
import rasterio
import shapely
from pyproj import CRS

from furrowmap.core.runtime.errors import InputError
from furrowmap.core.surfaces.grid import Grid
from furrowmap.exporters.farm.farm_geopackage import check_farm_map
from furrowmap.exporters.farm.surface_file import SurfaceFile, surface_file
from furrowmap.exporters.files.provenance import Origin
from furrowmap.exporters.files.result_folder import ResultFolder
from furrowmap.exporters.rasters.cog import HEIGHT_BAND
from tests.exporters.rasters.written_cogs import write_cog

UTM = "EPSG:32654"
TIMES = {"TIME_START": "2026-06-11T00:00:00Z", "TIME_END": "2026-06-11T01:00:00Z"}
BEGIN_S = 1_781_136_000.0


def written(
    folder: Path, transform: tuple[float, ...], crs: str | None = UTM, tags: dict[str, str] | None = None
) -> SurfaceFile:
    path = folder / "a.tif"
    profile = {"driver": "GTiff", "width": 4, "height": 3, "count": 1, "dtype": "float32", "crs": crs}
    with rasterio.open(path, "w", transform=rasterio.Affine(*transform), **profile) as raster:
        raster.write(np.zeros((1, 3, 4), np.float32))
        raster.update_tags(**(tags or {}))
    return surface_file(path)


def test_surface__of_furrowmap_has_its_grid_bands_and_times(tmp_path: Path) -> None:
    grid = Grid(0.25, 1_600_000, 16_000_000, (5, 7))
    origin = Origin("Surface", "field", [("a.pcap", "0" * 64)], (BEGIN_S, BEGIN_S + 60.0))
    write_cog(tmp_path / "a.tif", grid, CRS(UTM), [HEIGHT_BAND], [np.zeros(grid.shape)], origin)
    found = surface_file(tmp_path / "a.tif")
    assert (found.grid, found.cell_m, found.crs.to_epsg()) == (grid, 0.25, 32654)
    assert found.bounds_m == (400_000.0, 4_000_000.0 - 1.25, 400_001.75, 4_000_000.0)
    assert [(band.description, band.unit) for band in found.bands] == [("height", "m")]
    assert found.span_s == (BEGIN_S, BEGIN_S + 60.0)


@pytest.mark.parametrize(
    ("tags", "span_s"),
    [
        (TIMES, (BEGIN_S, BEGIN_S + 3600.0)),
        ({}, None),
        ({"TIME_START": TIMES["TIME_START"]}, None),
        (TIMES | {"TIME_END": "noon"}, None),
    ],
)
def test_times__of_another_file_are_unknown(
    tags: dict[str, str], span_s: tuple[float, float] | None, tmp_path: Path
) -> None:
    found = written(tmp_path, (0.5, 0, 400_000, 0, -0.5, 4_000_000), tags=tags)
    assert found.span_s == span_s
    assert [(band.description, band.unit) for band in found.bands] == [("band 1", "")]


@pytest.mark.parametrize(("off_cells", "anchored"), [(0.0, True), (5e-4, True), (2e-3, False), (0.5, False)])
@pytest.mark.parametrize("axis", [2, 5])
def test_grid__is_known_where_edges_are_multiples_of_the_cell(
    off_cells: float, anchored: bool, axis: int, tmp_path: Path
) -> None:
    transform = [0.5, 0.0, 400_000.0, 0.0, -0.5, 4_000_000.0]
    transform[axis] += 0.5 * off_cells
    found = written(tmp_path, tuple(transform))
    assert found.grid == (Grid(0.5, 800_000, 8_000_000, (3, 4)) if anchored else None)


@pytest.mark.parametrize(
    ("transform", "crs", "words"),
    [
        ((0.5, 0, 400_000, 0, -0.5, 4_000_000), None, "has no CRS"),
        ((0.5, 0.1, 400_000, 0, -0.5, 4_000_000), UTM, "not square and north-up"),
        ((0.5, 0, 400_000, 0.1, -0.5, 4_000_000), UTM, "not square and north-up"),
        ((0.5, 0, 400_000, 0, 0.5, 4_000_000), UTM, "not square and north-up"),
        ((0.5, 0, 400_000, 0, -0.51, 4_000_000), UTM, "not square and north-up"),
    ],
)
@pytest.mark.filterwarnings("ignore::rasterio.errors.NotGeoreferencedWarning")
def test_surface__of_other_cells_is_refused(
    transform: tuple[float, ...], crs: str | None, words: str, tmp_path: Path
) -> None:
    with pytest.raises(InputError, match=words) as refused:
        written(tmp_path, transform, crs)
    assert refused.value.code == ("surface-unusable" if crs is not None else "raster-no-crs")


def test_farm_map__that_is_a_folder_or_no_geopackage_is_refused(tmp_path: Path) -> None:
    (tmp_path / "text.gpkg").write_text("text")
    (tmp_path / "damaged.gpkg").write_bytes(b"SQLite format 3\0" + b"x" * 500)
    for path, words in (
        (tmp_path, "is a folder"),
        (tmp_path / "text.gpkg", "is not a GeoPackage"),
        (tmp_path / "damaged.gpkg", "is damaged"),
    ):
        with pytest.raises(InputError, match=words) as refused:
            check_farm_map(path)
        assert refused.value.code == "not-a-base"


def test_layer__that_a_result_does_not_have(tmp_path: Path) -> None:
    result = ResultFolder(tmp_path, {}, ("trajectory", "passes"))
    with pytest.raises(InputError, match=r"field\.gpkg has no layer 'tracks'") as refused:
        result.layer("tracks")
    assert refused.value.code == "no-such-layer"
    assert refused.value.lines[2] == "Layers: trajectory, passes."


def test_result__layer_without_a_crs_or_with_infinite_places_is_refused(tmp_path: Path) -> None:
    folder = ResultFolder(tmp_path, {}, ("good", "nowhere", "infinite"))
    for name, easting, crs in (("good", 1.0, "EPSG:6677"), ("nowhere", 1.0, None), ("infinite", np.inf, "EPSG:6677")):
        shape = shapely.Point(easting, 2.0)
        gpd.GeoDataFrame({"k": [1]}, geometry=[shape], crs=crs).to_file(tmp_path / "field.gpkg", layer=name)
    assert len(folder.layer("good")) == 1
    for name in ("nowhere", "infinite"):
        with pytest.raises(InputError, match="has no CRS, or coordinates that are not finite"):
            folder.layer(name)
