"""Every kind of file of polygons in every place that takes polygons: the same ground, or a refusal in three lines."""

from __future__ import annotations

import gzip
import json
import re
import sqlite3
import struct
import zipfile
from collections.abc import Callable, Mapping
from contextlib import closing
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import geopandas as gpd
import numpy as np
import pandas as pd
import pytest
import shapely
from pyproj import CRS, Transformer
from shapely.geometry.base import BaseGeometry

from furrowmap.core.coverage.field_boundary import field_boundary, ground_to_map
from furrowmap.core.crops.parcel_areas import read_parcels
from furrowmap.core.geodesy.projection import MapFrame, map_frame
from furrowmap.core.readers.areas.area import read_area
from furrowmap.core.readers.boundary_file import read_fields
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import FurrowmapError
from furrowmap.core.session.trial_files import TrialFiles
from furrowmap.core.values.session import Crs

MAP = CRS.from_epsg(25832)
FRAME = map_frame(Crs(map="EPSG:25832"))
EAST, NORTH = 651_000.0, 5_700_000.0
HOLE = shapely.box(EAST + 20.0, NORTH + 20.0, EAST + 40.0, NORTH + 40.0)
HOLES = [HOLE, shapely.box(EAST + 60.0, NORTH + 20.0, EAST + 80.0, NORTH + 40.0)]
A = shapely.box(EAST, NORTH, EAST + 100.0, NORTH + 50.0)
RING = A.difference(HOLE)
B = shapely.box(EAST + 130.0, NORTH, EAST + 150.0, NORTH + 40.0)


@dataclass(frozen=True)
class Site:
    """A map, and places on it that were driven, in each of the fields."""

    crs: CRS
    frame: MapFrame
    driven: FloatArray


HERE = Site(MAP, FRAME, np.array([[EAST + 5.0, NORTH + 5.0], [EAST + 140.0, NORTH + 5.0]]))
FIJI = Site(CRS.from_epsg(32760), map_frame(Crs(map="EPSG:32760")), np.array([[819_789.0, 8_140_176.0]]))
FIELDS = gpd.GeoDataFrame({"id": ["A1", "B2"]}, geometry=[RING, B], crs=MAP)
WHOLE = gpd.GeoDataFrame({"id": ["A1", "B2"]}, geometry=[A, B], crs=MAP)
HIGH = FIELDS.set_geometry(shapely.force_3d([RING, B], 90.0))
COMPOUND = FIELDS.set_crs("EPSG:25832+7837", allow_override=True)
DRIVERS = {"gpkg": "GPKG", "fgb": "FlatGeobuf", "shp": "ESRI Shapefile", "geojson": "GeoJSON", "kml": "LIBKML"}
TO_DEGREES = Transformer.from_crs(MAP, 4258, always_xy=True)
ORIGIN = (10.9, 51.42)


def layer(folder: Path, name: str, table: gpd.GeoDataFrame = FIELDS, **options: Any) -> Path:
    path = folder / name
    driver = DRIVERS[path.suffix[1:]]
    degrees = driver in ("GeoJSON", "LIBKML")
    table = table.rename(columns={"id": "name"}) if driver == "LIBKML" else table
    options |= {"SPATIAL_INDEX": "NO"} if driver == "FlatGeobuf" else {}  # which would sort the features
    (table.to_crs(4258) if degrees else table).to_file(path, driver=driver, engine="pyogrio", **options)
    return path


def changed(path: Path, change: Callable[[str], str], encoding: str = "utf-8") -> Path:
    path.write_bytes(change(path.read_text(encoding="utf-8")).encode(encoding))
    return path


def zipped(folder: Path, name: str) -> Path:
    layer(folder, name)
    path = folder / "packed.zip"
    with zipfile.ZipFile(path, "w") as packed:
        for part in sorted(folder.glob(f"{Path(name).stem}.*")):
            packed.write(part, f"plots/{part.name}")
    return path


def layers(folder: Path) -> Path:
    path = folder / "a.gpkg"
    gpd.GeoDataFrame(geometry=[A.centroid], crs=MAP).to_file(path, layer="stakes", engine="pyogrio")
    FIELDS.to_file(path, layer="plots", engine="pyogrio", mode="a")
    return path


def kml(folder: Path, between: str = " ", page: str = "", word: str = "") -> Path:
    """In UTF-8, or a code page that it declares; `word` begins the names."""
    marks = []
    for name, shape in zip(FIELDS["id"], [A, B], strict=True):
        corners = shapely.get_coordinates(
            shapely.transform(shape, lambda xy: np.column_stack(TO_DEGREES.transform(*xy.T)))
        )
        text = between.join(f"{lon:.9f},{lat:.9f},0" for lon, lat in corners)
        ring = f"<outerBoundaryIs><LinearRing><coordinates>{text}</coordinates></LinearRing></outerBoundaryIs>"
        marks.append(f"<Placemark><name>{word}{name}</name><Polygon>{ring}</Polygon></Placemark>")
    path = folder / "a.kml"
    head = f'<?xml version="1.0" encoding="{page}"?>' if page else ""
    text = f'{head}<kml xmlns="http://www.opengis.net/kml/2.2"><Document>{"".join(marks)}</Document></kml>'
    path.write_bytes(text.encode(page.replace("windows-", "cp") or "utf-8"))
    return path


def collections(folder: Path, name: str) -> Path:
    """Each polygon in a collection with its middle, the first in a collection within it."""
    inner = shapely.GeometryCollection([RING])
    shapes = [shapely.GeometryCollection([A.centroid, inner]), shapely.GeometryCollection([B.centroid, B])]
    return layer(folder, name, FIELDS.set_geometry(shapes), **({"COORDINATE_PRECISION": 12} if "json" in name else {}))


def curved(folder: Path) -> Path:
    """The second field as a CurvePolygon, whose ring is a circular string that is straight (OGC 06-103r4)."""
    path = layer(folder, "a.gpkg")
    west, south, east, north = B.bounds
    ring = [(west, south), (east, south), (east, north), (west, north), (west, south)]
    halves = [(0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1])) for a, b in pairwise(ring)]
    places = [place for pair in zip(ring, halves, strict=False) for place in pair] + [ring[0]]
    line = struct.pack("<BII", 1, 8, len(places)) + b"".join(struct.pack("<2d", *place) for place in places)
    with closing(sqlite3.connect(path)) as base, base:
        for (trigger,) in base.execute("select name from sqlite_master where type = 'trigger'").fetchall():
            base.execute(f'drop trigger "{trigger}"')
        head = b"GP\0\1" + struct.pack("<i", 25832)
        base.execute("update a set geom = ? where id = 'B2'", (head + struct.pack("<BII", 1, 10, 1) + line,))
        base.execute("update gpkg_geometry_columns set geometry_type_name = 'GEOMETRY'")
    return path


def corners(folder: Path, *, degrees: bool, suffix: str = "csv") -> Path:
    rows = []
    for name, shape in zip(FIELDS["id"], [A, B], strict=True):
        xy = shapely.get_coordinates(shape)[:-1]
        xy = np.column_stack(TO_DEGREES.transform(*xy.T)) if degrees else xy
        rows += [(name, *place) for place in xy.tolist()]
    table = pd.DataFrame(rows, columns=["id", *(("lon_deg", "lat_deg") if degrees else ("e_m", "n_m"))])
    path = folder / f"corners.{suffix}"
    table.to_csv(path, index=False) if suffix == "csv" else table.to_excel(path, index=False)
    return path


def agopengps(folder: Path) -> Path:
    """The first field, by the formula of AgOpenGPS's LocalPlane.cs, inverted."""
    field = folder / "A1"
    field.mkdir()
    (field / "Field.txt").write_text(f"2026-May-01\n$FieldDir\nA1\nStartFix\n{ORIGIN[1]},{ORIGIN[0]}\n")
    at = np.radians(ORIGIN[1])
    lat_m = 111132.92 - 559.82 * np.cos(2 * at) + 1.175 * np.cos(4 * at) - 0.0023 * np.cos(6 * at)
    text = ["$Boundary"]
    for ring, shape in (("False", A), ("False", HOLE)):
        lon, lat = np.array(TO_DEGREES.transform(*shapely.get_coordinates(shape).T))
        b = np.radians(lat)
        lon_m = 111412.84 * np.cos(b) - 93.5 * np.cos(3 * b) + 0.118 * np.cos(5 * b)
        rows = [f"{e:.4f},{n:.4f},0" for e, n in zip((lon - ORIGIN[0]) * lon_m, (lat - ORIGIN[1]) * lat_m, strict=True)]
        text += [ring, str(len(rows)), *rows]
    (field / "Boundary.txt").write_text("\n".join(text) + "\n")
    return field


def task_data(folder: Path, *, packed: bool = False) -> Path:
    fields = []
    for k, (name, shape) in enumerate(zip(FIELDS["id"], [A, B], strict=True), start=1):
        places = np.column_stack(TO_DEGREES.transform(*shapely.get_coordinates(shape).T))
        points = "".join(f'<PNT A="2" C="{lat:.9f}" D="{lon:.9f}"/>' for lon, lat in places)
        fields.append(f'<PFD A="PFD{k}" C="{name}" D="0"><PLN A="1"><LSG A="1">{points}</LSG></PLN></PFD>')
    about = 'VersionMajor="4" VersionMinor="0" DataTransferOrigin="1"'
    text = f"<ISO11783_TaskData {about}>{''.join(fields)}</ISO11783_TaskData>"
    inside = folder / "card" / "TASKDATA"
    inside.mkdir(parents=True)
    (inside / "TASKDATA.XML").write_text(text)
    if packed:
        with zipfile.ZipFile(folder / "card.zip", "w") as archive:
            archive.write(inside / "TASKDATA.XML", "TASKDATA/TASKDATA.XML")
        return folder / "card.zip"
    return folder / "card"


def attribute_page(folder: Path, word: str, page: str) -> Path:
    return layer(folder, "a.shp", FIELDS.assign(id=[f"{word}1", f"{word}2"]), encoding=page)


def linked(folder: Path) -> Path:
    layer(folder, "target.gpkg")
    path = folder / "link.gpkg"
    path.symlink_to("target.gpkg")
    return path


def unclosed(text: str) -> str:
    found = json.loads(text)
    for feature in found["features"]:
        feature["geometry"]["coordinates"] = [ring[:-1] for ring in feature["geometry"]["coordinates"]]
    return json.dumps(found)


def with_lists(text: str) -> str:
    found = json.loads(text)
    for feature in found["features"]:
        feature["properties"]["rows"] = [1, 2, {"a": 3}]
    return json.dumps(found)


def geojson(folder: Path, table: gpd.GeoDataFrame = FIELDS) -> Path:
    return layer(folder, "a.geojson", table, COORDINATE_PRECISION=12)


def by_address(folder: Path) -> Path:
    """In metres, with the address of their CRS, as OGC's services write it."""
    found = json.loads(FIELDS.to_json(drop_id=True))
    found["crs"] = {"type": "name", "properties": {"name": "http://www.opengis.net/def/crs/EPSG/0/25832"}}
    path = folder / "a.geojson"
    path.write_text(json.dumps(found))
    return path


def big_endian(folder: Path) -> Path:
    """A GeoPackage whose geometries and their heads are big-endian, without an envelope (OGC 12-128r18, 2.1.3)."""
    path = layer(folder, "a.gpkg")
    with closing(sqlite3.connect(path)) as base, base:
        for (trigger,) in base.execute("select name from sqlite_master where type = 'trigger'").fetchall():
            base.execute(f'drop trigger "{trigger}"')
        for name, shape in (("A1", RING), ("B2", B)):
            data = b"GP\0\0" + struct.pack(">i", 25832) + shapely.to_wkb(shape, byte_order=0)
            base.execute("update a set geom = ? where id = ?", (data, name))
    return path


def in_grads() -> CRS:
    """ETRS89 in grads, of which a right angle has a hundred."""
    content = CRS.from_epsg(4258).to_json_dict()
    for name in ("id", "usages", "scope", "area", "bbox"):
        content.pop(name, None)
    for axis in content["coordinate_system"]["axis"]:
        axis["unit"] = {"type": "AngularUnit", "name": "grad", "conversion_factor": np.pi / 200.0}
    return CRS.from_json_dict(content)


def grads(folder: Path) -> Path:
    shapes = [shapely.transform(shape, lambda xy: xy / 0.9) for shape in FIELDS.to_crs(4258).geometry]
    return layer(folder, "a.gpkg", gpd.GeoDataFrame(FIELDS[["id"]], geometry=shapes, crs=in_grads()))


def inner_rings(folder: Path) -> Path:
    """Two holes in one inner boundary, as Google Earth wrote them."""
    path = kml(folder)
    holes = "".join(
        f"<LinearRing><coordinates>{' '.join(f'{x:.9f},{y:.9f},0' for x, y in ring)}</coordinates></LinearRing>"
        for ring in (np.column_stack(TO_DEGREES.transform(*shapely.get_coordinates(s).T)).tolist() for s in HOLES)
    )
    end = "</outerBoundaryIs>"
    return changed(path, lambda text: text.replace(end, f"{end}<innerBoundaryIs>{holes}</innerBoundaryIs>", 1))


def beside(*others: BaseGeometry | None) -> gpd.GeoDataFrame:
    return gpd.GeoDataFrame({"id": ["A1", "B2", *["x"] * len(others)]}, geometry=[RING, B, *others], crs=MAP)


def across(folder: Path, *rings: list[list[float]]) -> Path:
    """A field across 180°, in one polygon or several."""
    geometry = {"type": "MultiPolygon", "coordinates": [[ring] for ring in rings]}
    feature = {"type": "Feature", "properties": {"id": "A1"}, "geometry": geometry}
    path = folder / "a.geojson"
    path.write_text(json.dumps({"type": "FeatureCollection", "features": [feature]}))
    return path


def box_deg(west: float, east: float, south: float = -16.8, north: float = -16.7995) -> list[list[float]]:
    return [[west, south], [east, south], [east, north], [west, north], [west, south]]


TO_FIJI = Transformer.from_crs(4326, FIJI.crs, always_xy=True)
ISLAND = shapely.transform(
    shapely.segmentize(shapely.Polygon(box_deg(179.9995, 180.0005)), 1e-5),
    lambda xy: np.column_stack(TO_FIJI.transform(*xy.T)),
)
Made = Callable[[Path], Path]
PROPERTIES: Mapping[str, tuple[Made, tuple[BaseGeometry, ...]]] = {
    "GeoPackage": (lambda folder: layer(folder, "a.gpkg"), (RING, B)),
    "FlatGeobuf": (lambda folder: layer(folder, "a.fgb"), (RING, B)),
    "Shapefile": (lambda folder: layer(folder, "a.shp"), (RING, B)),
    "Shapefile in a zip archive": (lambda folder: zipped(folder, "a.shp"), (RING, B)),
    "GeoJSON": (geojson, (RING, B)),
    "GeoJSON with a byte order mark": (lambda folder: changed(geojson(folder), lambda t: "\ufeff" + t), (RING, B)),
    "GeoJSON with lists as properties": (lambda folder: changed(geojson(folder), with_lists), (RING, B)),
    "GeoJSON with rings that are not closed": (lambda folder: changed(geojson(folder), unclosed), (RING, B)),
    "KML": (lambda folder: layer(folder, "a.kml"), (RING, B)),
    "KML in a zip archive": (lambda folder: zipped(folder, "a.kml"), (RING, B)),
    "KML with commas between its tuples": (lambda folder: kml(folder, ","), (A, B)),
    "KML with line breaks between its tuples": (lambda folder: kml(folder, "\n"), (A, B)),
    "KML in Shift-JIS": (lambda folder: kml(folder, page="Shift_JIS", word="圃場"), (A, B)),
    "KML in UTF-16": (lambda folder: kml(folder, page="utf-16", word="Поле"), (A, B)),
    "collections of geometries": (lambda folder: collections(folder, "a.gpkg"), (RING, B)),
    "collections of geometries in GeoJSON": (lambda folder: collections(folder, "a.geojson"), (RING, B)),
    "curve polygons": (curved, (RING, B)),
    "several layers, the first of points": (layers, (RING, B)),
    "MultiPolygon of one part": (
        lambda folder: layer(folder, "a.gpkg", FIELDS.set_geometry([shapely.MultiPolygon([s]) for s in (RING, B)])),
        (RING, B),
    ),
    "holes": (lambda folder: layer(folder, "a.gpkg"), (RING, B)),
    "corners with heights": (lambda folder: layer(folder, "a.gpkg", HIGH), (RING, B)),
    "features without a geometry": (lambda folder: layer(folder, "a.gpkg", beside(None)), (RING, B)),
    "features without a geometry in GeoJSON": (lambda folder: geojson(folder, beside(None)), (RING, B)),
    "other geometries beside polygons": (lambda folder: geojson(folder, beside(A.centroid, A.exterior)), (RING, B)),
    "another projected CRS of the datum": (lambda folder: layer(folder, "a.gpkg", FIELDS.to_crs(25833)), (RING, B)),
    "longitudes and latitudes": (lambda folder: layer(folder, "a.gpkg", FIELDS.to_crs(4258)), (RING, B)),
    "compound CRS": (lambda folder: layer(folder, "a.gpkg", COMPOUND), (RING, B)),
    "names in Shift-JIS without a code page": (lambda folder: attribute_page(folder, "圃場", "cp932"), (RING, B)),
    "names in Windows-1252": (lambda folder: attribute_page(folder, "Témoin", "cp1252"), (RING, B)),
    "GeoJSON with the address of its CRS": (by_address, (RING, B)),
    "GeoPackage in big-endian": (big_endian, (RING, B)),
    "KML with two rings in one inner boundary": (inner_rings, (A.difference(shapely.union_all(HOLES)), B)),
    "symbolic link": (linked, (RING, B)),
    "table of corners in metres": (lambda folder: corners(folder, degrees=False), (A, B)),
    "table of corners in degrees": (lambda folder: corners(folder, degrees=True), (A, B)),
    "spreadsheet of corners": (lambda folder: corners(folder, degrees=False, suffix="xlsx"), (A, B)),
    "field folder of AgOpenGPS": (agopengps, (RING,)),
    "task data in a folder": (task_data, (A, B)),
    "task data in a zip archive": (lambda folder: task_data(folder, packed=True), (A, B)),
    "across 180°, cut in two": (
        lambda folder: across(folder, box_deg(179.9995, 180.0), box_deg(-180.0, -179.9995)), (ISLAND,),
    ),
    "across 180°, in one ring": (lambda folder: across(folder, box_deg(179.9995, -179.9995)), (ISLAND,)),
    "across 180°, beyond it": (lambda folder: across(folder, box_deg(179.9995, 180.0005)), (ISLAND,)),
}  # fmt: skip


def no_crs(folder: Path) -> Path:
    return layer(folder, "a.gpkg", FIELDS.set_crs(None, allow_override=True))


def as_degrees(folder: Path, name: str) -> Path:
    """Metres of the map, in a file that says or means that they are degrees."""
    degrees = FIELDS.set_crs(4326, allow_override=True)
    if name.endswith("csv"):
        path = corners(folder, degrees=False)
        return changed(path, lambda text: text.replace("e_m,n_m", "longitude,latitude"))
    if name.endswith("kml"):
        return changed(kml(folder), lambda text: re.sub(r"\d+\.\d+,\d+\.\d+,0", moved, text))
    degrees.to_file(folder / name, driver=DRIVERS[name.rpartition(".")[2]], engine="pyogrio")
    return folder / name


def moved(found: re.Match[str]) -> str:
    lon, lat, _ = found[0].split(",")
    east, north = TO_DEGREES.transform(float(lon), float(lat), direction="INVERSE")
    return f"{east:.3f},{north:.3f},0"


def compressed(folder: Path) -> Path:
    path = folder / "a.geojson.gz"
    path.write_bytes(gzip.compress(geojson(folder).read_bytes()))
    return path


REFUSED: Mapping[str, Made] = {
    "no CRS": no_crs,
    "gzip": compressed,
    "points alone": lambda folder: geojson(folder, gpd.GeoDataFrame(geometry=[A.centroid], crs=MAP)),
    "an empty folder": lambda folder: (folder / "empty").mkdir() or folder / "empty",
    "text in UTF-16 that is no table": lambda folder: changed(
        geojson(folder), lambda text: "\ufeff" + text, "utf-16-le"
    ),
    "GeoJSON of metres without a CRS": lambda folder: as_degrees(folder, "a.geojson"),
    "KML of metres": lambda folder: as_degrees(folder, "a.kml"),
    "metres in a CRS of degrees": lambda folder: as_degrees(folder, "a.gpkg"),
    "table of metres as longitudes and latitudes": lambda folder: as_degrees(folder, "corners.csv"),
    "a datum of the past": lambda folder: layer(folder, "a.gpkg", FIELDS.to_crs(31467)),
    "a datum of the past in grads from Paris": lambda folder: layer(folder, "a.gpkg", FIELDS.to_crs(27572)),
    "a datum of the past that PROJ cannot transform": lambda folder: layer(
        folder, "a.gpkg", FIELDS.to_crs(4258).set_crs("+proj=longlat +ellps=bessel +type=crs", allow_override=True)
    ),
    "longitudes and latitudes in grads": grads,
    "geocentric coordinates": lambda folder: layer(folder, "a.gpkg", FIELDS.set_crs(4936, allow_override=True)),
    "a plane of its own": lambda folder: changed(
        layer(folder, "a.shp").with_suffix(".prj"), lambda _: 'LOCAL_CS["site",UNIT["metre",1]]'
    ).with_suffix(".shp"),
}


def by_within(path: Path, site: Site) -> BaseGeometry:
    return shapely.union_all(read_area(path, site.crs).polygons)


def by_field_within(path: Path, site: Site) -> BaseGeometry:
    return shapely.union_all(ground_to_map(path, site.frame).polygons)


def by_boundary(path: Path, site: Site) -> BaseGeometry:
    return field_boundary(path, site.frame, None, site.driven)[0]


def by_batch(path: Path, site: Site) -> BaseGeometry:
    fields = read_fields(path, target=site.crs)[0]
    assert all(field.names for field in fields)
    on_map = Transformer.from_crs(4258, site.crs, always_xy=True)
    return shapely.transform(
        shapely.union_all([field.outline for field in fields]), lambda xy: np.column_stack(on_map.transform(*xy.T))
    )


def by_parcels(path: Path, site: Site) -> BaseGeometry:
    parcels = read_parcels(path, site.crs)[0]
    assert [parcel.id[-1:] for parcel in parcels] in (["1", "2"], ["1"])
    return shapely.union_all([parcel.gross for parcel in parcels])


def by_net(path: Path, site: Site) -> BaseGeometry:
    return shapely.union_all([parcel.net for parcel in read_parcels(path, site.crs, net=path)[0]])


PLACES: Mapping[str, Callable[[Path, Site], BaseGeometry]] = {
    "--within": by_within,
    "[field] within": by_field_within,
    "[field] boundary": by_boundary,
    "batch --boundaries": by_batch,
    "PARCELS": by_parcels,
    "--net": by_net,
}


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("stated", PROPERTIES)
def test_ground__does_not_depend_on_the_file(stated: str, place: str, tmp_path: Path) -> None:
    make, shapes = PROPERTIES[stated]
    found = PLACES[place](make(tmp_path), FIJI if "180°" in stated else HERE)
    assert found.symmetric_difference(shapely.union_all(shapes)).area < 0.002 * found.length


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("stated", REFUSED)
def test_what_cannot_be_honoured__is_refused_in_three_lines(stated: str, place: str, tmp_path: Path) -> None:
    with pytest.raises(FurrowmapError) as refused:
        PLACES[place](REFUSED[stated](tmp_path), HERE)
    assert len(str(refused.value).splitlines()) == 3


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("stated", [name for name in REFUSED if "metres" in name])
def test_metres__that_count_as_degrees_are_named_with_the_file(stated: str, place: str, tmp_path: Path) -> None:
    path = REFUSED[stated](tmp_path)
    with pytest.raises(FurrowmapError) as refused:
        PLACES[place](path, HERE)
    what, meaning, remedy = str(refused.value).splitlines()
    assert what.startswith(f"{path}: the coordinates 651")
    assert "look like metres of a projected CRS" in meaning
    named = {"GeoJSON": "WGS 84", "KML": "WGS 84", "metres": "EPSG:4326", "table": "names"}
    assert named[stated.split()[0]] in meaning
    assert ("e_m" if "table" in stated else "GIS") in remedy


def test_names__are_those_of_the_file(tmp_path: Path) -> None:
    for word, page, folder in (("圃場", "cp932", "a"), ("Témoin", "cp1252", "b")):
        (tmp_path / folder).mkdir()
        path = attribute_page(tmp_path / folder, word, page)
        assert [field.names for field in read_fields(path)[0]] == [(f"{word}1",), (f"{word}2",)]
        assert [parcel.id for parcel in read_parcels(path, MAP)[0]] == [f"{word}1", f"{word}2"]


@pytest.mark.parametrize(
    ("page", "word"),
    [
        ("Shift_JIS", "圃場"), ("euc-kr", "논밭"), ("gb18030", "麦田"), ("big5", "麥田"), ("windows-874", "แปลง"),
        ("windows-1250", "Řepka"), ("koi8-r", "Поле"), ("utf-16", "Έλος"),
    ],
)  # fmt: skip
def test_names__in_kml_are_in_the_code_page_that_it_declares(page: str, word: str, tmp_path: Path) -> None:
    path = kml(tmp_path, page=page, word=word)
    assert [field.names for field in read_fields(path)[0]] == [(f"{word}A1",), (f"{word}B2",)]


def test_left_out_features__are_noticed_everywhere(tmp_path: Path) -> None:
    path = geojson(tmp_path, beside(A.centroid, None))
    notices = [*read_parcels(path, MAP)[1], *read_fields(path)[1]]
    notices += read_area(path, MAP).notices
    notices += ground_to_map(path, FRAME).notices
    notices += field_boundary(path, FRAME, None, np.array([[EAST, NORTH]]))[1]
    notices += TrialFiles.among([path]).notices
    told = [notice for notice in notices if notice.code == "features-left-out"]
    assert len(told) == 6
    assert {dict(notice.values)["left_out"] for notice in told} == {2}
