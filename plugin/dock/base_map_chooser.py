# SPDX-License-Identifier: GPL-2.0-or-later
"""The choice of a base map: a row of the dock."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from qgis.core import QgsLayerTree, QgsLayerTreeNode, QgsMapLayer, QgsNetworkContentFetcher, QgsProject
from qgis.PyQt.QtCore import QTimer, QUrl
from qgis.PyQt.QtNetwork import QNetworkReply, QNetworkRequest
from qgis.PyQt.QtWidgets import (
    QComboBox,
    QFileDialog,
    QFormLayout,
    QInputDialog,
    QLabel,
    QLineEdit,
    QToolButton,
    QWidget,
)

from ..basemap import (
    NO_BASE_MAP,
    OWN_BASE_MAP,
    PROBE_PROPERTY,
    attribution_of,
    base_map_layers,
    base_maps,
    is_service,
    known_layer,
    note_reached,
    own_layer,
    remember,
    remembered,
    service_layer,
    show_base_map,
)
from ..map_service import capabilities_url, service_layers
from .form_parts import below, side_by_side, small_text

RETRY_MS = 20_000
"""A map that could not be reached is asked again after this time."""
HTTP_REFUSALS = (401, 403)
"""Status of a host that answers, but gives no map; so are those from 500 on."""


class BaseMapChooser(QWidget):
    """A list of base maps; nothing is downloaded until one is chosen."""

    def __init__(self, report: Callable[[str], None]) -> None:
        super().__init__()
        self._report = report
        self._fetcher: Any = None  # of a request that runs
        form = QFormLayout(self)
        form.setContentsMargins(6, 0, 6, 0)
        self.box = QComboBox(objectName="furrowmapBaseMap")
        self.box.addItem(self.tr("none (offline)"), NO_BASE_MAP)
        for base in base_maps():
            self.box.addItem(base.name, base.key)
        self.box.addItem(self.tr("other map…"), OWN_BASE_MAP)
        form.addRow(QLabel(self.tr("Base map")), self.box)
        self.own = QLineEdit(remembered()[0], objectName="furrowmapOwnBaseMap")
        self.own.setPlaceholderText(self.tr("Address or file"))
        self.own.setToolTip(
            self.tr(
                "Address of a WMS or WMTS; URL of tiles with {z}, {x} and {y}; or path of an MBTiles file, a "
                "GeoTIFF or another raster"
            )
        )
        browse = QToolButton(text="…")
        browse.clicked.connect(self._browse)
        self.attribution = QLineEdit(remembered()[1], objectName="furrowmapOwnAttribution")
        self.attribution.setPlaceholderText(self.tr("Attribution, if the map states none itself"))
        for field in (self.own, self.attribution):
            field.returnPressed.connect(self._apply)
        self.inputs = below(side_by_side(self.own, browse), self.attribution)
        form.addRow(self.inputs)
        self.unreached = small_text("furrowmapUnreached")
        self.unreached.hide()
        form.addRow(self.unreached)
        self._again = QTimer(self, interval=RETRY_MS, singleShot=True)
        self._again.timeout.connect(self._try_all)
        self.box.activated.connect(self._show_choice)
        QgsProject.instance().readProject.connect(self.follow_project)
        QgsProject.instance().layerTreeRoot().visibilityChanged.connect(self._try_shown_in)
        self.follow_project()

    def follow_project(self, *_: object) -> None:
        """Show the project's base map, and say if it cannot be reached."""
        layers = base_map_layers(QgsProject.instance())
        key = layers[0].customProperty("furrowmap/basemap") if layers else NO_BASE_MAP
        self.box.setCurrentIndex(max(self.box.findData(key), 0))
        self.inputs.setVisible(key == OWN_BASE_MAP)
        for layer in layers:
            if layer.isValid():
                self._try_if_visible(layer)
            else:
                self._report(self.tr("The base map {name} cannot be opened.").format(name=layer.name()))

    def end(self) -> None:
        """Cancel a request, before the plugin is unloaded."""
        self._again.stop()
        fetcher = self._fetcher
        self._fetcher = None
        if fetcher is not None:
            fetcher.cancel()

    def _show_choice(self, *_: object) -> None:
        own = self.box.currentData() == OWN_BASE_MAP
        self.inputs.setVisible(own)
        if not own or self.own.text().strip():
            self._apply()

    def _browse(self) -> None:
        filters = self.tr("Rasters and MBTiles (*.mbtiles *.tif *.tiff *.vrt *.jp2 *.png *.jpg)")
        filters += f";;{self.tr('All files')} (*)"
        path, _ = QFileDialog.getOpenFileName(self, self.tr("Base map"), "", filters)
        if path:
            self.own.setText(path)
            self._apply()

    def _apply(self) -> None:
        self.unreached.hide()
        key, own, attribution = self.box.currentData(), self.own.text().strip(), self.attribution.text().strip()
        if key == OWN_BASE_MAP and is_service(own):
            self._fetch(capabilities_url(own), lambda text: self._offer(text, own, attribution))
            return
        try:
            self._show(own_layer(own, attribution) if key == OWN_BASE_MAP else known_layer(key), key, own, attribution)
        except ValueError as error:
            self._report(str(error))

    def _offer(self, text: str, own: str, attribution: str) -> None:
        """Show the layer of a service; the user chooses among several."""
        try:
            layers = service_layers(text, own, QgsProject.instance().crs().authid())
        except ValueError:
            layers = []
        if not layers:
            self._report(self.tr("{own} has no map layers of a WMS or WMTS.").format(own=own))
            return
        chosen = layers[0]
        if len(layers) > 1:
            titles = [layer.title if layer.title == layer.name else f"{layer.title} ({layer.name})" for layer in layers]
            title, agreed = QInputDialog.getItem(self, self.tr("Base map"), self.tr("Layer"), titles, editable=False)
            if not agreed:
                return
            chosen = layers[titles.index(title)]
        layer = service_layer(chosen, attribution)  # asks the service, while the window goes on
        if (self.box.currentData(), self.own.text().strip()) != (OWN_BASE_MAP, own):
            return  # another map was chosen meanwhile
        if layer.isValid():
            self._show(layer, OWN_BASE_MAP, own, attribution)
        else:
            self._report(self.tr("The base map {name} cannot be opened.").format(name=chosen.title))

    def _show(self, layer: QgsMapLayer | None, key: str, own: str, attribution: str) -> None:
        show_base_map(layer, key)
        remember(own, attribution)
        if layer is not None:
            self.attribution.setToolTip(attribution_of([layer]))
            self._try(layer)

    def _try_shown_in(self, node: QgsLayerTreeNode) -> None:
        """A base map of a project, such as a farm map's, may be hidden at first; then it asks nothing."""
        for layer in base_map_layers(QgsProject.instance()):
            if layer.id() in ([node.layerId()] if QgsLayerTree.isLayer(node) else node.findLayerIds()):
                self._try_if_visible(layer)

    def _try_all(self) -> None:
        for layer in base_map_layers(QgsProject.instance()):
            self._try_if_visible(layer)

    def _try_if_visible(self, layer: QgsMapLayer) -> None:
        shown = QgsProject.instance().layerTreeRoot().findLayer(layer.id())
        if shown is not None and shown.isVisible():
            self._try(layer)

    def _try(self, layer: QgsMapLayer) -> None:
        """Ask for one tile: QGIS itself shows nothing where a map cannot be reached."""
        probe = layer.customProperty(PROBE_PROPERTY)
        if probe:
            self._fetch(probe, lambda _text: None, layer.id())

    def _fetch(self, url: str, on_text: Callable[[str], None], layer_id: str = "") -> None:
        """Get a file in the background, of a layer or of a service; a failure is reported."""
        self.end()
        fetcher = self._fetcher = QgsNetworkContentFetcher()

        def finished() -> None:
            if fetcher is not self._fetcher:
                return  # another map was chosen meanwhile
            self._fetcher = None
            reply = fetcher.reply()
            status = reply.attribute(QNetworkRequest.Attribute.HttpStatusCodeAttribute)
            failed = reply.error() != QNetworkReply.NetworkError.NoError
            unreached = failed and (status is None or status in HTTP_REFUSALS or status >= 500)
            layer = QgsProject.instance().mapLayer(layer_id)
            if layer is not None:
                note_reached(layer, reached=not unreached)
            if unreached:
                text = self.tr(
                    "The map of {host} cannot be reached: {reason}.\nThe other layers do not need it. Check the "
                    "address and the network, or choose a map from a file."
                )
                text = text.format(host=QUrl(url).host(), reason=reply.errorString().rstrip("."))
                if self.unreached.isHidden():
                    self._report(text)
                self.unreached.setText(text.partition("\n")[0])  # until it is reached, or another one is chosen
                self.unreached.show()
                self._again.start()
            else:
                self.unreached.hide()
                on_text(fetcher.contentAsString())
            fetcher.deleteLater()

        fetcher.finished.connect(finished)
        fetcher.fetchContent(QUrl(url))
