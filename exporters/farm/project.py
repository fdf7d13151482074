"""The QGIS project of a farm map, written without QGIS and stored as QGIS itself stores one."""

from __future__ import annotations

import datetime as dt
import io
import json
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final
from xml.etree import ElementTree as ET

from pyproj import CRS

from furrowmap.exporters.farm.results import PROVENANCE, SESSIONS, TRACKS
from furrowmap.exporters.farm.styling import DOCTYPE

PROJECT: Final = "furrowmap"
"""Its name in the farm map."""
_TITLE: Final = "Farm map"
_QGIS: Final = "3.34.0"
"""The first version that supports everything written here."""
_GROUPS: Final[Mapping[str, tuple[str, ...]]] = {
    "Sessions": (SESSIONS, TRACKS),
    "Work in detail": ("events", "tool_path", "misses", "unworked", "overlaps", "passes"),
    "Worked ground by day": ("coverage",),
    "Features": ("plants", "lines", "planes"),
    "Field": ("boundary", "zones"),
    "Tables": (PROVENANCE,),
}
_OTHERS: Final = "Field"
"""The group of all other layers."""
_HIDDEN_AT_FIRST: Final = frozenset({TRACKS, "zones"})
_MARGIN: Final = 0.05
_PARTS: Final = ("renderer-v2", "labeling", "temporal", "mapTip", "layerOpacity", "blendMode")


@dataclass(frozen=True)
class ProjectLayer:
    """A layer as a project names it.

    Attributes:
        name: of the layer.
        kind: of geometry, as OGR calls it; empty for a table of attributes.
        source: data source of its provider.
        provider: QGIS's name of it.
        style: QML; None for QGIS's default.
    """

    name: str
    kind: str
    source: str
    provider: str
    style: str | None

    @property
    def id(self) -> str:
        """Its name within the project."""
        return f"furrowmap_{self.name}"


def project_metadata(user: str) -> str:
    """The JSON that QGIS stores beside a project."""
    moment = dt.datetime.now(dt.UTC).strftime("%Y-%m-%dT%H:%M:%S")
    return json.dumps({"last_modified_time": moment, "last_modified_user": user})


def project_archive(
    layers: Sequence[ProjectLayer],
    crs: CRS,
    bounds: tuple[float, float, float, float],
    span: tuple[dt.datetime, dt.datetime],
) -> bytes:
    """The project as a `.qgz`; QGIS completes its XML with defaults.

    Args:
        layers: the topmost of the map first.
        crs: of the map.
        bounds: west, south, east and north of the first view.
        span: of the temporal controller, in steps of a day.
    """
    root = ET.Element("qgis", {"version": _QGIS, "projectname": _TITLE})
    _text(root, "title", _TITLE)
    _put_crs(ET.SubElement(root, "projectCrs"), crs)
    _put_tree(root, layers)
    _put_relations(root, layers)
    within = ET.SubElement(root, "projectlayers")
    for layer in layers:
        _put_layer(within, layer, crs)
    order = ET.SubElement(root, "layerorder")
    for layer in layers:
        ET.SubElement(order, "layer", {"id": layer.id})
    _put_time(root, span)
    view = ET.SubElement(root, "ProjectViewSettings", {"UseProjectScales": "0", "rotation": "0"})
    west, south, east, north = bounds
    margin = _MARGIN * max(east - west, north - south, 1.0)
    box = {"xmin": west - margin, "ymin": south - margin, "xmax": east + margin, "ymax": north + margin}
    _put_crs(ET.SubElement(view, "DefaultViewExtent", {name: repr(float(value)) for name, value in box.items()}), crs)
    properties = ET.SubElement(root, "properties")
    _text(ET.SubElement(properties, "Paths"), "Absolute", "false", type="bool")
    _text(ET.SubElement(properties, "SpatialRefSys"), "ProjectionsEnabled", "1", type="int")
    ET.indent(root, " ")
    archive = io.BytesIO()
    entry = zipfile.ZipInfo(f"{PROJECT}.qgs")  # dated 1980: the same project is the same archive
    entry.compress_type = zipfile.ZIP_DEFLATED
    with zipfile.ZipFile(archive, "w") as file:
        file.writestr(entry, DOCTYPE + ET.tostring(root, encoding="unicode") + "\n")
    return archive.getvalue()


def _put_tree(root: ET.Element, layers: Sequence[ProjectLayer]) -> None:
    tree = ET.SubElement(root, "layer-tree-group")
    named = {name for names in _GROUPS.values() for name in names}
    for title, names in _GROUPS.items():
        inside = [x for x in layers if x.name in names or (title == _OTHERS and x.name not in named)]
        if not inside:
            continue
        group = ET.SubElement(tree, "layer-tree-group", {"name": title, "checked": "Qt::Checked", "expanded": "1"})
        for layer in inside:
            checked = "Qt::Unchecked" if layer.name in _HIDDEN_AT_FIRST else "Qt::Checked"
            attributes = {"id": layer.id, "name": layer.name, "source": layer.source, "providerKey": layer.provider}
            expanded = "1" if layer.name == "coverage" else "0"
            ET.SubElement(group, "layer-tree-layer", attributes | {"checked": checked, "expanded": expanded})


def _put_relations(root: ET.Element, layers: Sequence[ProjectLayer]) -> None:
    """From every session to its features, for QGIS's forms."""
    relations = ET.SubElement(root, "relations")
    (sessions,) = (layer for layer in layers if layer.name == SESSIONS)
    for layer in layers:
        if layer is sessions:
            continue
        attributes = {
            "id": f"furrowmap_{layer.name}_of_session",
            "name": layer.name,
            "referencingLayer": layer.id,
            "referencedLayer": sessions.id,
            "strength": "Association",
        }
        fields = {"referencingField": "session", "referencedField": "session"}
        ET.SubElement(ET.SubElement(relations, "relation", attributes), "fieldRef", fields)


def _put_layer(within: ET.Element, layer: ProjectLayer, crs: CRS) -> None:
    geometry = next((word for word in ("Polygon", "Line", "Point") if word in layer.kind), "No geometry")
    element = ET.SubElement(
        within, "maplayer", {"type": "vector", "geometry": geometry, "styleCategories": "AllStyleCategories"}
    )
    _text(element, "id", layer.id)
    _text(element, "datasource", layer.source)
    _text(element, "layername", layer.name)
    if layer.kind:
        _put_crs(ET.SubElement(element, "srs"), crs)
    _text(element, "provider", layer.provider, encoding="UTF-8")
    style = ET.fromstring(layer.style) if layer.style else ET.Element("qgis")  # noqa: S314 (of this package)
    element.extend([part for part in style if part.tag in _PARTS])
    element.set("labelsEnabled", "0" if style.find("labeling") is None else "1")


def _put_time(root: ET.Element, span: tuple[dt.datetime, dt.datetime]) -> None:
    settings = {"timeStep": "1", "timeStepUnit": "d", "frameRate": "1", "cumulativeTemporalRange": "0"}
    times = ET.SubElement(ET.SubElement(root, "ProjectTimeSettings", settings), "TemporalRange")
    begin, end = (moment.astimezone(dt.UTC) for moment in span)
    _text(times, "start", begin.strftime("%Y-%m-%dT00:00:00Z"))
    _text(times, "end", (end + dt.timedelta(days=1)).strftime("%Y-%m-%dT00:00:00Z"))


def _put_crs(parent: ET.Element, crs: CRS) -> None:
    element = ET.SubElement(parent, "spatialrefsys", {"nativeFormat": "Wkt"})
    _text(element, "wkt", crs.to_wkt())
    authority = crs.to_authority()
    if authority:
        _text(element, "authid", ":".join(authority))
    _text(element, "description", crs.name)
    _text(element, "geographicflag", "true" if crs.is_geographic else "false")


def _text(parent: ET.Element, tag: str, text: str, **attributes: str) -> None:
    ET.SubElement(parent, tag, attributes).text = text
