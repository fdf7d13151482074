"""The map of a run: heights against a surface in closed form, and a picture with worked ground over them."""

from __future__ import annotations

import runpy
from pathlib import Path

import geopandas as gpd
import laspy
import numpy as np
import pytest
import shapely
from matplotlib.colors import to_rgb
from matplotlib.image import imread

from furrowmap.core.runtime.errors import InputError

SCRIPT = runpy.run_path(str(Path(__file__).resolve().parents[1] / "scripts" / "picture.py"))
draw_map, ground_around = SCRIPT["draw_map"], SCRIPT["ground_around"]

E0_M, N0_M = 16650.0, 96550.0
TRACK_M = np.column_stack([E0_M + np.linspace(0.0, 4.0, 101), np.full(101, N0_M)])


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
    points = gpd.points_from_xy(*TRACK_M.T, np.full(101, 270.0))
    boxes = [shapely.box(E0_M, N0_M + low_m, E0_M + 4.0, N0_M + low_m + 2.0) for low_m in (-3.0, -1.2, 1.5)]
    layers = {
        "trajectory": gpd.GeoDataFrame({"t_s": np.arange(101)}, geometry=points),
        "passes": gpd.GeoDataFrame({"pass": [1, 2, 3]}, geometry=boxes),
        "overlaps": gpd.GeoDataFrame({"pass_a": [1]}, geometry=[boxes[0] & boxes[1]]),
        "misses": gpd.GeoDataFrame({"kind": ["gap"]}, geometry=[shapely.box(E0_M, N0_M + 0.8, E0_M + 4.0, N0_M + 1.5)]),
        "tool_path": gpd.GeoDataFrame({"implement": ["down"]}, geometry=[shapely.LineString(TRACK_M)]),
        "events": gpd.GeoDataFrame({"kind": ["down", "up"]}, geometry=[points[0], points[-1]]),
    }
    for name, layer in layers.items():
        layer.set_crs("EPSG:6677").to_file(folder / "field.gpkg", layer=name)
    return folder


def test_ground__is_the_surface_as_last_seen(result: Path) -> None:
    grid = ground_around(result / "cloud.copc.laz", TRACK_M)
    rows, cols = grid.height_m.shape
    e_m = grid.e0_m + (np.arange(cols) + 0.5) * grid.cell_m
    n_m = grid.n0_m + (np.arange(rows)[:, None] + 0.5) * grid.cell_m
    truth_m = slope_m(e_m, n_m) + np.where(n_m > N0_M, 0.03, 0.0)
    error_m = grid.height_m - truth_m
    clear_of_step = np.broadcast_to(np.abs(n_m - N0_M) > grid.cell_m, error_m.shape)
    assert np.isfinite(grid.height_m).all()
    assert np.abs(error_m[clear_of_step]).max() < 0.002  # the slope within a cell
    west, east, south, north = grid.extent
    assert west <= E0_M - 3 < E0_M + 7 <= east
    assert south <= N0_M - 3 < N0_M + 3 <= north


def test_map__shows_passes_and_loudly_what_was_worked_twice_or_missed(result: Path, tmp_path: Path) -> None:
    draw_map(result, tmp_path / "map.png", "A slope")
    pixels = imread(tmp_path / "map.png")[..., :3]
    assert pixels.shape[1] == 1500

    def of_colour(colour: str) -> int:
        return int((np.abs(pixels - np.array(to_rgb(colour))).max(axis=2) < 0.1).sum())

    twice, missed = of_colour(SCRIPT["OVERLAP_COLOUR"]), of_colour(SCRIPT["MISSED_COLOUR"])
    # 0.2 and 0.7 m of 4 m, and a square in the legend each
    assert missed / twice == pytest.approx(0.7 / 0.2, rel=0.25)
    greenish = (pixels[..., 1] > pixels[..., 0] + 0.03) & (pixels[..., 1] > pixels[..., 2] + 0.03)
    assert greenish.sum() > 2 * missed, "the second pass"


def test_map__of_a_run_without_an_implement_shows_the_track(result: Path, tmp_path: Path) -> None:
    (tmp_path / "cloud.copc.laz").symlink_to(result / "cloud.copc.laz")
    track = gpd.read_file(result / "field.gpkg", layer="trajectory")
    track.to_file(tmp_path / "field.gpkg", layer="trajectory")
    draw_map(tmp_path, tmp_path / "map.png", "A slope")
    dark = (imread(tmp_path / "map.png")[..., :3] < 0.2).all(axis=2)
    assert dark.any(axis=0).sum() > 400  # a line across 4 of 11 metres


@pytest.mark.parametrize("product", ["cloud.copc.laz", "field.gpkg"])
def test_map__names_the_product_that_is_missing(result: Path, tmp_path: Path, product: str) -> None:
    for path in result.iterdir():
        if path.name != product:
            (tmp_path / path.name).symlink_to(path)
    with pytest.raises(InputError, match=product):
        draw_map(tmp_path, tmp_path / "map.png", "A slope")
