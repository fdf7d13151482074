# SPDX-License-Identifier: GPL-2.0-or-later
"""The background map with its attribution. There is none by default, since most come over the network."""

from __future__ import annotations

import html
import re
import sqlite3
from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from urllib.parse import quote

from qgis.core import QgsMapLayer, QgsProject, QgsRasterLayer, QgsSettings
from qgis.gui import QgsMapCanvas
from qgis.PyQt.QtCore import QCoreApplication, QEvent, QObject, Qt
from qgis.PyQt.QtWidgets import QLabel

from .map_service import ServiceLayer
from .own_layers import mark, may_go
from .platforms import resolved

tr = partial(QCoreApplication.translate, "BaseMap")

OWN_KEY = "furrowmap/basemapOwn"
OWN_ATTRIBUTION_KEY = "furrowmap/basemapOwnAttribution"
NO_BASE_MAP = "none"
OWN_BASE_MAP = "own"
BASE_MAP_PROPERTY = "furrowmap/basemap"
"""Property of a layer: the key of the base map."""
ATTRIBUTION_PROPERTY = "furrowmap/attribution"
PROBE_PROPERTY = "furrowmap/probe"
"""Property of a layer: an address whose host answers if the map can be reached."""
_UNREACHED: set[str] = set()
"""Ids of the layers whose host did not answer: they show no tiles."""


@dataclass(frozen=True)
class BaseMap:
    """Tiles to show with their attribution; `key` names them in settings and projects, `zmax` is their last level."""

    key: str
    name: str
    url: str
    zmax: int
    attribution: str


def base_maps() -> tuple[BaseMap, ...]:
    """The base maps on offer."""
    gsi = tr("Geospatial Information Authority of Japan (GSI) tiles")
    host = "https://cyberjapandata.gsi.go.jp/xyz"
    osm = tr("© OpenStreetMap contributors")
    osm_tiles = "https://tile.openstreetmap.org/{z}/{x}/{y}.png"
    return (
        BaseMap("osm", "OpenStreetMap", osm_tiles, 19, osm),
        BaseMap("gsi-standard", tr("GSI standard map"), f"{host}/std/{{z}}/{{x}}/{{y}}.png", 18, gsi),
        BaseMap("gsi-photo", tr("GSI aerial photo"), f"{host}/seamlessphoto/{{z}}/{{x}}/{{y}}.jpg", 18, gsi),
    )


def show_base_map(layer: QgsMapLayer | None, key: str, project: QgsProject | None = None) -> None:
    """Put a base map (None for none) below all layers, in place of the one before; `key` names it in the project."""
    project = QgsProject.instance() if project is None else project
    for old in filter(may_go, base_map_layers(project)):
        project.removeMapLayer(old.id())
    if layer is not None:
        layer.setCustomProperty(BASE_MAP_PROPERTY, key)
        mark(layer, "basemap")
        project.addMapLayer(layer, addToLegend=False)
        project.layerTreeRoot().addLayer(layer).setExpanded(False)  # the last is the lowest


def base_map_layers(project: QgsProject) -> list[QgsMapLayer]:
    """The base maps in a project."""
    return [layer for layer in project.mapLayers().values() if layer.customProperty(BASE_MAP_PROPERTY)]


def note_reached(layer: QgsMapLayer, *, reached: bool) -> None:
    """Remember whether the host of a base map answers; where that has changed, the map is drawn again."""
    if reached == (layer.id() in _UNREACHED):
        _UNREACHED.symmetric_difference_update({layer.id()})
        layer.triggerRepaint()


def with_tiles(layers: Sequence[QgsMapLayer]) -> list[QgsMapLayer]:
    """The layers but those whose host did not answer."""
    return [layer for layer in layers if layer.id() not in _UNREACHED]


def attribution_of(layers: Sequence[QgsMapLayer]) -> str:
    """The attribution of these layers."""
    texts = [layer.customProperty(ATTRIBUTION_PROPERTY) for layer in layers]
    return " · ".join(dict.fromkeys(text for text in texts if text))


def remember(own: str, attribution: str) -> None:
    """Store the user's own map and its attribution for the next project."""
    QgsSettings().setValue(OWN_KEY, own)
    QgsSettings().setValue(OWN_ATTRIBUTION_KEY, attribution)


def remembered() -> tuple[str, str]:
    """The user's own map and its attribution, as stored."""
    return QgsSettings().value(OWN_KEY, "", str), QgsSettings().value(OWN_ATTRIBUTION_KEY, "", str)


def known_layer(key: str) -> QgsRasterLayer | None:
    """The layer of one of :func:`base_maps`; None for :data:`NO_BASE_MAP`."""
    base = next((base for base in base_maps() if base.key == key), None)
    if base is None:
        return None
    return _attributed(_tile_layer(base.url, base.zmax, base.name), base.attribution)


def own_layer(own: str, attribution: str = "") -> QgsRasterLayer:
    """The layer of a map of the user: tiles by URL, or a file; raises ValueError if `own` is none of these.

    Args:
        own: the URL of tiles (XYZ, or RESTful WMTS in Web Mercator), an MBTiles file or another raster.
        attribution: "" for what the file states.
    """
    own = own.strip()
    tiles = own
    for name, short in (("{TileMatrix}", "{z}"), ("{TileRow}", "{y}"), ("{TileCol}", "{x}")):
        tiles = tiles.replace(name, short)
    if tiles.startswith(("http://", "https://", "file://")) and "{z}" in tiles and "{x}" in tiles:
        layer = _tile_layer(tiles, 22, tr("Own base map"))
    elif own.lower().endswith(".mbtiles") and Path(own).is_file():
        try:
            with closing(sqlite3.connect(f"file:{quote(own)}?mode=ro", uri=True)) as database:
                stated = {str(name): str(value) for name, value in database.execute("select name, value from metadata")}
        except sqlite3.Error:
            stated = {}
        if stated.get("format") == "pbf":
            raise ValueError(
                tr("{file} has vector tiles. Only raster tiles can be the base map.").format(file=Path(own).name)
            )
        attribution = attribution or re.sub("<[^>]*>", "", stated.get("attribution", ""))
        address = quote(resolved(own).as_uri(), safe="")
        layer = QgsRasterLayer(f"type=mbtiles&url={address}", Path(own).stem, "wms")
    elif own and Path(own).is_file():
        layer = QgsRasterLayer(own, Path(own).stem, "gdal")
        if layer.isValid() and not layer.crs().isValid():
            raise ValueError(tr("{file} states no CRS. Assign one in QGIS first.").format(file=Path(own).name))
        if layer.isValid() and not attribution:
            copyright_tag = re.search(r"TIFFTAG_COPYRIGHT\s*=\s*([^<]+)", layer.dataProvider().htmlMetadata())
            attribution = html.unescape(copyright_tag[1]).strip() if copyright_tag else ""
    else:
        layer = None
    if layer is None or not layer.isValid():
        raise ValueError(
            tr(
                "'{own}' is not a base map. Give the address of a WMS or WMTS, a URL with {{z}}, {{x}} and {{y}}, or a "
                "file: MBTiles, GeoTIFF or another raster."
            ).format(own=own)
        )
    return _attributed(layer, attribution)


def is_service(own: str) -> bool:
    """Whether a map of the user is the address of a WMS or WMTS."""
    return own.strip().startswith(("http://", "https://")) and "{" not in own


def service_layer(offered: ServiceLayer, attribution: str = "") -> QgsRasterLayer:
    """The layer of a :class:`.map_service.ServiceLayer`; its attribution is that of the service unless one is given."""
    layer = QgsRasterLayer(offered.source, offered.title, "wms")
    return _attributed(layer, attribution or offered.attribution)


def _tile_layer(url: str, zmax: int, name: str) -> QgsRasterLayer:
    layer = QgsRasterLayer(f"type=xyz&url={quote(url, safe='')}&zmin=0&zmax={zmax}", name, "wms")
    for place in ("{z}", "{x}", "{y}", "{-y}", "{q}"):  # the tile of the whole earth
        url = url.replace(place, "0")
    layer.setCustomProperty(PROBE_PROPERTY, "" if url.startswith("file:") else url)
    return layer


def _attributed(layer: QgsRasterLayer, text: str) -> QgsRasterLayer:
    layer.setCustomProperty(ATTRIBUTION_PROPERTY, text)
    metadata = layer.metadata()
    metadata.setRights([text] if text else [])
    layer.setMetadata(metadata)
    return layer


class AttributionLabel(QObject):
    """The attribution in the canvas's corner, if a visible layer needs it and its tiles can be had."""

    def __init__(self, canvas: QgsMapCanvas) -> None:
        super().__init__(canvas)
        self._canvas = canvas
        self.label = QLabel(canvas, objectName="furrowmapAttribution")
        self.label.setStyleSheet("background: rgba(255, 255, 255, 200); color: black; padding: 1px 4px;")
        self.label.setAttribute(Qt.WidgetAttribute.WA_TransparentForMouseEvents)
        canvas.installEventFilter(self)
        canvas.layersChanged.connect(self.refresh)
        canvas.mapCanvasRefreshed.connect(self.refresh)
        self.refresh()

    def refresh(self) -> None:
        """Show the attribution of the present layers."""
        text = attribution_of(with_tiles(self._canvas.layers()))
        self.label.setText(text)
        self.label.adjustSize()
        self.label.move(self._canvas.width() - self.label.width() - 2, self._canvas.height() - self.label.height() - 2)
        self.label.setVisible(bool(text))

    def remove(self) -> None:
        """Remove it from the canvas."""
        self._canvas.layersChanged.disconnect(self.refresh)
        self._canvas.mapCanvasRefreshed.disconnect(self.refresh)
        self._canvas.removeEventFilter(self)
        self.label.deleteLater()
        self.deleteLater()

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:  # noqa: N802, ARG002 - the name is Qt's
        """Stay in the corner."""
        if event.type() == QEvent.Type.Resize:
            self.refresh()
        return False
