"""The XML of QGIS projects, written without QGIS; QGIS completes it with defaults."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final
from xml.etree import ElementTree as ET

from pyproj import CRS

from furrowmap.exporters.vectors.qgis_styles import DOCTYPE

_QGIS: Final = "3.34.0"
"""The first version that supports everything written here."""
_VIEW_MARGIN: Final = 0.05
_STYLE_ELEMENTS: Final = (
    "renderer-v2", "labeling", "temporal", "mapTip", "layerOpacity", "blendMode", "fieldConfiguration", "aliases",
)  # fmt: skip


@dataclass(frozen=True)
class ProjectLayer:
    """A layer as a project names it.

    Attributes:
        kind: of geometry, as OGR calls it; empty for a table of attributes.
        source: data source of its provider.
        provider: QGIS's name of it.
        style: QML; None for QGIS's default.
        title: for people; empty for the name.
        properties: custom properties, which plugins read.
        attribution: that a map has to show.
    """

    name: str
    kind: str
    source: str
    provider: str
    style: str | None
    title: str = ""
    read_only: bool = False
    properties: tuple[tuple[str, str], ...] = ()
    attribution: str = ""

    @property
    def id(self) -> str:
        """Its name within the project."""
        return f"furrowmap_{self.name}"


def project_root(title: str, crs: CRS) -> ET.Element:
    """A project without layers."""
    root = ET.Element("qgis", {"version": _QGIS, "projectname": title})
    put_text(root, "title", title)
    put_crs(ET.SubElement(root, "projectCrs"), crs)
    return root


def project_text(root: ET.Element) -> str:
    """The content of a `.qgs` file."""
    ET.indent(root, " ")
    return DOCTYPE + ET.tostring(root, encoding="unicode") + "\n"


def put_view(root: ET.Element, crs: CRS, bounds: tuple[float, float, float, float]) -> None:
    """The first view of a project, of bounds (west, south, east, north), and relative paths."""
    view = ET.SubElement(root, "ProjectViewSettings", {"UseProjectScales": "0", "rotation": "0"})
    west, south, east, north = bounds
    margin = _VIEW_MARGIN * max(east - west, north - south, 1.0)
    box = {"xmin": west - margin, "ymin": south - margin, "xmax": east + margin, "ymax": north + margin}
    texts = {name: repr(float(value)) for name, value in box.items()}
    put_crs(ET.SubElement(view, "DefaultViewExtent", texts), crs)
    canvas = ET.SubElement(root, "mapcanvas", {"name": "theMapCanvas"})  # what QField shows first
    extent = ET.SubElement(canvas, "extent")
    for name, text in texts.items():
        put_text(extent, name, text)
    put_crs(ET.SubElement(canvas, "destinationsrs"), crs)
    properties = ET.SubElement(root, "properties")
    put_text(ET.SubElement(properties, "Paths"), "Absolute", "false", type="bool")
    put_text(ET.SubElement(properties, "SpatialRefSys"), "ProjectionsEnabled", "1", type="int")


def put_tree_layer(tree: ET.Element, layer: ProjectLayer, *, checked: bool, expanded: bool = False) -> None:
    """A layer in the layer tree of a project, or in a group of it."""
    attributes = {"id": layer.id, "name": layer.title or layer.name, "source": layer.source}
    state = {"checked": "Qt::Checked" if checked else "Qt::Unchecked", "expanded": str(int(expanded))}
    ET.SubElement(tree, "layer-tree-layer", {**attributes, "providerKey": layer.provider, **state})


def put_vector_layer(within: ET.Element, layer: ProjectLayer, crs: CRS) -> None:
    """A vector layer or a table, in the CRS of the map."""
    geometry = next((word for word in ("Polygon", "Line", "Point") if word in layer.kind), "No geometry")
    attributes = {"type": "vector", "geometry": geometry, "styleCategories": "AllStyleCategories"}
    element = _put_layer(within, layer, crs, attributes | {"readOnly": str(int(layer.read_only))})
    style = ET.fromstring(layer.style) if layer.style else ET.Element("qgis")  # noqa: S314 (of this package)
    element.extend([part for part in style if part.tag in _STYLE_ELEMENTS])
    element.set("labelsEnabled", "0" if style.find("labeling") is None else "1")


def put_raster_layer(within: ET.Element, layer: ProjectLayer, crs: CRS) -> None:
    """A raster in the CRS of the map."""
    element = _put_layer(within, layer, crs, {"type": "raster", "styleCategories": "AllStyleCategories"})
    pipe = ET.fromstring(layer.style).find("pipe") if layer.style else None  # noqa: S314 (of this package)
    if pipe is not None:
        element.append(pipe)
    put_text(element, "blendMode", "0")


def put_point_cloud_layer(
    within: ET.Element, layer: ProjectLayer, crs: CRS, classes: Sequence[tuple[int, str, str]]
) -> None:
    """A point cloud in the CRS of the map; `classes` are code, colour and name of each class that is shown."""
    element = _put_layer(within, layer, crs, {"type": "point-cloud", "styleCategories": "AllStyleCategories"})
    renderer = {"type": "classified", "attribute": "Classification", "pointSize": "1"}
    categories = ET.SubElement(ET.SubElement(element, "renderer", renderer), "categories")
    for code, colour, name in classes:  # without them QGIS draws nothing
        red, green, blue = (int(colour[k : k + 2], 16) for k in (1, 3, 5))
        values = {"value": str(code), "color": f"{red},{green},{blue},255", "label": name, "pointSize": "0"}
        ET.SubElement(categories, "category", {**values, "render": "true"})


def _put_layer(within: ET.Element, layer: ProjectLayer, crs: CRS, attributes: dict[str, str]) -> ET.Element:
    element = ET.SubElement(within, "maplayer", attributes)
    put_text(element, "id", layer.id)
    put_text(element, "datasource", layer.source)
    put_text(element, "layername", layer.title or layer.name)
    if layer.kind:
        put_crs(ET.SubElement(element, "srs"), crs)
    put_text(element, "provider", layer.provider, encoding="UTF-8")
    if layer.properties:
        within_map = ET.SubElement(ET.SubElement(element, "customproperties"), "Option", {"type": "Map"})
        for name, value in layer.properties:
            ET.SubElement(within_map, "Option", {"name": name, "type": "QString", "value": value})
    if layer.attribution:
        put_text(ET.SubElement(element, "resourceMetadata"), "rights", layer.attribution)
    return element


def put_crs(parent: ET.Element, crs: CRS) -> None:
    """A CRS as QGIS stores it."""
    element = ET.SubElement(parent, "spatialrefsys", {"nativeFormat": "Wkt"})
    put_text(element, "wkt", crs.to_wkt())
    authority = crs.to_authority()
    if authority:
        put_text(element, "authid", ":".join(authority))
    put_text(element, "description", crs.name)
    put_text(element, "geographicflag", "true" if crs.is_geographic else "false")


def put_text(parent: ET.Element, tag: str, text: str, **attributes: str) -> None:
    """An element with text."""
    ET.SubElement(parent, tag, attributes).text = text
