"""Runs inside QGIS: does what one job after another asks of the plugin's algorithms, and prints the answers as JSON.

The first argument is the folder with the plugin, the second a JSON file with a list of jobs: ``{"do": NAME, ...}``.
What QGIS's log says at warning level or above is told with each answer, but for what the plugin's own tab is meant for.
"""

from __future__ import annotations

import json
import os
import sys
import threading
import time
import traceback
from pathlib import Path
from typing import Any

import qgis.utils
from qgis.core import (
    Qgis,
    QgsApplication,
    QgsProcessingContext,
    QgsProcessingException,
    QgsProcessingFeedback,
    QgsProject,
    QgsSettings,
)
from qgis.PyQt.QtCore import QCoreApplication

LOGGED: list[str] = []


def listen(message: str, tab: str, level: Any) -> None:
    if level in (Qgis.MessageLevel.Warning, Qgis.MessageLevel.Critical):
        LOGGED.append(f"{tab}: {message}")


class Feedback(QgsProcessingFeedback):
    """Keeps what it is told; cancels itself so long after the first stage, where that is asked for."""

    def __init__(self, cancel_after_s: float | None = None) -> None:
        super().__init__(False)
        self.told: list[str] = []
        self.cancel_after_s = cancel_after_s
        self.cancelled_at: float | None = None

    def pushInfo(self, text: str) -> None:
        self.told.append(text)

    def pushCommandInfo(self, text: str) -> None:
        self.told.append(text)

    def pushWarning(self, text: str) -> None:
        self.told.append(text)

    def pushConsoleInfo(self, text: str) -> None:
        self.told.append(text)

    def setProgressText(self, text: str) -> None:
        self.told.append(text)
        if self.cancel_after_s is not None and self.cancelled_at is None:
            self.cancelled_at = 0.0
            threading.Timer(self.cancel_after_s, self._cancel).start()

    def _cancel(self) -> None:
        self.cancelled_at = time.monotonic()
        self.cancel()


def algorithm(name: str) -> Any:
    found = QgsApplication.processingRegistry().algorithmById(f"furrowmap:{name}")
    assert found is not None, name
    return found


def describe(_: dict[str, Any]) -> Any:
    """Every algorithm with its parameters and outputs."""
    provider = QgsApplication.processingRegistry().providerById("furrowmap")
    return {
        a.name(): {
            "verb": list(a.VERB),
            "title": a.displayName(),
            "group": [a.groupId(), a.group()],
            "help": a.shortHelpString(),
            "url": a.helpUrl(),
            "options": a.options,
            "parameters": {p.name(): [p.type(), p.description(), p.help()] for p in a.parameterDefinitions()},
            "choices": {p.name(): p.options() for p in a.parameterDefinitions() if p.type() == "enum"},
            "outputs": [o.name() for o in a.outputDefinitions()],
        }
        for a in (x.create() for x in provider.algorithms())
    }


def check(job: dict[str, Any]) -> Any:
    """What the algorithm says of the values before it starts."""
    return list(algorithm(job["algorithm"]).create().checkParameterValues(job["parameters"], QgsProcessingContext()))


def run(job: dict[str, Any]) -> Any:
    """Outputs, what was told, what is to be loaded; or the error."""
    project = QgsProject()
    context = QgsProcessingContext()
    context.setProject(project)
    feedback = Feedback(job.get("cancel_after_s"))
    a = algorithm(job["algorithm"]).create()
    can, reason = a.canExecute()
    if not can:
        return {"cannot": reason}
    a.prepare(job["parameters"], context, feedback)
    try:
        outputs = a.runPrepared(job["parameters"], context, feedback)
        error = None
    except QgsProcessingException as raised:
        outputs, error = {}, str(raised)
    after_s = time.monotonic() - feedback.cancelled_at if feedback.cancelled_at else None
    if error is None:
        a.postProcess(context, feedback)
    loaded = {}
    for source, details in context.layersToLoadOnCompletion().items():
        layer = context.getMapLayer(source) or open_layer(source, context)
        if details.postProcessor() is not None:
            details.postProcessor().postProcessLayer(layer, context, feedback)
        loaded[details.name] = [details.groupName, layer.isValid(), layer.renderer().type()]
    layers = [layer.name() for layer in project.mapLayers().values()]
    return {
        "outputs": outputs,
        "told": feedback.told,
        "error": error,
        "loaded": loaded,
        "layers": layers,
        "cancelled_after_s": after_s,
    }


def open_layer(source: str, context: QgsProcessingContext) -> Any:
    from qgis.core import QgsProcessingUtils

    return QgsProcessingUtils.mapLayerFromString(source, context)


def settings(job: dict[str, Any]) -> Any:
    """Set the interpreter the user chose, and variables of QGIS's process."""
    if "interpreter" in job:
        QgsSettings().setValue("furrowmap/interpreter", job["interpreter"])
    os.environ.update(job.get("environment", {}))
    return None


def main(plugins_folder: str, jobs: str) -> None:
    application = QgsApplication([], True)
    application.initQgis()
    QgsApplication.messageLog().messageReceived[str, str, Qgis.MessageLevel].connect(listen)
    sys.path.insert(0, plugins_folder)
    qgis.utils.plugin_paths.append(plugins_folder)
    qgis.utils.updateAvailablePlugins()
    assert qgis.utils.loadPlugin("furrowmap")
    qgis.utils.iface = None
    assert qgis.utils.startProcessingPlugin("furrowmap")
    answers = []
    for job in json.loads(Path(jobs).read_text(encoding="utf-8")):
        LOGGED.clear()
        try:
            answer = globals()[job["do"]](job)
        except Exception:  # noqa: BLE001 - the next job shall have its turn
            answer = {"raised": traceback.format_exc()}
        QCoreApplication.processEvents()
        answers.append({"answer": answer, "logged": list(LOGGED)})
    print(json.dumps(answers, default=str))
    QgsProject.instance().clear()
    application.exitQgis()


main(*sys.argv[1:])
