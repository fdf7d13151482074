"""Surveyed points as QField, QGIS and Emlid write them: heights in z or a column, parts, layers, empty geometries."""

from pathlib import Path

import geopandas as gpd
import numpy as np
import pandas as pd
import pyproj
import pytest
import shapely

from furrowmap.core.accuracy.point_check import surface_at_points
from furrowmap.core.readers.chosen_survey import SurveyOptions
from furrowmap.core.readers.surveyed_points import read_points
from furrowmap.core.readers.vector_file import read_polygons
from furrowmap.core.runtime.errors import InputError, RefusedError

UTM = pyproj.CRS.from_epsg(32632)
EAST, NORTH = 580_000.0 + np.arange(5.0), 5_700_000.0 + 2.0 * np.arange(5.0)
HEIGHT = 100.0 + 0.1 * np.arange(5.0)
SUFFIXES = {"gpkg": "GPKG", "fgb": "FlatGeobuf", "shp": "ESRI Shapefile"}


def unreadable(why: str) -> InputError:
    return InputError("within-unreadable", path="field.gpkg", why=why, formats="")


def written(folder: Path, suffix: str, geometry: list[object], **columns: object) -> Path:
    path = folder / f"survey.{suffix}"
    frame = gpd.GeoDataFrame({"name": [f"P{k}" for k in range(5)], **columns}, geometry=geometry, crs=UTM)
    kept_order = {"SPATIAL_INDEX": "NO"} if suffix == "fgb" else {}
    frame.to_file(path, driver=SUFFIXES[suffix], engine="pyogrio", **kept_order)
    return path


def points(z: object) -> list[object]:
    return list(shapely.points(EAST, NORTH, z))


@pytest.mark.parametrize("suffix", SUFFIXES)
@pytest.mark.parametrize("column", ["elevation", "h_m", "Altitude", "z_m", "elev"])
def test_z_of_nothing__gives_way_to_the_column(suffix: str, column: str, tmp_path: Path) -> None:
    found = read_points(written(tmp_path, suffix, points(0.0), **{column: HEIGHT}), UTM)
    np.testing.assert_allclose(found.xyz_m, np.column_stack([EAST, NORTH, HEIGHT]))
    assert not found.notices


def test_z_of_nothing__in_some_points(tmp_path: Path) -> None:
    z = np.where(np.arange(5) < 2, 0.0, HEIGHT)
    found = read_points(written(tmp_path, "gpkg", points(z), elevation=HEIGHT), UTM)
    np.testing.assert_allclose(found.xyz_m[:, 2], HEIGHT)


def test_z_of_nothing__without_a_column_is_said(tmp_path: Path) -> None:
    found = read_points(written(tmp_path, "gpkg", points(0.0), remark=["a"] * 5), UTM)
    assert [notice.code for notice in found.notices] == ["points-zero"]


def test_two_heights__are_said(tmp_path: Path) -> None:
    found = read_points(written(tmp_path, "gpkg", points(HEIGHT + 46.2), elevation=HEIGHT), UTM)
    np.testing.assert_allclose(found.xyz_m[:, 2], HEIGHT + 46.2)
    (notice,) = found.notices
    assert notice.code == "points-two-heights"
    assert "46.200 m" in notice.text


@pytest.mark.parametrize(
    ("suffix", "nothing"),
    [*((suffix, None) for suffix in SUFFIXES), ("gpkg", shapely.Point()), ("gpkg", shapely.MultiPoint())],
)
def test_features_without_a_place__are_left_out_with_a_notice(suffix: str, nothing: object, tmp_path: Path) -> None:
    found = read_points(written(tmp_path, suffix, [*points(HEIGHT)[:4], nothing], n=range(5)), UTM)
    assert found.name == ("P0", "P1", "P2", "P3")
    assert [notice.code for notice in found.notices] == ["points-incomplete"]


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_multipoints__of_one_member_are_points(suffix: str, tmp_path: Path) -> None:
    members = [shapely.MultiPoint([point]) for point in points(HEIGHT)]
    found = read_points(written(tmp_path, suffix, list(members), n=range(5)), UTM)
    assert found.name == ("P0", "P1", "P2", "P3", "P4")
    np.testing.assert_allclose(found.xyz_m, np.column_stack([EAST, NORTH, HEIGHT]))
    assert not found.notices


def test_multipoints__of_several_members_are_split_with_a_notice(tmp_path: Path) -> None:
    all_points = points(HEIGHT)
    members = [shapely.MultiPoint(all_points[:3]), *all_points[1:4], None]
    found = read_points(written(tmp_path, "gpkg", list(members), sigma_h_m=[0.02, 0.03, 0.04, 0.05, 0.06]), UTM)
    assert found.name == ("P0/1", "P0/2", "P0/3", "P1", "P2", "P3")
    assert found.sigma_m[:, 2].tolist() == [0.02, 0.02, 0.02, 0.03, 0.04, 0.05]
    assert [notice.code for notice in found.notices] == ["points-split", "points-incomplete"]


def layers(folder: Path, **parts: object) -> Path:
    path = folder / "several.gpkg"
    for name, geometry in parts.items():
        frame = gpd.GeoDataFrame({"name": [name]}, geometry=[geometry], crs=UTM)
        frame.to_file(path, layer=name, driver="GPKG", engine="pyogrio")
    return path


def test_layers__that_with_the_right_geometry_is_read(tmp_path: Path) -> None:
    area = shapely.box(580_000.0, 5_700_000.0, 580_010.0, 5_700_010.0)
    line = shapely.LineString([(580_000.0, 5_700_000.0), (580_010.0, 5_700_000.0)])
    path = layers(tmp_path, line=line, area=area, point=shapely.Point(580_000.0, 5_700_000.0, 7.0))
    assert read_points(path, UTM).name == ("point",)
    found = read_polygons(path, unreadable)
    assert [row["name"] for row in found.attributes] == ["area"]
    assert not found.notices


def test_layers__of_the_same_kind_are_named(tmp_path: Path) -> None:
    boxes = {f"plots_{k}": shapely.box(580_000.0, 0.0, 580_010.0 + k, 10.0) for k in range(3)}
    found = read_polygons(layers(tmp_path, **boxes), unreadable)
    assert [row["name"] for row in found.attributes] == ["plots_0"]
    assert [notice.code for notice in found.notices] == ["layer-chosen"]
    assert "plots_1, plots_2" in found.notices[0].text


def test_layers__of_other_kinds_only_are_named(tmp_path: Path) -> None:
    path = layers(tmp_path, a=shapely.Point(0.0, 0.0, 1.0), b=shapely.LineString([(0.0, 0.0), (1.0, 1.0)]))
    with pytest.raises(InputError) as raised:
        read_polygons(path, unreadable)
    assert "a (Point Z), b (LineString)" in raised.value.what


EMLID = (
    "Name,Easting,Northing,Elevation,Longitude,Latitude,Ellipsoidal height,Easting RMS,Northing RMS,Elevation RMS\n"
    "P0,{},10.151200904,51.445548373,146.240,0.010,0.011,0.014\n"
)


def test_emlid__in_a_map_projection(tmp_path: Path) -> None:
    path = tmp_path / "points.csv"
    path.write_text(EMLID.format("580002,5700002,100.04"))
    found = read_points(path, UTM)
    np.testing.assert_allclose(found.xyz_m, [[580_002.0, 5_700_002.0, 100.04]])
    np.testing.assert_allclose(found.sigma_m, [[0.010, 0.011, 0.014]])


def test_emlid__global(tmp_path: Path) -> None:
    path = tmp_path / "points.csv"
    path.write_text(EMLID.format(",,"))
    found = read_points(path, UTM)
    np.testing.assert_allclose(found.xyz_m, [[580_002.0, 5_700_002.0, 146.24]], atol=0.001)
    with pytest.raises(RefusedError, match="ellipsoidal height"):
        read_points(path, pyproj.CRS("EPSG:32632+5783"))


@pytest.mark.parametrize(("name", "points_there"), [("pz0", 10), ("nogeom", 9), ("mpt", 10)])
def test_samples__of_qfield_fit_their_plane(name: str, points_there: int, shared_data: Path) -> None:
    folder = shared_data / "foreign/10-survey-gpkg-z0"
    found = surface_at_points(folder / "surface.tif", folder / f"{name}.gpkg", SurveyOptions())
    errors = np.array([check.found_m[2] - check.surveyed_m[2] for check in found.points])
    assert len(errors) == points_there
    assert np.abs(errors).max() < 0.001
    assert [notice.code for notice in found.notices] == (["points-incomplete"] if name == "nogeom" else [])


def test_sample__of_emlid(shared_data: Path) -> None:
    path = shared_data / "foreign/20-header-words/emlid_global.csv"
    table = pd.read_csv(path)
    found = read_points(path, UTM)
    moved = pyproj.Transformer.from_crs(4326, 32632, always_xy=True).transform(table["Longitude"], table["Latitude"])
    np.testing.assert_allclose(found.xyz_m, np.column_stack([*moved, table["Ellipsoidal height"]]), atol=1e-4)
    np.testing.assert_allclose(found.sigma_m, [[0.010, 0.010, 0.014]] * len(table))


def test_sample__of_two_layers(shared_data: Path) -> None:
    found = read_polygons(shared_data / "foreign/20-header-words/two.gpkg", unreadable)
    assert [row["id"] for row in found.attributes] == ["A1", "A2"]
