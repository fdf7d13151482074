"""Surfaces of a result for ties: whose they are, how far off they may be, and their cells."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import rasterio
import shapely

from furrowmap.core.runtime.errors import InputError
from furrowmap.core.surfaces.grid import Grid
from furrowmap.exporters.farm.surface_file import open_surface, surface_file
from furrowmap.exporters.files.provenance import Origin
from furrowmap.exporters.files.result_folder import ResultFolder, open_result
from furrowmap.exporters.rasters.cog import SURFACE_BANDS, Bands, with_heights
from furrowmap.exporters.rasters.tied_surfaces import (
    ERROR_INDEX,
    SPREAD_INDEX,
    cells_inside,
    dated_surface,
    resample_surface,
)
from furrowmap.exporters.vectors.geopackage import write_field
from tests.exporters.farm.result_folders import JAPAN, coverage, field, write_result
from tests.exporters.rasters.written_cogs import write_cog

GRID = Grid(0.5, 40, 60, (8, 12))
ORIGIN = Origin("Surface", "field", [], None, {})


def bands() -> Bands:
    """Height, count, spread and standard error, each with values of its own."""
    height = 10.0 + np.arange(96.0).reshape(GRID.shape) / 8.0
    height[2, 3] = np.nan
    return [height, np.full(GRID.shape, 7.0), np.full(GRID.shape, 0.0625), np.full(GRID.shape, 0.03125)]


def surface(path: Path, count: int = 4) -> Path:
    write_cog(path, GRID, with_heights(JAPAN), SURFACE_BANDS[:count], bands()[:count], ORIGIN)
    return path


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = write_result(tmp_path_factory.mktemp("dated") / "a", name="North field")
    return surface(folder / "dsm.tif").parent


@pytest.mark.parametrize(
    ("stated", "wanted"),
    [
        ((0.03, 0.04, 0.05, 0.3, 0.4, 0.7), (0.03, 0.04, 0.05, np.radians(0.5), np.radians(0.5), np.radians(0.7))),
        ((np.nan,) * 6, (0.05, 0.05, 0.1, 0.005, 0.005, 0.01)),
        ((0.001, 0.001, 0.001, 0.001, 0.001, 0.001), (0.01, 0.01, 0.02, 0.001, 0.001, 0.002)),
        ((0.5, 0.001, np.nan, 5.0, 0.0, np.nan), (0.5, 0.01, 0.1, np.radians(5.0), np.radians(5.0), 0.01)),
    ],
)
def test_sigmas__are_the_sessions_medians_and_no_smaller_than_surfaces_agree(
    stated: tuple[float, ...], wanted: tuple[float, ...], result: Path, tmp_path: Path
) -> None:
    """A third of the poses states ten times as much, or nothing; roll and pitch count together."""
    poses, _ = field()
    sigma = np.tile(stated, (12, 1))
    sigma[::6], sigma[1::6] = 10.0 * sigma[::6], np.nan
    few = {name: values[:12] for name, values in vars(poses).items()} | {"sigma": sigma}
    write_field(tmp_path / "field.gpkg", replace(poses, **few), JAPAN)
    surface(tmp_path / "dsm.tif")
    found = ResultFolder(tmp_path, open_result(result).report, ("trajectory",))
    assert dated_surface(found).sigma == pytest.approx(wanted, rel=1e-6)


def test_surfaces__are_those_of_the_session_with_what_its_tool_touched(result: Path) -> None:
    found = dated_surface(open_result(result))
    assert (found.name, found.folder, found.work_known) == ("North field", result, True)
    assert found.start.isoformat() == "2026-06-11T15:00:00+00:00"
    assert found.after is found.before
    assert found.after.path == (result / "dsm.tif").resolve()
    assert found.worked.symmetric_difference(coverage()).area < 1e-6
    assert found.touched.contains(coverage().buffer(0.49))
    assert coverage().buffer(0.51).contains(found.touched)
    surface(result / "dsm_before.tif")
    both = dated_surface(open_result(result))
    assert (both.after.path.name, both.before.path.name) == ("dsm.tif", "dsm_before.tif")


@pytest.mark.parametrize(("implement", "known"), [({"width_m": 1.7}, False), (None, True)])
def test_work__is_unknown_where_a_tool_left_no_trace(implement: object, known: bool, result: Path) -> None:
    report = open_result(result).report
    report["session"]["implement"] = implement
    found = dated_surface(ResultFolder(result, report, ("trajectory",)))
    assert found.worked.is_empty
    assert found.work_known == known


@pytest.mark.parametrize(("stated", "zone"), [("Asia/Tokyo", "Asia/Tokyo"), (None, "UTC"), ("no/such zone", "UTC")])
def test_time_zone__that_is_not_known_is_utc(stated: str | None, zone: str, result: Path) -> None:
    found = open_result(result)
    found.report["figures"]["time_zone"] = stated
    assert dated_surface(found).zone.key == zone


def test_result__without_a_surface_is_refused(result: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError) as refused:
        dated_surface(replace(open_result(result), folder=tmp_path))
    assert refused.value.code == "tie-no-surface"


@pytest.mark.parametrize(
    "part",
    [GRID, Grid(0.5, 43, 58, (3, 4)), Grid(0.5, 36, 63, (5, 9)), Grid(0.5, 50, 54, (9, 9)), Grid(0.5, 90, 60, (2, 2))],
)
def test_cells__of_any_part_are_those_of_the_file_and_unknown_beside_it(part: Grid, tmp_path: Path) -> None:
    with open_surface(surface_file(surface(tmp_path / "dsm.tif"))) as found:
        read = found.read(part), found.read(part, SPREAD_INDEX), found.read(part, ERROR_INDEX)
    for values, band in zip(read, (bands()[0], bands()[2], bands()[3]), strict=True):
        for row in range(part.rows):
            for column in range(part.columns):
                i, j = row + GRID.north - part.north, column + part.west - GRID.west
                there = 0 <= i < GRID.rows and 0 <= j < GRID.columns
                wanted = band[i, j] if there else np.nan
                assert values[row, column] == pytest.approx(wanted, abs=1e-4, nan_ok=True)


@pytest.mark.parametrize(("count", "spread", "error"), [(1, False, False), (2, False, False), (3, True, False)])
def test_figures__that_a_file_does_not_have_are_unknown(count: int, spread: bool, error: bool, tmp_path: Path) -> None:
    with open_surface(surface_file(surface(tmp_path / "dsm.tif", count))) as found:
        assert np.isfinite(found.read(GRID)).sum() == 95
        assert bool(np.isfinite(found.read(GRID, SPREAD_INDEX)).all()) == spread
        assert bool(np.isfinite(found.read(GRID, ERROR_INDEX)).all()) == error


@pytest.mark.parametrize("nodata", [None, -9999.0, np.nan])
def test_resampled__is_bilinear_between_the_middles_of_cells(nodata: float | None, tmp_path: Path) -> None:
    """A plane, moved by a third of a cell, is still the plane; what is marked as unknown stays so."""
    rows, columns = np.mgrid[0:8, 0:12]
    east, north = 20.1 + 0.5 * (columns + 0.5), 30.2 - 0.5 * (rows + 0.5)
    height = (5.0 + 0.25 * east - 0.5 * north).astype(np.float32)
    if nodata is not None:
        height[6, 10] = nodata
    path = tmp_path / "dsm.tif"
    with rasterio.open(
        path, "w", driver="GTiff", dtype="float32", count=1, height=8, width=12, crs="EPSG:6677", nodata=nodata,
        transform=rasterio.Affine(0.5, 0.0, 20.1, 0.0, -0.5, 30.2),
    ) as raster:  # fmt: skip
        raster.write(height, 1)
    file = surface_file(path)
    assert file.grid is None
    target = Grid(0.5, 39, 62, (13, 16))
    with resample_surface(file, target) as found:
        heights = found.read(target)
    places = target.positions_m().reshape(*target.shape, 2)
    plane = 5.0 + 0.25 * places[..., 0] - 0.5 * places[..., 1]
    within = (np.abs(places - (23.1, 28.2)) < (2.75, 1.75)).all(axis=-1)
    within &= (nodata is None) | (np.abs(places - (25.35, 26.95)) > 0.5).any(axis=-1)
    assert heights[within] == pytest.approx(plane[within], abs=1e-4)
    beyond = (np.abs(places - (23.1, 28.2)) > (3.0, 2.0)).any(axis=-1)
    assert np.isnan(heights[beyond]).all()
    assert np.nanmin(heights) > -100.0


def test_inside__is_by_the_middles_of_cells_or_by_what_a_shape_touches() -> None:
    shape = shapely.box(21.2, 27.3, 22.8, 28.6)
    boxes = shapely.box(*(GRID.positions_m().T - 0.25), *(GRID.positions_m().T + 0.25))
    middles = shapely.points(GRID.positions_m())
    by_middle, by_touch = cells_inside(shape, GRID, touched=False), cells_inside(shape, GRID, touched=True)
    assert by_middle.ravel().tolist() == shapely.contains(shape, middles).tolist()
    assert by_touch.ravel().tolist() == (shapely.area(shapely.intersection(shape, boxes)) > 0.0).tolist()
    assert 0 < by_middle.sum() < by_touch.sum()
    for away in (shapely.Polygon(), shapely.box(0.0, 0.0, 1.0, 1.0)):
        assert not cells_inside(away, GRID, touched=True).any()
