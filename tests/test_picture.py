"""The map of a run: heights against a surface in closed form, and a picture that shows them."""

from __future__ import annotations

import runpy
from pathlib import Path

import geopandas as gpd
import laspy
import numpy as np
import pytest
from matplotlib.image import imread

from furrowmap.core.runtime.errors import InputError

SCRIPT = runpy.run_path(str(Path(__file__).resolve().parents[1] / "scripts" / "picture.py"))
Track, draw_map, ground_around = SCRIPT["Track"], SCRIPT["draw_map"], SCRIPT["ground_around"]

E0_M, N0_M = 16650.0, 96550.0
TRACK = Track(np.column_stack([E0_M + np.linspace(0.0, 4.0, 101), np.full(101, N0_M)]), np.arange(101) > 60)


def slope_m(e_m: np.ndarray, n_m: np.ndarray) -> np.ndarray:
    return 270.0 + 0.02 * (e_m - E0_M) - 0.01 * (n_m - N0_M)


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A slope, its northern half raised by 3 cm and seen again a minute later, below a hedge and above a vehicle."""
    e_m, n_m = (a.ravel() for a in np.meshgrid(E0_M + np.arange(-8, 12, 0.025), N0_M + np.arange(-8, 8, 0.025)))
    north, hedge, vehicle = np.flatnonzero(n_m > N0_M), np.arange(0, len(e_m), 7), np.arange(0, len(e_m), 11)
    seen = np.concatenate([np.arange(len(e_m)), north, hedge, vehicle])
    raised_m = np.repeat([0.0, 0.03, 1.5, -2.0], [len(e_m), len(north), len(hedge), len(vehicle)])
    e_m, n_m = e_m[seen], n_m[seen]
    h_m, t_s = slope_m(e_m, n_m) + raised_m, np.where(raised_m == 0.03, 60.0, 0.0)
    classification = np.where(raised_m < 0, 64, 1)
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales, header.offsets = [0.0001] * 3, [E0_M, N0_M, 270.0]
    las = laspy.LasData(header)
    las.x, las.y, las.z, las.gps_time, las.classification = e_m, n_m, h_m, t_s, classification
    folder = tmp_path_factory.mktemp("result")
    las.write(folder / "cloud.copc.laz")
    points = gpd.points_from_xy(*TRACK.en_m.T, np.full(101, 270.0))
    motion = np.where(TRACK.reverse, "reverse", "forward")
    gpd.GeoDataFrame({"motion": motion}, geometry=points, crs="EPSG:6677").to_file(
        folder / "field.gpkg", layer="trajectory"
    )
    return folder


def test_ground__is_the_surface_as_last_seen(result: Path) -> None:
    grid = ground_around(result / "cloud.copc.laz", TRACK)
    rows, cols = grid.height_m.shape
    e_m = grid.e0_m + (np.arange(cols) + 0.5) * grid.cell_m
    n_m = grid.n0_m + (np.arange(rows)[:, None] + 0.5) * grid.cell_m
    truth_m = slope_m(e_m, n_m) + np.where(n_m > N0_M, 0.03, 0.0)
    error_m = grid.height_m - truth_m
    clear_of_step = np.broadcast_to(np.abs(n_m - N0_M) > grid.cell_m, error_m.shape)
    assert np.isfinite(grid.height_m).all()
    assert np.abs(error_m[clear_of_step]).max() < 0.002  # the slope within a cell
    west, east, south, north = grid.extent
    assert west <= E0_M - 6 < E0_M + 10 <= east
    assert south <= N0_M - 6 < N0_M + 6 <= north


def test_map__is_a_picture_with_relief_and_both_directions(result: Path, tmp_path: Path) -> None:
    draw_map(result, tmp_path / "map.png", "A slope")
    pixels = imread(tmp_path / "map.png")[..., :3]
    assert pixels.shape[1] == 1500
    assert np.mean(np.ptp(pixels, axis=2) > 0.05) > 0.5  # most of it is coloured ground, not paper
    for colour in ((0xC8, 0x10, 0x2E), (0x1F, 0x4F, 0xBF)):
        assert (np.abs(pixels - np.array(colour) / 255).max(axis=2) < 0.02).sum() > 100


@pytest.mark.parametrize("product", ["cloud.copc.laz", "field.gpkg"])
def test_map__names_the_product_that_is_missing(result: Path, tmp_path: Path, product: str) -> None:
    for path in result.iterdir():
        if path.name != product:
            (tmp_path / path.name).symlink_to(path)
    with pytest.raises(InputError, match=product):
        draw_map(tmp_path, tmp_path / "map.png", "A slope")
