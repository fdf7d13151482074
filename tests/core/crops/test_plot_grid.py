"""Grids of plots: places, numbering, blocks; against the sample's surveyed parcels and closed forms."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import geopandas as gpd
import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from pyproj import CRS, Geod, Transformer

from furrowmap import Place, plots
from furrowmap.cli.main import command_line
from furrowmap.core.crops.parcel_areas import plot_grid, read_parcels
from furrowmap.core.runtime.errors import InputError
from furrowmap.core.values.plot_grid import PlotGrid

CORNER = np.array([651_000.0, 6_132_600.0])
SMALL = PlotGrid(rows=2, columns=3, length_m=10.0, width_m=2.5, alley_m=1.0, path_m=0.5)


def numbers(grid: PlotGrid) -> list[list[str]]:
    """Identifiers as they lie: a line for each row."""
    found, _ = plot_grid(grid, CORNER, azimuth_deg=90.0)
    lying = {(each.attributes["row"], each.attributes["column"]): each.id for each in found}
    return [[lying[(float(r + 1), float(c + 1))] for c in range(grid.columns)] for r in range(grid.rows)]


def test_plots__lie_where_sizes_and_alleys_put_them() -> None:
    found, notices = plot_grid(SMALL, CORNER, azimuth_deg=90.0)
    assert not notices
    assert [each.id for each in found] == ["1", "2", "3", "4", "5", "6"]
    first, last = found[0].gross.bounds, found[5].gross.bounds
    assert np.subtract(first, [*CORNER, *CORNER]) == pytest.approx((0.0, 0.0, 10.0, 2.5), abs=1e-6)
    assert np.subtract(last, [*CORNER, *CORNER]) == pytest.approx((22.0, 3.0, 32.0, 5.5), abs=1e-6)
    right, _ = plot_grid(dataclasses.replace(SMALL, side="right"), CORNER, azimuth_deg=90.0)
    assert np.subtract(right[5].gross.bounds, [*CORNER, *CORNER]) == pytest.approx((22.0, -5.5, 32.0, -3.0), abs=1e-6)


@pytest.mark.parametrize(
    ("changes", "wanted"),
    [
        ({}, [["1", "2", "3"], ["4", "5", "6"]]),
        ({"serpentine": True}, [["1", "2", "3"], ["6", "5", "4"]]),
        ({"along": "columns"}, [["1", "3", "5"], ["2", "4", "6"]]),
        ({"along": "columns", "serpentine": True, "first": 11}, [["11", "14", "15"], ["12", "13", "16"]]),
        ({"block": "rows", "by_block": True}, [["101", "102", "103"], ["201", "202", "203"]]),
        ({"block": "columns", "by_block": True, "block_size": 2}, [["101", "102", "201"], ["103", "104", "202"]]),
        (
            {"rows": 4, "columns": 2, "block": "rows", "block_size": 2, "by_block": True, "serpentine": True},
            [["101", "102"], ["104", "103"], ["201", "202"], ["204", "203"]],
        ),
    ],
)
def test_numbers__run_as_asked(changes: dict[str, object], wanted: list[list[str]]) -> None:
    assert numbers(dataclasses.replace(SMALL, **changes)) == wanted


@given(st.integers(1, 6), st.integers(1, 6), st.floats(0.0, 360.0), st.booleans(), st.sampled_from(["left", "right"]))
def test_plots__never_overlap_and_have_their_size(
    rows: int, columns: int, azimuth: float, back: bool, side: str
) -> None:
    grid = PlotGrid(rows, columns, 8.0, 1.5, 0.5, 0.25, side, serpentine=back, block="rows", by_block=True)  # type: ignore[arg-type]
    found, _ = plot_grid(grid, CORNER, azimuth_deg=azimuth)
    shapes = np.array([each.gross for each in found], object)
    assert len({each.id for each in found}) == rows * columns
    assert shapely.area(shapes) == pytest.approx(12.0)
    assert shapely.area(shapely.union_all(shapes)) == pytest.approx(12.0 * rows * columns)


def test_two_corners__give_direction_and_length() -> None:
    end = CORNER + 32.0 * np.array([0.6, 0.8])
    grid = dataclasses.replace(SMALL, length_m=None)
    found, notices = plot_grid(grid, CORNER, end)
    assert not notices
    assert shapely.area(found[0].gross) == pytest.approx(25.0)
    assert found[2].gross.distance(shapely.Point(end)) < 1e-6
    _, notices = plot_grid(SMALL, CORNER, CORNER + np.array([32.5, 0.0]))
    assert [notice.code for notice in notices] == ["plots-baseline"]
    assert "32.50 m apart; plots and alleys take 32.00 m" in notices[0].text


@pytest.mark.parametrize(
    ("changes", "end", "azimuth", "says"),
    [
        ({}, None, None, "stated nowhere"),
        ({}, CORNER + 1.0, 90.0, "stated twice"),
        ({"length_m": None}, None, 90.0, "length of a plot is not stated"),
        ({"length_m": None}, CORNER + 1.0, None, "alleys alone take 2.00 m"),
        ({"length_m": None, "alley_m": 0.0}, CORNER + 1e-4, None, "0.00 m apart"),
        ({"by_block": True}, None, 90.0, "there are no blocks"),
        ({"rows": 1000, "columns": 1000}, None, 90.0, "1,000,000 plots"),
    ],
)
def test_what_makes_no_grid__is_refused(changes: dict[str, object], end: object, azimuth: object, says: str) -> None:
    with pytest.raises(InputError, match=says) as refused:
        plot_grid(dataclasses.replace(SMALL, **changes), CORNER, end, azimuth)  # type: ignore[arg-type]
    assert refused.value.code == "plots-grid"


def test_sample__is_drawn_again_from_two_clicks(
    shared_data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Four columns of five; the corners in longitude and latitude, as a map gives them."""
    surveyed = read_parcels(shared_data / "uav_wheat" / "parcels.geojson", CRS.from_epsg(25832))[0]
    table = gpd.read_file(shared_data / "uav_wheat" / "parcels.geojson").set_crs(4258, allow_override=True)
    corner = table.geometry[0].exterior.coords[0]
    end = table.geometry[15].exterior.coords[1]
    gap = surveyed[0].gross.distance(surveyed[1].gross)
    options = [
        f"--corner={corner[0]},{corner[1]}",
        "--corner-crs=EPSG:4258",
        f"--end={end[0]},{end[1]}",
        "--end-crs=EPSG:4258",
    ]
    options += ["--rows=5", "--columns=4", "--alley=1", "--width=2.5", f"--path={gap}", "--along=columns"]
    options += ["--numbering=straight", "--blocks=columns", "--crs=EPSG:25832", "-o", str(tmp_path / "plots.geojson")]
    assert command_line(["plots", *options, "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert (answer["plots"], answer["blocks"], answer["first"], answer["last"]) == (20, 4, "1", "20")
    drawn = read_parcels(tmp_path / "plots.geojson", CRS.from_epsg(25832))[0]
    for one, other in zip(drawn, surveyed, strict=True):
        assert (one.id, one.block) == (other.id, other.block)
        assert one.gross.intersection(other.gross).area > 0.95 * other.gross.area  # paths are 0.45 to 0.60 m wide


@pytest.mark.parametrize("crs", ["EPSG:25832", "EPSG:3857", "EPSG:32633"])
def test_plots__have_their_sizes_on_the_ground(crs: str) -> None:
    """Geodesic lengths (Karney 2013) of the sides of plots, in projections of scales from 0.9996 to 1.75."""
    found = plots(PlotGrid(2, 3, 10.0, 2.5, 1.0, 0.5), None, crs, Place(11.39, 55.33, "EPSG:4258"), azimuth_deg=40.0)
    to_degrees = Transformer.from_crs(crs, 4258, always_xy=True)
    for parcel in found.parcels:
        lon, lat = to_degrees.transform(*shapely.get_coordinates(parcel.gross).T)
        sides = Geod(ellps="GRS80").inv(lon[:-1], lat[:-1], lon[1:], lat[1:])[2]
        assert sorted(sides) == pytest.approx([2.5, 2.5, 10.0, 10.0], rel=4e-3 if crs == "EPSG:3857" else 1e-5)
    end = Place(*to_degrees.transform(*shapely.get_coordinates(found.parcels[2].gross)[1]), "EPSG:4258")
    again = plots(PlotGrid(2, 3, None, 2.5, 1.0, 0.5), None, crs, Place(11.39, 55.33, "EPSG:4258"), end=end)
    assert shapely.equals_exact(again.parcels[5].gross, found.parcels[5].gross, 1e-3)


@pytest.mark.parametrize(
    ("crs", "corner", "end"),
    [
        ("EPSG:25832", Place(10.2, 51.3), None),
        ("EPSG:25832", Place(51.3, 10.2), None),
        ("EPSG:25832", Place(651_000.0, 6_132_600.0), Place(10.2, 51.3)),
        ("EPSG:25832", Place(10.2, 51.3, "EPSG:25833"), None),
        ("EPSG:25832", Place(-120.0, 40.0), None),
        ("EPSG:3857", Place(10.2, 51.3), None),
        ("EPSG:6677", Place(139.8, 36.1), None),
        ("EPSG:3460", Place(-179.9, -17.0), None),
        ("+proj=laea +lat_0=51.3 +lon_0=10.2 +ellps=GRS80 +units=m", Place(10.21, 51.31), None),
    ],
)
def test_corners_in_degrees__are_refused_in_a_projected_crs(crs: str, corner: Place, end: Place | None) -> None:
    """In either order, in each CRS of the map or of a corner; EPSG:3460 lies across the antimeridian."""
    azimuth_deg = 90.0 if end is None else None
    with pytest.raises(InputError, match="looks like longitude and latitude") as refused:
        plots(SMALL, None, crs, corner, end=end, azimuth_deg=azimuth_deg)
    assert refused.value.code == "plots-degrees"
    lines = str(refused.value).splitlines()
    assert len(lines) == 3
    assert ("--corner-crs" if end is None else "--end-crs") in lines[2]


@pytest.mark.parametrize(
    ("crs", "corner"),
    [
        ("EPSG:6677", Place(139.8, 36.1, "EPSG:6677")),
        ("EPSG:6677", Place(12.5, 80.0)),
        ("+proj=laea +lat_0=51.3 +lon_0=10.2 +ellps=GRS80 +units=m", Place(120.5, 40.0)),
    ],
)
def test_small_coordinates__near_the_origin_of_a_map_are_metres(crs: str, corner: Place) -> None:
    found = plots(SMALL, None, crs, corner, azimuth_deg=90.0)
    assert found.parcels[0].gross.bounds[:2] == pytest.approx((corner.x, corner.y))


def test_command__writes_a_geopackage_and_refuses_what_it_cannot(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    least = ["plots", "--corner=651000,6132600", "--azimuth=90", "--rows=2", "--columns=3", "--length=10", "--width=2"]
    file = tmp_path / "plots.gpkg"
    assert command_line([*least, "--crs=EPSG:25832", "-o", str(file)]) == 0
    assert "6 plots, 1 to 6" in capsys.readouterr().out
    table = gpd.read_file(file)
    assert table.crs.to_epsg() == 25832
    assert table["id"].tolist() == ["1", "2", "3", "4", "5", "6"]
    assert table["column"].tolist() == [1, 2, 3, 3, 2, 1]
    assert command_line([*least, "--crs=EPSG:25832", "-o", str(file)]) == 4
    for changed, status, code in (
        ([*least, "--crs=EPSG:25832", "-o", str(tmp_path / "p.dxf")], 2, "usage"),
        ([*least, "--crs=EPSG:4326", "-o", str(tmp_path / "p.gpkg")], 3, "crs-not-projected"),
        ([*least, "--crs=EPSG:1", "-o", str(tmp_path / "p.gpkg")], 3, "crs-unknown"),
        ([*least, "--corner=1;2", "--crs=EPSG:25832", "-o", str(tmp_path / "p.gpkg")], 2, "usage"),
        ([*least, '--corner-crs=LOCAL_CS["x"]', "--crs=EPSG:25832", "-o", str(tmp_path / "p.gpkg")], 3, "polygons-crs"),
    ):
        capsys.readouterr()
        assert command_line([*changed, "--json"]) == status
        assert code in "".join(capsys.readouterr())
