# SPDX-License-Identifier: GPL-2.0-or-later
"""'pass 12' in QGIS's locator bar shows that pass on the map."""

import re
from functools import partial

from qgis.core import QgsFeatureRequest, QgsLocatorFilter, QgsLocatorResult, QgsProject
from qgis.PyQt.QtCore import QCoreApplication

from .results import groups_of

tr = partial(QCoreApplication.translate, "PassLocator")

MOST_RESULTS = 50


class PassLocator(QgsLocatorFilter):
    """Finds passes of the open sessions by their number.

    Args:
        iface: QGIS's interface.
    """

    def __init__(self, iface):
        super().__init__()
        self._iface = iface
        self._known = []

    def clone(self):
        """A copy for the locator's thread."""
        return PassLocator(self._iface)

    def name(self):
        """The filter's id."""
        return "furrowmapPasses"

    def displayName(self):  # noqa: N802 - the names are QGIS's
        """As the locator's settings show it."""
        return tr("furrowmap passes")

    def prefix(self):
        """The prefix to type."""
        return "pass"

    def prepare(self, string, context):  # noqa: ARG002
        """In the main thread, to which layers belong: collect the passes."""
        if self._number(string) is None and string.strip():
            return []
        for group in groups_of(QgsProject.instance()):
            for node in group.findLayers():
                layer = node.layer()
                if layer is not None and layer.name() == "passes" and layer.fields().indexOf("pass") >= 0:
                    self._known += _passes(group.name(), layer)
        return []

    def fetchResults(self, string, context, feedback):  # noqa: N802, ARG002
        """In the locator's thread: return passes whose number begins with the one typed."""
        number = self._number(string)
        if number is None and string.strip():
            return
        typed = "" if number is None else str(number)
        found = [entry for entry in self._known if str(entry["pass"]).startswith(typed)]
        for entry in sorted(found, key=lambda e: (len(str(e["pass"])), e["pass"]))[:MOST_RESULTS]:
            if feedback.isCanceled():
                return
            result = QgsLocatorResult(self, tr("Pass {number}").format(number=entry["pass"]), entry)
            result.description = f"{entry['session']}, {entry['words']}"
            result.score = 1.0 if str(entry["pass"]) == typed else 0.5
            self.resultFetched.emit(result)

    def triggerResult(self, result):  # noqa: N802
        """Show the pass on the map."""
        data = result.getUserData() if hasattr(result, "getUserData") else result.userData
        layer = QgsProject.instance().mapLayer(data["layer"])
        if layer is not None:
            canvas = self._iface.mapCanvas()
            canvas.zoomToFeatureIds(layer, [data["feature"]])
            canvas.flashFeatureIds(layer, [data["feature"]])

    @staticmethod
    def _number(string):
        """The number typed, with or without the prefix."""
        found = re.fullmatch(r"\s*(?:pass\s+)?(\d+)\s*", string, re.IGNORECASE)
        return None if found is None else int(found[1])


def _passes(session, layer):
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
                "words": f"{float(area):,.1f} m²" if isinstance(area, (int, float)) else "",
            }
        )
    return found
