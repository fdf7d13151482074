# SPDX-License-Identifier: GPL-2.0-or-later
"""'pass 12' in QGIS's locator bar shows that pass on the map."""

from __future__ import annotations

import re
from functools import partial
from typing import Any

from qgis.core import (
    QgsFeatureRequest,
    QgsFeedback,
    QgsLocatorContext,
    QgsLocatorFilter,
    QgsLocatorResult,
    QgsProject,
    QgsVectorLayer,
)
from qgis.gui import QgisInterface
from qgis.PyQt.QtCore import QCoreApplication

from .own_layers import nodes_by_key
from .results import groups_of
from .translation import in_marks

tr = partial(QCoreApplication.translate, "PassLocator")

MAX_RESULTS = 50


class PassLocator(QgsLocatorFilter):
    """Finds passes of the open sessions by their number."""

    def __init__(self, iface: QgisInterface) -> None:
        super().__init__()
        self._iface = iface
        self._known: list[dict[str, Any]] = []

    def clone(self) -> PassLocator:
        """A copy for the locator's thread."""
        return PassLocator(self._iface)

    def name(self) -> str:
        """The filter's id."""
        return "furrowmapPasses"

    def displayName(self) -> str:  # noqa: N802 - the names are QGIS's
        """As the locator's settings show it."""
        return tr("furrowmap passes")

    def prefix(self) -> str:
        """The prefix to type."""
        return "pass"

    def prepare(self, string: str, context: QgsLocatorContext) -> list[str]:  # noqa: ARG002
        """In the main thread, to which layers belong: collect the passes."""
        if _typed_number(string) is None:
            return []
        for group in groups_of(QgsProject.instance()):
            node = nodes_by_key(group).get("passes")
            if node is not None and node.layer().fields().indexOf("pass") >= 0:
                self._known += _passes(group.name(), node.layer())
        return []

    def fetchResults(  # noqa: N802
        self,
        string: str,
        context: QgsLocatorContext,  # noqa: ARG002
        feedback: QgsFeedback,
    ) -> None:
        """In the locator's thread: return passes whose number begins with the one typed."""
        typed = _typed_number(string)
        if typed is None:
            return
        found = [entry for entry in self._known if str(entry["pass"]).startswith(typed)]
        for entry in sorted(found, key=lambda e: (len(str(e["pass"])), e["pass"]))[:MAX_RESULTS]:
            if feedback.isCanceled():
                return
            result = QgsLocatorResult(self, tr("Pass {number}").format(number=entry["pass"]), entry)
            result.description = f"{entry['session']}, {entry['words']}"
            result.score = 1.0 if str(entry["pass"]) == typed else 0.5
            self.resultFetched.emit(result)

    def triggerResult(self, result: QgsLocatorResult) -> None:  # noqa: N802
        """Show the pass on the map."""
        data = result.getUserData() if hasattr(result, "getUserData") else result.userData
        layer = QgsProject.instance().mapLayer(data["layer"])
        if layer is not None:
            canvas = self._iface.mapCanvas()
            canvas.zoomToFeatureIds(layer, [data["feature"]])
            canvas.flashFeatureIds(layer, [data["feature"]])


def _typed_number(string: str) -> str | None:
    """The number typed, with or without the prefix; "" for an empty text, None for another."""
    found = re.fullmatch(r"\s*(?:pass\s+)?(\d+)\s*", string, re.IGNORECASE)
    if found:
        return str(int(found[1]))
    return None if string.strip() else ""


def _passes(session: str, layer: QgsVectorLayer) -> list[dict[str, Any]]:
    """The passes of a layer as plain values, for the locator's thread."""
    request = QgsFeatureRequest().setFlags(QgsFeatureRequest.Flag.NoGeometry)
    fields = layer.fields()
    found = []
    for feature in layer.getFeatures(request):
        area = feature["area_m2"] if fields.indexOf("area_m2") >= 0 else None
        found.append(
            {
                "session": session,
                "layer": layer.id(),
                "feature": feature.id(),
                "pass": int(feature["pass"]),
                "words": ", ".join(
                    [
                        *([str(feature["tool"])] if fields.indexOf("tool") >= 0 else []),
                        *([in_marks(f"{float(area):,.1f} m²")] if isinstance(area, (int, float)) else []),
                    ]
                ),
            }
        )
    return found
