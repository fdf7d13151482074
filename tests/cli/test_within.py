"""`--within POLYGONS` of `cloud`, `surface` and `check`: what lies in the polygons, and nothing else."""

from __future__ import annotations

import json
from pathlib import Path

import geopandas as gpd
import laspy
import numpy as np
import pyproj
import pytest
import rasterio
import shapely

from furrowmap.cli.main import command_line

WEST, SOUTH = 500_000.0, 5_300_000.0
HOLE = shapely.box(4.0, 4.0, 7.0, 7.0)
FRAME = shapely.box(1.0, 1.0, 10.0, 10.0).difference(HOLE)


def call(capsys: pytest.CaptureFixture[str], *words: str | Path) -> tuple[int, str, str]:
    status = command_line([str(word) for word in words])
    return status, *capsys.readouterr()


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Returns on a lattice of 0.1 m, 5 cm off all edges, on a plane; polygons in degrees."""
    folder = tmp_path_factory.mktemp("site")
    x, y = (part.ravel() for part in np.meshgrid(np.arange(0.05, 12.0, 0.1), np.arange(0.05, 12.0, 0.1)))
    header = laspy.LasHeader(version="1.4", point_format=6)
    header.scales, header.offsets = np.full(3, 0.001), np.array([WEST, SOUTH, 0])
    header.add_crs(pyproj.CRS.from_epsg(32633))
    las = laspy.LasData(header)
    las.x, las.y, las.z = WEST + x, SOUTH + y, 100.0 + 0.1 * x
    las.return_number[:] = las.number_of_returns[:] = 1
    las.write(folder / "cloud.las")
    for name, shape in (("frame", FRAME), ("far", shapely.transform(FRAME, lambda xy: xy + 500.0))):
        on_map = shapely.transform(shape, lambda xy: xy + np.array([WEST, SOUTH]))
        gpd.GeoDataFrame(geometry=[on_map], crs=32633).to_crs(4326).to_file(folder / f"{name}.geojson")
    rows = [f"P{k},{WEST + e},{SOUTH + n},{100.0 + 0.1 * e}" for k, (e, n) in enumerate([(2, 2), (5, 5), (11, 11)])]
    (folder / "points.csv").write_text("\n".join(["name,e_m,n_m,h_m", *rows]))
    return folder


def inside(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    frame = (x > 1.0) & (x < 10.0) & (y > 1.0) & (y < 10.0)
    return frame & ~((x > 4.0) & (x < 7.0) & (y > 4.0) & (y < 7.0))


def test_cloud__has_the_points_in_the_polygons(site: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ("cloud", site / "cloud.las", "--within", site / "frame.geojson")
    status, out, _ = call(capsys, *words, "-o", tmp_path / "a.copc.laz", "--json")
    assert status == 0
    las = laspy.read(tmp_path / "a.copc.laz")
    assert len(las.points) == json.loads(out)["figures"]["points"] == 90**2 - 30**2
    assert inside(np.asarray(las.x) - WEST, np.asarray(las.y) - SOUTH).all()
    assert json.loads(out)["parameters"]["within"] == "frame.geojson"
    half = f"{WEST},{SOUTH},{WEST + 4},{SOUTH + 12}"  # and in a box
    assert call(capsys, *words, "-o", tmp_path / "b.copc.laz", "--bbox", half)[0] == 0
    assert len(laspy.read(tmp_path / "b.copc.laz").points) == 30 * 90
    other = ("--dst-crs", "EPSG:25833", "-o", tmp_path / "c.copc.laz")  # polygons are moved to the CRS of the output
    assert call(capsys, *words, *other)[0] == 0
    assert len(laspy.read(tmp_path / "c.copc.laz").points) == 90**2 - 30**2


def test_surface__has_cells_in_the_polygons_and_fills_no_hole_of_them(
    site: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ("surface", site / "cloud.las", "--within", site / "frame.geojson", "--ground-method", "none")
    assert call(capsys, *words, "-o", tmp_path, "--cell", "0.1", "--fill", "3")[0] == 0
    with rasterio.open(tmp_path / "dsm.tif") as raster:
        heights = raster.read(1)
        rows, columns = np.mgrid[: raster.height, : raster.width]
        x, y = rasterio.transform.xy(raster.transform, rows, columns)
    seen = np.isfinite(heights)
    wanted = inside(x.ravel() - WEST, y.ravel() - SOUTH).reshape(seen.shape)
    assert (seen == wanted).all()
    assert json.loads((tmp_path / "surfaces.json").read_text())["parameters"]["within"] == "frame.geojson"


def test_check__compares_the_points_in_the_polygons(site: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ("check", site / "cloud.las", site / "points.csv", "--json")
    polygons = ("--within", site / "frame.geojson")
    names = [
        [point["name"] for point in json.loads(call(capsys, *words, *more)[1])["points"]] for more in ((), polygons)
    ]
    assert names == [["P0", "P1", "P2"], ["P0"]]
    status, out, _ = call(capsys, *words, *polygons, "--pairs")
    assert status == 0
    assert json.loads(out)["pairs"]["z"] == 1
    tables = ("check", site / "points.csv", site / "points.csv", "--pairs", "--json", *polygons)
    assert json.loads(call(capsys, *tables)[1])["error"]["code"] == "pairs-need-crs"
    assert json.loads(call(capsys, *tables, "--crs", "EPSG:32633")[1])["pairs"]["z"] == 1


@pytest.mark.parametrize("command", ["cloud", "surface", "check"])
def test_nothing_within__is_an_error_of_three_lines(
    site: Path, tmp_path: Path, command: str, capsys: pytest.CaptureFixture[str]
) -> None:
    targets = {"cloud": ("-o", tmp_path / "a.copc.laz"), "surface": ("-o", tmp_path / "s"), "check": ()}
    points = [site / "points.csv"] if command == "check" else []
    words = (command, site / "cloud.las", *points, *targets[command], "--within", site / "far.geojson")
    status, _, err = call(capsys, *words)
    assert status == 3
    assert len(err.splitlines()) == 3
    assert "none of " in err
    assert "lies in its polygons" in err
    assert list(tmp_path.iterdir()) == []
    assert json.loads(call(capsys, *words, "--json")[1])["error"]["code"] == "within-nothing"
