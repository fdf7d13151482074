"""Mosaics of surfaces: exact where cells overlay, the latest session on top, and vouched for where they do not."""

from __future__ import annotations

import hashlib
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import rasterio
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from pyproj import CRS, Transformer
from rio_cogeo import cog_validate

from furrowmap.core.runtime.errors import InputError, RefusedError
from furrowmap.core.surfaces.grid import Grid
from furrowmap.exporters.farm.surface_mosaic import write_mosaic
from furrowmap.exporters.files.provenance import Origin
from furrowmap.exporters.rasters import windows
from furrowmap.exporters.rasters.cog import COUNT_BAND, HEIGHT_BAND, with_heights
from tests.exporters.rasters.written_cogs import write_cog

JAPAN = CRS.from_epsg(6677)
UTM = CRS.from_epsg(6691)
CELL_M = 0.25
WEST, NORTH = 66_600, 386_400
Write = Callable[..., Path]


@pytest.fixture
def write(tmp_path: Path) -> Write:
    """Writes a surface: its heights, and where its north-western corner is in cells from that of the first."""

    def put(
        name: str, height_m: np.ndarray, east: int = 0, south: int = 0, crs: CRS | None = None, cell_m: float = CELL_M
    ) -> Path:
        grid = Grid(cell_m, WEST + east, NORTH - south, height_m.shape)
        count = np.isfinite(height_m) * 5.0
        path = tmp_path / f"{name}.tif"
        write_cog(path, grid, crs or with_heights(JAPAN), [HEIGHT_BAND, COUNT_BAND], [height_m, count], Origin(name))
        return path

    return put


def read(path: Path) -> np.ndarray:
    with rasterio.open(path) as raster:
        return raster.read(masked=True).filled(np.nan)


def eighths(shape: tuple[int, int], seed: int, holes: float = 0.3) -> np.ndarray:
    """Heights that a surface's file keeps exactly, with holes."""
    rng = np.random.default_rng(seed)
    height_m = 270.0 + rng.integers(0, 64, shape) / 8.0
    height_m[rng.random(shape) < holes] = np.nan
    return height_m.astype(np.float32)


def pasted(parts: list[tuple[np.ndarray, int, int]], shape: tuple[int, int]) -> np.ndarray:
    """The later over the earlier: what numpy makes of it."""
    whole = np.full(shape, np.nan, np.float32)
    for height_m, east, south in parts:
        place = whole[south : south + height_m.shape[0], east : east + height_m.shape[1]]
        place[~np.isnan(height_m)] = height_m[~np.isnan(height_m)]
    return whole


@settings(max_examples=5, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    st.lists(
        st.tuples(
            arrays.arrays(
                np.float32,
                st.tuples(st.integers(1, 7), st.integers(1, 9)),
                elements=st.one_of(st.just(np.nan), st.integers(0, 80).map(lambda i: i / 8.0)),
            ),
            st.integers(0, 12),
            st.integers(0, 12),
        ),
        min_size=1,
        max_size=4,
    )
)
def test_latest__covers_the_earlier_cell_by_cell(
    write: Write, tmp_path: Path, parts: list[tuple[np.ndarray, int, int]]
) -> None:
    paths = [write(f"s{i}", *part) for i, part in enumerate(parts)]
    left, top = min(east for _, east, _ in parts), min(south for _, _, south in parts)
    right = max(east + height.shape[1] for height, east, _ in parts)
    bottom = max(south + height.shape[0] for height, _, south in parts)
    shifted = [(height, east - left, south - top) for height, east, south in parts]
    expected = pasted(shifted, (bottom - top, right - left))
    for name in ("farm.tif", "farm.vrt"):
        made = write_mosaic(paths, tmp_path / name)
        assert (made.rows, made.columns) == expected.shape
        found = read(tmp_path / name)
        np.testing.assert_array_equal(found[0], expected)
        with rasterio.open(tmp_path / name) as raster:
            assert raster.transform.c == (WEST + left) * CELL_M
            assert raster.transform.f == (NORTH - top) * CELL_M


def test_bands_of_a_cell__come_from_one_session(write: Write, tmp_path: Path) -> None:
    height_m = eighths((20, 30), 1)
    write_mosaic([write("a", eighths((20, 30), 0, 0.0)), write("b", height_m)], tmp_path / "farm.tif")
    with rasterio.open(tmp_path / "farm.tif") as raster:
        assert raster.descriptions == ("height", "returns")
        digest = hashlib.sha256((tmp_path / "b.tif").read_bytes()).hexdigest()
        assert raster.tags()["INPUT_2"] == f"{tmp_path.name}/b.tif sha256:{digest}"
        np.testing.assert_array_equal(raster.read(2), 5.0)


def test_tiles__join_without_a_seam(write: Write, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    parts = [(eighths((60, 50), 0), 0, 0), (eighths((40, 70), 1), 13, 17)]
    paths = [write(f"s{i}", *part) for i, part in enumerate(parts)]
    monkeypatch.setattr(windows, "WINDOW_CELLS", 16)
    write_mosaic(paths, tmp_path / "farm.tif")
    np.testing.assert_array_equal(read(tmp_path / "farm.tif")[0], pasted(parts, (60, 83)))


def test_mean__is_numpys_with_the_number_of_sessions(write: Write, tmp_path: Path) -> None:
    heights = [eighths((20, 30), seed, 0.5) for seed in range(3)]
    write_mosaic(
        [write(f"s{i}", height_m) for i, height_m in enumerate(heights)],
        tmp_path / "farm.tif",
        mean=True,
    )
    mean_m, number = read(tmp_path / "farm.tif")
    known = np.isfinite(heights).any(axis=0)
    np.testing.assert_allclose(mean_m[known], np.nanmean(np.array(heights)[:, known], axis=0), rtol=1e-7)
    np.testing.assert_array_equal(number[known], np.isfinite(heights).sum(axis=0)[known])
    assert np.isnan(mean_m[~known]).all()


def test_geotiff__is_a_valid_cog_in_the_crs_of_the_surfaces(write: Write, tmp_path: Path) -> None:
    path = write("a", eighths((20, 30), 0))
    write_mosaic([path], tmp_path / "farm.tif")
    write_mosaic([path], tmp_path / "farm.vrt")
    assert cog_validate(tmp_path / "farm.tif", strict=True, quiet=True)[:2] == (True, [])
    with (
        rasterio.open(tmp_path / "farm.tif") as tif,
        rasterio.open(tmp_path / "farm.vrt") as vrt,
        rasterio.open(path) as surface,
    ):
        assert tif.crs == vrt.crs == surface.crs
        assert vrt.tags()["INPUT_1"] == tif.tags()["INPUT_1"]
        assert vrt.tags()["HEIGHTS"] == "JGD2011 ellipsoidal height"


def test_other_crs__has_the_height_of_the_place(write: Write, tmp_path: Path) -> None:
    rows, columns = np.mgrid[0:80, 0:100]
    plane_m = (250.0 + 0.05 * columns * CELL_M - 0.02 * rows * CELL_M).astype(np.float32)
    plane_m[:, 60:64] = np.nan
    made = write_mosaic([write("a", plane_m)], tmp_path / "farm.tif", crs=UTM)
    assert made.cell_m == CELL_M
    with rasterio.Env(GTIFF_REPORT_COMPD_CS=True), rasterio.open(tmp_path / "farm.tif") as raster:
        heights = raster.read(1)
        assert "UTM zone 54N" in raster.crs.to_wkt()
        assert "ellipsoidal height" in raster.crs.to_wkt()
        row, column = np.nonzero(np.isfinite(heights))
        e_m, n_m = raster.xy(row, column)
    e_m, n_m = Transformer.from_crs(UTM, JAPAN, always_xy=True).transform(np.array(e_m), np.array(n_m))
    east, south = e_m / CELL_M - WEST, NORTH - n_m / CELL_M
    inside = (east > 1) & (east < 99) & (south > 1) & (south < 79)
    expected = 250.0 + 0.05 * (east - 0.5) * CELL_M - 0.02 * (south - 0.5) * CELL_M
    away = inside & (np.abs(east - 62) > 3)
    np.testing.assert_allclose(heights[row, column][away], expected[away], atol=2e-3)
    assert inside.sum() > 0.9 * 96 * 78
    assert not ((np.abs(east - 62) < 1.5) & inside).any()  # the hole is not filled


def test_other_crs__keeps_the_ground_that_was_seen(write: Write, tmp_path: Path) -> None:
    """Of a surface full of holes neither more nor less is left than there was."""
    height_m = eighths((200, 200), 3, holes=0.4)
    write_mosaic([write("a", height_m)], tmp_path / "farm.tif", crs=UTM)
    found, number = read(tmp_path / "farm.tif")
    assert np.isfinite(found).sum() == pytest.approx(np.isfinite(height_m).sum(), rel=0.01)
    assert np.array_equal(np.isfinite(found), np.isfinite(number))
    assert np.nanmin(found) >= np.nanmin(height_m)
    assert np.nanmax(found) <= np.nanmax(height_m)


def test_coarser_cells__have_the_mean_of_the_seen_ones(write: Write, tmp_path: Path) -> None:
    height_m = eighths((40, 40), 5, holes=0.7)
    write_mosaic([write("a", height_m)], tmp_path / "farm.tif", cell_m=4 * CELL_M)
    with np.errstate(invalid="ignore"):
        blocks = height_m.reshape(10, 4, 10, 4).transpose(0, 2, 1, 3).reshape(10, 10, 16).astype(np.float64)
        expected = np.nansum(blocks, axis=2) / np.isfinite(blocks).sum(axis=2)
    np.testing.assert_allclose(read(tmp_path / "farm.tif")[0], expected, atol=2e-4)


def test_surfaces_of_two_crs__go_into_the_one_that_is_named(write: Write, tmp_path: Path) -> None:
    here = write("here", np.full((40, 40), 250.0, np.float32))
    write_mosaic([here], tmp_path / "there.tif", crs=UTM)
    with pytest.raises(RefusedError) as refused:
        write_mosaic([here, tmp_path / "there.tif"], tmp_path / "farm.tif")
    assert refused.value.code == "results-crs-mixed"
    write_mosaic([here, tmp_path / "there.tif"], tmp_path / "farm.tif", crs=JAPAN)
    np.testing.assert_allclose(read(tmp_path / "farm.tif")[0][5:35, 5:35], 250.0, atol=1e-4)


def test_coarser_cells__are_asked_for(write: Write, tmp_path: Path) -> None:
    made = write_mosaic([write("a", np.full((40, 40), 250.0, np.float32))], tmp_path / "farm.tif", cell_m=1.0)
    assert (made.cell_m, made.rows, made.columns) == (1.0, 10, 10)
    assert np.nanmax(np.abs(read(tmp_path / "farm.tif")[0] - 250.0)) == 0.0


@pytest.mark.parametrize("options", [{"mean": True}, {"crs": UTM}, {"cell_m": 1.0}])
def test_virtual_raster__computes_nothing(write: Write, tmp_path: Path, options: dict[str, object]) -> None:
    with pytest.raises(RefusedError) as refused:
        write_mosaic([write("a", eighths((4, 4), 0))], tmp_path / "farm.vrt", **options)
    assert refused.value.code == "mosaic-virtual"
    assert not (tmp_path / "farm.vrt").exists()


def test_virtual_raster__moves_with_its_surfaces(write: Write, tmp_path: Path) -> None:
    path = write("a & b", eighths((4, 4), 0))
    write_mosaic([path], tmp_path / "farm.vrt")
    moved = tmp_path / "圃 場"
    moved.mkdir()
    for name in (path.name, "farm.vrt"):
        shutil.move(tmp_path / name, moved / name)
    np.testing.assert_array_equal(read(moved / "farm.vrt")[0], eighths((4, 4), 0))


def test_heights_of_two_kinds__are_not_mixed(write: Write, tmp_path: Path) -> None:
    paths = [write("a", eighths((4, 4), 0)), write("b", eighths((4, 4), 0), crs=CRS.from_user_input("EPSG:6677+6695"))]
    with pytest.raises(RefusedError) as refused:
        write_mosaic(paths, tmp_path / "farm.tif")
    assert refused.value.code == "results-heights-mixed"


def test_surface_itself__is_not_overwritten(write: Write) -> None:
    path = write("a", eighths((4, 4), 0))
    with pytest.raises(RefusedError) as refused:
        write_mosaic([path], path)
    assert refused.value.code == "output-is-input"


def test_what_is_no_surface__is_told(write: Write, tmp_path: Path) -> None:
    text = tmp_path / "text.tif"
    text.write_text("<VRTDataset rasterXSize='1' rasterYSize='1'/>")
    turned = tmp_path / "turned.tif"
    profile = {"driver": "GTiff", "width": 2, "height": 2, "count": 1, "dtype": "float32"}
    with rasterio.open(turned, "w", crs="EPSG:6677", transform=rasterio.Affine(1, 0.5, 0, 0, -1, 0), **profile):
        pass
    for path in (tmp_path / "none.tif", text, turned):
        with pytest.raises(InputError) as refused:
            write_mosaic([write("a", eighths((4, 4), 0)), path], tmp_path / "farm.tif")
        assert refused.value.code == "surface-unusable"


def test_a_surface_that_is_damaged_inside__is_told(write: Write, tmp_path: Path) -> None:
    whole, damaged = write("a", eighths((40, 40), 0)), write("b", eighths((40, 40), 1))
    with rasterio.open(damaged) as raster:
        at = int(raster.get_tag_item("BLOCK_OFFSET_0_0", "TIFF", bidx=1))
        size = int(raster.get_tag_item("BLOCK_SIZE_0_0", "TIFF", bidx=1))
    data = bytearray(damaged.read_bytes())
    data[at : at + size] = b"\xff" * size
    damaged.write_bytes(data)
    with pytest.raises(InputError, match="is damaged") as refused:
        write_mosaic([whole, damaged], tmp_path / "farm.tif")
    assert refused.value.code == "surface-unusable"
    assert not (tmp_path / "farm.tif").exists()
