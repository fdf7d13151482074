"""Areas of files on the map: which points lie in them, against closed forms."""

from __future__ import annotations

import zipfile
from pathlib import Path

import geopandas as gpd
import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from pyproj import CRS
from shapely import affinity

from furrowmap.core.readers.areas.area import MANY_POLYGONS, Area, read_area
from furrowmap.core.readers.areas.rings import pixels_in, ring_at, rings_of
from furrowmap.core.runtime.errors import InputError
from furrowmap.core.surfaces.grid import Grid

MAP = CRS.from_epsg(25832)
EAST, NORTH = 651_000.0, 6_132_600.0
OUTER = shapely.box(EAST, NORTH, EAST + 20.0, NORTH + 10.0)
HOLE = shapely.box(EAST + 5.0, NORTH + 2.0, EAST + 9.0, NORTH + 6.0)
RING = OUTER.difference(HOLE)
APART = shapely.box(EAST + 30.0, NORTH, EAST + 34.0, NORTH + 4.0)

places = st.lists(st.tuples(*[st.integers(-99, 999)] * 2), min_size=1, max_size=60)


def corner(shape: shapely.Polygon) -> np.ndarray:
    return np.array([[*ring] for ring in shape.exterior.coords])


@settings(max_examples=40, deadline=None)
@given(places=places, copies=st.sampled_from([1, MANY_POLYGONS]))
def test_area__holds_what_lies_in_a_polygon_and_in_none_of_its_holes(
    places: list[tuple[int, int]], copies: int
) -> None:
    """Frames of 60 m with a hole of 20 m, side by side; half a centimetre off all edges."""
    frames = [
        shapely.Polygon(shapely.box(x, 0, x + 60, 60).exterior, [shapely.box(x + 20, 20, x + 40, 40).exterior])
        for x in 70.0 * np.arange(copies)
    ]
    xy = np.array(places) / 2.0 + 0.005
    x, y = xy[:, 0] % 70.0, xy[:, 1]
    there = (xy[:, 0] > 0.0) & (xy[:, 0] < 70.0 * copies) & (x < 60.0) & (y > 0.0) & (y < 60.0)
    wanted = there & ~((x > 20.0) & (x < 40.0) & (y > 20.0) & (y < 40.0))
    assert (Area(Path("a.gpkg"), tuple(frames)).contains(xy) == wanted).all()


@pytest.mark.parametrize("kind", ["gpkg", "zip", "geojson", "kml", "csv"])
def test_area__is_the_same_from_every_format(tmp_path: Path, kind: str) -> None:
    table = gpd.GeoDataFrame({"id": [1, 2]}, geometry=[RING, APART], crs=MAP)
    path = tmp_path / f"area.{kind}"
    if kind == "zip":
        table.to_crs(25833).to_file(tmp_path / "a.shp")
        with zipfile.ZipFile(path, "w") as packed:
            for part in tmp_path.glob("a.*"):
                packed.write(part, part.name)
    elif kind == "csv":  # which has no holes
        rows = [f"{k},{e},{n}" for k, shape in enumerate([OUTER, APART]) for e, n in corner(shape)[:-1]]
        path.write_text("\n".join(["id,e_m,n_m", *rows]))
    else:
        drivers = {"gpkg": "GPKG", "geojson": "GeoJSON", "kml": "LIBKML"}
        table.to_crs(25832 if kind == "gpkg" else 4258).to_file(path, driver=drivers[kind])
    area = read_area(path, MAP)
    x, y = np.meshgrid(np.arange(-0.95, 36.0, 0.5), np.arange(-0.95, 12.0, 0.5))
    xy = np.column_stack([x.ravel(), y.ravel()])
    near = np.add(xy, (EAST, NORTH))
    outer = ((xy > 0.0) & (xy < (20.0, 10.0))).all(axis=1)
    hole = ((xy > (5.0, 2.0)) & (xy < (9.0, 6.0))).all(axis=1) if kind != "csv" else False
    apart = ((xy > (30.0, 0.0)) & (xy < (34.0, 4.0))).all(axis=1)
    assert (area.contains(near) == (outer & ~hole | apart)).all()


def test_area__of_damaged_polygons_is_refused(tmp_path: Path) -> None:
    bow = shapely.Polygon([(0, 0), (1, 1), (1, 0), (0, 1)])
    gpd.GeoDataFrame(geometry=[APART, bow], crs=MAP).to_file(tmp_path / "bow.gpkg")
    (tmp_path / "text.csv").write_text("id,e_m,n_m\n1,0,0\n1,1,0\n")
    for name, code, words in (
        ("bow.gpkg", "within-invalid", "polygon 2 crosses itself"),
        ("text.csv", "within-unreadable", "2 corners"),
    ):
        with pytest.raises(InputError, match=words) as refused:
            read_area(tmp_path / name, MAP)
        assert refused.value.code == code


@pytest.mark.parametrize("turn_deg", [0.0, 4.0, 67.0])
def test_pixels_in__are_those_whose_middle_shapely_finds_inside(turn_deg: float) -> None:
    shape = shapely.box(0.013, 0.017, 4.0, 2.0).difference(shapely.box(1.007, 0.501, 2.003, 1.203))
    turned = affinity.translate(affinity.rotate(shape, turn_deg), 651_000.0, 6_132_600.0)
    grid = Grid.of_bounds(0.04, turned.buffer(0.1).bounds)
    expected = shapely.contains_xy(turned, *np.meshgrid(*grid.centres_m()))
    assert (pixels_in(turned, grid) == expected).all()


@pytest.mark.parametrize("turned", [False, True])
def test_borders__belong_to_the_plot_east_or_north_of_them_alone(turned: bool) -> None:
    """Plots of a metre side by side share their edges and corners; pixels with a middle there belong to the same."""
    plots = [shapely.box(x, y, x + 1.0, y + 1.0) for y in range(3) for x in range(4)]
    plots = [shapely.reverse(plot) for plot in plots] if turned else plots
    x, y = (part.ravel() for part in np.meshgrid(np.arange(-0.5, 5.0, 0.5), np.arange(-0.5, 4.0, 0.5)))
    within = (x >= 0.0) & (x < 4.0) & (y >= 0.0) & (y < 3.0)
    number = np.where(within, np.floor(x) + 4.0 * np.floor(y), -1.0)
    assert ring_at(rings_of(plots, (0.0, 0.0)), x, y).tolist() == number.tolist()
    grid = Grid.of_bounds(1.0, (-1.0, -1.0, 5.0, 4.0))
    middle_x, middle_y = np.meshgrid(*grid.centres_m())
    for k, plot in enumerate(plots):
        moved = affinity.translate(plot, 0.5, 0.5)
        own = (middle_x == k % 4 + 0.5) & (middle_y == k // 4 + 0.5)
        assert (pixels_in(moved, grid) == own).all()
