"""Parcels from files: formats, identifiers, blocks, net parcels, and what is refused."""

from __future__ import annotations

import json
import zipfile
from pathlib import Path

import geopandas as gpd
import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from pyproj import CRS
from shapely.affinity import rotate, translate

from furrowmap.core.crops.parcel_areas import inset_parcels, read_parcels
from furrowmap.core.runtime.errors import InputError

MAP = CRS.from_epsg(25832)
SHAPES = [rotate(shapely.box(e, 6_132_600.0, e + 10.0, 6_132_602.5), 4.0) for e in (651_000.0, 651_011.0)]
TABLE = gpd.GeoDataFrame({"id": [7, 8], "Block": ["A", "B"], "n_kg_ha": [0.0, 50.5]}, geometry=SHAPES, crs=MAP)


def same(found: shapely.Geometry, wanted: shapely.Geometry) -> bool:
    return bool(shapely.hausdorff_distance(shapely.normalize(found), shapely.normalize(wanted)) < 1e-4)


@pytest.mark.parametrize(
    ("suffix", "driver"),
    [("gpkg", "GPKG"), ("fgb", "FlatGeobuf"), ("shp", "ESRI Shapefile"), ("geojson", "GeoJSON"), ("kml", "LIBKML")],
)
def test_every_format__gives_the_same_parcels(tmp_path: Path, suffix: str, driver: str) -> None:
    file = tmp_path / f"parcels.{suffix}"
    degrees = suffix in ("geojson", "kml")
    table = TABLE.to_crs(4258 if degrees else 25833 if suffix == "fgb" else 25832)
    if degrees:
        table = table.set_crs(4326, allow_override=True)
    options = {"COORDINATE_PRECISION": 11} if suffix == "geojson" else {}
    table.to_file(file, driver=driver, engine="pyogrio", **options)
    found = sorted(read_parcels(file, MAP)[0], key=lambda parcel: parcel.id)  # FlatGeobuf orders by place
    assert [p.id for p in found] == ["7", "8"]
    assert [p.block for p in found] == ["A", "B"]
    assert [p.attributes["n_kg_ha"] for p in found] == [0.0, 50.5]
    assert all(same(p.gross, shape) and p.net == p.gross for p, shape in zip(found, SHAPES, strict=True))


def test_a_zipped_shapefile__is_read_and_one_of_two_is_not_guessed(tmp_path: Path) -> None:
    TABLE.to_file(tmp_path / "plots.shp")
    parts = sorted(tmp_path.glob("plots.*"))
    for name, stems in (("one.zip", ["trial/plots"]), ("two.zip", ["plots", "others"]), ("none.zip", [])):
        with zipfile.ZipFile(tmp_path / name, "w", zipfile.ZIP_DEFLATED) as archive:
            archive.writestr("readme.txt", "as surveyed")
            for stem in stems:
                for part in parts:
                    archive.write(part, f"{stem}{part.suffix}")
    assert [p.id for p in read_parcels(tmp_path / "one.zip", MAP)[0]] == ["7", "8"]
    for name, fault in (("two.zip", "holds 2"), ("none.zip", "holds 0")):
        with pytest.raises(InputError, match=fault) as refused:
            read_parcels(tmp_path / name, MAP)
        assert refused.value.code == "parcels-unreadable"


@pytest.mark.parametrize("degrees", [False, True])
def test_corners__one_row_each(tmp_path: Path, *, degrees: bool) -> None:
    shapes = TABLE.to_crs(4258).geometry if degrees else TABLE.geometry
    rows = ["plot;lon_deg;lat_deg;rep;variety" if degrees else "plot;e_m;n_m;rep;variety"]
    for name, shape in zip("PQ", shapes, strict=True):
        rows += [f"{name};{x:.12g};{y:.12g};2;Benchmark" for x, y in shape.exterior.coords[:-1]]
    (tmp_path / "corners.csv").write_text("\n".join(rows))
    found = read_parcels(tmp_path / "corners.csv", MAP)[0]
    assert [(p.id, p.block, p.attributes["variety"]) for p in found] == [
        ("P", "2", "Benchmark"),
        ("Q", "2", "Benchmark"),
    ]
    assert all(same(p.gross, shape) for p, shape in zip(found, SHAPES, strict=True))


@given(
    st.floats(-180.0, 180.0),
    st.floats(0.0, 3.0),
    st.floats(0.0, 1.2),
    st.booleans(),
)
def test_net__is_the_rectangle_without_its_strips(turn: float, ends: float, sides: float, backwards: bool) -> None:
    """A rectangle of 10 x 2.5 m, as drawn in either sense and turned, against the rectangle in its own axes."""
    box = shapely.box(0.0, 0.0, 10.0, 2.5, ccw=not backwards)
    found = inset_parcels([translate(rotate(box, turn, origin=(0, 0)), 651_000.0, 6_132_600.0)], ends, sides)[0]
    wanted = shapely.box(ends, sides, 10.0 - ends, 2.5 - sides)
    assert found is not None
    back = rotate(translate(found, -651_000.0, -6_132_600.0), -turn, origin=(0, 0))
    assert back.symmetric_difference(wanted).area < 1e-5


def test_net__of_a_parcel_without_four_corners_uses_its_smallest_rectangle() -> None:
    bent = shapely.Polygon([(0, 0), (10, 0), (10, 2), (5, 2.2), (0, 2)])
    found = inset_parcels([bent], 1.0, 0.25)[0]
    assert found is not None
    assert found.bounds == pytest.approx((1.0, 0.25, 9.0, 1.95))
    assert inset_parcels([bent], 1.0, 1.1)[0] is None


def test_net__may_be_a_file_of_its_own(tmp_path: Path) -> None:
    TABLE.to_file(tmp_path / "gross.gpkg")
    nets = TABLE.iloc[::-1].copy()
    nets.geometry = nets.buffer(-0.5)
    nets.to_file(tmp_path / "net.gpkg")
    found = read_parcels(tmp_path / "gross.gpkg", MAP, net=tmp_path / "net.gpkg")[0]
    assert all(same(p.net, shape.buffer(-0.5)) for p, shape in zip(found, SHAPES, strict=True))
    nets.iloc[:1].to_file(tmp_path / "net.gpkg")
    with pytest.raises(InputError, match=r"1 identifier \(7\) in only one") as refused:
        read_parcels(tmp_path / "gross.gpkg", MAP, net=tmp_path / "net.gpkg")
    assert refused.value.code == "parcels-identifiers"


def geojson(file: Path, *features: tuple[dict[str, object], object]) -> Path:
    made = [{"type": "Feature", "properties": p, "geometry": g} for p, g in features]
    file.write_text(json.dumps({"type": "FeatureCollection", "features": made}))
    return file


def ring(*corners: tuple[float, float]) -> dict[str, object]:
    return {"type": "Polygon", "coordinates": [[*corners, corners[0]]]}


GOOD = ring((11.3881, 55.3279), (11.3883, 55.3279), (11.3883, 55.328), (11.3881, 55.328))
BOW = ring((11.3881, 55.3279), (11.3883, 55.328), (11.3883, 55.3279), (11.3881, 55.328))
TWO = {"type": "MultiPolygon", "coordinates": [GOOD["coordinates"], [[(12, 55), (12.1, 55), (12, 55.1), (12, 55)]]]}


@pytest.mark.parametrize(
    ("features", "code", "says"),
    [
        ([], "parcels-unreadable", "no polygon"),
        (
            [({}, {"type": "Point", "coordinates": [11.0, 55.0]})],
            "parcels-unreadable",
            "1 features, but no",
        ),
        ([({"id": 1}, GOOD), ({"id": 1.0}, GOOD)], "parcels-identifiers", r"1 identifier \(1\) twice"),
        ([({"id": 1}, GOOD), ({"id": None}, GOOD)], "parcels-identifiers", r"1 polygon \(2\) without one"),
        ([({"id": "a"}, GOOD), ({"id": "b"}, BOW)], "parcels-invalid", r"1 parcel \(b\) with a ring that crosses"),
        ([({"id": "a"}, TWO)], "parcels-invalid", "several parts"),
        ([({}, ring((191.0, 95.0), (191.1, 95.0), (191.1, 95.1)))], "polygons-elsewhere", "is not for there"),
    ],
)
def test_what_is_no_set_of_parcels__is_refused(tmp_path: Path, features: list[object], code: str, says: str) -> None:
    with pytest.raises(InputError, match=says) as refused:
        read_parcels(geojson(tmp_path / "p.geojson", *features), MAP)
    assert refused.value.code == code


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("id,e_m,n_m\n1,0,0\n1,1,0\n", "2 corners"),
        ("id,e_m,n_m\n1,0,0\n1,x,0\n1,1,1\n", "line 3 holds 'x' under e_m"),
        ("id,e_m,n_m\n1,0,0\n1,,0\n1,1,1\n", "line 3 has a coordinate that is empty"),
        ("block,e_m,n_m\n1,0,0\n", "no rows with an identifier"),
        ("id,e_m,n_m\n", "no rows with an identifier"),
        ("<kml><Placemark><Polygon/></Placemark></kml>", "no outer boundary"),
        ("<kml><Placemark><Polygon>", "no element found"),
        ("<?xml version='1.0'?><!DOCTYPE k [<!ENTITY e 'x'>]><kml>&e;</kml>", "document type"),
        ("<OGRVRTDataSource/>", "neither"),
        ("id,e_m,n_m\n" + "1" * 140_000 + ",0,0\n", "larger than field limit"),
    ],
    ids=lambda value: value[:40],
)
def test_damaged_texts__are_told(tmp_path: Path, text: str, says: str) -> None:
    (tmp_path / "p.csv").write_text(text)
    with pytest.raises(InputError, match=says) as refused:
        read_parcels(tmp_path / "p.csv", MAP)
    assert refused.value.code == "parcels-unreadable"


def test_inset__larger_than_a_parcel_is_refused(tmp_path: Path) -> None:
    TABLE.to_file(tmp_path / "p.gpkg")
    with pytest.raises(InputError, match=r"2 parcels \(7, 8\) after 0 m off each end and 1.26 m") as refused:
        read_parcels(tmp_path / "p.gpkg", MAP, (0.0, 1.26))
    assert refused.value.code == "parcels-inset"


def test_parcels_on_a_datum_of_the_past__are_refused(tmp_path: Path) -> None:
    gpd.GeoDataFrame({"id": [1]}, geometry=[shapely.box(9.2, 48.8, 9.21, 48.81)], crs=4326).to_crs(31467).to_file(
        tmp_path / "old.gpkg"
    )
    with pytest.raises(InputError, match=r"differ by \d+ m") as refused:
        read_parcels(tmp_path / "old.gpkg", MAP)
    assert refused.value.code == "polygons-datum"


def test_sample__has_the_net_parcels_of_its_readme(shared_data: Path) -> None:
    """10 x 2.5 m gross, 8 x 2.28 m net, in 4 blocks of 5."""
    parcels = read_parcels(shared_data / "uav_wheat" / "parcels.geojson", MAP, (1.00, 0.11))[0]
    assert [p.id for p in parcels] == [str(k) for k in range(1, 21)]
    assert [p.block for p in parcels] == [str(k) for k in np.repeat(range(1, 5), 5)]
    for parcel in parcels:
        assert parcel.net.area == pytest.approx(8.0 * 2.28, rel=1e-3)
        assert parcel.gross.contains(parcel.net)
