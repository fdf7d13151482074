"""Runs inside QGIS: does what one job after another asks of the plugin's algorithms, and prints the answers as JSON.

The first argument is the folder with the plugin, the second a JSON file with a list of jobs: ``{"do": NAME, ...}``.
Each answer has what QGIS logged meanwhile at warning level or above.
"""

from __future__ import annotations

import ast
import enum
import faulthandler
import gc
import importlib
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
    QgsPointCloudLayer,
    QgsProcessingContext,
    QgsProcessingException,
    QgsProcessingFeedback,
    QgsProcessingUtils,
    QgsProject,
    QgsSettings,
    QgsVectorLayer,
)
from qgis.PyQt.QtCore import QCoreApplication

LOGGED: list[str] = []


def listen(message: str, tab: str, level: Any) -> None:
    if level in (Qgis.MessageLevel.Warning, Qgis.MessageLevel.Critical):
        LOGGED.append(f"{tab}: {message}")


class Feedback(QgsProcessingFeedback):
    """Keeps the messages; cancels itself some time after the first stage, if asked to."""

    def __init__(self, cancel_after_s: float | None = None) -> None:
        super().__init__(False)
        self.messages: list[str] = []
        self.cancel_after_s = cancel_after_s

    def pushInfo(self, text: str) -> None:
        self.messages.append(text)

    def pushCommandInfo(self, text: str) -> None:
        self.messages.append(text)

    def pushWarning(self, text: str) -> None:
        self.messages.append(text)

    def pushConsoleInfo(self, text: str) -> None:
        self.messages.append(text)

    def setProgressText(self, text: str) -> None:
        self.messages.append(text)
        if self.cancel_after_s is not None:
            threading.Timer(self.cancel_after_s, self.cancel).start()
            self.cancel_after_s = None


def algorithm(name: str) -> Any:
    found = QgsApplication.processingRegistry().algorithmById(f"furrowmap:{name}")
    assert found is not None, name
    return found


def describe(_: dict[str, Any]) -> Any:
    """Every algorithm with its parameters and outputs."""
    provider = QgsApplication.processingRegistry().providerById("furrowmap")
    return {
        a.name(): {
            "command": a.description.command,
            "title": a.displayName(),
            "group": [a.groupId(), a.group()],
            "help": a.shortHelpString(),
            "url": a.helpUrl(),
            "options": {parameter.name: parameter.option for parameter in a.description.parameters},
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
    """Outputs, messages, and layers to be loaded; or the error."""
    project = QgsProject()
    for name, (provider, source) in job.get("layers", {}).items():
        kind = {"copc": QgsPointCloudLayer, "ogr": QgsVectorLayer}[provider]
        assert project.addMapLayer(kind(source, name, provider)).isValid(), name
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
    if error is None:
        a.postProcess(context, feedback)
    loaded = {}
    for source, details in context.layersToLoadOnCompletion().items():
        layer = QgsProcessingUtils.mapLayerFromString(source, context, True, details.layerTypeHint)
        if details.postProcessor() is not None:
            details.postProcessor().postProcessLayer(layer, context, feedback)
        loaded[layer.customProperty("furrowmap/key")] = [details.groupName, layer.isValid(), layer.renderer().type()]
    layers = [layer.customProperty("furrowmap/key") or layer.name() for layer in project.mapLayers().values()]
    return {
        "outputs": outputs,
        "written": sorted(name for name, value in outputs.items() if str(value)[:1] == "/" and Path(value).exists()),
        "messages": feedback.messages,
        "error": error,
        "loaded": loaded,
        "layers": layers,
    }


def settings(job: dict[str, Any]) -> Any:
    """Set the interpreter the user chose, and variables of QGIS's process."""
    if "interpreter" in job:
        QgsSettings().setValue("furrowmap/interpreter", job["interpreter"])
    for name, value in job.get("environment", {}).items():
        os.environ[name] = value
    for name in job.get("forget", []):
        os.environ.pop(name, None)
    return None


def translate(job: dict[str, Any]) -> Any:
    """What the strings become in a language, and one that is not the plugin's."""
    from furrowmap.translation import install_translator

    translator = install_translator(job["locale"])
    translated = [QCoreApplication.translate(context, text) for context, text in job["strings"]]
    title = algorithm("run").create().displayName()
    if translator is not None:
        QCoreApplication.removeTranslator(translator)
    return {"translated": translated, "title": title, "unknown": install_translator("xx_YY") is None}


def options(job: dict[str, Any]) -> Any:
    """The options page: what it shows at first, and after its buttons were pressed one after the other."""
    from qgis.PyQt.QtWidgets import QLabel, QPlainTextEdit, QPushButton

    from furrowmap.options_page import OptionsFactory, OptionsPage

    page = OptionsFactory().createWidget(None)
    shown = [page.findChild(QLabel, "furrowmapUsed").text()]
    for press in job["press"]:
        if "wheels" in press:
            page.from_folder.setChecked(True)
            page.wheels.setFilePath(press["wheels"])
        if "package" in press:
            page.from_index.setChecked(True)
            page.package.setFilePath(press["package"])
        if "chosen" in press:
            page.chosen.setFilePath(press["chosen"])
        if press.get("button") == "create":
            page.create()  # what the button does when the question was answered
        elif press.get("button") == "remove":
            page.remove()  # likewise
        elif press.get("button"):
            page.findChild(QPushButton, press["button"]).click()
        until = time.monotonic() + 120
        while OptionsPage.task is not None and time.monotonic() < until:
            QCoreApplication.processEvents()
            time.sleep(0.02)
        shown.append(page.findChild(QPlainTextEdit, "furrowmapLog").toPlainText())
    page.apply()
    shown.append(QgsSettings().value("furrowmap/interpreter", "", str))
    page.deleteLater()
    return shown


def enums(job: dict[str, Any]) -> Any:
    """Members of enums that the sources name without their enum, which Qt 6 does not know; and how many are scoped."""
    unscoped, scoped = [], 0
    for path in sorted(Path(job["folder"]).rglob("*.py")):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        known: dict[str, Any] = {}
        for node in ast.walk(tree):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("qgis"):
                module = importlib.import_module(str(node.module))
                known |= {alias.asname or alias.name: getattr(module, alias.name, None) for alias in node.names}
        for node in (node for node in ast.walk(tree) if isinstance(node, ast.Attribute)):
            owner = known.get(node.value.id) if isinstance(node.value, ast.Name) else None
            value = getattr(owner, node.attr, None)
            if isinstance(value, int | enum.Enum):
                unscoped.append(f"{path.name}:{node.lineno} {ast.unparse(node)}")
            scoped += isinstance(value, type)
    return {"unscoped": unscoped, "scoped": scoped}


def find(_: dict[str, Any]) -> Any:
    """The interpreter that would be used, and where the plugin's own environment lies."""
    from furrowmap.interpreter import environment_folder, find_interpreter

    found = find_interpreter()
    folder = environment_folder()
    left = sorted(path.name for path in folder.parent.iterdir()) if folder.parent.is_dir() else []
    return {"program": found and list(found.program), "origin": found and found.origin, "left": left}


def main(plugins_folder: str, jobs: str) -> None:
    faulthandler.enable()
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
        begun = time.monotonic(), sum(os.times()[:4])
        try:
            answer = globals()[job["do"]](job)
        except Exception:  # noqa: BLE001 - the next job shall have its turn
            answer = {"raised": traceback.format_exc()}
        QCoreApplication.processEvents()
        spent = time.monotonic() - begun[0], sum(os.times()[:4]) - begun[1]
        answers.append({"answer": answer, "logged": list(LOGGED), "spent_s": spent})
    print(json.dumps(answers, default=str))
    sys.stdout.flush()
    QgsApplication.messageLog().messageReceived[str, str, Qgis.MessageLevel].disconnect(listen)
    qgis.utils.plugins["furrowmap"].unload()
    gc.collect()
    QgsProject.instance().clear()
    application.exitQgis()


main(*sys.argv[1:])
