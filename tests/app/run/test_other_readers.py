"""Every product of a run and every export, opened by two readers that are not ours; the texts in them are hostile."""

from __future__ import annotations

import csv
import json
import shutil
import sqlite3
import tomllib
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any
from xml.etree import ElementTree as ET

import copclib
import geopandas as gpd
import laspy
import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pystac
import pytest
import rasterio
import shapely
from isoxml.util.isoxml_io import isoxml_from_path
from rio_cogeo import cog_validate

import furrowmap

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

Web = Callable[[str, Path], Any]
ATTACK = "document.title='attacked'"
HOSTILE = f'=cmd() <script>{ATTACK}</script>"><img src=x onerror="{ATTACK}"> \x1b[31m圃場 & ]]> \'; DROP'
SHOWN = HOSTILE.replace("\x1b", "\\x1b")
DECODED = """image => new Promise(done => {
  const copy = new Image();
  copy.onload = () => done(copy.naturalWidth);
  copy.onerror = () => done(0);
  copy.src = image.href.baseVal;
})"""
RECORDING = f'"><img src=x onerror={ATTACK}>.pcap'
LAYERS = (
    "trajectory",
    "events",
    "tool_path",
    "misses",
    "unworked",
    "boundary",
    "overlaps",
    "coverage",
    "passes",
    "zones",
)


@pytest.fixture(scope="module")
def made(simulated: furrowmap.Simulated, tmp_path_factory: pytest.TempPathFactory) -> furrowmap.Result:
    """The result of a small run whose names are hostile."""
    folder = tmp_path_factory.mktemp("hostile") / "-o <b>%s 圃場"
    shutil.copytree(simulated.folder, folder)
    (folder / "recording.pcap").rename(folder / RECORDING)
    text = (folder / "session.toml").read_text(encoding="utf-8")
    text = text.replace('"One pass"', json.dumps(HOSTILE)).replace('"recording.pcap"', json.dumps(RECORDING))
    (folder / "session.toml").write_text(text, encoding="utf-8")
    return furrowmap.run(folder / "session.toml", folder / "result")


def passed_on(made: furrowmap.Result, to: str, suffix: str = "") -> Path:
    target = made.path.parent / f"{to}{suffix}"
    furrowmap.export([made.path], to, target, overwrite=True)
    return target


def test_cloud__is_the_same_for_laspy_copclib_and_copc_js(made: furrowmap.Result, web_reader: Web) -> None:
    path = made.path / "cloud.copc.laz"
    web, las = web_reader("copc", path), laspy.read(path)
    assert web["points"] == web["header"]["pointCount"] == len(las) == made.report["figures"]["points"]
    assert copclib.FileReader(str(path)).copc_config.las_header.point_count == len(las)
    theirs = {"Intensity": las.intensity, "Classification": las.classification, "PointSourceId": las.point_source_id}
    for name, values in {**theirs, "GpsTime": las.gps_time, "scan": las.scan, "X": las.x, "Z": las.z}.items():
        found = web["dimensions"][name]
        assert found["least"] == pytest.approx(np.min(values), abs=1e-9), name
        assert found["greatest"] == pytest.approx(np.max(values), abs=1e-9), name
        assert found["sum"] == pytest.approx(np.sum(np.asarray(values, np.float64)), rel=1e-9), name
    (scan,) = web["extra"]
    assert (scan["name"], scan["min"], scan["max"]) == ("scan", las.scan.min(), las.scan.max())


@pytest.mark.parametrize("name", ["dsm.tif", "dsm_before.tif", "change.tif"])
def test_rasters__are_the_same_for_gdal_and_geotiff_js(made: furrowmap.Result, web_reader: Web, name: str) -> None:
    path = made.path / name
    assert cog_validate(path, strict=True) == (True, [], [])
    web = web_reader("geotiff", path)
    with rasterio.open(path) as raster:
        bands = raster.read()
        assert (web["rows"], web["columns"]) == raster.shape
        assert (web["origin"][:2], web["cell"][:2]) == ([raster.transform.c, raster.transform.f], [0.05, -0.05])
        assert web["keys"]["ProjectedCSTypeGeoKey"] == raster.crs.to_epsg() == 6677
        assert raster.tags()["SESSION"] == SHOWN
    np.testing.assert_array_equal(np.array(web["bands"], np.float32), bands.reshape(len(bands), -1))


def blob_geometry(blob: bytes) -> shapely.Geometry:
    """The geometry of a GeoPackage's blob (OGC 12-128r18, 2.1.3)."""
    envelope = (0, 32, 48, 48, 64)[blob[3] >> 1 & 7]
    return shapely.from_wkb(blob[8 + envelope :])


def test_layers__are_the_same_for_gdal_and_sqlite(made: furrowmap.Result) -> None:
    path = made.path / "field.gpkg"
    with sqlite3.connect(f"{path.as_uri()}?mode=ro", uri=True) as database:
        assert database.execute("PRAGMA integrity_check").fetchall() == [("ok",)]
        assert database.execute("PRAGMA foreign_key_check").fetchall() == []
        assert database.execute("PRAGMA application_id").fetchone() == (int.from_bytes(b"GPKG", "big"),)
        listed = dict(database.execute("SELECT table_name, srs_id FROM gpkg_contents WHERE data_type = 'features'"))
        assert listed == dict.fromkeys(LAYERS, 6677)
        for name in LAYERS:
            column = database.execute("SELECT column_name FROM gpkg_geometry_columns WHERE table_name = ?", (name,))
            rows = database.execute(f'SELECT "{column.fetchone()[0]}" FROM "{name}"').fetchall()
            shapes = [blob_geometry(blob) for (blob,) in rows]
            theirs = gpd.read_file(path, layer=name, engine="pyogrio").geometry
            assert len(shapes) == len(theirs) == len(made.layer(name))
            assert all(shapely.equals_exact(a, b) for a, b in zip(shapes, theirs, strict=True))
        metadata = database.execute("SELECT group_concat(metadata) FROM gpkg_metadata").fetchone()[0]
        fields = {item.get("key"): item.text for item in ET.fromstring(metadata).iter("MDI")}
        assert fields["SESSION"] == SHOWN


def test_small_files__are_read_by_the_libraries_of_python(made: furrowmap.Result) -> None:
    report = json.loads((made.path / "report.json").read_text(encoding="utf-8"))
    assert report["session"]["name"] == HOSTILE
    session = tomllib.loads((made.path / "session.toml").read_text(encoding="utf-8"))
    assert (session["name"], session["recording"]["lidar"]) == (HOSTILE, [RECORDING])
    item = pystac.Item.from_file(made.path / "item.json")
    assert item.properties["proj:code"] == "EPSG:6677"
    assert {Path(asset.href).name for asset in item.assets.values()} <= set(report["products"])
    with np.load(made.path / "implement.npz", allow_pickle=False) as arrays:
        assert all(arrays[name].dtype.kind != "O" for name in arrays.files)
    with (made.path / "states.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    table = pd.read_csv(made.path / "states.csv")
    assert table["t_s"].tolist() == [float(row["t_s"]) for row in rows]
    for path in made.path.glob("*.qml"):
        assert ET.parse(path).getroot().tag == "qgis"


def whole(shape: shapely.Geometry) -> shapely.Geometry:
    """A polygon of one part or several, in one form."""
    return shapely.normalize(shapely.MultiPolygon([*shapely.get_parts(shape)]))


@pytest.mark.parametrize("to", ["geoparquet", "flatgeobuf", "shapefile", "geojson", "kml", "csv", "gpkg"])
def test_exports__are_the_same_for_gdal_and_the_web(made: furrowmap.Result, web_reader: Web, to: str) -> None:
    """The pass, its polygon and its time; and every layer, the empty ones too."""
    suffix = {"geoparquet": ".parquet", "flatgeobuf": ".fgb", "shapefile": ".shp"}.get(to, f".{to}")
    target = passed_on(made, to, suffix if to in ("kml", "gpkg") else "")
    path = target if target.is_file() else target / f"passes{suffix}"
    truth = made.passes
    if to == "geoparquet":
        theirs = gpd.read_parquet(path)
        web = web_reader(to, path)
        assert web["geo"] == json.loads(pq.read_schema(path).metadata[b"geo"])
        (shape,), (properties,) = [shapely.geometry.shape(row["geometry"]) for row in web["rows"]], web["rows"]
    elif to in ("flatgeobuf", "shapefile", "kml"):
        theirs = gpd.read_file(path, layer="passes")
        features = web_reader(to, path)["features"]
        found = next(one for one in features if to != "kml" or one["properties"]["styleUrl"] == "#passes-1")
        shape, properties = shapely.geometry.shape(found["geometry"]), found["properties"]
    elif to == "geojson":
        theirs = gpd.read_file(path)
        (found,) = json.loads(path.read_text(encoding="utf-8"))["features"]
        shape, properties = shapely.geometry.shape(found["geometry"]), found["properties"]
    elif to == "csv":
        (properties,) = csv.DictReader(path.read_text(encoding="utf-8").splitlines())
        shape = shapely.from_wkt(properties["wkt"])
        theirs = gpd.GeoDataFrame(geometry=gpd.read_file(path).set_geometry([shape]).geometry, crs=truth.crs)
    else:
        theirs = gpd.read_file(path, layer="passes")
        with sqlite3.connect(path) as database:
            blob, start = database.execute("SELECT geom, start FROM passes").fetchone()
        shape, properties = blob_geometry(blob), {"start": start}
    assert shapely.equals_exact(whole(shape), whole(theirs.geometry[0]), 1e-7)
    there = theirs.to_crs(truth.crs).geometry[0]
    assert there.symmetric_difference(truth.geometry[0]).area < 1e-3
    assert pd.to_datetime(properties["start"], utc=True) == truth["start"][0]
    if target.is_dir():
        assert {one.stem for one in target.glob(f"*{suffix}")} == set(LAYERS)


def test_task_data__is_the_same_for_two_readers(made: furrowmap.Result, web_reader: Web) -> None:
    folder = passed_on(made, "isoxml")
    content, binaries = isoxml_from_path(folder)
    archive = folder.with_name("task.zip")
    with zipfile.ZipFile(archive, "w") as packed:
        for path in folder.iterdir():
            packed.write(path, f"TASKDATA/{path.name}")
    web = web_reader("isoxml", archive)
    assert web["warnings"] == []
    ((task,), (name,)) = web["tasks"], web["fields"]
    assert name == task["name"] == content.tasks[0].designator == content.partfields[0].designator
    (log,) = task["logs"]
    assert list(binaries) == ["TLG00001"]
    changes = made.events["kind"].isin(["down", "up"]).sum()
    assert len(log) == len(made.trajectory) + changes
    assert all(record["isValidPosition"] for record in log)


def test_stac__is_read_and_validated(made: furrowmap.Result) -> None:
    collection = pystac.Collection.from_file(passed_on(made, "stac") / "collection.json")
    (item,) = collection.get_items()
    assert item.properties["title"] == HOSTILE


def opened(browser: Browser, path: Path) -> tuple[Page, list[str], list[str]]:
    """A page, the addresses that it asked the network for besides itself and embedded data, and its faults."""
    page = browser.new_page()
    asked: list[str] = []
    faults: list[str] = []
    page.on("request", lambda request: asked.append(request.url))
    page.on("requestfailed", lambda request: asked.remove(request.url) if request.failure == "csp" else None)
    page.on("console", lambda message: faults.append(message.text))
    page.on("pageerror", lambda error: faults.append(str(error)))
    page.goto(path.as_uri())
    return page, [url for url in asked if url != path.as_uri() and not url.startswith("data:")], faults


def test_promise_25__report_page_shows_hostile_names_as_text(made: furrowmap.Result, browser: Browser) -> None:
    page, asked, faults = opened(browser, made.path / "report.html")
    assert (asked, faults) == ([], [])
    assert page.title() == page.locator("h1").inner_text() == SHOWN
    assert RECORDING in page.locator("footer").inner_text()
    assert page.locator("script, iframe, object, link, [onerror]").count() == 0
    assert page.evaluate("getComputedStyle(document.body).maxWidth") == "896px", "the style sheet is allowed"
    assert page.locator("image.depth").first.evaluate(DECODED) > 0, "embedded images are allowed"
    assert page.locator(".key svg rect").first.evaluate("key => getComputedStyle(key).fill") != "rgb(0, 0, 0)"
    page.close()


def test_promise_25__policy_stops_what_would_slip_through(
    made: furrowmap.Result, browser: Browser, tmp_path: Path
) -> None:
    """As if nothing were escaped: no script runs, nothing is fetched, no style is taken over."""
    inserted = (
        f"<script>{ATTACK}</script><img src=x onerror=\"{ATTACK}\"><img src='https://example.org/a.png'>"
        "<link rel=stylesheet href='https://example.org/a.css'><iframe src='https://example.org/'></iframe>"
        "<style>body { max-width: 1px }</style><p id=loud style='color: red'>x</p><base href='https://example.org/'>"
    )
    text = (made.path / "report.html").read_text(encoding="utf-8")
    path = tmp_path / "report.html"
    path.write_text(text.replace("</header>", f"{inserted}</header>"), encoding="utf-8")
    page, asked, faults = opened(browser, path)
    assert page.title() != "attacked"
    assert asked == []
    assert len(faults) >= 7
    assert all("Content Security Policy" in fault for fault in faults)
    assert page.evaluate("getComputedStyle(document.body).maxWidth") == "896px"
    assert page.locator("#loud").evaluate("one => getComputedStyle(one).color") != "rgb(255, 0, 0)"
    page.close()
