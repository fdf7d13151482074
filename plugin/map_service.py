# SPDX-License-Identifier: GPL-2.0-or-later
"""Map services: what the capabilities of a WMS or a WMTS offer as background. Imports nothing of QGIS."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import NoReturn
from urllib.parse import parse_qsl, quote, urlencode, urlsplit, urlunsplit
from xml.etree import ElementTree as ET
from xml.parsers import expat

FALLBACK_CRS = "EPSG:3857"
PREFERRED_FORMATS = ("image/png", "image/jpeg")
REQUEST_KEYS = {"service", "request", "version", "layers", "styles", "crs", "srs", "bbox", "width", "height", "format"}
"""Of a query: what a request says itself. Others, such as a key of the user, belong to the service."""
UNRESTRICTED = {"", "none"}


@dataclass(frozen=True)
class ServiceLayer:
    """A layer that a service offers, by the name for requests, with its attribution and the source for QGIS."""

    name: str
    title: str
    attribution: str
    source: str


def capabilities_url(url: str) -> str:
    """The address of a service's capabilities, from it or from the address of the service."""
    parts = urlsplit(url)
    query = parse_qsl(parts.query, keep_blank_values=True)
    if parts.path.lower().endswith(".xml"):
        return url
    kept = [(key, value) for key, value in query if key.lower() not in REQUEST_KEYS]
    stated = [value.upper() for key, value in query if key.lower() == "service"]
    service = stated[0] if stated else "WMTS" if "wmts" in parts.path.lower() else "WMS"
    return urlunsplit(parts._replace(query=urlencode([*kept, ("SERVICE", service), ("REQUEST", "GetCapabilities")])))


def service_layers(text: str, url: str, wanted_crs: str = "") -> list[ServiceLayer]:
    """The layers of a service, in its order; LAYERS in `url` chooses. Raises ValueError without capabilities.

    Maps are asked for in `wanted_crs` if the service has it, else in Web Mercator, else in its first.
    """
    root = _parsed(text)
    of_kind = {"WMS_Capabilities": _wms, "WMT_MS_Capabilities": _wms, "Capabilities": _wmts}.get(_tag(root))
    if of_kind is None:
        raise ValueError(_tag(root))
    layers = of_kind(root, url, wanted_crs)
    query = {key.lower(): value for key, value in parse_qsl(urlsplit(url).query)}
    names = [name for name in query.get("layers", query.get("layer", "")).split(",") if name]
    return [layer for layer in layers if not names or layer.name in names]


def _parsed(text: str) -> ET.Element:
    """The elements of a text without entities of its own, by which a hostile one could grow."""
    builder = ET.TreeBuilder()
    parser = expat.ParserCreate("utf-8", "}")
    parser.StartElementHandler = builder.start
    parser.EndElementHandler = builder.end
    parser.CharacterDataHandler = builder.data
    parser.EntityDeclHandler = _refuse
    try:
        parser.Parse(text.encode(), True)  # noqa: FBT003 - it is all of it
    except expat.ExpatError as error:
        raise ValueError(str(error)) from None
    return builder.close()


def _refuse(name: str, *_: object) -> NoReturn:
    raise ValueError(name)


def _wms(root: ET.Element, url: str, wanted_crs: str) -> list[ServiceLayer]:
    capability = _child(root, "Capability")
    formats = [node.text or "" for node in _all(_child(_child(capability, "Request"), "GetMap"), "Format")]
    terms = _text(_child(root, "Service"), "AccessConstraints")
    parts = urlsplit(url)
    kept = [item for item in parse_qsl(parts.query, keep_blank_values=True) if item[0].lower() not in REQUEST_KEYS]
    base = urlunsplit(parts._replace(query=urlencode(kept)))
    found: list[ServiceLayer] = []

    def walk(node: ET.Element, codes: list[str], attribution: str) -> None:
        own_codes = [each.text or "" for key in ("CRS", "SRS") for each in _all(node, key)]
        codes = codes + " ".join(own_codes).split()
        attribution = _text(_child(node, "Attribution"), "Title") or attribution
        name = _text(node, "Name")
        if name and codes:
            source = {"layers": name, "styles": "", "url": base}
            found.append(_layer(_text(node, "Title"), attribution, codes, formats, wanted_crs, source))
        for below in _all(node, "Layer"):
            walk(below, codes, attribution)

    for node in _all(capability, "Layer"):
        walk(node, [], "" if terms.lower() in UNRESTRICTED else terms)
    return found


def _wmts(root: ET.Element, url: str, wanted_crs: str) -> list[ServiceLayer]:
    contents = _child(root, "Contents")
    crs_of = {_text(node, "Identifier"): _code(_text(node, "SupportedCRS")) for node in _all(contents, "TileMatrixSet")}
    provider = _text(_child(root, "ServiceProvider"), "ProviderName")
    found = []
    for node in _all(contents, "Layer"):
        matrix_sets = [_text(link, "TileMatrixSet") for link in _all(node, "TileMatrixSetLink")]
        sets = {crs_of.get(each): each for each in matrix_sets}
        if not sets:
            continue
        styles = sorted(_all(node, "Style"), key=lambda style: style.get("isDefault") != "true")
        style = _text(styles[0], "Identifier") if styles else ""
        codes = [code for code in sets if code]
        source = {
            "layers": _text(node, "Identifier"),
            "styles": style,
            "tileMatrixSet": sets[_chosen(codes, wanted_crs)],
        }
        source["url"] = capabilities_url(url)
        formats = [each.text or "" for each in _all(node, "Format")]
        found.append(_layer(_text(node, "Title"), provider, codes, formats, wanted_crs, source))
    return found


def _layer(
    title: str, attribution: str, codes: list[str], formats: list[str], wanted_crs: str, source: dict[str, str]
) -> ServiceLayer:
    offered = [known for known in PREFERRED_FORMATS if known in formats] or formats or list(PREFERRED_FORMATS)
    items = {"contextualWMSLegend": "0", "crs": _chosen(codes, wanted_crs), "format": offered[0], **source}
    text = "&".join(f"{key}={quote(value, safe='' if key == 'url' else ':/')}" for key, value in items.items())
    return ServiceLayer(source["layers"], title or source["layers"], attribution, text)


def _chosen(codes: list[str], wanted_crs: str) -> str:
    return next((code for code in (wanted_crs, FALLBACK_CRS) if code in codes), codes[0])


def _code(name: str) -> str:
    """A CRS as `EPSG:3857`, from that or from `urn:ogc:def:crs:EPSG::3857`."""
    parts = name.split(":")
    return f"{parts[-3]}:{parts[-1]}" if name.lower().startswith("urn:") and len(parts) > 3 else name


def _tag(node: ET.Element) -> str:
    return node.tag.rpartition("}")[2]


def _all(node: ET.Element | None, name: str) -> list[ET.Element]:
    children: Iterable[ET.Element] = () if node is None else node
    return [below for below in children if _tag(below) == name]


def _child(node: ET.Element | None, name: str) -> ET.Element | None:
    return next(iter(_all(node, name)), None)


def _text(node: ET.Element | None, name: str) -> str:
    found = _child(node, name)
    return (found.text or "").strip() if found is not None else ""
