"""Vector and raster files of anybody: GDAL opens what they are, and nothing that they refer to."""

from __future__ import annotations

import json
import os
import shutil
import sqlite3
from collections.abc import Callable, Iterator
from contextlib import closing, suppress
from pathlib import Path
from typing import Any

import geopandas as gpd
import numpy as np
import pyogrio
import pytest
import rasterio
from pyproj import CRS
from shapely.geometry import box

from furrowmap.core.crops.parcel_areas import read_parcels
from furrowmap.core.readers.areas.area import read_area
from furrowmap.core.readers.boundary_file import read_fields
from furrowmap.core.readers.geotiff import open_geotiff
from furrowmap.core.readers.ogr_layers import layer_info, list_layers, read_layer_arrays
from furrowmap.core.readers.surveyed_points import read_points
from furrowmap.core.runtime.errors import FurrowmapError, InputError
from tests.core.readers.driver_signatures import signatures
from tests.core.readers.watched_files import Bait, bait_beside

MAP = CRS.from_epsg(6677)
SUFFIXES = (".geojson", ".json", ".gpkg", ".fgb", ".shp", ".kml", ".csv", ".tif", ".tiff", ".xml", ".vrt", ".zip")
BEGINNINGS: dict[str, tuple[bytes, tuple[str, ...]]] = {
    "nothing": (b"", SUFFIXES),
    "a brace": (b"{", SUFFIXES),
    "KML": (b"<kml ", SUFFIXES),
    "GeoPackage": (b"SQLite format 3\0", (".gpkg", ".csv", ".vrt")),
    "FlatGeobuf": (b"fgb\x03fgb\x00", (".fgb", ".csv", ".vrt")),
    "Shapefile": (b"\0\0\x27\x0a" + b"\0" * 20, (".shp", ".csv", ".vrt")),
    "TIFF": (b"II*\0\x08\0\0\0", (".tif", ".csv", ".vrt")),
    "BigTIFF": (b"MM\0+", (".tif", ".csv", ".vrt")),
}
"""First bytes, and the names that files with these have."""
KILLS = int(os.environ.get("KILLS", "0"))
Read = Callable[[Path], object]


def unusable(path: Path, why: str) -> InputError:
    return InputError("surface-unusable", path=path, why=why)


def read_raster(path: Path) -> object:
    with open_geotiff(path, unusable) as raster:
        return raster.read(1, out_shape=(2, 2)), raster.dataset_mask(), raster.overviews(1)


READS: tuple[Read, ...] = (
    read_fields,
    lambda path: read_parcels(path, MAP)[0],
    lambda path: read_area(path, MAP),
    lambda path: read_points(path, MAP),
    list_layers,
    layer_info,
    read_layer_arrays,
    read_raster,
)


@pytest.fixture
def bait(tmp_path: Path) -> Iterator[Bait]:
    with bait_beside(tmp_path) as bait:
        yield bait


def read_all(path: Path) -> None:
    """By every reader; whatever it finds is no matter here."""
    for read in READS:
        with suppress(FurrowmapError, ValueError, OSError, RuntimeError, sqlite3.Error):
            read(path)


def test_bait__is_seen_to_be_taken(bait: Bait, tmp_path: Path) -> None:
    vrt = tmp_path / "taken.geojson"
    vrt.write_text("{" + signatures(str(bait.file), bait.url)["OGR_VRT"])
    assert not bait.taken()
    with suppress(RuntimeError):
        pyogrio.raw.read(vrt)
    assert bait.taken()


@pytest.mark.parametrize("beginning", BEGINNINGS)
def test_promise_23__files_with_signatures_of_all_drivers_open_nothing_else(
    beginning: str, bait: Bait, tmp_path: Path
) -> None:
    """Of the three beginnings with all suffixes, each driver meets each suffix with one; `KILLS=1` tries all."""
    head, suffixes = BEGINNINGS[beginning]
    share = 3 if suffixes is SUFFIXES and not KILLS else 1
    turn = [*BEGINNINGS].index(beginning)
    taken = []
    for number, (driver, text) in enumerate(signatures(str(bait.file), bait.url).items()):
        for suffix in suffixes[(turn + number) % share :: share]:
            path = tmp_path / f"any{suffix}"
            path.write_bytes(head + text.encode() + b"\n" * 200)
            read_all(path)
            if bait.taken():
                taken.append((driver, suffix))
            path.unlink()
    assert taken == []


def test_promise_23__a_text_of_another_driver_within_valid_geojson_opens_nothing(bait: Bait, tmp_path: Path) -> None:
    ring = [[140.0, 36.0], [140.001, 36.0], [140.001, 36.001], [140.0, 36.0]]
    path = tmp_path / "field.geojson"
    for text in signatures(str(bait.file), bait.url).values():
        feature = {
            "type": "Feature",
            "properties": {text: text},
            "geometry": {"type": "Polygon", "coordinates": [ring]},
        }
        path.write_text(json.dumps({text: 1, "type": "FeatureCollection", "features": [feature]}))
        assert len(read_fields(path)[0]) == 1
        read_all(path)
        assert not bait.taken()


def geopackage(path: Path, *statements: str, rows: int = 3) -> Path:
    shapes = [box(k, 0, k + 0.5, 1) for k in range(rows)]
    gpd.GeoDataFrame({"id": [f"P{k}" for k in range(rows)]}, geometry=shapes, crs=MAP).to_file(path, layer="fields")
    with closing(sqlite3.connect(path)) as database:
        database.execute("PRAGMA writable_schema = ON")
        for statement in statements:
            database.execute(statement)
        database.commit()
    return path


ENDLESS = "WITH RECURSIVE c(x) AS (SELECT 1 UNION ALL SELECT x + 1 FROM c) SELECT x AS fid FROM c WHERE x < 0"
COMPUTING = {
    "does not end soon": f"CREATE VIEW endless AS {ENDLESS}",
    "stored query 'pairs'": "CREATE VIEW pairs AS SELECT count(*) FROM fields a, fields b, fields c",
    "not authorized": "CREATE VIEW noise AS SELECT randomblob(1000000000)",
    "virtual table 'text'": "CREATE VIRTUAL TABLE text USING fts5(x)",
    "virtual table 'text using rtree'": 'CREATE VIRTUAL TABLE "text using rtree" USING fts5(x)',
    "virtual table 'remarked'": (
        "INSERT INTO sqlite_master VALUES ('table', 'remarked', 'remarked', 0, "
        "'CREATE/**/VIRTUAL TABLE remarked USING VirtualOGR(''/etc/passwd'')')"
    ),
    "virtual table 'other'": (
        "INSERT INTO sqlite_master VALUES ('table', 'other', 'other', 0, "
        "'CREATE VIRTUAL TABLE other USING VirtualOGR(''/etc/passwd'')')"
    ),
    "computes the column 'b'": "CREATE TABLE more (a, b AS (a + 1))",
}


@pytest.mark.parametrize("says", COMPUTING)
def test_promise_23__a_geopackage_that_computes_is_refused(says: str, tmp_path: Path) -> None:
    path = geopackage(tmp_path / "fields.gpkg", COMPUTING[says], rows=1000)
    with pytest.raises(InputError, match=says):
        read_parcels(path, MAP)
    for read in (list_layers, layer_info, read_layer_arrays):
        with pytest.raises(ValueError, match=says):
            read(path)


def test_a_geopackage__with_a_plain_stored_query_is_read(tmp_path: Path) -> None:
    path = geopackage(tmp_path / "fields.gpkg", "CREATE VIEW some AS SELECT * FROM fields WHERE id = 'P1'")
    assert [one.id for one in read_parcels(path, MAP)[0]] == ["P0", "P1", "P2"]


def test_promise_23__pages_that_are_used_twice_are_refused(tmp_path: Path) -> None:
    path = geopackage(tmp_path / "fields.gpkg", rows=5000)
    with closing(sqlite3.connect(path)) as database:
        (root,) = database.execute("SELECT rootpage FROM sqlite_master WHERE name = 'fields'").fetchone()
        (page_bytes,) = database.execute("PRAGMA page_size").fetchone()
    data = bytearray(path.read_bytes())
    begin = (root - 1) * page_bytes
    assert data[begin] == 5  # an interior page of a table
    cells = int.from_bytes(data[begin + 3 : begin + 5], "big")
    places = [int.from_bytes(data[begin + 12 + 2 * k : begin + 14 + 2 * k], "big") for k in range(cells)]
    for place in places[1:]:
        data[begin + place : begin + place + 4] = data[begin + places[0] : begin + places[0] + 4]
    path.write_bytes(data)
    with pytest.raises(InputError, match="is damaged"):
        read_parcels(path, MAP)


@pytest.mark.parametrize("end", ["-journal", "-wal", "-shm"])
def test_promise_23__files_of_a_geopackage_that_are_links_are_refused(end: str, bait: Bait, tmp_path: Path) -> None:
    path = geopackage(tmp_path / "fields.gpkg")
    Path(f"{path}{end}").symlink_to(bait.file)
    with pytest.raises(InputError, match="is a link"):
        read_parcels(path, MAP)
    assert not bait.taken()


def test_promise_23__a_journal_that_names_another_file_is_not_rolled_back(tmp_path: Path) -> None:
    path = geopackage(tmp_path / "fields.gpkg")
    victim = tmp_path / "victim"
    victim.write_bytes(b"\0")
    name = str(victim).encode()
    checksum = sum(name) & 0xFFFFFFFF
    record = name + len(name).to_bytes(4, "big") + checksum.to_bytes(4, "big") + bytes.fromhex("d9d505f920a163d7")
    Path(f"{path}-journal").write_bytes(bytes.fromhex("d9d505f920a163d7") + bytes(600) + record)
    with pytest.raises(InputError, match="names another file"):
        read_parcels(path, MAP)
    assert victim.exists()


def test_promise_23__parts_of_a_shapefile_lie_in_its_folder(bait: Bait, tmp_path: Path) -> None:
    gpd.GeoDataFrame({"id": ["A"]}, geometry=[box(0, 0, 9, 9)], crs=MAP).to_file(tmp_path / "fields.shp")
    assert [one.id for one in read_parcels(tmp_path / "fields.shp", MAP)[0]] == ["A"]
    for end in (".prj", ".dbf", ".shx"):
        folder = tmp_path / f"of{end}"
        folder.mkdir()
        for part in tmp_path.glob("fields.*"):
            shutil.copy(part, folder)
        (folder / f"fields{end}").unlink()
        (folder / f"fields{end}").symlink_to(bait.file)
        with pytest.raises(InputError, match="is a link to another folder"):
            read_parcels(folder / "fields.shp", MAP)
        assert not bait.taken()


def test_promise_07__records_of_a_shapefile_that_overlap_are_refused(tmp_path: Path) -> None:
    shapes = [box(10 * k, 0, 10 * k + 9, 9) for k in range(20)]
    gpd.GeoDataFrame({"id": [f"P{k}" for k in range(20)]}, geometry=shapes, crs=MAP).to_file(tmp_path / "fields.shp")
    index = tmp_path / "fields.shx"
    data = index.read_bytes()
    index.write_bytes(data[:100] + data[100:108] * 20)
    with pytest.raises(InputError, match=r"shx is damaged"):
        read_parcels(tmp_path / "fields.shp", MAP)


def test_promise_07__more_features_than_a_file_can_hold_are_refused(tmp_path: Path) -> None:
    path = geopackage(tmp_path / "fields.gpkg", "UPDATE gpkg_ogr_contents SET feature_count = 2000000000")
    with pytest.raises(InputError, match="2,000,000,000 features"):
        read_parcels(path, MAP)


def geotiff(path: Path, **tags: dict[str, str]) -> Path:
    profile: dict[str, Any] = {"driver": "GTiff", "width": 64, "height": 64, "count": 1, "dtype": "float32"}
    with rasterio.open(path, "w", **profile, crs="EPSG:6677", transform=rasterio.Affine(1, 0, 0, 0, -1, 0)) as raster:
        raster.write(np.ones((1, 64, 64), np.float32))
        for domain, values in tags.items():
            raster.update_tags(ns=domain, **values)
    return path


@pytest.mark.parametrize("end", [".ovr", ".msk", ".aux.xml", ".vrt"])
def test_promise_23__neighbours_of_a_geotiff_open_nothing_else(end: str, bait: Bait, tmp_path: Path) -> None:
    path = geotiff(tmp_path / "dsm.tif")
    for text in signatures(str(bait.file), bait.url).values():
        Path(f"{path}{end}").write_text(text)
        with suppress(InputError):
            read_raster(path)
        assert not bait.taken()
    Path(f"{path}{end}").write_text(
        f"<PAMDataset><Metadata domain='OVERVIEWS'><MDI key='OVERVIEW_FILE'>{bait.file}</MDI></Metadata></PAMDataset>"
    )
    with suppress(InputError):
        read_raster(path)
    assert not bait.taken()


@pytest.mark.parametrize("domain", ["OVERVIEWS", "GEOLOCATION"])
def test_promise_23__a_geotiff_whose_metadata_refer_to_files_is_refused(
    domain: str, bait: Bait, tmp_path: Path
) -> None:
    named = {"OVERVIEW_FILE": str(bait.file), "X_DATASET": str(bait.file), "Y_DATASET": f"/vsicurl/{bait.url}"}
    path = geotiff(tmp_path / "dsm.tif", **{domain: named})
    with pytest.raises(InputError, match=f"its metadata {domain} refer to another file"):
        read_raster(path)
    assert not bait.taken()


def test_a_geotiff__has_its_place_mask_and_missing_value_from_beside_it(tmp_path: Path) -> None:
    path = tmp_path / "dsm.tif"
    profile: dict[str, Any] = {"driver": "GTiff", "width": 8, "height": 8, "count": 1, "dtype": "float32"}
    with rasterio.Env(GDAL_TIFF_INTERNAL_MASK=False), rasterio.open(path, "w", **profile) as raster:
        raster.write(np.ones((1, 8, 8), np.float32))
        mask = np.full((8, 8), 255, np.uint8)
        mask[2, 3] = 0
        raster.write_mask(mask)
    assert Path(f"{path}.msk").is_file()
    (tmp_path / "dsm.tfw").write_text("0.5\n0\n0\n-0.5\n100.25\n199.75\n")
    srs = CRS.from_epsg(6677).to_wkt("WKT1_GDAL").replace('"', "&quot;")
    value = "<PAMRasterBand band='1'><Description>height</Description></PAMRasterBand>"
    Path(f"{path}.aux.xml").write_text(f"<PAMDataset><SRS>{srs}</SRS>{value}</PAMDataset>")
    with open_geotiff(path, unusable) as raster:
        assert raster.transform == rasterio.Affine(0.5, 0, 100, 0, -0.5, 200)
        assert CRS.from_wkt(raster.crs.to_wkt()).name == MAP.name
        assert raster.descriptions == ("height",)
        assert np.flatnonzero(raster.dataset_mask() == 0).tolist() == [19]
    assert read_raster(path)


@pytest.mark.parametrize("end", [".tfw", ".aux.xml", ".msk"])
def test_promise_23__neighbours_that_are_links_or_too_large_are_refused(end: str, bait: Bait, tmp_path: Path) -> None:
    (tmp_path / "result").mkdir()
    path = geotiff(tmp_path / "result" / "dsm.tif")
    beside = path.with_suffix(end) if end == ".tfw" else Path(f"{path}{end}")
    beside.symlink_to(bait.file)
    with pytest.raises(InputError, match="is a link to another folder"):
        read_raster(path)
    assert not bait.taken()
    beside.unlink()
    beside.write_bytes(b"\n" * 2_000_000)
    with pytest.raises(InputError, match=r"2,000,000 bytes|is no TIFF"):
        read_raster(path)
