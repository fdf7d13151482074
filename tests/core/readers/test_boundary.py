"""Field boundaries from vector files."""

from __future__ import annotations

import json
from pathlib import Path

import geopandas as gpd
import numpy as np
import pytest
import shapely
from pyproj import Geod

from furrowmap.core.readers.boundary_file import read_fields
from furrowmap.core.readers.isoxml.content import open_task_sets, read_content
from furrowmap.core.readers.reader import Recognised
from furrowmap.core.runtime.errors import InputError

FIELD = shapely.Polygon(
    [(140.02, 36.87), (140.021, 36.87), (140.021, 36.871), (140.02, 36.871)],
    [[(140.0204, 36.8704), (140.0206, 36.8704), (140.0206, 36.8706), (140.0204, 36.8706)]],
)


def read_boundary(path: Path) -> shapely.Geometry:
    """All fields of a file as one."""
    return shapely.union_all([field.outline for field in read_fields(path)[0]])


def test_geojson__is_read_with_its_holes_as_longitude_and_latitude(tmp_path: Path) -> None:
    file = tmp_path / "圃場 1.geojson"
    file.write_text(json.dumps(shapely.geometry.mapping(FIELD)))
    assert read_boundary(file).equals(FIELD)


@pytest.mark.parametrize(
    ("suffix", "driver"), [("gpkg", "GPKG"), ("fgb", "FlatGeobuf"), ("shp", "ESRI Shapefile"), ("geojson", "GeoJSON")]
)
@pytest.mark.parametrize("crs", ["EPSG:6668", "EPSG:6677"])
def test_every_format_and_crs__gives_the_same_field(tmp_path: Path, suffix: str, driver: str, crs: str) -> None:
    """JGD2011 in degrees, and its plane rectangular zone IX; GeoJSON is always in degrees."""
    table = gpd.GeoDataFrame({"name": ["North"]}, geometry=[FIELD], crs="EPSG:6668")
    file = tmp_path / f"field.{suffix}"
    table.to_crs(crs if driver != "GeoJSON" else "EPSG:6668").to_file(file, driver=driver, engine="pyogrio")
    field = read_boundary(file)
    assert field.symmetric_difference(FIELD).area < 1e-9 * FIELD.area + 1e-12
    assert field.area == pytest.approx(FIELD.area, rel=1e-5)


@pytest.mark.parametrize(("crs", "lon", "lat"), [(30169, 140.02, 36.87), (27700, -1.5, 52.5), (31467, 9.2, 48.8)])
def test_a_boundary_on_a_datum_of_the_past_is_refused(tmp_path: Path, crs: int, lon: float, lat: float) -> None:
    shape = shapely.box(lon, lat, lon + 0.001, lat + 0.001)
    gpd.GeoDataFrame(geometry=[shape], crs="EPSG:4326").to_crs(crs).to_file(tmp_path / "f.gpkg", engine="pyogrio")
    with pytest.raises(InputError, match=r"differ by \d{2,3} m") as refused:
        read_boundary(tmp_path / "f.gpkg")
    assert refused.value.code == "boundary-datum"


def test_several_fields__are_all_read_and_other_geometries_do_not_count(tmp_path: Path) -> None:
    other = shapely.transform(FIELD, lambda xy: xy + np.array([0.01, 0.0]))
    shapes = [FIELD, other, shapely.Point(140.0, 36.0), shapely.LineString([(140, 36), (141, 37)])]
    features = [{"type": "Feature", "properties": {}, "geometry": shapely.geometry.mapping(s)} for s in shapes]
    file = tmp_path / "fields.geojson"
    file.write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    assert read_boundary(file).equals(shapely.union(FIELD, other))


def test_sample__has_the_area_of_its_field(shared_data: Path) -> None:
    field = read_boundary(shared_data / "tractor_loop" / "boundary.geojson")
    figures = json.loads((shared_data / "tractor_loop" / "truth" / "figures.json").read_text())
    local = gpd.GeoSeries([field], crs="EPSG:6668").to_crs("EPSG:6677")
    assert local.area[0] == pytest.approx(figures["field_area_m2"], rel=1e-4)


@pytest.mark.parametrize(
    ("content", "why"),
    [
        (b"", "neither"),
        (b"\x89PNG\r\n", "neither"),
        (b"<OGRVRTDataSource><OGRVRTLayer name='x'/></OGRVRTDataSource>", "neither"),
        (b"{", "field.geojson"),
        (b'{"type": "FeatureCollection", "features": []}', "but no polygon"),
        (b'{"type": "Point", "coordinates": [140.0, 36.0]}', "but no polygon"),
        (b'{"type": "Polygon", "coordinates": [[[0, 0], [0, 0], [0, 0], [0, 0]]]}', "empty"),
        (b"SQLite format 3\0" + b"x" * 200, "field.geojson"),
    ],
)
def test_no_boundary__is_reported_with_the_file_and_the_reason(tmp_path: Path, content: bytes, why: str) -> None:
    file = tmp_path / "field.geojson"
    file.write_bytes(content)
    with pytest.raises(InputError, match=why) as error:
        read_boundary(file)
    assert error.value.code == "boundary-unreadable"
    assert "field.geojson" in error.value.what


def test_missing_file__is_reported(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="No such file"):
        read_boundary(tmp_path / "nothing.geojson")


@pytest.mark.parametrize(
    ("ring", "says"),
    [
        ("[[1e999,1],[1,2],[2,2],[1e999,1]]", "out of range"),
        ("[[NaN,1],[1,2],[2,2],[NaN,1]]", "invalid character"),
        ("[[140,95],[140.1,99],[140.1,95],[140,95]]", "99 latitude"),
        ("[[500,35],[501,36],[501,35],[500,35]]", "501 longitude"),
        ("[[140,35],[143,36],[143,35],[140,35]]", "3° wide"),
        ("[[140,35],[140,35],[140,35],[140,35]]", "empty"),
        ("[[" + "9" * 5000 + ",1],[1,2],[2,2],[1,1]]", ""),
        ("[" * 100_000, "nest"),
    ],
)
def test_promise_17__corners_that_no_field_has_are_refused(tmp_path: Path, ring: str, says: str) -> None:
    file = tmp_path / "field.geojson"
    file.write_text(f'{{"type":"Polygon","coordinates":[{ring}]}}')
    with pytest.raises(InputError) as refused:
        read_boundary(file)
    assert refused.value.code == "boundary-unreadable"
    assert says in refused.value.what


def test_a_ring_that_crosses_itself__is_the_ground_on_both_sides(tmp_path: Path) -> None:
    file = tmp_path / "field.geojson"
    file.write_text('{"type":"Polygon","coordinates":[[[0.1,0],[0.2,0.1],[0.2,0],[0.1,0.1],[0.1,0]]]}')
    assert read_boundary(file).area == pytest.approx(0.005)


def test_names__are_the_attributes_of_a_feature(tmp_path: Path) -> None:
    table = gpd.GeoDataFrame({"name": ["North "], "no": [7], "ha": [1.2], "note": [None]}, geometry=[FIELD], crs=4326)
    table.to_file(tmp_path / "field.gpkg", engine="pyogrio")
    (field,) = read_fields(tmp_path / "field.gpkg")[0]
    assert field.names == ("North", "7")


def test_task_data__has_its_fields_by_name_and_id(tmp_path: Path) -> None:
    ring = "".join(
        f'<PNT A="2" C="{lat}" D="{lon}"/>' for lon, lat in [(8, 50), (8.002, 50), (8.002, 50.001), (8, 50.001)]
    )
    field = '<PFD A="PFD{0}" C="{1}" D="0"><PLN A="1"><LSG A="1">{2}</LSG></PLN></PFD>'
    text = '<ISO11783_TaskData VersionMajor="4" VersionMinor="0"><PFD A="PFD2" C="Leer" D="0"/>'
    text += field.format(1, "Hof", ring)
    (tmp_path / "TASKDATA.XML").write_text(f"{text}</ISO11783_TaskData>")
    for path in (tmp_path, tmp_path / "TASKDATA.XML"):
        (one,) = read_fields(path)[0]
        assert one.names == ("Hof", "PFD1")
        assert one.outline.equals(shapely.box(8, 50, 8.002, 50.001))
    (tmp_path / "TASKDATA.XML").write_text(text.replace("PLN", "GGP") + "</ISO11783_TaskData>")
    with pytest.raises(InputError, match="none of its 2 fields has a boundary"):
        read_fields(tmp_path)


@pytest.mark.parametrize(
    ("west", "south", "east", "north", "is_field"),
    [
        (140.0, 89.5, 140.001, 90.0, True),
        (140.0, -90.0, 140.001, -89.5, True),
        (140.0, 89.5, 140.001, 90.001, False),
        (140.0, -90.001, 140.001, -89.5, False),
        (359.5, 10.0, 360.0, 10.1, True),
        (359.5, 10.0, 360.001, 10.1, False),
        (-360.0, 10.0, -359.5, 10.1, True),
        (-360.001, 10.0, -359.5, 10.1, False),
        (140.0, 35.0, 140.1, 36.0, True),
        (140.0, 35.0, 140.1, 36.001, False),
        (140.0, 0.0, 141.0, 0.1, True),
        (140.0, 60.0, 142.001, 60.1, True),
        (140.0, -60.1, 142.001, -60.0, True),
        (140.0, 60.0, 142.02, 60.1, False),
        (140.0, -60.1, 142.02, -60.0, False),
    ],
)
def test_outline__is_on_the_earth_and_at_most_a_degree_of_latitude_large(
    west: float, south: float, east: float, north: float, is_field: bool, tmp_path: Path
) -> None:
    """At 60.1 degrees of latitude, that is 2.006 degrees of longitude."""
    file = tmp_path / "field.geojson"
    file.write_text(json.dumps(shapely.geometry.mapping(shapely.box(west, south, east, north))))
    if is_field:
        assert read_boundary(file).equals(shapely.box(west, south, east, north))
        return
    with pytest.raises(InputError) as refused:
        read_boundary(file)
    assert refused.value.code == "boundary-unreadable"


def ring_of(corners: list[tuple[float, float]], kind: int = 1) -> str:
    points = "".join(f'<PNT A="2" C="{lat}" D="{lon}"/>' for lon, lat in corners)
    return f'<LSG A="{kind}">{points}</LSG>'


@pytest.mark.parametrize(
    ("ring", "is_kept"),
    [
        (ring_of([(179.0, 89.0), (180.0, 89.0), (180.0, 90.0), (179.0, 90.0)]), True),
        (ring_of([(-180.0, -90.0), (-179.0, -90.0), (-179.0, -89.0)]), True),
        (ring_of([(179.5, 50.0), (180.001, 50.0), (179.8, 50.1)]), False),
        (ring_of([(-179.5, 50.0), (-180.001, 50.0), (-179.8, 50.1)]), False),
        (ring_of([(8.0, 89.9), (8.0, 90.001), (8.1, 89.9)]), False),
        (ring_of([(8.0, -89.9), (8.0, -90.001), (8.1, -89.9)]), False),
        (ring_of([(8.0, 50.0), (9.0, 50.0), (8.0, 51.0)]), True),
        (ring_of([(8.0, 50.0), (9.001, 50.0), (8.0, 50.1)]), False),
        (ring_of([(8.0, 50.0), (8.1, 50.0), (8.0, 51.001)]), False),
        (ring_of([(8.0, 50.0), (8.1, 50.1)]), False),
        (ring_of([]), False),
        (ring_of([(8.0, 50.0), (8.1, 50.0), (8.0, 50.1)], 3), False),
    ],
)
def test_task_data__rings_that_no_field_has_are_dropped_and_named(ring: str, is_kept: bool, tmp_path: Path) -> None:
    """On the Earth, of three corners, a degree large, and an exterior or a hole."""
    whole = ring_of([(100.0, 10.0), (100.1, 10.0), (100.0, 10.1)])
    text = '<ISO11783_TaskData VersionMajor="4" VersionMinor="0"><PFD A="PFD1" C="Hof"><PLN A="1">'
    (tmp_path / "TASKDATA.XML").write_text(f"{text}{whole}{ring}</PLN></PFD></ISO11783_TaskData>")
    content = read_content(open_task_sets(tmp_path)[0])
    boundary = content.partfields["PFD1"].boundary
    assert shapely.get_num_geometries(boundary) == 1 + is_kept
    assert [notice.code for notice in content.notices] == ([] if is_kept else ["boundary-ring"])
    if not is_kept:
        assert "Hof" in content.notices[0].text


def test_task_data__holes_and_several_exteriors(tmp_path: Path) -> None:
    shells = [shapely.box(8, 50, 8.1, 50.1), shapely.box(8.2, 50, 8.3, 50.1)]
    hole = shapely.box(8.02, 50.02, 8.05, 50.05)
    rings = [(shells[0], 1), (hole, 2), (shells[1], 1)]
    text = "".join(ring_of(list(shape.exterior.coords), kind) for shape, kind in rings)
    text = f'<PFD A="P" C="Hof"><PLN A="1">{text}</PLN><PLN A="2">{ring_of([(1, 1), (1.1, 1), (1, 1.1)])}</PLN></PFD>'
    (tmp_path / "TASKDATA.XML").write_text(f'<ISO11783_TaskData VersionMajor="4">{text}</ISO11783_TaskData>')
    assert read_boundary(tmp_path).equals(shapely.difference(shapely.union_all(shells), hole))


def agopengps_folder(folder: Path, boundary: str) -> Path:
    """A field as AgOpenGPS 6 writes it (FieldPlaneFiles.cs, BoundaryFiles.cs)."""
    folder.mkdir(parents=True, exist_ok=True)
    start = "2026-June-11 08:04:00 AM\n$FieldDir\nFieldNew\n$Offsets\n0,0\nConvergence\n0\nStartFix\n36.87,140.02\n"
    (folder / "Field.txt").write_text(start, encoding="utf-8")
    (folder / "Boundary.txt").write_text(boundary, encoding="utf-8")
    return folder


RING = "False\n4\n-50.000,-40.000,0.00000\n50.000,-40.000,1.57080\n50.000,40.000,3.14159\n-50.000,40.000,4.71239\n"


def test_agopengps__a_folder_is_a_field(tmp_path: Path) -> None:
    island = RING.replace("0.000", ".000")  # ten times smaller
    folder = agopengps_folder(
        tmp_path / "北圃場", "$Boundary\n" + RING + island + island.replace("False", "True\nTrue")
    )
    (field,) = read_fields(folder)[0]
    assert field.names == ("北圃場",)
    area, length = Geod(ellps="WGS84").geometry_area_perimeter(shapely.geometry.polygon.orient(field.outline))
    assert area == pytest.approx(100 * 80 - 10 * 8, rel=1e-4)  # the second island is to drive through
    assert (length, len(field.outline.interiors)) == (pytest.approx(360, rel=1e-4), 1)
    assert field.outline.bounds[:2] == pytest.approx((140.02 - 50 / 89160, 36.87 - 40 / 110980), abs=1e-6)


@pytest.mark.parametrize("corner_m", [(0.0, 0.0), (800.0, 800.0), (-3000.0, 3000.0), (3800.0, -5000.0)])
def test_agopengps__metres_per_degree_are_those_of_the_latitude(corner_m: tuple[float, float], tmp_path: Path) -> None:
    """Against the radii of curvature of the ellipsoid, by which AgOpenGPS's series are made."""
    east_m, north_m = corner_m
    text = f"{east_m},{north_m},0\n{east_m + 100},{north_m},0\n{east_m},{north_m + 100},0\n"
    (field,) = read_fields(agopengps_folder(tmp_path, "$Boundary\nFalse\n3\n" + text))[0]
    lon = 140.02
    lat = 36.87
    squared = 0.00669437999014
    meridian_m = 6378137.0 * (1 - squared) / (1 - squared * np.sin(np.radians(lat)) ** 2) ** 1.5
    corner_lat = lat + np.degrees(north_m / meridian_m)
    normal_m = 6378137.0 / np.sqrt(1 - squared * np.sin(np.radians(corner_lat)) ** 2)
    corner_lon = lon + np.degrees(east_m / (normal_m * np.cos(np.radians(corner_lat))))
    expected = shapely.Point(corner_lon, corner_lat)
    nearest = min((shapely.Point(place) for place in field.outline.exterior.coords), key=expected.distance)
    assert Geod(ellps="WGS84").geometry_length(shapely.LineString([expected, nearest])) < 0.05


@pytest.mark.parametrize(
    ("boundary", "words"),
    [
        ("$Boundary\n", "has no boundary"),
        (RING[:55], "corners of 4"),
        (RING.replace("4\n", "x\n", 1), "is damaged at 'x'"),
        (RING.replace("50.000", "nan"), "far from the origin"),
        ("False\n", "is damaged"),
    ],
)
def test_agopengps__damage(boundary: str, words: str, tmp_path: Path) -> None:
    folder = agopengps_folder(tmp_path, boundary)
    with pytest.raises(InputError, match=words) as caught:
        read_fields(folder)
    assert caught.value.code == "boundary-unreadable"
    (folder / "Field.txt").write_text("$FieldDir\n")
    with pytest.raises(InputError, match="no origin"):
        read_fields(folder)


def test_agopengps__is_no_recording(tmp_path: Path) -> None:
    folder = agopengps_folder(tmp_path, "$Boundary\n" + RING)
    for path in (folder, folder / "Field.txt", folder / "Boundary.txt"):
        with pytest.raises(InputError, match="a field folder of AgOpenGPS") as caught:
            Recognised.by_content(path)
        assert caught.value.code == "unknown-format"
