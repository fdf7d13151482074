"""The stored project of a farm map, as text: names for people, what is hidden, classes of points, the background."""

from __future__ import annotations

import datetime as dt
import io
import zipfile
from xml.etree import ElementTree as ET

from furrowmap.core.runtime.settings import using
from furrowmap.exporters.farm.project import CLOUDS, POINT_CLOUD_WORDS, background_layer, layer_title, project_archive
from furrowmap.exporters.files.qgis_project import ProjectLayer
from tests.exporters.farm.result_folders import JAPAN

BOUNDS = (16_600.0, 96_500.0, 16_700.0, 96_600.0)
NAMES = ("fields", "visits", "seasons", "machines", "sessions", "tracks", "coverage", "misses", "provenance")


def project(language: str) -> ET.Element:
    noon = dt.datetime(2026, 6, 11, 12, tzinfo=dt.UTC)
    with using(language=language):
        layers = [ProjectLayer(name, "Polygon", name, "ogr", None, layer_title(name)) for name in NAMES]
        layers.append(ProjectLayer(CLOUDS, POINT_CLOUD_WORDS, "./farm_clouds.vpc", "vpc", None, "Point clouds"))
        layers.append(background_layer(JAPAN, BOUNDS))
        archive = project_archive(layers, JAPAN, BOUNDS, (noon, noon))
    with zipfile.ZipFile(io.BytesIO(archive)) as file:
        return ET.fromstring(file.read("furrowmap.qgs"))


def test_names__are_for_people_in_their_language() -> None:
    english = [node.get("name") for node in project("en").iter("layer-tree-layer")]
    assert english[:2] == ["Fields", "Work of each session"]
    assert not {name for name in english if name in NAMES}
    japanese = [node.get("name") or "" for node in project("ja").iter("layer-tree-layer")]
    assert not {name for name in japanese if name.isascii()} - {"Point clouds"}
    assert layer_title("a layer of the user") == "a layer of the user"


def test_what_a_session_missed__is_hidden_at_first() -> None:
    groups = {group.get("name"): group for group in project("en").iter("layer-tree-group") if group.get("name")}
    assert groups["Work in detail"].get("checked") == "Qt::Unchecked"
    assert [node.get("name") for node in groups["Work in detail"]] == ["Missed ground"]
    assert groups["Worked ground by day"].get("checked") == "Qt::Checked"


def test_points__have_a_colour_for_each_class() -> None:
    codes = {one.get("value"): one.get("color") for one in project("en").iter("category")}
    assert codes["2"] == "156,122,74,255"
    assert {"1", "64", "65"} <= codes.keys()


def test_background__names_its_source_and_where_to_try_it() -> None:
    with using(language="en"):
        layer = background_layer(JAPAN, BOUNDS)
    told = dict(layer.properties)
    assert told["furrowmap/probe"] == "https://cyberjapandata.gsi.go.jp/xyz/seamlessphoto/0/0/0.jpg"
    assert "Geospatial Information Authority of Japan" in told["furrowmap/attribution"] == layer.attribution
    options = {one.get("name"): one.get("value") for one in project("en").iter("Option")}
    assert options["furrowmap/basemap"] == "gsi-photo"
