"""Files of another kind than a reader expects, under a name that promises the right one: they are named, or read."""

from __future__ import annotations

import gzip
import io
import zipfile
from collections.abc import Callable
from pathlib import Path

import geopandas as gpd
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image
from pyproj import CRS
from shapely.geometry import Point, box

from furrowmap.core.crops.parcel_areas import read_parcels
from furrowmap.core.crops.trial_tables import read_measured, read_treatments
from furrowmap.core.geodesy.projection import read_parameters
from furrowmap.core.pipeline.session_aid import read_pixels
from furrowmap.core.readers.areas.area import read_area
from furrowmap.core.readers.boundary_file import read_fields
from furrowmap.core.readers.image_table import read_image_table
from furrowmap.core.readers.mount_csv import read_mount
from furrowmap.core.readers.surveyed_points import read_points
from furrowmap.core.runtime.errors import InputError
from furrowmap.core.runtime.file_signatures import binary_kind
from furrowmap.core.session.session_file import load_session
from furrowmap.core.simulator.scenario import load_scenario

MAP = CRS.from_epsg(6677)
READERS: dict[str, Callable[[Path], object]] = {
    "points-unreadable": lambda path: read_points(path, MAP),
    "control-pixels-unreadable": lambda path: read_pixels(path, ("A",)),
    "treatments-unreadable": read_treatments,
    "parcel-table-unreadable": lambda path: read_measured(path, "height_m"),
    "parcels-unreadable": lambda path: read_parcels(path, MAP)[0],
    "within-unreadable": lambda path: read_area(path, MAP),
    "boundary-unreadable": read_fields,
    "not-a-table": lambda path: read_image_table(path, path.parent),
    "parameters-unreadable": read_parameters,
    "session-unreadable": load_session,
}


def contents() -> dict[str, bytes]:
    """Content by what it is said to be."""
    picture, sheet = io.BytesIO(), io.BytesIO()
    Image.new("RGB", (9, 9)).save(picture, "PNG")
    with zipfile.ZipFile(sheet, "w") as archive:
        archive.writestr("a.txt", "text")
    noise = np.random.default_rng(1).bytes(6000)
    return {
        "a PNG picture": picture.getvalue(),
        "a PDF document": b"%PDF-1.7\n" + noise,
        "a Parquet table": b"PAR1" + noise,
        "a LAS or LAZ point cloud": b"LASF" + noise,
        "a zip archive": sheet.getvalue(),
        "a gzip archive": gzip.compress(noise),
        "binary data": noise,
    }


@pytest.mark.parametrize("code", READERS)
def test_promise_02__other_content_is_named(code: str, tmp_path: Path) -> None:
    path = tmp_path / "named.csv"
    for kind, content in contents().items():
        path.write_bytes(content)
        with pytest.raises(InputError) as refused:
            READERS[code](path)
        assert refused.value.code == code
        assert str(path) in refused.value.what
        if "archive" not in kind:  # spreadsheets and Shapefiles are zip archives, and gzip is unpacked by some
            assert kind in refused.value.what
        for sentence in (refused.value.what, refused.value.meaning, refused.value.remedy):
            assert "codec" not in sentence


def test_promise_02__a_mount_of_another_kind_is_named(tmp_path: Path) -> None:
    path = tmp_path / "mount.csv"
    path.write_bytes(contents()["a PNG picture"])
    with pytest.raises(InputError, match="it is a PNG picture, not text") as refused:
        read_mount(path, 0.0)
    assert refused.value.code == "not-a-table"


def test_promise_02__a_scenario_that_is_no_text_is_told(tmp_path: Path) -> None:
    path = tmp_path / "scenario.toml"
    path.write_bytes(contents()["a PNG picture"])
    with pytest.raises(InputError, match="it is not UTF-8 text") as refused:
        load_scenario(path)
    assert refused.value.code == "scenario-unreadable"


@pytest.mark.parametrize("suffix", ["csv", "txt", "shp", "tif", "geojson"])
def test_promise_02__a_geopackage_is_one_by_any_name(suffix: str, tmp_path: Path) -> None:
    fields = gpd.GeoDataFrame({"id": ["A", "B"]}, geometry=[box(0, 0, 9, 9), box(20, 0, 29, 9)], crs=MAP)
    fields.to_file(tmp_path / "fields.gpkg")
    (tmp_path / "fields.gpkg").rename(tmp_path / f"fields.{suffix}")
    assert [one.id for one in read_parcels(tmp_path / f"fields.{suffix}", MAP)[0]] == ["A", "B"]
    points = gpd.GeoDataFrame({"name": ["P", "Q"]}, geometry=[Point(1, 2, 3), Point(4, 5, 6)], crs=MAP)
    points.to_file(tmp_path / "points.gpkg")
    (tmp_path / "points.gpkg").rename(tmp_path / f"points.{suffix}")
    found = read_points(tmp_path / f"points.{suffix}", MAP)
    assert found.name == ("P", "Q")
    np.testing.assert_allclose(found.xyz_m, [[1, 2, 3], [4, 5, 6]], atol=1e-6)


@pytest.mark.parametrize(("driver", "suffix"), [("FlatGeobuf", "fgb"), ("GeoJSON", "geojson")])
def test_promise_02__other_vector_files_are_known_by_content(driver: str, suffix: str, tmp_path: Path) -> None:
    fields = gpd.GeoDataFrame({"id": ["A"]}, geometry=[box(139.0, 36.0, 139.001, 36.001)], crs=4326)
    fields.to_file(tmp_path / f"fields.{suffix}", driver=driver)
    (tmp_path / f"fields.{suffix}").rename(tmp_path / "fields.csv")
    assert [one.id for one in read_parcels(tmp_path / "fields.csv", MAP)[0]] == ["A"]


@given(st.text(st.characters(categories=["L", "N", "P", "Zs"]), max_size=500), st.sampled_from(["utf-8", "utf-8-sig"]))
def test_text__in_any_script_is_text(text: str, encoding: str) -> None:
    assert binary_kind(f"id,e_m,n_m\r\n{text}\n".encode(encoding)) is None
    assert binary_kind(f"id,{text}".encode("utf-16")) is None


def test_text__of_japanese_spreadsheets_is_text() -> None:
    assert binary_kind("圃場,名前\r\n一号,田\r\n".encode("cp932")) is None
    assert binary_kind(b"") is None
