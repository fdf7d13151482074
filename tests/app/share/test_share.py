"""A result as a page in a real browser, from disk and from a server, and as a project in a real QGIS."""

from __future__ import annotations

import base64
import json
import re
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any
from xml.etree import ElementTree as ET
from zoneinfo import ZoneInfo

import numpy as np
import pytest
import rasterio
import shapely

import furrowmap
from furrowmap.core.values.margins import with_margin
from furrowmap.exporters.share import page as page_module
from tests.app.files_server import served
from tests.app.told_progress import Told

if TYPE_CHECKING:
    from conftest import QgisRoot
    from playwright.sync_api import Browser, Page

CHECKOUT = Path(__file__).resolve().parents[3]
ATTACK = "document.title='attacked'"
HOSTILE = f'圃場 </script><script>{ATTACK}</script><img src=x onerror="{ATTACK}"> & ]]> \''
POINTS = 40_000
PHONE, DESKTOP = (360, 640), (1280, 800)
BEYOND_THE_PANEL = """
[...document.querySelectorAll('#panel *')].filter((one) => {
  const box = one.getBoundingClientRect();
  return box.width > 0 && box.right > document.getElementById('panel').getBoundingClientRect().right;
}).map((one) => one.textContent)
"""
LAYERS_WITHOUT_SYMBOL = """
[...document.querySelectorAll('#layers li:has(label)')].filter((one) => !one.querySelector('svg'))
  .map((one) => one.querySelector('input').name)
"""


@pytest.fixture(scope="module")
def named(result: furrowmap.Result, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The result under a hostile name."""
    folder = tmp_path_factory.mktemp("share") / "result"
    shutil.copytree(result.path, folder)
    report = json.loads((folder / "report.json").read_text(encoding="utf-8"))
    report["session"]["name"] = HOSTILE
    (folder / "report.json").write_text(json.dumps(report), encoding="utf-8")
    return folder


@pytest.fixture(scope="module")
def shared(named: Path, page_scripts: None) -> furrowmap.Shared:
    """Its page, with so few points that drawing them without a graphics card is fast."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(page_module, "MAX_SHARED_POINTS", POINTS)
        return furrowmap.share(named, progress=Told())


@pytest.fixture(scope="module")
def data(shared: furrowmap.Shared) -> dict[str, Any]:
    return script(shared.folder / "data.js", "furrowmapData")


def script(path: Path, name: str) -> dict[str, Any]:
    """What a script of data sets."""
    text = path.read_text(encoding="ascii")
    assert text.startswith(f"window.{name}=")
    content: dict[str, Any] = json.loads(text.removeprefix(f"window.{name}=").removesuffix(";\n"))
    return content


@pytest.fixture(scope="module")
def site(shared: furrowmap.Shared) -> Iterator[str]:
    """The page on a server that knows nothing of it."""
    with served(shared.folder) as address:
        yield address


def on_map(page: Page, x: float, y: float) -> tuple[float, float]:
    """Where a place of the map is in the window."""
    where = page.evaluate(
        "([x, y]) => { const [a, b] = furrowmapPage.map.getPixelFromCoordinate([x, y]);"
        " const box = document.getElementById('map').getBoundingClientRect(); return [box.x + a, box.y + b]; }",
        [x, y],
    )
    return where[0], where[1]


def try_out(page: Page, data: dict[str, Any]) -> None:
    """Tap on a pass, measure, hide a layer, look at the cloud."""
    passes = next(layer for layer in data["layers"] if layer["name"] == "passes")
    inside = shapely.geometry.shape(passes["features"][0]["geometry"]).representative_point()
    page.mouse.click(*on_map(page, inside.x, inside.y + 0.4))  # beside the label and the tool's path
    page.wait_for_selector("#card:not([hidden])")
    shown = page.inner_text("#card")
    assert dict(passes["features"][0]["rows"])["Area"] in shown

    west, south, _, north = data["extent"]
    a, b = (west + 3.0, 0.5 * (south + north)), (west + 7.0, 0.5 * (south + north) + 3.0)
    page.click("#distance")
    page.mouse.click(*on_map(page, *a))
    page.wait_for_timeout(400)  # two taps in short order are one that ends
    page.mouse.dblclick(*on_map(page, *b))
    page.wait_for_function("document.getElementById('card').innerText.includes(' m')")
    metres = float(re.findall(r"([\d.]+) m\b", page.inner_text("#card"))[0])
    assert metres == pytest.approx(5.0 / data["crs"]["scale"], abs=0.1)  # taps hit pixels
    page.click("#distance")

    page.click("#solid")
    page.wait_for_selector("body[data-cloud=shown]")
    boxes = [box for part in ("#cloud-canvas", "#cloud-key") if (box := page.locator(part).bounding_box()) is not None]
    (top, canvas), (under, key) = ((box["y"], box["y"] + box["height"]) for box in boxes)
    assert top < canvas <= under < key <= page.evaluate("innerHeight")  # nothing lies over the picture
    assert page.is_disabled("#layers input[name=trajectory]")
    drawn = page.evaluate(
        "() => new Promise((done) => { const own = document.getElementById('cloud-canvas');"
        " requestAnimationFrame(() => { document.querySelector('#whole').click(); requestAnimationFrame(() => {"
        " const copy = document.createElement('canvas'); copy.width = 64; copy.height = 64;"
        " const pen = copy.getContext('2d'); pen.drawImage(own, 0, 0, 64, 64);"
        " const pixels = pen.getImageData(0, 0, 64, 64).data; const colours = new Set();"
        " for (let i = 0; i < pixels.length; i += 4) colours.add(pixels.slice(i, i + 3).join());"
        " done(colours.size); }); }); })"
    )
    assert drawn > 50
    page.click("#solid")
    assert page.is_visible("#map")
    assert page.is_enabled("#layers input[name=trajectory]")


@pytest.mark.parametrize(
    ("place", "size", "language"), [("disk", PHONE, "ja-JP"), ("server", DESKTOP, "en-GB"), ("disk", PHONE, "de-AT")]
)
def test_page__works_and_asks_for_nothing_outside(
    shared: furrowmap.Shared,
    site: str,
    data: dict[str, Any],
    browser: Browser,
    place: str,
    size: tuple[int, int],
    language: str,
) -> None:
    base = site if place == "server" else f"{shared.folder.as_uri()}/"
    viewport: Any = {"width": size[0], "height": size[1]}
    context = browser.new_context(viewport=viewport, locale=language, has_touch=size == PHONE)
    page = context.new_page()
    asked, faults = [], []
    page.on("request", lambda request: asked.append(request.url))
    page.on("console", lambda message: faults.append(message.text) if message.type == "error" else None)
    page.on("pageerror", lambda error: faults.append(str(error)))
    page.goto(f"{base}index.html")
    page.wait_for_selector("body[data-map=shown]")
    assert page.title() == HOSTILE
    assert page.evaluate("document.documentElement.scrollWidth") == size[0]
    for button in page.query_selector_all("#tools button, header button, .ol-zoom button"):
        box = button.bounding_box()
        assert box is not None
        assert min(box["width"], box["height"]) >= 44
        assert box["x"] >= 0
        assert box["x"] + box["width"] <= size[0]
    if size == PHONE:
        assert not page.is_visible("#panel")
        page.click("#menu")
    assert page.is_visible("#panel")
    panel = page.inner_text("#panel")
    assert page.evaluate(BEYOND_THE_PANEL) == []
    pictures = {layer["name"] for layer in data["layers"] if "features" not in layer}
    assert pictures.issuperset(page.evaluate(LAYERS_WITHOUT_SYMBOL))
    assert data["when"] in panel
    for figure in data["figures"]:
        assert figure["value"][language[:2]] in panel
    assert {"ja-JP": "作業面積", "en-GB": "Worked", "de-AT": "Bearbeitet"}[language] in panel
    page.select_option("#language", "en" if language == "ja-JP" else "ja")
    assert ("Worked" if language == "ja-JP" else "作業面積") in page.inner_text("#panel")
    page.uncheck("#layers input[name=dsm]")
    page.check("#layers input[name=passes]")
    page.uncheck("#layers input[name=coverage]")  # it lies above the passes
    page.check("#layers input[name=trajectory]")
    if size == PHONE:
        page.click("#menu")
    try_out(page, data)
    assert faults == []
    assert [url for url in asked if not url.startswith((base, "data:"))] == []
    assert {url.removeprefix(base) for url in asked} >= {"index.html", "data.js", "map.js", "cloud.js", "points.js"}
    context.close()


def test_page__says_what_it_may_load(shared: furrowmap.Shared) -> None:
    text = (shared.folder / "index.html").read_text(encoding="utf-8")
    (policy,) = re.findall(r'http-equiv="Content-Security-Policy" content="([^"]*)"', text)
    rules = dict(part.split(" ", 1) for part in policy.split("; "))
    assert rules.pop("style-src").startswith("'sha256-")
    assert rules == {
        "default-src": "'none'",
        "script-src": "'self'",
        "img-src": "'self' data:",
        "base-uri": "'none'",
        "form-action": "'none'",
    }
    assert "<script>" not in text
    for path in (*shared.folder.glob("*.js"), shared.start):
        found = re.findall(r"https?://[\w.]+", path.read_text(encoding="utf-8"))
        assert set(found) <= {"http://www.opengis.net", "http://www.w3.org"}, path.name  # names of vocabularies
    assert shared.size_bytes == sum(path.stat().st_size for path in shared.folder.iterdir())
    assert {path.name for path in shared.files} == {path.name for path in shared.folder.iterdir()}


def test_layers__are_those_of_the_geopackage(data: dict[str, Any], result: furrowmap.Result) -> None:
    vectors = {layer["name"]: layer for layer in data["layers"] if "features" in layer}
    assert list(vectors) == [name for name, layer in result.layers.items() if len(layer)]
    for name, layer in vectors.items():
        theirs = shapely.from_geojson([json.dumps(one["geometry"]) for one in layer["features"]])
        ours = shapely.force_2d(result.layers[name].geometry.to_numpy())
        assert shapely.hausdorff_distance(theirs, ours).max() < 0.011, name
        assert all(0 <= one["symbol"] < len(layer["symbols"]) for one in layer["features"])
    (row,) = [dict(one["rows"]) for one in vectors["passes"]["features"]]
    one = result.passes.iloc[0]
    assert row["Pass"] == "1"
    assert row["Area"] == f"{with_margin(one['area_m2'], one['area_sigma_m2'], ' m²')} (95 %)"
    local = one["start"].tz_convert(ZoneInfo("Asia/Tokyo"))
    assert row["Time"].startswith(f"{local:%Y-%m-%d %H:%M:%S}")
    assert row["Time"].endswith("(Asia/Tokyo)")
    assert data["when"].endswith("(Asia/Tokyo, UTC+09:00)")


def test_pictures__lie_where_the_rasters_lie(data: dict[str, Any], result: furrowmap.Result) -> None:
    import rasterio

    pictures = {layer["name"]: layer for layer in data["layers"] if "file" in layer}
    assert set(pictures) == {"dsm", "dsm_before", "change"}
    for name, layer in pictures.items():
        with rasterio.open(result.path / f"{name}.tif") as raster:
            assert layer["extent"] == pytest.approx(list(raster.bounds))


def test_points__are_points_of_the_cloud(
    shared: furrowmap.Shared, data: dict[str, Any], result: furrowmap.Result
) -> None:
    points = script(shared.folder / "points.js", "furrowmapPoints")
    steps = np.frombuffer(base64.b64decode(points["xyz"]), "<u2").reshape(-1, 3)
    low, high = np.array(points["low"]), np.array(points["high"])
    xyz_m = low + steps / 65535 * (high - low)
    assert 0.9 * POINTS < len(xyz_m) == data["cloud"]["points"] <= POINTS
    assert data["cloud"]["of"] == result.report["figures"]["points"]
    from scipy.spatial import cKDTree

    cloud = result.points().read()
    away_m, nearest = cKDTree(np.column_stack([cloud[axis] for axis in "xyz"])).query(xyz_m[::50])
    assert away_m.max() < 1.01 * np.linalg.norm((high - low) / 65535)
    codes = np.frombuffer(base64.b64decode(points["classes"]), np.uint8)
    assert np.mean(codes[::50] == cloud["classification"][nearest]) > 0.95  # of points closer to each other than a step
    assert 7 not in codes
    assert {one["code"] for one in points["palette"]} == set(np.unique(codes).tolist())


def test_share__keeps_to_its_size(
    named: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, page_scripts: None
) -> None:
    monkeypatch.setattr(page_module, "MAX_FOLDER_BYTES", 3_000_000)
    small = furrowmap.share(named, tmp_path / "small", language="ja")
    assert 2_000_000 < small.size_bytes <= 3_000_000
    assert script(small.folder / "data.js", "furrowmapData")["language"] == "ja"


def test_share__refuses_folders_that_hold_something(shared: furrowmap.Shared, named: Path) -> None:
    with pytest.raises(furrowmap.RefusedError) as refused:
        furrowmap.share(named, named)
    assert refused.value.code == "output-is-result"
    with pytest.raises(furrowmap.RefusedError) as refused:
        furrowmap.share(named)
    assert refused.value.code == "output-exists"


def test_share__replaces_an_earlier_page_whole(shared: furrowmap.Shared, named: Path, tmp_path: Path) -> None:
    other, target = tmp_path / "other", tmp_path / "page"
    shutil.copytree(named, other)
    shutil.copytree(shared.folder, target)
    for name in ("change.tif", "cloud.copc.laz"):
        (other / name).unlink()
    (target / "mine.txt").write_text("kept")
    done = furrowmap.share(other, target, overwrite=True)
    assert "change.webp" not in {path.name for path in done.files}
    assert {path.name for path in target.iterdir()} == {path.name for path in done.files} | {"mine.txt"}
    assert script(target / "data.js", "furrowmapData")["cloud"] is None


def test_share__without_its_scripts_writes_nothing(
    named: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(page_module, "SCRIPTS", ("of_a_checkout_without_npm.js",))
    with pytest.raises(furrowmap.RefusedError) as refused:
        furrowmap.share(named, tmp_path / "page")
    assert refused.value.code == "no-web-bundle"
    assert list(tmp_path.iterdir()) == []


def test_project__opens_in_qgis_wherever_it_is_copied(named: Path, tmp_path: Path, qgis: QgisRoot) -> None:
    written = furrowmap.share(named, tmp_path / "written", qfield=True, language="ja")
    assert written.start == tmp_path / "written" / "field.qgs"
    shutil.move(written.folder, tmp_path / "phone")
    answer = qgis.run("python3", CHECKOUT / "tests" / "app" / "project_in_qgis.py", tmp_path / "phone" / "field.qgs")
    project = json.loads(answer.splitlines()[-1])
    layers = {layer["name"]: layer for layer in project["layers"]}
    assert (project["title"], project["crs"]) == (HOSTILE, "EPSG:6677")
    assert all(layer["valid"] and layer["crs"] == "EPSG:6677" for layer in layers.values())
    assert all(str(tmp_path / "phone") in layer["source"] for layer in layers.values())
    assert list(layers)[-2:] == ["作業後の地表面", "作業前の地表面"]
    assert layers["作業後の地表面"]["renderer"] == "hillshade"
    assert layers["地表面の変化"]["renderer"] == "singlebandpseudocolor"
    assert layers["耕うん経路"]["labels"] == ["作業機 下", "作業機 上", "不明"]
    assert layers["行程"]["features"] == 1
    assert layers["行程"]["read_only"]
    assert not layers["車両の位置"]["shown"]


def test_project__has_the_layers_of_the_result_beside_it_and_leaves_the_result_as_it_was(
    named: Path, tmp_path: Path
) -> None:
    layers, surface = (named / name for name in ("field.gpkg", "dsm.tif"))
    before = layers.read_bytes(), surface.read_bytes()
    folder = furrowmap.share(named, tmp_path / "written", qfield=True).folder
    assert (layers.read_bytes(), surface.read_bytes()) == before
    assert (folder / "field.gpkg").read_bytes() == before[0]
    with rasterio.open(surface) as own, rasterio.open(folder / "dsm.tif") as copied:
        assert (copied.count, copied.bounds) == (1, own.bounds)
        assert np.array_equal(copied.read(1), own.read(1), equal_nan=True)
    project = ET.parse(folder / "field.qgs")
    sources = [str(source.text) for source in project.iterfind(".//maplayer/datasource")]
    assert {source.split("|")[0] for source in sources} >= {"./field.gpkg", "./dsm.tif"}
    assert all((folder / source.split("|")[0]).is_file() for source in sources)
