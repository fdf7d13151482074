# SPDX-License-Identifier: GPL-2.0-or-later
"""A command of `furrowmap` as a Processing algorithm, built from its description; the worker does the work."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from fnmatch import fnmatch
from functools import partial
from html import escape
from pathlib import Path
from typing import Any

from qgis.core import (
    QgsCoordinateReferenceSystem,
    QgsMessageLog,
    QgsProcessingAlgorithm,
    QgsProcessingContext,
    QgsProcessingException,
    QgsProcessingFeedback,
    QgsProcessingParameterBoolean,
    QgsProcessingProvider,
)
from qgis.PyQt.QtCore import QCoreApplication
from qgis.PyQt.QtGui import QIcon
from qgis.utils import pluginMetadata

from ..dock_words import in_dock_words
from ..interpreter import find_interpreter, is_usable
from ..previews import open_preview
from ..results import open_results
from ..worker import WorkerCancelled, WorkerError, percent_of, run_command, stage_name
from .description import ALGORITHMS, COMMAND_EXAMPLES, COMMAND_OPTIONS, TOOLBOX_GROUPS, Algorithm, Parameter
from .layer_files import first_unknown, layer_files
from .loading import is_raster, load_when_done, style_when_done
from .parameters import qgis_output, qgis_parameter

tr = partial(QCoreApplication.translate, "Algorithms")

TAB = "furrowmap"
"""Of QGIS's message log."""
OPEN = "OPEN"
"""The parameter that opens the products as layers."""
ERROR_CODE = "furrowmapErrorCode"
"""Property of the feedback that holds the code of the command's error."""
ERROR_SETTING = "furrowmapErrorSetting"
"""Property of the feedback: the line of the session file that remedies the error, as JSON."""

ERROR_EXTRA = "furrowmapErrorExtra"
"""Property of the feedback: the part of furrowmap that has to be installed."""


PICTURE_WIDTH = 230
"""Of the picture in the help, in pixels: the panel of a dialog has about as much."""


class CommandAlgorithm(QgsProcessingAlgorithm):
    """Runs a command of `furrowmap`."""

    def __init__(self, description: Algorithm) -> None:
        super().__init__()
        self.description = description
        self.by_name = {parameter.name: parameter for parameter in description.parameters}
        self.files: dict[str, list[str]] = {}

    def createInstance(self) -> CommandAlgorithm:  # noqa: N802 - the names are QGIS's
        """Another instance, as QGIS asks for."""
        return type(self)(self.description)

    def name(self) -> str:
        """The id within the provider."""
        return self.description.id

    def displayName(self) -> str:  # noqa: N802
        """As the toolbox shows it."""
        return translated(self.description.title)

    def groupId(self) -> str:  # noqa: N802
        """The id of its group."""
        return self.description.group

    def group(self) -> str:
        """Its group as the toolbox shows it."""
        return translated(TOOLBOX_GROUPS[self.description.group][0])

    def icon(self) -> QIcon:
        """The plugin's icon."""
        return QIcon(str(Path(__file__).parents[1] / "icon.svg"))

    def tags(self) -> list[str]:
        """Words by which the toolbox finds it."""
        words = self.description.command.split()
        return ["furrowmap", "lidar", "gnss", "tractor", "point cloud", "tillage", *words]

    def shortHelpString(self) -> str:  # noqa: N802
        """A picture, the summary, what goes in and comes out, and an example; needs no network."""
        picture = Path(__file__).with_name("pictures") / f"{self.description.group}.svg"
        known = [p for p in self.parameterDefinitions() if p.help()]
        written = [p for p in known if p.isDestination()]
        given = [(p.description(), p.help()) for p in known if not p.isDestination()]
        made = [(p.description(), p.help()) for p in written]
        made += [(output.label, "") for output in self.description.outputs]
        example = _html(COMMAND_EXAMPLES[self.description.command])
        paragraphs = [
            f'<img src="{picture.as_uri()}" width="{PICTURE_WIDTH}">',
            _html(translated(self.description.summary)),
            *_headed(tr("Inputs"), given),
            *_headed(tr("Outputs"), [(translated(label), text) for label, text in made]),
            f"{_bold(tr('Example on the command line'))}<br><code>{example}</code>",
        ]
        return "".join(f"<p>{text}</p>" for text in paragraphs)

    def helpUrl(self) -> str:  # noqa: N802
        """The command's section in the documentation, below the plugin's homepage."""
        page = pluginMetadata("furrowmap", "homepage").rstrip("/")
        return f"{page}/reference/commands/#furrowmap-{self.description.command.replace(' ', '-')}"

    def initAlgorithm(self, configuration: dict[str, Any] | None = None) -> None:  # noqa: N802, ARG002
        """Add parameters and outputs."""
        for parameter in self.by_name.values():
            self.addParameter(qgis_parameter(parameter, translated))
        if self.description.opens:
            opens = QgsProcessingParameterBoolean(OPEN, tr("Open the products as styled layers"), defaultValue=True)
            opens.setHelp(tr("Adds them to the project when the algorithm has finished."))
            self.addParameter(opens)
        for output in self.description.outputs:
            self.addOutput(qgis_output(output, translated))

    def canExecute(self) -> tuple[bool, str]:  # noqa: N802
        """Whether a worker is set up; if not, where to do that."""
        if is_usable(find_interpreter()):
            return True, ""
        return False, tr(
            "furrowmap's worker is not set up. Choose or create its environment in Settings › Options › furrowmap."
        )

    def checkParameterValues(  # noqa: N802
        self, parameters: dict[str, Any], context: QgsProcessingContext
    ) -> tuple[bool, str]:
        """Check the values before the worker starts."""
        valid, message = super().checkParameterValues(parameters, context)
        if not valid:
            return valid, message
        fault = self._fault(parameters, context)
        return not fault, fault

    def _fault(self, parameters: dict[str, Any], context: QgsProcessingContext) -> str:
        """What is wrong with the values; "" if nothing."""
        ways: dict[str, list[tuple[str, bool]]] = {}
        for parameter in self.by_name.values():
            label = translated(parameter.label)
            if parameter.kind.startswith("new ") or parameter.layers:  # evaluating these may add a layer to the context
                values = [value for value in [parameters.get(parameter.name)] if value]
            else:
                values = self._values(parameter, parameters, context)
            absent = _absent(parameter, values, context)
            if absent:
                return tr("{parameter}: {path} does not exist.").format(parameter=label, path=absent)
            if parameter.kind == "numbers" and values and not _are_numbers(values[0], parameter.count):
                return tr("{parameter}: '{text}' has the wrong format. {help}").format(
                    parameter=label, text=values[0], help=translated(parameter.help)
                )
            ways.setdefault(parameter.option, []).append((label, bool(values)))
        for option, either in ways.items():
            count = sum(given for _, given in either)
            least = 0 if COMMAND_OPTIONS[self.description.command][option].get("default") is not None else 1
            if len(either) > 1 and not least <= count <= 1:
                return tr("Give either '{one}' or '{other}'.").format(one=either[0][0], other=either[1][0])
        return ""

    def _arguments(
        self, values: dict[str, list[str]], parameters: dict[str, Any], context: QgsProcessingContext
    ) -> list[str]:
        """The arguments of the command line, its name first; `values` has each parameter's :meth:`_values`."""
        options: list[str] = []
        arguments: list[str] = []
        for name, parameter in self.by_name.items():
            if not parameter.option.startswith("--"):
                arguments += values[name]
            elif parameter.kind == "flag":
                options += [parameter.option] if values[name] else []
            else:
                options += [f"{parameter.option}={value}" for value in values[name]]
            if parameter.crs and values[name]:
                of = self.parameterAsPointCrs if parameter.kind == "point" else self.parameterAsExtentCrs
                crs = of(parameters, name, context)
                options += [f"{parameter.crs}={crs_text(crs)}"] if crs.isValid() else []
        return [*self.description.command.split(), *options, "--", *arguments]

    def _values(self, parameter: Parameter, parameters: dict[str, Any], context: QgsProcessingContext) -> list[str]:
        """A parameter's value as the command line takes it: one or several strings, none where it is not given."""
        name = parameter.name
        kind = parameter.kind
        if kind == "flag":
            return ["yes"] if self.parameterAsBool(parameters, name, context) else []
        if kind in ("integer", "number"):
            number = self.parameterAsDouble(parameters, name, context)
            given = parameters.get(name, parameter.default) is not None
            return [f"{number:.12g}"] if given and math.isfinite(number) else []
        if kind in ("choice", "choices"):
            return [choice for choice in self.parameterAsEnumStrings(parameters, name, context) if choice]
        if kind == "crs":
            crs = self.parameterAsCrs(parameters, name, context)
            return [crs_text(crs)] if crs.isValid() else []
        if kind == "extent":
            box = self.parameterAsExtent(parameters, name, context)
            sides = (box.xMinimum(), box.yMinimum(), box.xMaximum(), box.yMaximum())
            return [] if box.isNull() else [",".join(f"{side:.9f}" for side in sides)]
        if kind == "point":
            point = self.parameterAsPoint(parameters, name, context)
            return [f"{point.x():.9f},{point.y():.9f}"] if parameters.get(name) else []
        return self._texts(parameter, parameters, context)

    def _texts(self, parameter: Parameter, parameters: dict[str, Any], context: QgsProcessingContext) -> list[str]:
        """The values of a parameter that is text or a path."""
        name = parameter.name
        kind = parameter.kind
        if parameter.layers:
            texts = self.files[name]
        elif kind == "files":
            texts = self.parameterAsFileList(parameters, name, context)
        elif kind == "texts":
            texts = [line.strip() for line in self.parameterAsString(parameters, name, context).splitlines()]
        elif kind == "new raster":
            texts = [self.parameterAsOutputLayer(parameters, name, context)]
        elif kind in ("new file", "new folder"):
            texts = [self.parameterAsFileOutput(parameters, name, context)]
        else:
            texts = [self.parameterAsString(parameters, name, context)]
        texts = [text for text in texts if text] or [text for text in [parameter.if_absent] if text]
        if parameter.folder_of:
            folders = [str(Path(text).parent) if _stands_for_folder(text, parameter) else text for text in texts]
            return list(dict.fromkeys(folders))
        return texts

    def prepareAlgorithm(  # noqa: N802
        self, parameters: dict[str, Any], context: QgsProcessingContext, feedback: QgsProcessingFeedback
    ) -> bool:
        """Find or write the files of layers, in the thread of the project."""
        with_layers = [parameter for parameter in self.by_name.values() if parameter.layers]
        self.files = {p.name: layer_files(p, parameters.get(p.name), context, feedback) for p in with_layers}
        return True

    def processAlgorithm(  # noqa: N802
        self, parameters: dict[str, Any], context: QgsProcessingContext, feedback: QgsProcessingFeedback
    ) -> dict[str, Any]:
        """Have the worker run the command, report its progress, return the outputs."""
        interpreter = find_interpreter()
        if interpreter is None or not is_usable(interpreter):
            raise QgsProcessingException(self.canExecute()[1])
        values = {name: self._values(each, parameters, context) for name, each in self.by_name.items()}
        arguments = self._arguments(values, parameters, context)
        feedback.pushCommandInfo(" ".join(["furrowmap", *arguments]))
        try:
            answer = run_command(interpreter.program, arguments, _Listener(feedback), feedback.isCanceled)
        except WorkerCancelled:
            feedback.pushInfo(tr("Cancelled; no partial files are left."))
            return {}
        except WorkerError as error:
            for line in error.log:
                feedback.pushConsoleInfo(line)
            QgsMessageLog.logMessage("\n".join([*error.lines, *error.log]), TAB)
            feedback.setProperty(ERROR_CODE, error.code)
            feedback.setProperty(ERROR_SETTING, json.dumps(error.setting))
            feedback.setProperty(ERROR_EXTRA, error.extra)
            raise QgsProcessingException("\n".join(error.lines)) from None
        feedback.setProgress(100)
        if self.description.layers and self.parameterAsBool(parameters, OPEN, context):
            self._load(self.description.opened(answer), values, context)
        for name, parameter in self.by_name.items():
            if parameter.kind == "new raster":
                style_when_done(context, values[name][0])
        return self._outputs(answer, values)

    def _load(self, paths: Sequence[str], values: dict[str, list[str]], context: QgsProcessingContext) -> None:
        """Have QGIS open products in one group, the first of them topmost; of several rasters one is seen."""
        named = next((value[0] for name, value in values.items() if value and self.by_name[name].layers), "")
        group = translated(self.description.layer_group) or "{folder}"
        rasters = [path for path in paths if is_raster(path)]
        for number, path in enumerate(paths):
            title = group.format(name=Path(named).name.partition(".")[0], folder=Path(path).parent.name)
            load_when_done(context, path, title, below=100 * (len(paths) - number), shown=path not in rasters[1:])

    def _outputs(self, answer: Any, values: dict[str, list[str]]) -> dict[str, Any]:
        """The files and folders that parameters name, and what the description takes from the answer."""
        named = [name for name, parameter in self.by_name.items() if parameter.kind.startswith("new ")]
        files = {name: values[name][0] if values[name] else None for name in named}
        taken = {output.name: output.value(answer) for output in self.description.outputs}
        absent = {output.name: "" for output in self.description.outputs if output.kind == "text"}
        return {**files, **absent, **{name: value for name, value in taken.items() if value is not None}}


class RunAlgorithm(CommandAlgorithm):
    """`furrowmap run`, whose products open as a group of their own."""

    folder: str | None = None

    def processAlgorithm(  # noqa: N802
        self, parameters: dict[str, Any], context: QgsProcessingContext, feedback: QgsProcessingFeedback
    ) -> dict[str, Any]:
        """Remember what :meth:`postProcessAlgorithm` opens."""
        outputs = super().processAlgorithm(parameters, context, feedback)
        if self.parameterAsBool(parameters, OPEN, context):
            self.folder = outputs.get("FOLDER")
            self.open = open_preview if self.parameterAsBool(parameters, "PREVIEW", context) else open_results
        return outputs

    def postProcessAlgorithm(  # noqa: N802
        self, context: QgsProcessingContext, feedback: QgsProcessingFeedback
    ) -> dict[str, Any]:
        """Open the products, in the main thread."""
        if self.folder and not feedback.isCanceled() and context.project() is not None:
            self.open(self.folder, context.project())
        return {}


def translated(text: str) -> str:
    """As :func:`tr`, for the texts of descriptions, which are no literals here."""
    return QCoreApplication.translate("Algorithms", text) if text else ""


def crs_text(crs: QgsCoordinateReferenceSystem) -> str:
    """A CRS as another program reads it: WKT for a user-defined one, whose code only this QGIS knows."""
    own = not crs.authid() or crs.authid().startswith("USER:")
    return crs.toWkt(QgsCoordinateReferenceSystem.WktVariant.WKT_PREFERRED) if own else crs.authid()


def _stands_for_folder(text: str, parameter: Parameter) -> bool:
    return Path(text).is_file() and fnmatch(Path(text).name.lower(), parameter.folder_of)


def _absent(parameter: Parameter, values: Sequence[Any], context: QgsProcessingContext) -> str:
    """The first of the files in values that does not exist; "" if all do."""
    if parameter.kind not in ("file", "files"):
        return ""
    if parameter.layers:
        return first_unknown(parameter, values[0] if values else None, context)
    return next((path for path in values if path != parameter.if_absent and not Path(path).exists()), "")


def _are_numbers(text: str, count: int | None) -> bool:
    parts = text.split(",")
    try:
        return all(math.isfinite(float(part)) for part in parts) and count in (None, len(parts))
    except ValueError:
        return False


def _html(text: str) -> str:
    return escape(text, quote=False)


def _bold(text: str) -> str:
    """Not by `<b>`, to which the dark theme of QGIS gives a colour that cannot be read on it."""
    return f'<span style="font-weight: bold">{_html(text)}</span>'


def _headed(title: str, rows: Sequence[tuple[str, str]]) -> list[str]:
    """A heading, and a paragraph for each label with its text; nothing for no rows."""
    found = [_bold(label) + (f"<br>{_html(text)}" if text else "") for label, text in rows]
    return [f"<u>{_html(title)}</u>", *found] if found else []


class _Listener:
    """Passes the worker's messages on to QGIS's feedback."""

    def __init__(self, feedback: QgsProcessingFeedback) -> None:
        self.feedback = feedback
        self.stage: str | None = None

    def __call__(self, message: dict[str, Any]) -> None:
        kind = message["type"]
        if kind == "progress":
            if message.get("stage") != self.stage:
                self.stage = message.get("stage")
                self.feedback.setProgressText(stage_name(str(self.stage)))
            self.feedback.setProgress(percent_of(message))
        elif kind == "warning":
            self.feedback.pushWarning(in_dock_words(str(message.get("text", ""))))
        else:
            self.feedback.pushInfo(str(message.get("text", message)))


class FurrowmapProvider(QgsProcessingProvider):
    """One algorithm for each command; they are listed without a worker as well, and then say that it is missing."""

    def id(self) -> str:
        """Never translated: models and scripts name it."""
        return "furrowmap"

    def name(self) -> str:
        """As the toolbox shows it."""
        return "furrowmap"

    def icon(self) -> QIcon:
        """The plugin's icon."""
        return QIcon(str(Path(__file__).parents[1] / "icon.svg"))

    def loadAlgorithms(self) -> None:  # noqa: N802 - the name is QGIS's
        """Add each algorithm."""
        for description in ALGORITHMS:
            self.addAlgorithm((RunAlgorithm if description.command == "run" else CommandAlgorithm)(description))
