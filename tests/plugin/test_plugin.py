"""The plugin as it is handed to QGIS: what the zip holds, what it imports, and that a real QGIS loads it."""

from __future__ import annotations

import ast
import configparser
import json
import re
import sys
import zipfile
from pathlib import Path
from typing import TYPE_CHECKING

import geopandas as gpd
import pytest
from shapely import Point

from furrowmap.workflows.share.qgis_plugin import write_plugin_zip

if TYPE_CHECKING:
    from conftest import QgisRoot

CHECKOUT = Path(__file__).resolve().parents[2]
REQUIRED_KEYS = [
    "name",
    "description",
    "version",
    "qgisMinimumVersion",
    "author",
    "email",
    "about",
    "tracker",
    "repository",
]


@pytest.fixture(scope="module")
def plugin_zip(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("plugin") / "furrowmap.zip"
    write_plugin_zip(out)
    return out


@pytest.fixture(scope="module")
def metadata() -> configparser.SectionProxy:
    parser = configparser.ConfigParser(interpolation=None)
    parser.read(CHECKOUT / "metadata.txt", encoding="utf-8")
    return parser["general"]


def test_metadata__has_what_the_plugin_site_asks_for(metadata: configparser.SectionProxy) -> None:
    assert [key for key in REQUIRED_KEYS if not metadata.get(key)] == []
    assert "/" not in metadata["author"]
    assert re.fullmatch(r"[\x20-\x7e]+", metadata["description"])
    assert (metadata["qgisMinimumVersion"], metadata["qgisMaximumVersion"]) == ("3.34", "4.99")
    assert "plugin" not in metadata["name"].lower()


def test_zip__keeps_the_rules_of_the_plugin_site(plugin_zip: Path) -> None:
    with zipfile.ZipFile(plugin_zip) as archive:
        names = archive.namelist()
        assert archive.testzip() is None
        licence = archive.read("furrowmap/LICENSE").decode()
    assert {name.split("/")[0] for name in names} == {"furrowmap"}
    assert {"furrowmap/__init__.py", "furrowmap/metadata.txt", "furrowmap/icon.svg"} <= set(names)
    assert not [name for name in names if "__pycache__" in name or ".." in name or name.endswith(".pyc")]
    assert plugin_zip.stat().st_size < 25_000_000
    assert "GNU GENERAL PUBLIC LICENSE" in licence
    assert "Version 2, June 1991" in licence


def test_zip__is_the_same_from_the_same_checkout(plugin_zip: Path, tmp_path: Path) -> None:
    again = tmp_path / "again.zip"
    write_plugin_zip(again)
    assert again.read_bytes() == plugin_zip.read_bytes()


@pytest.mark.parametrize("path", sorted((CHECKOUT / "plugin").rglob("*.py")), ids=lambda p: p.name)
def test_plugin__imports_only_qgis_and_the_standard_library(path: Path) -> None:
    source = path.read_text(encoding="utf-8")
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            modules = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.level == 0:
            modules = [node.module or ""]
        else:
            continue
        for module in modules:
            top = module.split(".")[0]
            assert top in sys.stdlib_module_names or re.match(r"qgis(\.(_3d|core|gui|utils|PyQt\b.*))?$", module), (
                module
            )
    assert source.startswith("# SPDX-License-Identifier: GPL-2.0-or-later\n")


def test_legends__have_the_words_of_every_colour_in_the_styles_of_rasters() -> None:
    styles = [path.read_text(encoding="utf-8") for path in (CHECKOUT / "exporters" / "styles").glob("*.qml")]
    colours = {label for style in styles for label in re.findall(r'<item [^>]*label="([^"]+)"', style)}
    labels = {label for label in colours if not re.fullmatch(r"[-\d.]+( m| mm)?", label)}
    assert labels <= set(json.loads((CHECKOUT / "plugin" / "legends.json").read_text(encoding="utf-8"))["colours"])


def test_open_layers__tells_kind_crs_count_and_extent(qgis: QgisRoot, tmp_path: Path) -> None:
    table = gpd.GeoDataFrame({"scan": [0, 1]}, geometry=[Point(4000, 5000), Point(4010, 5020)], crs="EPSG:6677")
    table.to_file(tmp_path / "two.gpkg", layer="trajectory")
    (layer,) = qgis.open_layers(tmp_path / "two.gpkg")
    assert (layer["valid"], layer["kind"], layer["crs"], layer["count"]) == (True, "vector", "EPSG:6677", 2)
    assert layer["extent"] == [4000, 5000, 4010, 5020]
    assert "scan" in layer["fields"]
