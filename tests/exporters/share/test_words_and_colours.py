"""Names and colours of shared results are those of the QGIS styles and of the plugin, in every language."""

from __future__ import annotations

import ast
import json
import re
import sys
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np
import pytest
import rasterio
from pyproj import CRS

from furrowmap.core.runtime.languages.texts import LANGUAGES, SHARE, texts_of
from furrowmap.core.surfaces.grid import Grid
from furrowmap.exporters.files.provenance import Origin
from furrowmap.exporters.files.result_folder import RUN_RASTERS, packaged_style, packaged_styles
from furrowmap.exporters.rasters.cog import Band
from furrowmap.exporters.rasters.web_images import encode_image
from furrowmap.exporters.share.page import WEBP_QUALITY, draw_raster
from furrowmap.exporters.share.page_features import SHOWN_FIELDS
from furrowmap.exporters.share.page_points import CLASS_COLOURS
from furrowmap.exporters.share.shown_layers import SHOWN_TOGETHER
from furrowmap.exporters.share.symbols import layer_style
from furrowmap.exporters.vectors.labels import SHARED_LAYERS
from tests.exporters.rasters.written_cogs import write_cog

CHECKOUT = Path(__file__).resolve().parents[3]
sys.path.insert(0, str(CHECKOUT / "scripts"))
from plugin_strings import translations  # noqa: E402

FIELD_LAYERS = ("events", "trajectory", "tool_path", "misses", "unworked", "boundary", "overlaps", "coverage",
                "passes", "zones", "strips", "strip_differences", "parcels")  # fmt: skip
NAMES = {"LineString", "Polygon"}
"""Of what OpenLayers draws."""
NUMBER = re.compile(r"-?[\d.]+( m| mm)?")


def texts() -> set[str]:
    """Every text of a page that is not the user's own."""
    found = {
        *SHARED_LAYERS.values(),
        *(label for label, _ in SHOWN_FIELDS.values()),
        *(label for _, _, label in CLASS_COLOURS),
    }
    rasters = {Path(name).with_suffix(".qml").name for name in RUN_RASTERS} & packaged_styles()
    for name in (*(f"{layer}.qml" for layer in FIELD_LAYERS), *rasters):
        root = ET.fromstring(packaged_style(name))
        found |= {str(one.get("label")) for tag in ("category", "item") for one in root.iter(tag)}
    html = (CHECKOUT / "exporters" / "share" / "share.html").read_text(encoding="utf-8")
    found |= set(re.findall(r'data-(?:say|label)="([^"]+)"', html))
    source = (CHECKOUT / "web" / "map.js").read_text(encoding="utf-8")
    found |= set(re.findall(r'say\("([^"]+)"', source)) | set(re.findall(r'[\[?:] ?"([A-Z][^"]+)"', source))
    page = ast.parse((CHECKOUT / "exporters" / "share" / "page.py").read_text(encoding="utf-8"))
    for node in ast.walk(page):
        if isinstance(node, ast.FunctionDef) and node.name in ("_figures", "_accuracy", "_about"):
            found |= {
                one.value
                for one in ast.walk(node)
                if isinstance(one, ast.Constant) and isinstance(one.value, str) and one.value[:1].isupper()
                if " `" not in one.value and not one.value.endswith(".")
            }
    return {text for text in found - NAMES if not NUMBER.fullmatch(text)}


@pytest.mark.parametrize("language", LANGUAGES[1:])
def test_words__all_are_in_every_language(language: str) -> None:
    assert sorted(texts() - set(texts_of(language, SHARE))) == []
    assert all(texts_of(language, SHARE).values())


@pytest.mark.parametrize("language", LANGUAGES[1:])
def test_words__are_those_of_the_plugin(language: str) -> None:
    ours = texts_of(language, SHARE)
    theirs: dict[str, set[str]] = {}
    for (context, text), translated in translations(language).items():
        if context in ("Legends", "Classes", "Figures"):
            theirs.setdefault(text, set()).add(translated)
    shared = set(theirs) & set(ours)
    assert len(shared) > 30
    assert {text: ours[text] for text in shared if ours[text] not in theirs[text]} == {}


def test_layers__have_the_names_and_themes_of_the_plugin() -> None:
    """In the dock, on a shared page and in a QField project, which take both from the one list."""
    theirs = json.loads((CHECKOUT / "plugin" / "legends.json").read_text(encoding="utf-8"))
    assert {key: theirs["layers"][key] for key in SHARED_LAYERS} == dict(SHARED_LAYERS)
    plugin = ast.parse((CHECKOUT / "plugin" / "results.py").read_text(encoding="utf-8"))
    found = {node.targets[0].id: node.value for node in plugin.body
             if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name)}  # fmt: skip
    always = ast.literal_eval(found["_ALWAYS"])
    themes = eval(compile(ast.Expression(found["THEMES"]), "results.py", "eval"), {"_ALWAYS": always})
    assert tuple(themes.values()) == SHOWN_TOGETHER
    assert set().union(*SHOWN_TOGETHER) - {"plants", "lines", "planes"} <= set(SHARED_LAYERS)


def test_classes__have_the_colours_of_the_plugin() -> None:
    theirs = json.loads((CHECKOUT / "plugin" / "legends.json").read_text(encoding="utf-8"))["classes"]
    assert [tuple(row) for row in theirs] == [*CLASS_COLOURS, tuple(theirs[-1])]  # the page leaves noise out


@pytest.mark.parametrize("name", sorted(packaged_styles() & {f"{name}.qml" for name in SHARED_LAYERS}))
def test_symbols__every_style_is_understood(name: str) -> None:
    if "rasterrenderer" in packaged_style(name):
        return
    text = packaged_style(name)
    fields = {field: [1, 2, 3] for field in re.findall(r"&quot;(\w+)&quot;", text)}
    style = layer_style(name.removesuffix(".qml"), fields)
    assert style.default.fill or style.default.stroke
    assert set(style.labels) == {str(one.get("value")) for one in ET.fromstring(text).iter("category")}
    assert (style.ramp is not None) == ("ramp_color" in text)


def test_ramp__is_that_of_the_style() -> None:
    """Pale, middle and dark green; half way between two of them is their mean."""
    ramp = layer_style("passes", {"pass": [1, 2, 3, 4, 5]}).ramp
    assert ramp is not None
    assert [ramp.colour(n) for n in (1, 3, 5)] == ["rgba(181,220,196,1)", "rgba(46,139,87,1)", "rgba(18,63,41,1)"]
    assert ramp.colour(2, 0.65) == "rgba(114,180,142,0.65)"
    assert layer_style("tool_path", {}).by_value["down"].stroke == "rgba(90,61,255,1)"
    assert layer_style("no such layer", {}).ramp is None


def written(path: Path, values: np.ndarray[Any, Any], cell_m: float) -> Path:
    grid = Grid(cell_m, 0, round(values.shape[0]), values.shape)
    write_cog(path, grid, CRS.from_epsg(6677), (Band("height"),), [values.astype(np.float32)], Origin("test"))
    return path


@pytest.mark.filterwarnings("ignore::rasterio.errors.NotGeoreferencedWarning")
def test_picture__has_the_colours_of_the_style(tmp_path: Path) -> None:
    values = np.full((8, 6), -0.05)
    values[:, 3:] = 0.1
    values[0, 0] = np.nan
    shown = draw_raster(written(tmp_path / "change.tif", values, 0.5), "change.qml")
    assert shown.rgba[4, 1].tolist() == [0x80, 0xCD, 0xC1, 255]
    assert shown.rgba[4, 4].tolist() == [0x8C, 0x51, 0x0A, 255]
    assert shown.rgba[0, 0, 3] == 0
    assert shown.box_m == (0.0, 0.0, 3.0, 4.0)
    assert ("#8c510a", "0.10 m") in shown.legend
    (tmp_path / "change.webp").write_bytes(encode_image(shown.rgba, "WEBP", QUALITY=WEBP_QUALITY))
    with rasterio.open(tmp_path / "change.webp") as image:
        assert image.driver == "WEBP"
        assert np.abs(image.read()[:3, 4, 1].astype(int) - [0x80, 0xCD, 0xC1]).max() < 20  # chroma is subsampled


def test_picture__shades_planes_as_lamberts_law_does(tmp_path: Path) -> None:
    """Light from the north-west at 45 degrees, heights doubled: a plane's grey is the cosine of light and normal."""
    columns = np.arange(40) * 0.5
    for slope in (0.0, 0.3, -0.3):
        rise = np.tile(slope * columns, (40, 1))  # towards the east
        shown = draw_raster(written(tmp_path / f"dsm{slope}.tif", rise, 0.5), "dsm.qml")
        normal = np.array([-2.0 * slope, 0.0, 1.0]) / np.hypot(2.0 * slope, 1.0)
        light = np.array([-0.5, 0.5, np.sqrt(0.5)])
        assert np.abs(shown.rgba[5:-5, 5:-5, 0] - 255.0 * (normal @ light)).max() < 1.0
