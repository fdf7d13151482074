"""Every kind of file of points with heights in every place that takes them: the same points, or a refusal."""

from __future__ import annotations

import gzip
import json
import zipfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import geopandas as gpd
import numpy as np
import pandas as pd
import pytest
import rasterio
import shapely
from pyproj import CRS, Transformer
from rasterio.transform import from_origin

from furrowmap.core.accuracy.paired_points import pairs_of_files
from furrowmap.core.accuracy.point_check import surface_at_points
from furrowmap.core.accuracy.product_check import check_product
from furrowmap.core.readers.chosen_survey import SurveyOptions
from furrowmap.core.readers.surveyed_points import read_points
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import FurrowmapError
from furrowmap.workflows.clouds.check import check_pairs

MAP = CRS.from_epsg(25832)
EAST, NORTH = 580_000.0, 5_700_000.0
XYZ = np.array([[EAST + 10.0 + k, NORTH + 12.0 + 2.0 * k, 100.0 + 0.25 * k] for k in range(5)])
NAMES = [f"P{k}" for k in range(5)]
TO_DEGREES = Transformer.from_crs(MAP, 4258, always_xy=True)
DEGREES = np.column_stack([*TO_DEGREES.transform(*XYZ[:, :2].T), XYZ[:, 2]])
TABLE = gpd.GeoDataFrame({"name": NAMES}, geometry=list(shapely.points(XYZ)), crs=MAP)
DRIVERS = {"gpkg": "GPKG", "fgb": "FlatGeobuf", "shp": "ESRI Shapefile"}


def layer(folder: Path, name: str, table: gpd.GeoDataFrame = TABLE) -> Path:
    path = folder / name
    driver = DRIVERS[path.suffix[1:]]
    options = {"SPATIAL_INDEX": "NO"} if driver == "FlatGeobuf" else {}
    table.to_file(path, driver=driver, engine="pyogrio", **options)
    return path


def zipped(folder: Path) -> Path:
    layer(folder, "a.shp")
    with zipfile.ZipFile(folder / "a.zip", "w") as packed:
        for part in sorted(folder.glob("a.[sdpc]*")):
            packed.write(part, part.name)
    return folder / "a.zip"


def geojson(folder: Path, *, flat: bool = False, extra: str = "", multi: bool = False) -> Path:
    """In the plane of the map, as files of before RFC 7946 name it: exact, unlike WGS 84."""
    features: list[Any] = []
    for name, place in zip(NAMES, XYZ.tolist(), strict=True):
        where = place[:2] if flat else place
        geometry = {"type": "MultiPoint" if multi else "Point", "coordinates": [where] if multi else where}
        properties = {"name": name, **({extra: place[2]} if extra else {})}
        features.append({"type": "Feature", "properties": properties, "geometry": geometry})
    features.append({"type": "Feature", "properties": {"name": "none"}, "geometry": None})
    crs = {"type": "name", "properties": {"name": "urn:ogc:def:crs:EPSG::25832"}}
    path = folder / "a.geojson"
    path.write_text(json.dumps({"type": "FeatureCollection", "crs": crs, "features": features}))
    return path


def kml(folder: Path, *, mode: str = "absolute", column: bool = False, add_m: float = 0.0, page: str = "UTF-8") -> Path:
    marks = []
    for name, (lon, lat, height) in zip(NAMES, DEGREES.tolist(), strict=True):
        data = f'<ExtendedData><Data name="elevation"><value>{height}</value></Data></ExtendedData>' if column else ""
        place = f"<altitudeMode>{mode}</altitudeMode><coordinates>{lon:.10f},{lat:.10f},{height + add_m}</coordinates>"
        marks.append(f"<Placemark><name>{name}</name>{data}<Point>{place}</Point></Placemark>")
    path = folder / "a.kml"
    head = f'<?xml version="1.0" encoding="{page}"?>'
    text = f'{head}<kml xmlns="http://www.opengis.net/kml/2.2"><Document>{"".join(marks)}</Document></kml>'
    path.write_bytes(text.encode(page))
    return path


def table(folder: Path, suffix: str = "csv", *, degrees: bool = False) -> Path:
    places = DEGREES if degrees else XYZ
    columns = ["lon_deg", "lat_deg", "h_m"] if degrees else ["e_m", "n_m", "h_m"]
    frame = pd.DataFrame({"name": NAMES, **dict(zip(columns, places.T, strict=True))})
    path = folder / f"a.{suffix}"
    frame.to_excel(path, index=False) if suffix == "xlsx" else frame.to_csv(path, index=False)
    return path


def agopengps(folder: Path) -> Path:
    field = folder / "North"
    field.mkdir()
    (field / "Field.txt").write_text("2026-May-01\n$FieldDir\nNorth\nStartFix\n51.4,10.1\n")
    head = "2026-May-01\r\n$FieldDir\r\nElevation\r\nStartFix\r\n51.4,10.1\r\n"
    head += "Latitude,Longitude,Elevation,Quality,Easting,Northing,Heading,Roll\r\n"
    rows = "".join(f"{lat:.9f},{lon:.9f},{height},4,1,234.50,0.00,1.571,0\r\n" for lon, lat, height in DEGREES.tolist())
    (field / "Elevation.txt").write_text(head + rows)
    return field


def linked(folder: Path) -> Path:
    layer(folder, "target.gpkg")
    (folder / "link.gpkg").symlink_to("target.gpkg")
    return folder / "link.gpkg"


def layers(folder: Path) -> Path:
    path = folder / "a.gpkg"
    gpd.GeoDataFrame(geometry=[shapely.box(*XYZ[0, :2], *XYZ[1, :2])], crs=MAP).to_file(path, layer="plots")
    TABLE.to_file(path, layer="points", mode="a")
    return path


def without_z(**columns: Any) -> gpd.GeoDataFrame:
    return gpd.GeoDataFrame({"name": NAMES, **columns}, geometry=list(shapely.points(XYZ[:, :2])), crs=MAP)


def with_zero(**columns: Any) -> gpd.GeoDataFrame:
    return gpd.GeoDataFrame({"name": NAMES, **columns}, geometry=list(shapely.points(*XYZ[:, :2].T, 0.0)), crs=MAP)


def with_nothing() -> gpd.GeoDataFrame:
    return gpd.GeoDataFrame({"name": [*NAMES, "none"]}, geometry=[*TABLE.geometry, None], crs=MAP)


def in_us_feet() -> CRS:
    """The map in US survey feet, which states no heights: these have its unit, as those of clouds and rasters."""
    content = MAP.to_json_dict()
    for name in ("id", "usages", "scope", "area", "bbox"):
        content.pop(name, None)
    content["name"] += " (ftUS)"
    for axis in content["coordinate_system"]["axis"]:
        axis["unit"] = {"type": "LinearUnit", "name": "US survey foot", "conversion_factor": US_FOOT_M}
    return CRS.from_json_dict(content)


US_FOOT_M = 1200 / 3937
FEET = gpd.GeoDataFrame({"name": NAMES}, geometry=list(shapely.points(XYZ / US_FOOT_M)), crs=in_us_feet())


def with_none(folder: Path, none: float) -> Path:
    """A table with a further point whose height is none."""
    path = table(folder)
    path.write_text(path.read_text() + f"P9,{EAST + 11.0},{NORTH + 13.0},{none}\n")
    return path


def collections(folder: Path) -> Path:
    shapes = [shapely.GeometryCollection([shapely.LineString(XYZ[:2]), one]) for one in TABLE.geometry]
    return layer(folder, "a.gpkg", TABLE.set_geometry(shapes))


Made = Callable[[Path], Path]
PROPERTIES: Mapping[str, Made] = {
    "table": table,
    "table in degrees": lambda folder: table(folder, degrees=True),
    "spreadsheet": lambda folder: table(folder, "xlsx"),
    "GeoPackage": lambda folder: layer(folder, "a.gpkg"),
    "FlatGeobuf": lambda folder: layer(folder, "a.fgb"),
    "Shapefile": lambda folder: layer(folder, "a.shp"),
    "Shapefile in a zip archive": zipped,
    "GeoJSON": geojson,
    "GeoJSON of MultiPoints": lambda folder: geojson(folder, multi=True),
    "GeoJSON with the height in a column": lambda folder: geojson(folder, flat=True, extra="elevation"),
    "KML": kml,
    "KML with altitudes above ground and the height in a column": lambda folder: kml(
        folder, mode="relativeToGround", column=True, add_m=-90.0
    ),
    "KML in Shift-JIS": lambda folder: kml(folder, page="Shift_JIS"),
    "KML in UTF-16": lambda folder: kml(folder, page="UTF-16"),
    "map in feet, heights in its unit": lambda folder: layer(folder, "a.gpkg", FEET),
    "map in feet, heights in a column of metres": lambda folder: layer(
        folder, "a.gpkg", FEET.set_geometry(shapely.force_2d(FEET.geometry)).assign(h_m=XYZ[:, 2])
    ),
    "a height of -9999": lambda folder: with_none(folder, -9999.0),
    "a height of 0 far from the others": lambda folder: with_none(folder, 0.0),
    "an infinite height": lambda folder: with_none(folder, np.inf),
    "collections of geometries": collections,
    "several layers, the first of polygons": layers,
    "MultiPoints of one member": lambda folder: layer(
        folder, "a.gpkg", TABLE.set_geometry([shapely.MultiPoint([one]) for one in TABLE.geometry])
    ),
    "features without a geometry": lambda folder: layer(folder, "a.gpkg", with_nothing()),
    "z = 0 and the height in a column": lambda folder: layer(folder, "a.gpkg", with_zero(elevation=XYZ[:, 2])),
    "no z and the height in a column": lambda folder: layer(folder, "a.shp", without_z(h_m=XYZ[:, 2])),
    "another projected CRS of the datum": lambda folder: layer(folder, "a.gpkg", TABLE.to_crs(25833)),
    "longitudes and latitudes of the datum": lambda folder: layer(folder, "a.gpkg", TABLE.to_crs(4258)),
    "symbolic link": linked,
    "field folder of AgOpenGPS": agopengps,
    "Elevation.txt of AgOpenGPS": lambda folder: agopengps(folder) / "Elevation.txt",
}


def compressed(folder: Path) -> Path:
    path = folder / "a.gpkg.gz"
    path.write_bytes(gzip.compress(layer(folder, "a.gpkg").read_bytes()))
    return path


def lines(folder: Path) -> Path:
    frame = gpd.GeoDataFrame({"name": ["x"]}, geometry=[shapely.LineString(XYZ)], crs=MAP)
    return layer(folder, "a.gpkg", frame)


def as_degrees(folder: Path, name: str) -> Path:
    """Metres of the map, in a file that says or means that they are degrees."""
    path = folder / name
    if name.endswith("csv"):
        text = table(folder).read_text()
        path.write_text(text.replace("e_m,n_m", "lon,lat"))
    elif name.endswith("kml"):
        marks = [f"<Placemark><Point><coordinates>{x},{y},{z}</coordinates></Point></Placemark>" for x, y, z in XYZ]
        path.write_text(f"<kml>{''.join(marks)}</kml>")
    elif name.endswith("geojson"):
        found = json.loads(geojson(folder).read_text())
        path.write_text(json.dumps({key: value for key, value in found.items() if key != "crs"}))
    else:
        layer(folder, name, TABLE.set_crs(4326, allow_override=True))
    return path


REFUSED: Mapping[str, Made] = {
    "GeoJSON of metres without a CRS": lambda folder: as_degrees(folder, "b.geojson"),
    "KML of metres": lambda folder: as_degrees(folder, "b.kml"),
    "metres in a CRS of degrees": lambda folder: as_degrees(folder, "b.gpkg"),
    "table of metres as longitudes and latitudes": lambda folder: as_degrees(folder, "b.csv"),
    "depths, which count downwards": lambda folder: layer(
        folder, "a.gpkg", TABLE.set_crs("EPSG:25832+5715", allow_override=True)
    ),
    "gzip of a binary file": compressed,
    "lines": lines,
    "no heights": lambda folder: layer(folder, "a.gpkg", without_z()),
    "KML with altitudes above ground alone": lambda folder: kml(folder, mode="relativeToGround"),
    "an empty folder": lambda folder: (folder / "empty").mkdir() or folder / "empty",
}


def surface(folder: Path) -> Path:
    """A surface on the plane of the points: 100 m and 0.25 m more for each metre to the east."""
    path = folder / "dsm.tif"
    east = EAST + 0.5 * np.arange(60) + 0.25
    heights = np.tile(100.0 + 0.25 * (east - EAST - 10.0), (80, 1)).astype("float32")
    profile = {"driver": "GTiff", "width": 60, "height": 80, "count": 1, "dtype": "float32", "crs": "EPSG:25832"}
    with rasterio.open(path, "w", transform=from_origin(EAST, NORTH + 40.0, 0.5, 0.5), **profile) as raster:
        raster.write(heights, 1)
    return path


def by_check(path: Path) -> FloatArray:
    found = check_product(surface(path.parent), path)
    np.testing.assert_allclose([point.error_m[2] for point in found.points], 0.0, atol=1e-4)
    return np.array([point.surveyed_m for point in found.points])


def by_tie(path: Path) -> FloatArray:
    found = surface_at_points(surface(path.parent), path, SurveyOptions())
    return np.array([point.surveyed_m for point in found.points])


def by_session(path: Path) -> FloatArray:
    return read_points(path, MAP).xyz_m


def truth(folder: Path) -> Path:
    """Points of the same names, or numbers where the file has no names."""
    path = folder / "truth.csv"
    rows = [f"{name},{x},{y},{z}\n" for k, (x, y, z) in enumerate(XYZ.tolist()) for name in (f"P{k}", k + 1)]
    path.write_text("name,e_m,n_m,h_m\n" + "".join(rows))
    return path


def by_measured(path: Path) -> FloatArray:
    pairs = check_pairs(path, truth(path.parent), crs=MAP)
    return XYZ + pairs.difference_m


def by_surveyed(path: Path) -> FloatArray:
    return XYZ - pairs_of_files(truth(path.parent), path, MAP).difference_m


PLACES: Mapping[str, Callable[[Path], FloatArray]] = {
    "check POINTS": by_check,
    "check --pairs CLOUD_OR_DSM": by_measured,
    "check --pairs POINTS": by_surveyed,
    "tie --reference": by_tie,
    "[field] check_points, control_points, [camera] control_points": by_session,
}


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("stated", PROPERTIES)
def test_points__do_not_depend_on_the_file(stated: str, place: str, tmp_path: Path) -> None:
    found = PLACES[place](PROPERTIES[stated](tmp_path))
    np.testing.assert_allclose(found, XYZ, atol=2e-3 if "AgOpenGPS" in stated else 1e-4)


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("stated", REFUSED)
def test_what_cannot_be_honoured__is_refused_in_three_lines(stated: str, place: str, tmp_path: Path) -> None:
    with pytest.raises(FurrowmapError) as refused:
        PLACES[place](REFUSED[stated](tmp_path))
    assert len(str(refused.value).splitlines()) == 3


@pytest.mark.parametrize("stated", [name for name in REFUSED if "metres" in name])
def test_metres__that_count_as_degrees_are_named_with_the_file(stated: str, tmp_path: Path) -> None:
    path = REFUSED[stated](tmp_path)
    with pytest.raises(FurrowmapError) as refused:
        read_points(path, MAP)
    what, meaning, _ = str(refused.value).splitlines()
    assert what.startswith(f"{path}: the coordinates 580010, 5700012 ")
    assert "look like metres of a projected CRS" in meaning


def test_degrees_with_minutes__are_named(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("name,lon,lat,h_m\nP1,1008.8515,5126.7412,90.0\n")
    with pytest.raises(FurrowmapError, match="degrees and minutes"):
        read_points(path, MAP)


def test_heights_above_the_ellipsoid__of_a_crs_are_not_compared_with_others(tmp_path: Path) -> None:
    """EPSG:4937, ETRS89 with ellipsoidal heights, beside heights in DHHN2016: 45 m apart here."""
    path = layer(tmp_path, "a.gpkg", gpd.GeoDataFrame(geometry=list(shapely.points(DEGREES)), crs="EPSG:4937"))
    with pytest.raises(FurrowmapError, match="ellipsoidal height") as refused:
        read_points(path, CRS.from_user_input("EPSG:25832+7837"))
    assert refused.value.code == "check-heights"
    assert len(read_points(path, MAP)) == 5


def test_deviations__in_a_map_of_feet_have_its_unit_unless_their_columns_have_one(tmp_path: Path) -> None:
    path = layer(tmp_path, "a.gpkg", FEET.assign(sigma_e=1.0, sigma_h_m=0.5))
    found = read_points(path, MAP)
    np.testing.assert_allclose(found.sigma_m[:, [0, 2]], [[US_FOOT_M, 0.5]] * 5)
    assert [notice.code for notice in found.notices] == ["heights-in-feet"]


def test_heights__that_are_none_are_noticed(tmp_path: Path) -> None:
    for none in (-9999.0, 0.0):
        (notice,) = read_points(with_none(tmp_path, none), MAP).notices
        assert notice.code == "nodata-undeclared"
        assert f"such as {none:g}" in notice.text


def test_heights_of_agopengps__are_noticed_with_those_that_are_not_fixed(tmp_path: Path) -> None:
    path = agopengps(tmp_path) / "Elevation.txt"
    lines = path.read_text().splitlines()
    path.write_text("\n".join([*lines[:-1], lines[-1].replace(",4,1,234", ",5,1,234"), "51.4,10."]))
    found = read_points(path, MAP)
    assert len(found) == 5
    (notice,) = found.notices
    assert notice.code == "points-of-guidance"
    assert "5 heights" in notice.text
    assert "1 of them has no fixed ambiguities" in notice.text


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "has no heights"),
        ("51.4,x,1,4,0,0\n51.4,10.1,1,4\n", "is damaged at"),
        ("99.0,10.1,1,4\n", "impossible positions"),
    ],
)
def test_heights_of_agopengps__that_are_damaged_or_none(text: str, words: str, tmp_path: Path) -> None:
    path = agopengps(tmp_path) / "Elevation.txt"
    header = "Latitude,Longitude,Elevation,Quality,Easting,Northing,Heading,Roll\n"
    path.write_text(f"$FieldDir\nElevation\n{header}{text}")
    with pytest.raises(FurrowmapError, match=words):
        read_points(path, MAP)
