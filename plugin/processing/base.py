# SPDX-License-Identifier: GPL-2.0-or-later
"""What all algorithms have in common: they order a verb from the worker, and differ only in parameters and outputs."""

from pathlib import Path

from qgis.core import (
    QgsMessageLog,
    QgsProcessingAlgorithm,
    QgsProcessingException,
    QgsProcessingParameterDefinition,
)
from qgis.PyQt.QtCore import QCoreApplication
from qgis.PyQt.QtGui import QIcon

from ..interpreter import find_interpreter, is_usable
from ..worker import WorkerCancelled, WorkerError, run_verb

TAB = "furrowmap"
"""Of QGIS's message log."""


class VerbAlgorithm(QgsProcessingAlgorithm):
    """An algorithm that is a verb of `furrowmap`.

    A subclass names itself by literal ids, which models keep, and says how its parameters become the verb's arguments.
    """

    ID = ""
    GROUP = "session"

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
            "exchange": self.tr("Exchange"),
            "accuracy": self.tr("Accuracy"),
        }[self.GROUP]

    def icon(self):
        """The plugin's own."""
        return QIcon(str(Path(__file__).parents[1] / "icon.svg"))

    def tags(self):
        """Words by which the toolbox finds it."""
        return ["furrowmap", "lidar", "gnss", "tractor", "point cloud", "tillage", self.ID]

    def helpUrl(self):  # noqa: N802
        """Where more is told; offline, the short help is all there is."""
        return f"https://example.org/furrowmap/reference/commands/#{self.ID}"

    def canExecute(self):  # noqa: N802
        """Whether a worker is there; if not, why."""
        if is_usable(find_interpreter()):
            return True, ""
        return False, self.tr(
            "furrowmap's worker is not set up: Settings › Options › furrowmap makes or finds its environment."
        )

    def arguments(self, parameters, context):
        """The verb's arguments, its name first."""
        raise NotImplementedError

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
        feedback.pushCommandInfo(" ".join(["furrowmap", *map(str, arguments)]))
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

    def add(self, parameter, help_text="", *, advanced=False):
        """Add a parameter with the words that explain it."""
        parameter.setHelp(help_text)
        if advanced:
            parameter.setFlags(parameter.flags() | QgsProcessingParameterDefinition.Flag.FlagAdvanced)
        self.addParameter(parameter)

    @classmethod
    def tr(cls, text):
        """`text` in the user's language."""
        return QCoreApplication.translate(cls.__name__, text)


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
                self.feedback.setProgressText(str(self.stage))
            self.feedback.setProgress(100.0 * float(message.get("share", 0.0)))
        elif kind == "warning":
            self.feedback.pushWarning(str(message.get("text", "")))
        else:
            self.feedback.pushInfo(str(message.get("text", message)))
