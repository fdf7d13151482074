# SPDX-License-Identifier: GPL-2.0-or-later
"""The background map with its attribution. There is none by default, since most come over the network."""

import html
import re
import sqlite3
from contextlib import closing
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from urllib.parse import quote

from qgis.core import QgsProject, QgsRasterLayer, QgsSettings
from qgis.PyQt.QtCore import QCoreApplication, QEvent, QObject, Qt
from qgis.PyQt.QtWidgets import QLabel

tr = partial(QCoreApplication.translate, "BaseMap")

CHOICE_KEY, OWN_KEY = "furrowmap/basemap", "furrowmap/basemapOwn"
OWN_ATTRIBUTION_KEY = "furrowmap/basemapOwnAttribution"
KEYS = (CHOICE_KEY, OWN_KEY, OWN_ATTRIBUTION_KEY)
NONE, OWN = "none", "own"
PROPERTY = "furrowmap/basemap"
"""Property of a layer: the key of the base map."""
ATTRIBUTION_PROPERTY = "furrowmap/attribution"
PROBE_PROPERTY = "furrowmap/probe"
"""Property of a layer: an address whose host answers if the map can be reached."""
ADDRESSES = ("http://", "https://", "file://")


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


def show_base_map(layer, key, project=None):
    """Put a base map below all layers, in place of the one before.

    Args:
        layer: of :func:`known_layer`, :func:`own_layer` or :func:`service_layer`; None for no base map.
        key: of :func:`base_maps`, :data:`OWN` or :data:`NONE`.
        project: the current one by default.
    """
    project = QgsProject.instance() if project is None else project
    for old in base_map_layers(project):
        project.removeMapLayer(old.id())
    if layer is not None:
        layer.setCustomProperty(PROPERTY, key)
        project.addMapLayer(layer, addToLegend=False)
        project.layerTreeRoot().addLayer(layer).setExpanded(False)  # the last is the lowest


def base_map_layers(project):
    """The base maps in a project."""
    return [layer for layer in project.mapLayers().values() if layer.customProperty(PROPERTY)]


def attribution_of(layers):
    """The attribution of these layers."""
    texts = [layer.customProperty(ATTRIBUTION_PROPERTY) for layer in layers]
    return " · ".join(dict.fromkeys(text for text in texts if text))


def remember(key, own, attribution):
    """Store the choice for the next project."""
    QgsSettings().setValue(CHOICE_KEY, key)
    QgsSettings().setValue(OWN_KEY, own)
    QgsSettings().setValue(OWN_ATTRIBUTION_KEY, attribution)


def remembered():
    """The stored choice, the user's own map and its attribution."""
    return tuple(QgsSettings().value(key, NONE if key == CHOICE_KEY else "", str) for key in KEYS)


def known_layer(key):
    """The layer of one of :func:`base_maps`; None for :data:`NONE`."""
    base = next((base for base in base_maps() if base.key == key), None)
    if base is None:
        return None
    layer = QgsRasterLayer(_xyz(base.url, base.zmax), base.name, "wms")
    layer.setCustomProperty(PROBE_PROPERTY, _first_tile(base.url))
    _attribute(layer, base.attribution)
    return layer


def own_layer(own, attribution=""):
    """The layer of a map of the user: tiles by URL, or a file.

    Args:
        own: the URL of tiles (XYZ, or RESTful WMTS in Web Mercator), an MBTiles file or another raster.
        attribution: "" for what the file states.

    Raises:
        ValueError: if `own` is none of these.
    """
    own = own.strip()
    tiles = own
    for name, short in (("{TileMatrix}", "{z}"), ("{TileRow}", "{y}"), ("{TileCol}", "{x}")):
        tiles = tiles.replace(name, short)
    if tiles.startswith(ADDRESSES) and "{z}" in tiles and "{x}" in tiles:
        layer = QgsRasterLayer(_xyz(tiles, 22), tr("Own base map"), "wms")
        layer.setCustomProperty(PROBE_PROPERTY, _first_tile(tiles))
    elif own.lower().endswith(".mbtiles") and Path(own).is_file():
        stated = _mbtiles_metadata(own)
        if stated.get("format") == "pbf":
            raise ValueError(
                tr("{file} has vector tiles. Only raster tiles can be the base map.").format(file=Path(own).name)
            )
        attribution = attribution or re.sub("<[^>]*>", "", stated.get("attribution", ""))
        layer = QgsRasterLayer(
            f"type=mbtiles&url={quote(Path(own).resolve().as_uri(), safe='')}", Path(own).stem, "wms"
        )
    elif own and Path(own).is_file():
        layer = QgsRasterLayer(own, Path(own).stem, "gdal")
        if layer.isValid() and not layer.crs().isValid():
            raise ValueError(tr("{file} states no CRS. Assign one in QGIS first.").format(file=Path(own).name))
        attribution = attribution or (_copyright(layer) if layer.isValid() else "")
    else:
        layer = None
    if layer is None or not layer.isValid():
        raise ValueError(
            tr(
                "'{own}' is not a base map. Give the address of a WMS or WMTS, a URL with {{z}}, {{x}} and {{y}}, or a "
                "file: MBTiles, GeoTIFF or another raster."
            ).format(own=own)
        )
    _attribute(layer, attribution)
    return layer


def is_service(own):
    """Whether a map of the user is the address of a WMS or WMTS."""
    return own.strip().startswith(("http://", "https://")) and "{" not in own


def service_layer(offered, attribution=""):
    """The layer of a :class:`.map_service.ServiceLayer`; its attribution is that of the service unless one is given."""
    layer = QgsRasterLayer(offered.source, offered.title, "wms")
    _attribute(layer, attribution or offered.attribution)
    return layer


def _first_tile(url):
    """The address of the tile of the whole earth, to try whether the host answers; "" for files."""
    for mark in ("{z}", "{x}", "{y}", "{-y}", "{q}"):
        url = url.replace(mark, "0")
    return "" if url.startswith("file:") else url


def _mbtiles_metadata(path):
    try:
        with closing(sqlite3.connect(f"{Path(path).resolve().as_uri()}?mode=ro", uri=True)) as database:
            return {str(name): str(value) for name, value in database.execute("select name, value from metadata")}
    except sqlite3.Error:
        return {}


def _copyright(layer):
    """The copyright in a raster's tags."""
    found = re.search(r"TIFFTAG_COPYRIGHT\s*=\s*([^<]+)", layer.dataProvider().htmlMetadata())
    return html.unescape(found[1]).strip() if found else ""


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
