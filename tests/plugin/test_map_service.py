"""What the capabilities of map services offer as background, as their standards write it."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from types import ModuleType
from urllib.parse import parse_qs

import pytest

CHECKOUT = Path(__file__).resolve().parents[2]
WMS_1_1 = """<!DOCTYPE WMT_MS_Capabilities SYSTEM "http://schemas.opengis.net/wms/1.1.1/capabilities_1_1_1.dtd">
<WMT_MS_Capabilities version="1.1.1"><Service><Name>OGC:WMS</Name><AccessConstraints>none</AccessConstraints></Service>
<Capability><Request><GetMap><Format>image/gif</Format><Format>image/jpeg</Format></GetMap></Request>
<Layer><Title>All</Title><SRS>EPSG:4326 EPSG:6677</SRS>
<Layer><Name>soil</Name><Title>Soil map</Title></Layer>
<Layer><Name>roads</Name><Title>Roads</Title><SRS>EPSG:3857</SRS>
<Attribution><Title>Prefecture</Title></Attribution></Layer>
</Layer></Capability></WMT_MS_Capabilities>"""
WMTS = """<Capabilities xmlns="http://www.opengis.net/wmts/1.0" version="1.0.0"
  xmlns:ows="http://www.opengis.net/ows/1.1">
  xmlns:ows="http://www.opengis.net/ows/1.1">
<ows:ServiceProvider><ows:ProviderName>Survey office</ows:ProviderName></ows:ServiceProvider>
<Contents><Layer><ows:Title>Photo 2025</ows:Title><ows:Identifier>photo</ows:Identifier>
<Style><ows:Identifier>grey</ows:Identifier></Style>
<Style isDefault="true"><ows:Identifier>colour</ows:Identifier></Style><Format>image/png</Format>
<TileMatrixSetLink><TileMatrixSet>degrees</TileMatrixSet></TileMatrixSetLink>
<TileMatrixSetLink><TileMatrixSet>web</TileMatrixSet></TileMatrixSetLink></Layer>
<TileMatrixSet><ows:Identifier>degrees</ows:Identifier>
<ows:SupportedCRS>urn:ogc:def:crs:EPSG::4326</ows:SupportedCRS></TileMatrixSet>
<TileMatrixSet><ows:Identifier>web</ows:Identifier>
<ows:SupportedCRS>urn:ogc:def:crs:EPSG::3857</ows:SupportedCRS></TileMatrixSet></Contents></Capabilities>"""


@pytest.fixture(scope="module")
def maps() -> ModuleType:
    spec = importlib.util.spec_from_file_location("map_service", CHECKOUT / "plugin" / "map_service.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # dataclasses look their module up
    spec.loader.exec_module(module)
    return module


def facts(source: str) -> dict[str, str]:
    return {key: value[0] for key, value in parse_qs(source, keep_blank_values=True).items()}


def test_wms__layers_inherit_their_crs_and_the_maps_own_is_preferred(maps: ModuleType) -> None:
    soil, roads = maps.service_layers(WMS_1_1, "https://maps.example/wms?key=7&request=GetCapabilities", "EPSG:6677")
    assert (soil.name, soil.title, soil.attribution) == ("soil", "Soil map", "")
    assert (roads.name, roads.title, roads.attribution) == ("roads", "Roads", "Prefecture")
    of_roads = {"contextualWMSLegend": "0", "crs": "EPSG:6677", "format": "image/jpeg", "layers": "roads", "styles": ""}
    assert facts(roads.source) == {**of_roads, "url": "https://maps.example/wms?key=7"}
    soil, roads = maps.service_layers(WMS_1_1, "https://maps.example/wms", "EPSG:32654")
    assert facts(roads.source)["crs"] == "EPSG:3857", "Web Mercator, where the service lacks the map's"
    assert facts(soil.source)["crs"] == "EPSG:4326", "else the first that it has"


def test_wmts__takes_the_default_style_and_the_tiles_of_the_crs(maps: ModuleType) -> None:
    (photo,) = maps.service_layers(WMTS, "https://maps.example/wmts/1.0.0/WMTSCapabilities.xml")
    assert (photo.title, photo.attribution) == ("Photo 2025", "Survey office")
    found = facts(photo.source)
    assert (found["styles"], found["tileMatrixSet"], found["crs"]) == ("colour", "web", "EPSG:3857")
    assert found["url"] == "https://maps.example/wmts/1.0.0/WMTSCapabilities.xml"


def test_url__with_layers_chooses_them(maps: ModuleType) -> None:
    found = maps.service_layers(WMS_1_1, "https://maps.example/wms?SERVICE=WMS&LAYERS=roads")
    assert [layer.name for layer in found] == ["roads"]


@pytest.mark.parametrize(
    ("given", "asked"),
    [
        ("https://a.example/wms", "https://a.example/wms?SERVICE=WMS&REQUEST=GetCapabilities"),
        ("https://a.example/ows?map=x&layers=y", "https://a.example/ows?map=x&SERVICE=WMS&REQUEST=GetCapabilities"),
        ("https://a.example/wmts?key=7", "https://a.example/wmts?key=7&SERVICE=WMTS&REQUEST=GetCapabilities"),
        ("https://a.example/ows?service=wmts", "https://a.example/ows?SERVICE=WMTS&REQUEST=GetCapabilities"),
        ("https://a.example/1.0.0/WMTSCapabilities.xml", "https://a.example/1.0.0/WMTSCapabilities.xml"),
    ],
)
def test_capabilities_url__is_that_of_the_service(maps: ModuleType, given: str, asked: str) -> None:
    assert maps.capabilities_url(given) == asked


@pytest.mark.parametrize(
    "text", ["", "not found", "<html></html>", '<!DOCTYPE a [<!ENTITY b "b">]><WMS_Capabilities>&b;</WMS_Capabilities>']
)
def test_answer__that_is_no_capabilities_is_refused(maps: ModuleType, text: str) -> None:
    with pytest.raises(ValueError):
        maps.service_layers(text, "https://maps.example/wms")
