"""What is passed on says the same as `field.gpkg`, in whatever format, for whoever reads it."""

from __future__ import annotations

import json
import resource
import shutil
from pathlib import Path
from xml.etree import ElementTree as ET

import geopandas as gpd
import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pyogrio
import pystac
import pystac.validation
import pytest
import rasterio
import shapely
from pyproj import CRS, Transformer
from pystac.extensions.pointcloud import PointcloudExtension
from pystac.extensions.projection import ProjectionExtension
from rasterio.transform import from_origin

from furrowmap.core.runtime.errors import FurrowmapError, InputError, RefusedError, UsageError
from furrowmap.core.runtime.write_errors import WriteError
from furrowmap.exporters.exchange.trajectories import TRAJECTORIES
from furrowmap.exporters.files.provenance import Origin
from furrowmap.exporters.reports.drawings import pass_colour
from furrowmap.exporters.vectors.geopackage import write_field
from furrowmap.exporters.work_colours import MISSED_COLOUR, OVERLAP_COLOUR
from furrowmap.workflows.farm.mosaic import mosaic
from furrowmap.workflows.share.export import EXPORT_FORMATS, export
from tests.app.files_server import served
from tests.exporters.vectors.worked_field import worked_field

JAPAN = CRS.from_epsg(6677)
LAYERS = [
    "events",
    "trajectory",
    "tool_path",
    "misses",
    "unworked",
    "boundary",
    "overlaps",
    "coverage",
    "passes",
    "zones",
]


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of products with the layers of a field worked in closed form."""
    folder = tmp_path_factory.mktemp("field") / "result"
    folder.mkdir()
    poses, work = worked_field()
    write_field(folder / "field.gpkg", poses, JAPAN, work)
    write_report(folder, "Nordfeld, östlich")
    return folder


def write_report(folder: Path, name: str) -> None:
    report = {
        "furrowmap": "0.1.0",
        "session": {
            "name": name,
            "crs": {"map": "EPSG:6677", "heights": "ellipsoidal", "coordinates": "as-recorded"},
            "lidar": {"model": "VLP-16"},
            "implement": {"kind": "tiller", "width_m": 1.7, "xy_m": [-1.5, 0.0]},
        },
        "coordinates": {"frame": "JGD2011", "epoch": None},
        "inputs": [{"name": "recording.pcap", "bytes": 5, "sha256": "00ff"}],
        "figures": {
            "start": "2026-06-11T01:23:40.937Z",
            "end": "2026-06-11T01:24:40.692Z",
            "points": 1000,
            "worked_area_ellipsoid_m2": 50.0,
            "worked_length_m": 47.0,
            "distance_m": 84.0,
            "hours": {"field_s": 78.0, "working_s": 47.0, "turning_s": 31.0, "idle_s": 0.0},
            "bounds_m": [[16_600.0, 96_500.0, 270.0], [16_700.0, 96_600.0, 275.0]],
        },
        "products": ["cloud.copc.laz", "field.gpkg", "dsm.tif", "report.html", "something.else"],
    }
    (folder / "report.json").write_text(json.dumps(report), encoding="utf-8")


def original(result: Path, layer: str) -> gpd.GeoDataFrame:
    return gpd.read_file(result / "field.gpkg", layer=layer)


def assert_same(copy: gpd.GeoDataFrame, truth: gpd.GeoDataFrame, tolerance_m: float = 0.0) -> None:
    """The same features in the same order is not asked of FlatGeobuf, whose index sorts them."""
    assert len(copy) == len(truth)
    key = next(name for name in ("t_s", "start", "area_m2") if name in truth.columns)
    copy, truth = (table.sort_values(key, kind="stable").reset_index(drop=True) for table in (copy, truth))
    for name in set(truth.columns) - {"geometry"}:
        if truth[name].dtype.kind in "if":
            np.testing.assert_allclose(copy[name].astype(float), truth[name].astype(float), err_msg=name)
        elif truth[name].dtype.kind == "M":
            assert (pd.to_datetime(copy[name], utc=True) - truth[name]).abs().max() <= pd.Timedelta("1ms"), name
        else:
            assert copy[name].fillna("").tolist() == truth[name].fillna("").tolist(), name
    apart = copy.geometry.to_crs(truth.crs).hausdorff_distance(truth.geometry, align=False)
    assert apart.max() <= tolerance_m


@pytest.mark.parametrize(("to", "suffix"), [("geoparquet", "parquet"), ("flatgeobuf", "fgb")])
def test_files_a_layer__keep_every_field_and_coordinate(result: Path, tmp_path: Path, to: str, suffix: str) -> None:
    done = export([result], to, tmp_path / "out")
    assert sorted(path.name for path in done.files) == sorted(
        ["provenance.json", *(f"{name}.{suffix}" for name in LAYERS)]
    )
    for name in LAYERS:
        path = tmp_path / "out" / f"{name}.{suffix}"
        copy = gpd.read_parquet(path) if to == "geoparquet" else gpd.read_file(path)
        assert copy.crs == JAPAN
        truth = original(result, name)
        assert_same(copy, truth)
        assert copy.has_z.all() == truth.has_z.all()


def test_geoparquet__says_crs_and_box_of_each_row(result: Path, tmp_path: Path) -> None:
    export([result], "geoparquet", tmp_path / "out", layers=["passes"])
    told = json.loads(pq.read_schema(tmp_path / "out" / "passes.parquet").metadata[b"geo"])
    assert told["version"] == "1.1.0"
    column = told["columns"]["geometry"]
    assert CRS.from_json_dict(column["crs"]) == JAPAN
    assert set(column["covering"]["bbox"]) == {"xmin", "ymin", "xmax", "ymax"}


def test_geopackage__of_some_layers_in_another_crs_has_their_styles(result: Path, tmp_path: Path) -> None:
    path = tmp_path / "some.gpkg"
    done = export([result], "gpkg", path, layers=["passes", "events"], crs=CRS("EPSG:6678"))
    assert done.files == (path,)
    assert [name for name, kind in pyogrio.list_layers(path) if kind is not None] == ["passes", "events"]
    assert set(gpd.read_file(path, layer="layer_styles")["f_table_name"]) == {"passes", "events"}
    copy, truth = gpd.read_file(path, layer="events"), original(result, "events")
    assert_same(copy, truth, 1e-6)
    np.testing.assert_array_equal(copy.geometry.z, truth.geometry.z)


def test_geojson__is_in_wgs84_as_its_standard_asks(result: Path, tmp_path: Path) -> None:
    done = export([result], "geojson", tmp_path / "out")
    assert [notice.code for notice in done.notices] == ["crs-change-loose"]
    told = json.loads((tmp_path / "out" / "passes.geojson").read_text())
    assert "crs" not in told  # RFC 7946, section 4
    ring = told["features"][0]["geometry"]["coordinates"][0][0]
    to_map = Transformer.from_crs("EPSG:6668", JAPAN, always_xy=True)
    whole = shapely.Polygon(np.column_stack(to_map.transform(*np.array(ring)[:, :2].T)))
    assert whole.symmetric_difference(original(result, "passes").geometry[0]).area < 1e-3


def test_shapefile__says_what_its_names_became(result: Path, tmp_path: Path) -> None:
    done = export([result], "shapefile", tmp_path / "out", layers=["passes", "trajectory"])
    assert [notice.code for notice in done.notices] == ["shapefile-names"]
    copy, truth = gpd.read_file(tmp_path / "out" / "passes.shp"), original(result, "passes")
    assert copy["start"].tolist() == [t.isoformat(timespec="milliseconds")[:23] + "Z" for t in truth["start"]]
    np.testing.assert_allclose(copy["are_ell_m2"], truth["area_ellipsoid_m2"], rtol=1e-12)
    assert copy.crs.to_epsg() == 6677
    points = gpd.read_file(tmp_path / "out" / "trajectory.shp")
    assert len(set(points.columns)) == len(original(result, "trajectory").columns)
    assert max(map(len, points.columns.drop("geometry"))) <= 10


def test_kml__is_read_by_gdal_with_names_times_and_shapes(result: Path, tmp_path: Path) -> None:
    path = tmp_path / "field.kml"
    export([result], "kml", path)
    assert {name for name, _ in pyogrio.list_layers(path)} >= {
        "passes",
        "ground worked twice",
        "missed ground",
        "cultivated path",
    }
    copy, truth = gpd.read_file(path, layer="passes"), original(result, "passes")
    assert copy["Name"].tolist() == [f"pass {number}" for number in truth["pass"]]
    moved = shapely.transform(
        copy.geometry.array,
        lambda xy: np.column_stack(Transformer.from_crs("EPSG:6668", JAPAN, always_xy=True).transform(*xy.T)),
    )
    assert shapely.hausdorff_distance(moved, truth.geometry.array).max() < 1e-3
    spans = ET.parse(path).findall(".//{*}TimeSpan/{*}begin")
    assert f"{truth['start'][0].isoformat(timespec='milliseconds')[:23]}Z" in {begin.text for begin in spans}


def test_csv__has_coordinates_of_points_and_texts_of_shapes(result: Path, tmp_path: Path) -> None:
    export([result], "csv", tmp_path / "out")
    points, truth = pd.read_csv(tmp_path / "out" / "trajectory.csv"), original(result, "trajectory")
    np.testing.assert_allclose(points["e_m"], truth.geometry.x, atol=1e-9)
    np.testing.assert_allclose(points["h_m"], truth.geometry.z, atol=1e-4)
    assert points["time"][0].endswith("Z")
    passes = pd.read_csv(tmp_path / "out" / "passes.csv")
    areas = shapely.area(shapely.from_wkt(passes["wkt"].to_numpy(object)))
    np.testing.assert_allclose(areas, original(result, "passes").area, rtol=1e-4)


def told_in(to: str, target: Path) -> dict[str, str]:
    """What an export tells of where it comes from."""
    if to == "gpkg":
        return dict(pyogrio.read_info(target, layer="passes")["dataset_metadata"])
    if to == "kml":
        text = ET.parse(target).find("./{*}Document/{*}description").text
        return dict(part.split(" ", 1) for part in text.split("; "))
    if to == "isoxml":
        parser = ET.XMLParser(target=ET.TreeBuilder(insert_comments=True))
        comment = ET.parse(target / "TASKDATA.XML", parser).getroot()[0]
        return dict(line.strip().split(": ", 1) for line in comment.text.strip().splitlines())
    return json.loads((target / "provenance.json").read_text(encoding="utf-8"))


def test_kml__has_the_colours_of_the_map(result: Path, tmp_path: Path) -> None:
    """Those that QGIS shows: missed ground purple, worked twice orange, passes from pale to dark green."""
    path = tmp_path / "field.kml"
    export([result], "kml", path)
    root = ET.parse(path).getroot()
    named = {f"#{style.get('id')}": style for style in root.findall(".//{*}Style")}
    shown: dict[str, set[str]] = {}
    for folder in root.findall(".//{*}Folder"):
        for mark in folder.findall("{*}Placemark"):
            style = named[str(mark.findtext("{*}styleUrl"))]
            fill = str(style.findtext("{*}PolyStyle/{*}color"))[2:]
            shown.setdefault(str(folder.findtext("{*}name")), set()).add(fill)

    # Blue, green, red.
    assert shown["missed ground"] == {"".join(MISSED_COLOUR[k : k + 2] for k in (5, 3, 1))}
    assert shown["ground worked twice"] == {"".join(OVERLAP_COLOUR[k : k + 2] for k in (5, 3, 1))}
    assert shown["passes"] == {"".join(pass_colour(n, 3)[k : k + 2] for k in (5, 3, 1)) for n in (1, 2, 3)}


@pytest.mark.parametrize(
    "to", [name for name in EXPORT_FORMATS if name not in ("stac", "glb", *TRAJECTORIES)]
)  # those are nothing but poses; a mesh needs rasters, in test_textured_mesh.py
def test_export__tells_where_it_comes_from(result: Path, tmp_path: Path, to: str) -> None:
    target = tmp_path / ("out.gpkg" if to == "gpkg" else "out")
    export([result], to, target)
    told = told_in(to, target)
    assert told["SESSION"] == "Nordfeld, östlich"
    assert told["SOFTWARE"].startswith("furrowmap ")
    assert told["RESULT_OF"] == "furrowmap 0.1.0"
    assert told["INPUT_1"] == "recording.pcap sha256:00ff"
    assert (told["TIME_START"], told["MEASURED_EPOCH"]) == ("2026-06-11T01:23:40.937Z", "2026.441")
    assert told["MAP"] == "EPSG:6677"


@pytest.mark.parametrize("to", ["geojson", "flatgeobuf", "shapefile"])
def test_disk_that_is_full_at_the_last_byte__leaves_nothing(result: Path, tmp_path: Path, to: str) -> None:
    export([result], to, tmp_path / "whole")
    largest = max(path.stat().st_size for path in (tmp_path / "whole").iterdir())
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (largest - 1, limits[1]))
    try:
        with pytest.raises((OSError, WriteError)):
            export([result], to, tmp_path / "cut")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert [path.name for path in tmp_path.iterdir()] == ["whole"]


def test_export__of_fewer_layers_leaves_none_of_the_earlier_ones(result: Path, tmp_path: Path) -> None:
    target = tmp_path / "out"
    export([result], "csv", target)
    (target / "notes.txt").write_text("mine")
    export([result], "csv", target, layers=["passes"], overwrite=True)
    assert {path.name for path in target.iterdir()} == {"passes.csv", "provenance.json", "notes.txt"}


def test_stac__is_valid_and_says_where_and_what(result: Path, tmp_path: Path) -> None:
    second = tmp_path / "second"
    second.mkdir()
    (second / "field.gpkg").write_bytes((result / "field.gpkg").read_bytes())
    write_report(second, "")
    done = export([result, second], "stac", tmp_path / "farm")
    collection = pystac.Collection.from_file(str(tmp_path / "farm" / "collection.json"))
    assert len(done.files) == 4
    items = list(collection.get_items())
    for each in (collection, *items):
        pystac.validation.validate_dict(each.to_dict(), extensions=[])
    item = next(item for item in items if item.properties["title"] == "Nordfeld, östlich")
    projection = ProjectionExtension.ext(item)
    assert (projection.code, projection.bbox) == ("EPSG:6677", [16_600.0, 96_500.0, 16_700.0, 96_600.0])
    assert PointcloudExtension.ext(item).count == 1000
    assert set(item.assets) == {"cloud", "field", "dsm", "report"}
    assert (tmp_path / "farm" / item.assets["field"].href).resolve() == (result / "field.gpkg").resolve()
    footprint = shapely.geometry.shape(item.geometry)
    to_map = Transformer.from_crs("EPSG:6668", JAPAN, always_xy=True)
    on_map = shapely.transform(footprint, lambda xy: np.column_stack(to_map.transform(*xy.T)))
    assert on_map.symmetric_difference(shapely.box(16_600, 96_500, 16_700, 96_600)).area < 1.0
    assert footprint.exterior.is_ccw


def test_stac__is_read_from_a_server_of_plain_files(result: Path, tmp_path: Path) -> None:
    export([result], "stac", tmp_path / "farm")
    with served(tmp_path) as address:
        catalogue = pystac.Catalog.from_file(f"{address}farm/catalog.json")
        (item,) = catalogue.get_items(recursive=True)
    pystac.validation.validate_dict(catalogue.to_dict(), extensions=[])
    assert item.properties["title"] == "Nordfeld, östlich"
    assert item.get_root() is catalogue


def test_stac__tells_software_parameters_and_epoch(result: Path, tmp_path: Path) -> None:
    export([result], "stac", tmp_path / "farm")
    item = next(iter(pystac.Collection.from_file(str(tmp_path / "farm" / "collection.json")).get_items()))
    assert item.properties["processing:software"] == {"furrowmap": "0.1.0"}
    assert "https://stac-extensions.github.io/processing/v1.1.0/schema.json" in item.stac_extensions
    assert item.properties["furrowmap:measured_epoch"] == "2026.441"
    assert item.properties["furrowmap:parameters"]["heights"] == "ellipsoidal"
    assert item.properties["furrowmap:inputs"] == [{"name": "recording.pcap", "sha256": "00ff"}]


def test_stac__is_in_the_frame_in_which_coordinates_are_stated(result: Path, tmp_path: Path) -> None:
    folder = tmp_path / "today"
    folder.mkdir()
    (folder / "field.gpkg").write_bytes((result / "field.gpkg").read_bytes())
    write_report(folder, "today")
    report = json.loads((folder / "report.json").read_text(encoding="utf-8"))
    report["session"]["crs"]["coordinates"] = "ITRF2020@2026.4"
    report["coordinates"] = {"frame": "ITRF2020", "epoch": 2026.4}
    (folder / "report.json").write_text(json.dumps(report), encoding="utf-8")
    export([folder], "stac", tmp_path / "farm")
    item = next(iter(pystac.Collection.from_file(str(tmp_path / "farm" / "collection.json")).get_items()))
    projection = ProjectionExtension.ext(item)
    assert projection.code is None  # no EPSG code is of that frame
    assert projection.projjson is not None
    told = CRS.from_json_dict(projection.projjson)
    assert told.geodetic_crs is not None
    assert told.geodetic_crs.to_epsg() == 9990  # ITRF2020
    to_map = Transformer.from_crs("EPSG:9990", told, always_xy=True)
    on_map = shapely.transform(
        shapely.geometry.shape(item.geometry), lambda xy: np.column_stack(to_map.transform(*xy.T))
    )
    assert on_map.symmetric_difference(shapely.box(16_600, 96_500, 16_700, 96_600)).area < 1.0
    assert item.properties["furrowmap:parameters"]["coordinate_epoch"] == "2026.4"


def test_stac__of_the_same_session_twice_is_refused(result: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="same session"):
        export([result, result], "stac", tmp_path / "farm")
    assert not (tmp_path / "farm").exists()


@pytest.mark.parametrize("to", [name for name in EXPORT_FORMATS if name != "glb"])
def test_export__twice_gives_the_same_and_replaces_nothing_unasked(result: Path, tmp_path: Path, to: str) -> None:
    target = tmp_path / "out.gpkg" if to == "gpkg" else tmp_path / "out"
    first = export([result], to, target)
    with pytest.raises(RefusedError) as refused:
        export([result], to, target)
    assert refused.value.code == "output-exists"
    before = {path: path.read_bytes() for path in first.files}
    again = export([result], to, target, overwrite=True)
    assert again.files == first.files
    if to not in {"gpkg", "flatgeobuf", "shapefile"}:  # which tell the day or time of writing, or a random name
        assert {path: path.read_bytes() for path in again.files} == before


@pytest.fixture(scope="module")
def seen(result: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The result with a surface and an orthophoto: what every format can be made of."""
    folder: Path = tmp_path_factory.mktemp("seen") / "my.field"
    shutil.copytree(result, folder)
    for name, bands in (("dsm.tif", 1), ("orthophoto.tif", 3)):
        kind = {"driver": "GTiff", "crs": "EPSG:6677", "dtype": "float32" if bands == 1 else "uint8", "count": bands}
        place = {"height": 4, "width": 6, "transform": from_origin(16_600, 96_500, 0.5, 0.5)}
        with rasterio.open(folder / name, "w", **kind, **place) as file:
            file.write(np.full((bands, 4, 6), 100, kind["dtype"]))
    return folder


BEGINNINGS = {
    "gpkg": (".gpkg", b"SQLite format 3"),
    "kml": (".kml", b"<?xml"),
    "sbet": (".sbet", b""),
    "tum": (".tum", b"1750000000.1"),
    "poses": (".csv", b"time"),
    "glb": (".glb", b"glTF"),
}
"""Suffix and first bytes of formats with one file; the others are folders."""


@pytest.mark.parametrize("to", EXPORT_FORMATS)
def test_default_target__is_beside_the_result_and_named_after_it_and_the_format(seen: Path, to: str) -> None:
    suffix, begin = BEGINNINGS.get(to, ("", b""))
    beside = {path.name for path in seen.parent.iterdir()}
    done = export([seen], to)
    assert done.target == seen.with_name(f"my.field_{to}{suffix}")
    assert {path.name for path in seen.parent.iterdir()} - beside == {done.target.name}
    if suffix:
        assert done.files == (done.target,)
        assert done.target.read_bytes().startswith(begin)
    else:
        assert len(done.files) > 1
        assert set(done.files) == set(done.target.iterdir())


@pytest.mark.parametrize(
    ("arguments", "code"),
    [
        ({"to": "csv", "layers": ["pases"]}, "no-such-layer"),
        ({"to": "stac", "layers": ["passes"]}, "usage"),
        ({"to": "geojson", "folders": 2}, "usage"),
        ({"to": "csv", "folders": 0}, "no-result"),
        ({"to": "glb"}, "no-orthophoto"),
    ],
)
def test_export__that_cannot_be_says_why(result: Path, tmp_path: Path, arguments: dict[str, object], code: str) -> None:
    given = dict(arguments)
    count = given.pop("folders", 1)
    folders = [result] * int(str(count)) or [tmp_path / "nothing"]
    with pytest.raises(FurrowmapError) as told:
        export(folders, given.pop("to"), tmp_path / "out", **given)  # type: ignore[arg-type]
    assert told.value.code == code
    assert isinstance(told.value, InputError | UsageError)
    assert not (tmp_path / "out").exists()


def test_export__into_a_folder_of_products_is_refused(result: Path) -> None:
    with pytest.raises(RefusedError) as refused:
        export([result], "csv", result, overwrite=True)
    assert refused.value.code == "output-is-result"


@pytest.mark.parametrize("text", ["", "{", "[]", '{"session": 5}'])
def test_export__of_a_damaged_report_says_so(tmp_path: Path, text: str) -> None:
    (tmp_path / "report.json").write_text(text)
    with pytest.raises(InputError) as told:
        export([tmp_path], "csv", tmp_path / "out")
    assert told.value.code == "result-unreadable"


def test_report_with_a_damaged_time__is_an_error_of_the_result(result: Path, tmp_path: Path) -> None:
    folder = Path(shutil.copytree(result, tmp_path / "damaged"))
    text = (folder / "report.json").read_text(encoding="utf-8")
    (folder / "report.json").write_text(text.replace("2026-06-11T01:24:40.692Z", "2026-06-11T01null"), encoding="utf-8")
    for read in (lambda: export([folder], "csv", tmp_path / "out"), lambda: mosaic([folder], tmp_path / "out.vrt")):
        with pytest.raises(InputError) as raised:
            read()
        assert raised.value.code == "result-unreadable"


def test_reading__leaves_nothing_beside_the_products(tmp_path: Path) -> None:
    folder = tmp_path / "field"
    folder.mkdir()
    poses, work = worked_field()
    origin = Origin("A field", "Field", [("recording.pcap", "00ff")])
    write_field(folder / "field.gpkg", poses, JAPAN.to_wkt(), work, origin=origin)
    write_report(folder, "Field")
    before = sorted(path.name for path in folder.iterdir())
    export([folder], "csv", tmp_path / "out")
    assert sorted(path.name for path in folder.iterdir()) == before
