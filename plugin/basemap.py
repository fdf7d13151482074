# SPDX-License-Identifier: GPL-2.0-or-later
"""The background map with its attribution. There is none by default, since most come over the network."""

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from urllib.parse import quote

from qgis.core import QgsProject, QgsRasterLayer, QgsSettings
from qgis.PyQt.QtCore import QCoreApplication, QEvent, QObject, Qt
from qgis.PyQt.QtWidgets import QLabel

tr = partial(QCoreApplication.translate, "BaseMap")

CHOICE_KEY, OWN_KEY = "furrowmap/basemap", "furrowmap/basemapOwn"
NONE, OWN = "none", "own"
PROPERTY = "furrowmap/basemap"
"""Property of a layer: the key of the base map."""
ATTRIBUTION_PROPERTY = "furrowmap/attribution"


@dataclass(frozen=True)
class BaseMap:
    """Tiles that may be used with attribution.

    Attributes:
        key: in the settings and in projects.
        name: of the layer.
        url: of a tile.
        zmax: the finest level there is.
        attribution: that has to be shown.
    """

    key: str
    name: str
    url: str
    zmax: int
    attribution: str


def base_maps():
    """The base maps on offer."""
    gsi = tr("Geospatial Information Authority of Japan (GSI) tiles")
    host = "https://cyberjapandata.gsi.go.jp/xyz"
    return (
        BaseMap(
            "osm",
            "OpenStreetMap",
            "https://tile.openstreetmap.org/{z}/{x}/{y}.png",
            19,
            tr("© OpenStreetMap contributors"),
        ),
        BaseMap("gsi-standard", tr("GSI standard map"), f"{host}/std/{{z}}/{{x}}/{{y}}.png", 18, gsi),
        BaseMap("gsi-photo", tr("GSI aerial photo"), f"{host}/seamlessphoto/{{z}}/{{x}}/{{y}}.jpg", 18, gsi),
    )


def show_base_map(key, own="", project=None):
    """Add a base map below all layers; it replaces the one before.

    Args:
        key: of :func:`base_maps`, :data:`OWN` or :data:`NONE`.
        own: for :data:`OWN`: the URL of tiles (XYZ, or RESTful WMTS in Web Mercator), or an MBTiles file.
        project: the current one by default.

    Returns:
        The layer; None for no base map.

    Raises:
        ValueError: if `own` is none of these; the base map before is kept.
    """
    project = QgsProject.instance() if project is None else project
    layer = None if key == NONE else _own_layer(own) if key == OWN else _layer(key)
    for old in base_map_layers(project):
        project.removeMapLayer(old.id())
    if layer is not None:
        layer.setCustomProperty(PROPERTY, key)
        project.addMapLayer(layer, addToLegend=False)
        project.layerTreeRoot().addLayer(layer).setExpanded(False)  # the last is the lowest
    return layer


def base_map_layers(project):
    """The base maps in a project."""
    return [layer for layer in project.mapLayers().values() if layer.customProperty(PROPERTY)]


def attribution_of(layers):
    """The attribution of these layers."""
    texts = [layer.customProperty(ATTRIBUTION_PROPERTY) for layer in layers]
    return " · ".join(dict.fromkeys(text for text in texts if text))


def remember(key, own):
    """Store the choice for the next project."""
    QgsSettings().setValue(CHOICE_KEY, key)
    QgsSettings().setValue(OWN_KEY, own)


def remembered():
    """The stored choice, and the user's own map."""
    return QgsSettings().value(CHOICE_KEY, NONE, str), QgsSettings().value(OWN_KEY, "", str)


def _layer(key):
    base = next(base for base in base_maps() if base.key == key)
    layer = QgsRasterLayer(_xyz(base.url, base.zmax), base.name, "wms")
    _attribute(layer, base.attribution)
    return layer


def _own_layer(own):
    """Tiles by URL, or a file."""
    own = own.strip()
    if own.lower().endswith(".mbtiles") and Path(own).is_file():
        layer = QgsRasterLayer(
            f"type=mbtiles&url={quote(Path(own).resolve().as_uri(), safe='')}", Path(own).stem, "wms"
        )
    elif all(mark in own for mark in ("{TileMatrix}", "{TileRow}", "{TileCol}")):
        url = own.replace("{TileMatrix}", "{z}").replace("{TileRow}", "{y}").replace("{TileCol}", "{x}")
        layer = QgsRasterLayer(_xyz(url, 22), tr("Own base map"), "wms")
    elif own.startswith(("http://", "https://", "file://")) and "{z}" in own and "{x}" in own:
        layer = QgsRasterLayer(_xyz(own, 22), tr("Own base map"), "wms")
    else:
        layer = None
    if layer is None or not layer.isValid():
        raise ValueError(
            tr(
                "'{own}' is not a base map. Give a URL with {{z}}, {{x}} and {{y}}, or with {{TileMatrix}}, "
                "{{TileRow}} and {{TileCol}}, or an MBTiles file."
            ).format(own=own)
        )
    _attribute(layer, "")
    return layer


def _attribute(layer, text):
    layer.setCustomProperty(ATTRIBUTION_PROPERTY, text)
    metadata = layer.metadata()
    metadata.setRights([text] if text else [])
    layer.setMetadata(metadata)


def _xyz(url, zmax):
    return f"type=xyz&url={quote(url, safe='')}&zmin=0&zmax={zmax}"


class AttributionLabel(QObject):
    """The attribution in the canvas's corner, if a visible layer needs it."""

    def __init__(self, canvas):
        super().__init__(canvas)
        self._canvas = canvas
        self.label = QLabel(canvas, objectName="furrowmapAttribution")
        self.label.setStyleSheet("background: rgba(255, 255, 255, 200); color: black; padding: 1px 4px;")
        self.label.setAttribute(Qt.WidgetAttribute.WA_TransparentForMouseEvents)
        canvas.installEventFilter(self)
        canvas.layersChanged.connect(self.refresh)
        self.refresh()

    def refresh(self):
        """Show the attribution of the present layers."""
        text = attribution_of(self._canvas.layers())
        self.label.setText(text)
        self.label.adjustSize()
        self.label.move(self._canvas.width() - self.label.width() - 2, self._canvas.height() - self.label.height() - 2)
        self.label.setVisible(bool(text))

    def remove(self):
        """Remove it from the canvas."""
        self._canvas.layersChanged.disconnect(self.refresh)
        self._canvas.removeEventFilter(self)
        self.label.deleteLater()
        self.deleteLater()

    def eventFilter(self, watched, event):  # noqa: N802, ARG002 - the name is Qt's
        """Stay in the corner."""
        if event.type() == QEvent.Type.Resize:
            self.refresh()
        return False
