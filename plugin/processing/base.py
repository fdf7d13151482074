# SPDX-License-Identifier: GPL-2.0-or-later
"""What all algorithms have in common: they order a verb from the worker, and differ only in parameters and outputs."""

import math
from html import escape
from pathlib import Path

from qgis.core import (
    QgsCoordinateReferenceSystem,
    QgsMessageLog,
    QgsProcessingAlgorithm,
    QgsProcessingException,
    QgsProcessingParameterBoolean,
    QgsProcessingParameterCrs,
    QgsProcessingParameterDefinition,
    QgsProcessingParameterEnum,
    QgsProcessingParameterFile,
    QgsProcessingParameterFileDestination,
    QgsProcessingParameterMultipleLayers,
    QgsProcessingParameterNumber,
    QgsProcessingParameterRasterDestination,
)
from qgis.PyQt.QtCore import QCoreApplication
from qgis.PyQt.QtGui import QIcon
from qgis.utils import pluginMetadata

from ..interpreter import find_interpreter, is_usable
from ..stages import stage_words
from ..worker import WorkerCancelled, WorkerError, run_verb

TAB = "furrowmap"
"""Of QGIS's message log."""

ARGUMENT = ""
"""Instead of an option's name: the parameter is one of the verb's arguments, in the order in which they are added."""


class VerbAlgorithm(QgsProcessingAlgorithm):
    """An algorithm that is a verb of `furrowmap`.

    A subclass names itself by literal ids, which models keep; says which option of the verb each parameter is, from
    which the base class makes the verb's arguments; and makes outputs of the verb's answer.

    Attributes:
        ID: within the provider.
        VERB: the words of the command line.
        GROUP: id of the group in the toolbox.
        options: parameter's name → option of the verb, or :data:`ARGUMENT`.
    """

    ID = ""
    VERB = ()
    GROUP = "session"

    def __init__(self):
        super().__init__()
        self.options = {}

    def createInstance(self):  # noqa: N802 - the names are QGIS's
        """A new one, as QGIS asks for."""
        return type(self)()

    def name(self):
        """The id within the provider."""
        return self.ID

    def groupId(self):  # noqa: N802
        """The id of its group."""
        return self.GROUP

    def group(self):
        """Its group as the toolbox shows it."""
        return {
            "session": self.tr("Sessions"),
            "surfaces": self.tr("Surfaces and clouds"),
            "base": self.tr("Base map"),
            "exchange": self.tr("Exchange"),
            "accuracy": self.tr("Accuracy"),
        }[self.GROUP]

    def icon(self):
        """The plugin's own."""
        return QIcon(str(Path(__file__).parents[1] / "icon.svg"))

    def tags(self):
        """Words by which the toolbox finds it."""
        return ["furrowmap", "lidar", "gnss", "tractor", "point cloud", "tillage", *self.VERB]

    def summary(self):
        """What it does, in a paragraph."""
        raise NotImplementedError

    def shortHelpString(self):  # noqa: N802
        """The summary, what each parameter means, and the command that does the same; needs no network."""
        command = " ".join(["furrowmap", *self.VERB, "--help"])
        parameters = [(p.description(), p.help()) for p in self.parameterDefinitions() if p.help()]
        told = [
            _html(self.summary()),
            *(f"<b>{_html(name)}</b><br>{_html(text)}" for name, text in parameters),
            f"{self.tr('On the command line:')} <code>{command}</code>",
        ]
        return "".join(f"<p>{text}</p>" for text in told)

    def helpUrl(self):  # noqa: N802
        """Where more is told: below the plugin's own page, which its metadata name."""
        page = pluginMetadata("furrowmap", "homepage").rstrip("/")
        return f"{page}/reference/commands/#furrowmap-{'-'.join(self.VERB)}"

    def canExecute(self):  # noqa: N802
        """Whether a worker is there; if not, why."""
        if is_usable(find_interpreter()):
            return True, ""
        return False, self.tr(
            "furrowmap's worker is not set up: Settings › Options › furrowmap makes or finds its environment."
        )

    def add(self, parameter, option, help_text="", *, advanced=False):
        """Add a parameter: which option of the verb it is, and the words that explain it."""
        parameter.setHelp(help_text)
        if advanced:
            parameter.setFlags(parameter.flags() | QgsProcessingParameterDefinition.Flag.FlagAdvanced)
        self.addParameter(parameter)
        if option is not None:
            self.options[parameter.name()] = option

    def checkParameterValues(self, parameters, context):  # noqa: N802
        """Look at the values before anything starts: files that are to be read are there, and what the verb asks."""
        well, message = super().checkParameterValues(parameters, context)
        if not well:
            return well, message
        for definition in self.parameterDefinitions():
            for path in self._files_read(definition, parameters, context):
                if not Path(path).exists():
                    return False, self.tr("{parameter}: there is no {path}.").format(
                        parameter=definition.description(), path=path
                    )
        fault = self.fault(parameters, context)
        return not fault, fault

    def fault(self, parameters, context):  # noqa: ARG002 - for subclasses
        """What is wrong with the values together; empty if nothing."""
        return ""

    def _files_read(self, definition, parameters, context):
        if isinstance(definition, QgsProcessingParameterFile):
            return [path for path in [self.parameterAsFile(parameters, definition.name(), context)] if path]
        if isinstance(definition, QgsProcessingParameterMultipleLayers):
            return self.parameterAsFileList(parameters, definition.name(), context)
        return []

    def arguments(self, parameters, context):
        """The verb's arguments as on the command line, its name first."""
        options, arguments = [], []
        for definition in self.parameterDefinitions():
            option = self.options.get(definition.name())
            if option is None:
                continue
            values = self.words(definition, parameters, context)
            if option == ARGUMENT:
                arguments += values
            elif isinstance(definition, QgsProcessingParameterBoolean):
                options += [option] if values else []
            else:
                options += [f"{option}={value}" for value in values]
        return [*self.VERB, *options, "--", *arguments]

    def words(self, definition, parameters, context):
        """A parameter's value in words of the command line: none where it is not given."""
        name = definition.name()
        if isinstance(definition, QgsProcessingParameterBoolean):
            return ["yes"] if self.parameterAsBool(parameters, name, context) else []
        if isinstance(definition, QgsProcessingParameterNumber):
            given = parameters.get(name, definition.defaultValue())
            number = self.parameterAsDouble(parameters, name, context)
            return [f"{number:.12g}"] if given is not None and math.isfinite(number) else []
        if isinstance(definition, QgsProcessingParameterMultipleLayers):
            return self.parameterAsFileList(parameters, name, context)
        if isinstance(definition, QgsProcessingParameterEnum):
            return [choice for choice in self.parameterAsEnumStrings(parameters, name, context) if choice]
        if isinstance(definition, QgsProcessingParameterCrs):
            crs = self.parameterAsCrs(parameters, name, context)
            return [crs_words(crs)] if crs.isValid() else []
        if isinstance(definition, QgsProcessingParameterFileDestination):
            text = self.parameterAsFileOutput(parameters, name, context)
        elif isinstance(definition, QgsProcessingParameterRasterDestination):
            text = self.parameterAsOutputLayer(parameters, name, context)
        else:
            text = self.parameterAsString(parameters, name, context)
        return [text] if text else []

    def outputs(self, answer, parameters, context):
        """The algorithm's outputs, from the verb's answer."""
        raise NotImplementedError

    def processAlgorithm(self, parameters, context, feedback):  # noqa: N802
        """Order the verb, tell how it goes, give its outputs.

        Raises:
            QgsProcessingException: with the worker's three lines.
        """
        interpreter = find_interpreter()
        if not is_usable(interpreter):
            raise QgsProcessingException(self.canExecute()[1])
        arguments = self.arguments(parameters, context)
        feedback.pushCommandInfo(" ".join(["furrowmap", *arguments]))
        try:
            answer = run_verb(interpreter.program, arguments, _Listener(feedback), feedback.isCanceled)
        except WorkerCancelled:
            feedback.pushInfo(self.tr("Stopped before the end; nothing half-written is left."))
            return {}
        except WorkerError as error:
            for line in error.log:
                feedback.pushConsoleInfo(line)
            QgsMessageLog.logMessage("\n".join([*error.lines, *error.log]), TAB)
            raise QgsProcessingException("\n".join(error.lines)) from None
        feedback.setProgress(100)
        return self.outputs(answer, parameters, context)

    @staticmethod
    def tr(text):
        """`text` in the user's language."""
        return QCoreApplication.translate("Algorithms", text)


def _html(text):
    return escape(text, quote=False)


def crs_words(crs):
    """A CRS as another program knows it: those of the user's own have a number that only this QGIS knows."""
    own = not crs.authid() or crs.authid().startswith("USER:")
    return crs.toWkt(QgsCoordinateReferenceSystem.WktVariant.WKT_PREFERRED) if own else crs.authid()


class _Listener:
    """Tells QGIS's feedback what the worker says; the stages' shares become one bar as far as that can be known."""

    def __init__(self, feedback):
        self.feedback = feedback
        self.stage = None

    def __call__(self, message):
        kind = message["type"]
        if kind == "progress":
            if message.get("stage") != self.stage:
                self.stage = message.get("stage")
                self.feedback.setProgressText(stage_words(self.stage))
            self.feedback.setProgress(100.0 * float(message.get("share", 0.0)))
        elif kind == "warning":
            self.feedback.pushWarning(str(message.get("text", "")))
        else:
            self.feedback.pushInfo(str(message.get("text", message)))
