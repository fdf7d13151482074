"""`furrowmap tie`: results of one field, moved by known amounts, worked in part."""

from __future__ import annotations

import datetime as dt
import json
import re
from collections.abc import Sequence
from pathlib import Path

import geopandas as gpd
import laspy
import numpy as np
import pytest
import rasterio
import shapely
from numpy.typing import NDArray
from pyproj import CRS
from scipy.ndimage import gaussian_filter

import furrowmap
from furrowmap.cli.main import command_line
from furrowmap.core.runtime.errors import InputError, Notice, RefusedError, UsageError
from furrowmap.core.surfaces.grid import Grid
from furrowmap.exporters.files.provenance import Origin
from furrowmap.exporters.rasters.cog import SURFACE_BANDS
from tests.app.told_progress import Told
from tests.exporters.rasters.written_cogs import write_cog

CELL_M, SIDE = 0.05, 320
WEST, NORTH = 332_000, 1_930_000
GRID = Grid(CELL_M, WEST, NORTH, (SIDE, SIDE))
EAST_M, NORTH_M = WEST * CELL_M, NORTH * CELL_M
SOIL_M = 0.05
"""What each working raises the ground by."""
UP_M = (0.04, -0.03, 0.01)
"""What is off in the heights of each date."""
TILT = (0.0, 2e-3, -1e-3)


def strip(number: int) -> shapely.Polygon:
    """Ground that the tool works on a date."""
    return shapely.box(EAST_M + 3, NORTH_M - 4 - 3 * number, EAST_M + 13, NORTH_M - 2 - 3 * number)


def write_result(
    folder: Path,
    number: int,
    *,
    grid: Grid = GRID,
    crs: str = "EPSG:6677",
    known: bool = True,
    relief_m: float = 0.01,
    raised_m: float = 0.0,
    shadows: bool = False,
) -> Path:
    """The result of a date: relief of clods, worked by all dates up to it; something may lie on its corners.

    With shadows, the lower third of what the next date works was not seen.
    """
    rng = np.random.default_rng(number)
    relief = gaussian_filter(np.random.default_rng(99).standard_normal((SIDE, SIDE)), 1.0)
    x, y = (values.reshape(SIDE, SIDE) for values in GRID.positions_m().T)
    before = 271.0 + relief_m * relief / relief.std()
    before[:40] += raised_m
    before[-40:] += raised_m
    for done in range(number):
        before[shapely.contains_xy(strip(done), x, y)] += SOIL_M
    after = before.copy()
    after[shapely.contains_xy(strip(number), x, y)] += SOIL_M
    if shadows:
        after[shapely.contains_xy(strip(number + 1), x, y) & (relief < -0.43 * relief.std())] = np.nan
    off = UP_M[number] + TILT[number] * (x - x.mean()) + 0.002 * rng.standard_normal((SIDE, SIDE))
    folder.mkdir(parents=True)
    start = dt.datetime(2026, 6, 11 + number, tzinfo=dt.UTC).isoformat()
    for name, height in (("dsm.tif", after), ("dsm_before.tif", before)):
        cells = np.full((SIDE, SIDE), 9), np.full((SIDE, SIDE), 0.006), np.full((SIDE, SIDE), 0.002)
        write_cog(folder / name, grid, CRS(crs), SURFACE_BANDS, [height + off, *cells], Origin("surface"))
    sigmas = {"e": 0.02, "n": 0.02, "h": 0.04}
    poses = {f"sigma_{axis}_m": [value] for axis, value in sigmas.items()}
    poses |= {f"sigma_{axis}_deg": [0.1] for axis in ("roll", "pitch", "heading")}
    place = [shapely.Point(x.mean(), y.mean())]
    gpd.GeoDataFrame(poses, geometry=place, crs=crs).to_file(folder / "field.gpkg", layer="trajectory")
    if known:
        worked = [shapely.MultiPolygon([strip(number)])]
        gpd.GeoDataFrame(geometry=worked, crs=crs).to_file(folder / "field.gpkg", layer="coverage")
    report = {
        "furrowmap": "0.1.0",
        "session": {
            "name": f"date {number}",
            "crs": {"map": crs, "coordinates": "", "heights": ""},
            "lidar": {},
            "implement": {"width_m": 2.0},
        },
        "inputs": [],
        "figures": {"start": start, "end": start, "points": 1, "bounds_m": [[0, 0, 0], [1, 1, 1]]},
        "coordinates": {"frame": None, "epoch": None},
        "products": [],
    }
    (folder / "report.json").write_text(json.dumps(report))
    return folder


@pytest.fixture(scope="module")
def season(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    folder = tmp_path_factory.mktemp("season")
    return [write_result(folder / f"day{number}", number) for number in range(3)]


def write_cloud(folder: Path, number: int, parked_m: float) -> None:
    """A cloud of a wall, two posts and a parked vehicle, with the date's error: 5 cm to the east on the second."""
    rng = np.random.default_rng(number)
    along, up, around = rng.random(4000), 1.8 * rng.random(4000), rng.uniform(0.0, np.pi, 4000)
    things = [
        (0.3 + 0.02 * along, 2.0 + 12.0 * along, up),
        *((at + 0.06 * np.cos(around), 0.8 + 0.06 * np.sin(around), up) for at in (5.0, 13.0)),
        (14.5 + parked_m + 0.0 * along, 7.0 + 3.0 * along, up),
        (*rng.uniform(0.0, 16.0, (2, 4000)), np.zeros(4000)),
    ]
    xyz = np.concatenate([np.column_stack(thing) for thing in things])
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales, header.offsets = [0.001, 0.001, 0.001], [EAST_M, NORTH_M - 16.0, 271.0]
    cloud = laspy.LasData(header)
    cloud.xyz = xyz + [EAST_M + 0.05 * number, NORTH_M - 16.0, 271.0] + 0.005 * rng.standard_normal(xyz.shape)
    cloud.classification = np.repeat([1, 2], [len(xyz) - 4000, 4000]).astype(np.uint8)
    cloud.write(folder / "cloud.copc.laz")


def band(path: Path) -> NDArray[np.float32]:
    with rasterio.open(path) as raster:
        values: NDArray[np.float32] = raster.read(1)
    return values


def test_tie__leaves_the_soil_moved_and_nothing_of_the_receivers(season: Sequence[Path], tmp_path: Path) -> None:
    warned, told = list[Notice](), Told()
    account = furrowmap.tie(list(reversed(season)), tmp_path / "out", progress=told, warn=warned.append)
    assert not warned
    thirds = [0.0, 0.0, 1 / 3, 2 / 3]
    for stage in ("finding walls and posts", "tying dates", "writing surfaces"):
        assert told.shares[stage] == pytest.approx([*thirds, *([1.0] if stage == "tying dates" else [])])
    assert [date["name"] for date in account["dates"]] == ["date 0", "date 1", "date 2"]
    tie = next(row for row in account["ties"] if (row["date_a"], row["date_b"]) == (1, 2))
    assert tie["height_m"] == pytest.approx(UP_M[0] - UP_M[1], abs=1e-3)
    assert tie["tilt_east_deg"] == pytest.approx(np.degrees(TILT[0] - TILT[1]), abs=0.005)
    for row in account["changes"]:
        assert row["volume_m3"] == pytest.approx(20.0 * SOIL_M, rel=0.03)
        assert abs(row["untouched_median_m"]) < 1e-3
        assert row["volume_sigma_m3"] < 0.03
    change = band(tmp_path / "out" / "change_01_02.tif")
    assert np.nanmedian(change[110:130, 100:200]) == pytest.approx(SOIL_M, abs=2e-3)
    surfaces = [band(tmp_path / "out" / f"dsm_0{k}.tif") for k in (1, 2, 3)]
    assert np.nanmedian(surfaces[2] - surfaces[0]) == pytest.approx(0.0, abs=1e-3)
    layers = {name: gpd.read_file(tmp_path / "out" / "tie.gpkg", layer=name) for name in ("dates", "ties", "patches")}
    assert len(layers["dates"]) == 3
    assert list(layers["ties"]["cells"]) == [row["cells"] for row in account["ties"]]
    assert set(layers["patches"]["date_b"]) == {2, 3}
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == account["products"]
    assert "Soil moved between dates" in (tmp_path / "out" / "tie.html").read_text()
    with pytest.raises(RefusedError, match="already contains"):
        furrowmap.tie(season, tmp_path / "out")


def test_tie__moves_dates_onto_surveyed_points_or_a_surface(
    season: Sequence[Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    points = tmp_path / "points.csv"
    corners = [(x, y) for x in (1.0, 15.0) for y in (1.0, 15.0)]
    rows = [f"p{k},{EAST_M + x:.3f},{NORTH_M - y:.3f},271.000\n" for k, (x, y) in enumerate(corners)]
    points.write_text("name,e_m,n_m,h_m\n" + "".join(rows))
    settings = furrowmap.TieSettings(points, 0.005)
    account = furrowmap.tie(season, tmp_path / "points", settings)
    assert [date["height_m"] for date in account["dates"]] == pytest.approx([-up for up in UP_M], abs=0.02)
    assert account["dates"][0]["height_m_sigma"] < 0.012
    reference = tmp_path / "survey.tif"
    with rasterio.open(season[0] / "dsm_before.tif") as raster:
        profile, heights = raster.profile, raster.read(1)
    with rasterio.open(reference, "w", **(profile | {"driver": "GTiff", "count": 1})) as raster:
        raster.write(heights - UP_M[0], 1)
    arguments = ["tie", str(season[1]), "-o", str(tmp_path / "surface"), "--reference", str(reference), "--json"]
    assert command_line(arguments) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["dates"][0]["height_m"] == pytest.approx(-UP_M[1], abs=2e-3)
    assert told["dates"][0]["tilt_east_deg"] == pytest.approx(-np.degrees(TILT[1]), abs=0.005)


def test_tie__says_what_cannot_be_tied(season: Sequence[Path], tmp_path: Path) -> None:
    far = Grid(CELL_M, WEST + 4000, NORTH, (SIDE, SIDE))
    apart = write_result(tmp_path / "apart", 2, grid=far, known=False)
    with pytest.raises(InputError) as nothing:
        furrowmap.tie([season[0], apart], tmp_path / "out")
    assert nothing.value.code == "tie-nothing-common"
    assert not (tmp_path / "out").exists()
    warned: list[Notice] = []
    account = furrowmap.tie([*season[:2], apart], tmp_path / "out", warn=warned.append)
    assert {notice.code for notice in warned} == {"tie-none", "tie-work-unknown"}
    assert [date["tied"] for date in account["dates"]] == [True, True, False]
    assert account["dates"][2]["height_m"] is None
    assert len(account["changes"]) == 1
    beside = write_result(tmp_path / "beside", 1, grid=far)
    warned.clear()
    furrowmap.tie([*season[:2], apart, beside], tmp_path / "groups", warn=warned.append)
    assert "tie-groups" in {notice.code for notice in warned}


def test_tie__says_what_is_not_shown_and_what_contradicts(season: Sequence[Path], tmp_path: Path) -> None:
    smooth = [write_result(tmp_path / f"smooth{number}", number, relief_m=0.0) for number in range(2)]
    warned: list[Notice] = []
    furrowmap.tie(smooth, tmp_path / "out", warn=warned.append)
    assert [notice.code for notice in warned] == ["tie-place"]
    raised = write_result(tmp_path / "raised", 1, raised_m=0.4)
    points = tmp_path / "points.csv"
    corners = [(x, y) for x in (1.0, 15.0) for y in (1.0, 15.0)]
    rows = [f"p{k},{EAST_M + x:.3f},{NORTH_M - y:.3f},271.0\n" for k, (x, y) in enumerate(corners)]
    points.write_text("name,e_m,n_m,h_m\n" + "".join(rows))
    warned.clear()
    furrowmap.tie([season[0], raised], tmp_path / "points", furrowmap.TieSettings(points), warn=warned.append)
    assert "tie-contradiction" in {notice.code for notice in warned}


def test_tie__says_how_much_lay_in_shadows(season: Sequence[Path], tmp_path: Path) -> None:
    rough = write_result(tmp_path / "rough", 0, shadows=True)
    warned: list[Notice] = []
    account = furrowmap.tie([rough, season[1]], tmp_path / "out", warn=warned.append)
    assert [notice.code for notice in warned] == ["tie-shadows"]
    assert "34% of the ground worked up to date 1 lay in shadows" in warned[0].text
    (change,) = account["changes"]
    assert change["shadow_share"] == pytest.approx(1.0 / 3.0, abs=0.02)
    assert change["mean_change_sigma_m"] > 0.0
    assert [row["code"] for row in account["warnings"]] == ["tie-shadows"]


def test_tie__has_the_place_from_walls_and_posts_where_the_ground_shows_none(tmp_path: Path) -> None:
    smooth = [write_result(tmp_path / f"smooth{number}", number, relief_m=0.0) for number in range(2)]
    for number, result in enumerate(smooth):
        write_cloud(result, number, parked_m=0.06 * number)
    warned: list[Notice] = []
    account = furrowmap.tie(smooth, tmp_path / "out", warn=warned.append)
    assert [notice.code for notice in warned] == ["tie-moved"]
    assert "pieces of walls and posts are elsewhere on date 1 than on date 0" in warned[0].text
    stated = re.search(r"around easting ([\d.-]+) m, northing ([\d.-]+) m", warned[0].text)
    assert stated is not None
    west, south, east, north = GRID.bounds_m
    assert west - 20.0 < float(stated[1]) < east + 20.0
    assert south - 20.0 < float(stated[2]) < north + 20.0
    (row,) = account["ties"]
    assert row["upright"] > 20
    assert (row["east_m"], row["north_m"]) == pytest.approx((-0.05, 0.0), abs=0.008)
    assert row["east_m_sigma"] < 0.01
    (change,) = account["changes"]
    assert change["volume_m3"] == pytest.approx(20.0 * SOIL_M, rel=0.03)


def test_tie__is_none_where_all_that_both_dates_saw_was_worked_in_between(tmp_path: Path) -> None:
    results = [write_result(tmp_path / f"day{number}", number) for number in range(2)]
    whole = gpd.GeoDataFrame(geometry=[shapely.box(*GRID.bounds_m)], crs="EPSG:6677")
    whole.to_file(results[0] / "field.gpkg", layer="coverage")
    for number, result in enumerate(results):
        write_cloud(result, number, 0.0)
    with pytest.raises(InputError) as nothing:
        furrowmap.tie(results, tmp_path / "out")
    assert nothing.value.code == "tie-nothing-common"


def test_tie__refuses_what_cannot_be_compared(season: Sequence[Path], tmp_path: Path) -> None:
    with pytest.raises(UsageError):
        furrowmap.tie(season[:1], tmp_path / "out")
    other = write_result(tmp_path / "other", 1, crs="EPSG:6678")
    with pytest.raises(RefusedError) as crs:
        furrowmap.tie([season[0], other], tmp_path / "out")
    assert crs.value.code == "tie-crs"
    (other / "dsm.tif").unlink()
    with pytest.raises(InputError) as surface:
        furrowmap.tie([season[0], other], tmp_path / "out")
    assert surface.value.code == "tie-no-surface"
