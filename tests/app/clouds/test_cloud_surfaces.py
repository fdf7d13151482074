from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import laspy
import numpy as np
import pyproj
import pytest
import rasterio

import furrowmap
from furrowmap.core.pointclouds.joined_clouds import open_clouds
from furrowmap.core.pointclouds.spool_clouds import cell_for, spool_clouds
from furrowmap.core.pointclouds.surfaces import cloud_tiles
from furrowmap.core.runtime.errors import Cancelled, InputError, Notice, RefusedError
from furrowmap.core.runtime.json_text import plain
from furrowmap.core.surfaces.gaps import bridged
from furrowmap.core.surfaces.grid import Grid
from furrowmap.core.surfaces.spool import PointSpool
from furrowmap.settings import SurfaceSettings
from tests.app.told_progress import Told

UTM = pyproj.CRS.from_epsg(32633)
WEST, SOUTH = 500_000.0, 5_300_000.0
TREE = (12.3, 14.6, 4.0)
"""Place of the middle of its crown, from the south-west corner, and side of the crown."""
POND = (32.0, 8.0, 3.0, 0.20)
"""Place of the middle of a bowl, its radius and its depth."""


def ground_m(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """A slope with a bowl in it; x and y from the south-west corner."""
    away = np.hypot(x - POND[0], y - POND[1]) / POND[2]
    return 100.0 + 0.01 * x + 0.005 * y - POND[3] * np.clip(1.0 - away**2, 0.0, None)


def field(seed: int, points: int = 60_000) -> tuple[np.ndarray, np.ndarray]:
    """Points of a field of 45 by 30 m under a tree, and their classes: 2 ground, 5 tree, 7 noise high above."""
    chance = np.random.default_rng(seed)
    x, y = chance.uniform(0, 45, points), chance.uniform(0, 30, points)
    z = ground_m(x, y)
    classes = np.full(points, 2, np.uint8)
    tree = np.all(np.abs(np.stack([x, y], axis=1) - TREE[:2]) < 0.5 * TREE[2], axis=1) & (chance.random(points) < 0.8)
    z[tree] += chance.uniform(3.0, 5.0, int(tree.sum()))
    classes[tree] = 5
    classes[:20], z[:20] = 7, z[:20] + 80.0
    return np.column_stack([WEST + x, SOUTH + y, z]), classes


def write(
    path: Path,
    xyz: np.ndarray,
    classes: np.ndarray | int = 1,
    crs: pyproj.CRS | None = UTM,
    software: str = "a program",
    scale: Sequence[float] = (0.001, 0.001, 0.001),
) -> Path:
    header = laspy.LasHeader(version="1.4", point_format=6)
    header.scales, header.offsets = np.array(scale), np.floor(xyz.min(axis=0)) if len(xyz) else np.zeros(3)
    header.generating_software = software
    if crs is not None:
        header.add_crs(crs)
    las = laspy.LasData(header)
    las.x, las.y, las.z = xyz.T
    las.classification = np.broadcast_to(classes, len(xyz)).astype(np.uint8)
    las.write(path)
    return path


@pytest.fixture(scope="module")
def clouds(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """The field in two files, cut in the middle, the second compressed; their points are called ground and tree."""
    folder = tmp_path_factory.mktemp("clouds")
    xyz, classes = field(1)
    west = xyz[:, 0] < WEST + 22.5
    return [
        write(folder / "west.las", xyz[west], classes[west]),
        write(folder / "east.laz", xyz[~west], classes[~west]),
    ]


@pytest.fixture(scope="module")
def made(clouds: list[Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("made") / "surfaces"
    furrowmap.surface(clouds, folder, SurfaceSettings(cell_m=0.2), progress=Told())
    return folder


def written(clouds: list[Path]) -> tuple[np.ndarray, np.ndarray]:
    """Points and classes as laspy reads them: places are rounded to millimetres in the files."""
    read = [laspy.read(path) for path in clouds]
    return np.concatenate([las.xyz for las in read]), np.concatenate([np.array(las.classification) for las in read])


def raster(path: Path, band: int = 1) -> tuple[np.ndarray, Grid]:
    """A band, and its grid."""
    with rasterio.open(path) as file:
        cell = file.transform.a
        grid = Grid(cell, round(file.transform.c / cell), round(file.transform.f / cell), file.shape)
        return file.read(band), grid


def expected(points: np.ndarray, grid: Grid, statistic: str = "median") -> np.ndarray:
    """Statistic of the heights in each cell, by numpy."""
    flat, inside = grid.cells_of(points[:, 0], points[:, 1])
    out = np.full(grid.rows * grid.columns, np.nan)
    order = np.argsort(flat[inside], kind="stable")
    cells, first = np.unique(flat[inside][order], return_index=True)
    for cell, heights in zip(cells, np.split(points[inside, 2][order], first[1:]), strict=True):
        out[cell] = getattr(np, statistic)(heights)
    return out.reshape(grid.shape)


def test_dsm__is_the_median_of_all_points_but_noise(clouds: list[Path], made: Path) -> None:
    xyz, classes = written(clouds)
    height, grid = raster(made / "dsm.tif")
    np.testing.assert_allclose(height, expected(xyz[classes != 7], grid), atol=7e-4)
    count, _ = raster(made / "dsm.tif", 2)
    assert count.sum() == np.count_nonzero(classes != 7)
    assert (np.mod([grid.west, grid.north], 1) == 0).all()


def test_dtm__is_the_ground_below_the_tree_where_it_is_seen(clouds: list[Path], made: Path) -> None:
    xyz, classes = written(clouds)
    height, grid = raster(made / "dtm.tif")
    np.testing.assert_allclose(height, expected(xyz[classes == 2], grid), atol=7e-4)


def test_ground_by_smrf__finds_the_tree_by_itself(clouds: list[Path], tmp_path: Path) -> None:
    account = furrowmap.surface(clouds, tmp_path, SurfaceSettings(cell_m=0.2, ground="smrf"))
    assert account["parameters"]["ground"] == "smrf"
    xyz, classes = written(clouds)
    height, grid = raster(tmp_path / "dtm.tif")
    e, n = np.meshgrid(*grid.centres_m())
    away = height - ground_m(e - WEST, n - SOUTH)
    assert np.nanmax(np.abs(away)) < 0.15
    assert np.isfinite(height).sum() > 0.97 * np.isfinite(expected(xyz[classes == 2], grid)).sum()
    above, _ = raster(tmp_path / "height_above_ground.tif")
    crown = np.all(np.abs(np.stack([e - WEST, n - SOUTH]) - np.array(TREE[:2])[:, None, None]) < 1.0, axis=0)
    assert np.nanmedian(above[crown]) == pytest.approx(4.0, abs=0.3)
    assert np.nanpercentile(np.abs(above[~crown & (np.abs(e - WEST - TREE[0]) > 3)]), 99) < 0.05


def test_low_spots__hold_the_water_of_the_bowl(made: Path) -> None:
    """By the numbers of the bowl: water up to the lower rim of a bowl in a slope, by numerical integration."""
    account = json.loads((made / "surfaces.json").read_text())
    step = 0.02
    x, y = np.meshgrid(*(np.arange(middle - 4.0, middle + 4.0, step) for middle in POND[:2]))
    ground = ground_m(x, y)
    rim = ground[np.abs(np.hypot(x - POND[0], y - POND[1]) - POND[2]) < step].min()
    inside = np.hypot(x - POND[0], y - POND[1]) < POND[2]
    volume = np.clip(rim - ground, 0.0, None)[inside].sum() * step**2
    assert account["figures"]["low_spots_volume_m3"] == pytest.approx(volume, rel=0.08)
    depth, _ = raster(made / "low_spots.tif")
    assert np.nanmax(depth) == pytest.approx(rim - ground.min(), abs=0.01)


def test_slope__is_that_of_the_field(made: Path) -> None:
    slope, grid = raster(made / "slope.tif")
    e, _ = np.meshgrid(*grid.centres_m())
    flat = (e - WEST > 16) & (e - WEST < 27)
    assert np.nanmedian(slope[flat]) == pytest.approx(np.degrees(np.arctan(np.hypot(0.01, 0.005))), abs=0.1)


def test_roughness__of_a_smooth_field_is_that_of_its_cells(made: Path) -> None:
    rough, grid = raster(made / "roughness.tif")
    assert grid.cell_m == 1.0
    e, _ = np.meshgrid(*grid.centres_m())
    plain = (e - WEST > 16) & (e - WEST < 27) & np.isfinite(rough)
    assert plain.sum() > 250
    assert rough[plain].max() < 0.002


def test_roughness__along_the_tillage_is_without_its_marks(tmp_path: Path) -> None:
    heading = np.radians(30.0)
    e, n = (axis.ravel() for axis in np.mgrid[0:6:0.04, 0:6:0.04])
    marks = 0.05 * np.sin(2.0 * np.pi * (e * np.cos(heading) - n * np.sin(heading)) / 0.8)
    cloud = write(tmp_path / "a.las", np.column_stack([WEST + e, SOUTH + n, 100.0 + marks]), 2)
    rough = {}
    for tillage in (None, 30.0, 120.0):
        settings = SurfaceSettings(0.05, ground="class", tillage_heading_deg=tillage)
        furrowmap.surface([cloud], tmp_path / "out", settings, overwrite=True)
        rough[tillage] = float(np.nanmedian(raster(tmp_path / "out" / "roughness.tif")[0]))
    assert rough[None] == pytest.approx(0.05 / np.sqrt(2.0), rel=0.15)
    assert rough[30.0] < 0.25 * rough[None]  # strips are as wide as a cell, in which the marks rise
    assert rough[120.0] > 0.8 * rough[None]


def test_windows__leave_no_seams(
    clouds: list[Path], made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("furrowmap.exporters.rasters.windows.WINDOW_CELLS", 37)
    furrowmap.surface(clouds, tmp_path, SurfaceSettings(cell_m=0.2))
    for name in ("hillshade.tif", "slope.tif", "roughness.tif", "low_spots.tif"):
        np.testing.assert_array_equal(raster(tmp_path / name)[0], raster(made / name)[0], err_msg=name)


def test_blocks__leave_no_seams_in_the_ground(clouds: list[Path], monkeypatch: pytest.MonkeyPatch) -> None:
    """One block for the whole field, and one for each tile."""
    found = []
    for block_m in (128.0, 1.0):
        monkeypatch.setattr("furrowmap.core.pointclouds.surfaces.SURFACE_BLOCK_M", block_m)
        opened = open_clouds(clouds)
        with PointSpool(0.05) as points, PointSpool(0.05) as ground:
            spooled = spool_clouds(opened, points, ground)
            tiles = {(t.grid.west, t.grid.north): t for t in cloud_tiles(spooled, "smrf", 0.05)}
        found.append(tiles)
    whole, parts = found
    assert whole.keys() == parts.keys()
    assert len(whole) > 8
    for key, tile in whole.items():
        other = parts[key].dtm
        assert tile.dtm is not None
        assert other is not None
        np.testing.assert_array_equal(tile.dtm.count, other.count)


@pytest.mark.parametrize("cell_m", [1.0, 2.0, 4.0])
def test_ground__is_the_same_in_cells_of_any_size(clouds: list[Path], tmp_path: Path, cell_m: float) -> None:
    """It is found in half a metre: a wide cell has the ground points of the narrow ones in it."""
    for name, size_m in (("narrow", 0.5), ("wide", cell_m)):
        furrowmap.surface(clouds, tmp_path / name, SurfaceSettings(cell_m=size_m, ground="smrf"))
    factor = round(cell_m / 0.5)
    for file in ("dsm.tif", "dtm.tif"):
        narrow, grid = raster(tmp_path / "narrow" / file, 2)
        wide, whole = raster(tmp_path / "wide" / file, 2)
        assert whole == grid.coarser(factor)
        sums = np.zeros(whole.shape)
        row = whole.north - 1 - (grid.north - 1 - np.arange(grid.rows)) // factor
        column = (grid.west + np.arange(grid.columns)) // factor - whole.west
        np.add.at(sums, np.ix_(row, column), np.nan_to_num(narrow))
        np.testing.assert_array_equal(np.nan_to_num(wide), sums, err_msg=file)


def test_filled__gaps_are_filled_and_flagged(clouds: list[Path], tmp_path: Path) -> None:
    furrowmap.surface(clouds, tmp_path, SurfaceSettings(cell_m=0.2, fill_m=2.0))
    xyz, classes = written(clouds)
    height, grid = raster(tmp_path / "dtm.tif")
    flag, _ = raster(tmp_path / "dtm.tif", 5)
    seen = np.isfinite(expected(xyz[classes == 2], grid))
    np.testing.assert_array_equal(flag == 1, np.isfinite(height) & ~seen)
    e, n = np.meshgrid(*grid.centres_m())
    inside = (e - WEST > 0.5) & (e - WEST < 44.5) & (n - SOUTH > 0.5) & (n - SOUTH < 29.5)
    assert np.isfinite(height[inside]).all()
    assert np.abs(height - ground_m(e - WEST, n - SOUTH))[inside].max() < 0.05
    assert not list(tmp_path.glob("unfilled*"))


def test_bridged__fills_holes_and_grows_nothing_outside() -> None:
    seen = np.zeros((60, 60), bool)
    seen[5:40, 5:40] = True
    seen[15:18, 20:30] = False  # a gap three cells wide
    seen[25:38, 10:35] = False  # one of thirteen
    seen[50, 50] = True
    row, column = np.indices(seen.shape)
    plane = 100.0 + 0.1 * row - 0.2 * column
    out = bridged(np.where(seen, plane, np.nan), 3.0)
    expected = seen.copy()
    expected[15:18, 20:30] = True
    assert not np.isfinite(out[30:33, 15:30]).any()
    np.testing.assert_array_equal(np.isfinite(out)[:25], expected[:25])
    np.testing.assert_array_equal(np.isfinite(out)[40:], expected[40:])
    np.testing.assert_allclose(out[np.isfinite(out)], plane[np.isfinite(out)], atol=1e-6)


def test_box_classes_statistic_and_every(clouds: list[Path], tmp_path: Path) -> None:
    xyz, classes = written(clouds)
    box = (WEST + 5.0, SOUTH + 5.0, WEST + 20.0, SOUTH + 20.0)
    settings = SurfaceSettings(0.5, box=box, classes=frozenset({5}), statistic="max", ground="none")
    account = furrowmap.surface(clouds, tmp_path, settings)
    height, grid = raster(tmp_path / "dsm.tif")
    kept = xyz[(classes == 5) & np.all((xyz[:, :2] >= box[:2]) & (xyz[:, :2] <= box[2:]), axis=1)]
    assert account["figures"]["points"] == len(kept)
    np.testing.assert_allclose(height, expected(kept, grid, "max"), atol=7e-4)
    assert not (tmp_path / "dtm.tif").exists()
    thinned = furrowmap.surface(clouds, tmp_path, SurfaceSettings(0.5, every=10), overwrite=True)
    assert thinned["figures"]["points"] == pytest.approx(6000, abs=3)


def test_outliers__points_that_are_alone_do_not_count(tmp_path: Path) -> None:
    xyz, _ = field(2, 20_000)
    path = write(tmp_path / "cloud.las", xyz)  # noise is not called so here
    for kind in ("radius", "statistical"):
        furrowmap.surface([path], tmp_path / kind, SurfaceSettings(0.5, statistic="max", outliers=kind))
        height, _ = raster(tmp_path / kind / "dsm.tif")
        assert np.nanmax(height) < 110.0
    furrowmap.surface([path], tmp_path / "all", SurfaceSettings(0.5, statistic="max"))
    assert np.nanmax(raster(tmp_path / "all" / "dsm.tif")[0]) > 170.0


def test_dst_crs_and_feet__points_go_where_pyproj_puts_them_in_metres(tmp_path: Path) -> None:
    feet = pyproj.CRS.from_epsg(2226)  # NAD83 / California zone 2 (ftUS)
    chance = np.random.default_rng(3)
    xyz = np.column_stack([6_700_000.0 + chance.uniform(0, 300, (5000, 2)), chance.uniform(300, 310, 5000)])
    xyz[:, 1] -= 4_700_000.0
    path = write(tmp_path / "feet.las", xyz, crs=feet)
    with pytest.raises(InputError, match="US survey foot") as refused:
        open_clouds([path])
    assert "--dst-crs EPSG:26910" in refused.value.remedy  # on the same datum
    target = pyproj.CRS.from_epsg(26910)
    clouds = open_clouds([path], dst_crs=target)
    got = np.concatenate([batch.xyz_m for batch in clouds.batches()])
    read = laspy.read(path).xyz
    e, n = pyproj.Transformer.from_crs(feet, target, always_xy=True).transform(read[:, 0], read[:, 1])
    np.testing.assert_allclose(got, np.column_stack([e, n, read[:, 2] * 1200 / 3937]), atol=1e-4)
    assert "heights-in-feet" in {notice.code for notice in clouds.notices}


def test_crs__missing_or_mixed_is_told(tmp_path: Path) -> None:
    xyz, _ = field(4, 100)
    none = write(tmp_path / "none.las", xyz, crs=None)
    with pytest.raises(InputError, match="states no CRS") as refused:
        open_clouds([none])
    assert refused.value.code == "crs-missing"
    assert open_clouds([none], crs=UTM).crs == UTM
    other = write(tmp_path / "other.las", xyz, crs=pyproj.CRS.from_epsg(32632))
    with pytest.raises(InputError, match="32632") as refused:
        open_clouds([none, other], crs=UTM)
    assert refused.value.code == "crs-mixed"


def test_own_clouds__vehicle_and_implement_are_left_out_of_furrowmap_s_only(tmp_path: Path) -> None:
    xyz, _ = field(5, 900)
    classes = np.repeat([2, 64, 65], 300)
    own = open_clouds([write(tmp_path / "own.las", xyz, classes, software="furrowmap 0.1.0")])
    others = open_clouds([write(tmp_path / "others.las", xyz, classes)])
    assert [sum(len(b.xyz_m) for b in clouds.batches()) for clouds in (own, others)] == [300, 900]


def test_cell__is_chosen_by_the_density_where_there_are_points(tmp_path: Path) -> None:
    xyz, _ = field(6, 135_000)  # 100 points a square metre
    far = xyz + np.array([5_000.0, 0.0, 0.0])
    path = write(tmp_path / "cloud.las", np.concatenate([xyz, far]))
    assert cell_for(open_clouds([path])) == 0.2


@pytest.mark.parametrize(
    ("points_in_4_m2", "cell_m"),
    [(6400, 0.05), (1600, 0.1), (400, 0.2), (64, 0.5), (16, 1.0), (13, 1.0), (12, 2.0), (4, 2.0), (3, 5.0), (1, 5.0)],
)
def test_cell__is_the_round_size_with_four_points_or_a_little_fewer(
    points_in_4_m2: int, cell_m: float, tmp_path: Path
) -> None:
    """Cells a tenth smaller than four points want are taken: 13 points are 3.25 a cell of 1 m."""
    corners = np.array([[2.0 * column, 2.0 * row, 0.0] for column in range(4) for row in range(3)])
    xyz = np.repeat(corners, points_in_4_m2, axis=0) + np.array([16_600.5, 96_500.5, 10.0])
    assert cell_for(open_clouds([write(tmp_path / "cloud.las", xyz)])) == cell_m


def test_folder__is_not_overwritten_unasked(made: Path, clouds: list[Path], tmp_path: Path) -> None:
    before = {path.name: path.read_bytes() for path in made.iterdir()}
    with pytest.raises(RefusedError, match=r"dsm\.tif"):
        furrowmap.surface(clouds, made, SurfaceSettings(cell_m=0.2))
    assert {path.name: path.read_bytes() for path in made.iterdir()} == before
    (tmp_path / "report.json").write_text('{"products": ["cloud.copc.laz"]}')
    (tmp_path / "cloud.copc.laz").write_bytes(b"the run's")
    with pytest.raises(RefusedError, match="products of a run"):
        furrowmap.surface(clouds, tmp_path, SurfaceSettings(cell_m=0.2), overwrite=True)
    assert (tmp_path / "cloud.copc.laz").read_bytes() == b"the run's"


def test_nothing_left__is_told_and_leaves_nothing(clouds: list[Path], tmp_path: Path) -> None:
    with pytest.raises(InputError, match="is selected"):
        furrowmap.surface(clouds, tmp_path / "out", SurfaceSettings(0.2, box=(0.0, 0.0, 1.0, 1.0)))
    assert not (tmp_path / "out").exists()


def two_heaps(path: Path) -> Path:
    """A point in the middle of each square metre of two squares of 8 m, which lie 3.2 km apart."""
    x, y = np.meshgrid(np.arange(8) + 0.5, np.arange(8) + 0.5)
    heap = np.column_stack([WEST + x.ravel(), SOUTH + y.ravel(), np.full(64, 100.0)])
    return write(path, np.concatenate([heap, heap + np.array([3200.0, 3200.0, 0.0])]))


def test_grid__that_stays_mostly_empty_is_told_before_the_wait(tmp_path: Path) -> None:
    path, warned = two_heaps(tmp_path / "heaps.las"), []

    def nobody_waits(stage: str, share: float) -> None:
        if stage == "making surfaces":
            raise Cancelled

    with pytest.raises(Cancelled):
        furrowmap.surface([path], tmp_path / "out", SurfaceSettings(0.5), progress=nobody_waits, warn=warned.append)
    (notice,) = (notice for notice in warned if notice.code == "cells-mostly-empty")
    cells = 6415 * 6415
    assert all(words in notice.text for words in ("128 points", f"{cells:,} cells of 0.5 m", "--cell", "--bbox"))
    assert not (tmp_path / "out").exists()


def test_grid__mostly_empty_has_the_surfaces_of_its_heaps_and_the_warning_in_its_account(tmp_path: Path) -> None:
    path, warned = two_heaps(tmp_path / "heaps.las"), []
    settings = SurfaceSettings(1.0, ground="none")
    account = furrowmap.surface([path], tmp_path / "out", settings, warn=warned.append)
    assert account["warnings"] == plain(warned)
    assert "cells-mostly-empty" in {notice.code for notice in warned}
    height, grid = raster(tmp_path / "out" / "dsm.tif")
    assert grid.shape == (3208, 3208)
    slope, _ = raster(tmp_path / "out" / "slope.tif")
    for heights, inset in ((height, 0), (slope, 1)):
        expected_there = np.zeros(grid.shape, bool)
        expected_there[-8 + inset : grid.rows - inset, inset : 8 - inset] = True
        expected_there |= expected_there[::-1, ::-1]
        np.testing.assert_array_equal(np.isfinite(heights), expected_there)


def test_grid__full_of_points_or_small_is_not_called_empty(clouds: list[Path], tmp_path: Path) -> None:
    warned: list[Notice] = []
    furrowmap.surface(clouds, tmp_path / "full", SurfaceSettings(0.2, ground="none"), warn=warned.append)
    furrowmap.surface([two_heaps(tmp_path / "h.las")], tmp_path / "s", SurfaceSettings(5.0), warn=warned.append)
    assert "cells-mostly-empty" not in {notice.code for notice in warned}


def test_account__tells_files_and_lies(clouds: list[Path], tmp_path: Path) -> None:
    data = bytearray(clouds[0].read_bytes())
    (tmp_path / "cut.las").write_bytes(data[:-1000])
    account = furrowmap.surface([tmp_path / "cut.las"], tmp_path / "out", SurfaceSettings(0.5, ground="none"))
    assert [warning["code"] for warning in account["warnings"] if warning["code"] != "roughness-too-coarse"][:1] == [
        "points-missing"
    ]
    assert account["inputs"][0]["name"] == "cut.las"
    with rasterio.open(tmp_path / "out" / "dsm.tif") as file:
        assert file.tags()["INPUT_1"] == f"cut.las sha256:{account['inputs'][0]['sha256']}"
        assert file.crs.to_epsg() == 32633
