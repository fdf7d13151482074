# SPDX-License-Identifier: GPL-2.0-or-later
"""`furrowmap simulate` as an algorithm."""

from qgis.core import (
    QgsProcessingOutputFile,
    QgsProcessingOutputFolder,
    QgsProcessingParameterFile,
    QgsProcessingParameterFolderDestination,
)

from .base import ARGUMENT, VerbAlgorithm
from .shared import add_overwrite


class Simulate(VerbAlgorithm):
    """A recording with its truth."""

    ID, VERB = "simulate", ("simulate",)
    SCENARIO, OUTPUT = "SCENARIO", "OUTPUT"

    def displayName(self):  # noqa: N802 - the names are QGIS's
        """As the toolbox shows it."""
        return self.tr("Simulate a recording")

    def summary(self):
        """What it does."""
        return self.tr(
            "Writes what a tractor's recorder would have written: the LiDAR's packets, the GNSS log, a session and the "
            "field's boundary, with the truth beside them. To learn with, and to choose where a sensor goes."
        )

    def initAlgorithm(self, configuration=None):  # noqa: N802, ARG002
        """Its parameters and outputs."""
        self.add(
            QgsProcessingParameterFile(self.SCENARIO, self.tr("Scenario"), extension="toml", optional=True),
            ARGUMENT,
            self.tr("Field, drive and sensors. Left out: a small field that is tilled for a minute."),
        )
        self.add(
            QgsProcessingParameterFolderDestination(self.OUTPUT, self.tr("Folder for the recording")),
            "--output",
            self.tr("Takes recording, session and truth."),
        )
        add_overwrite(self, self.tr("Replace what is in the folder"))
        self.addOutput(QgsProcessingOutputFolder("FOLDER", self.tr("Folder of the recording")))
        self.addOutput(QgsProcessingOutputFile("SESSION", self.tr("Session file")))

    def words(self, definition, parameters, context):
        """The scenario "demo" where none is given."""
        words = super().words(definition, parameters, context)
        return ["demo"] if definition.name() == self.SCENARIO and not words else words

    def outputs(self, answer, parameters, context):  # noqa: ARG002
        """Where everything lies."""
        return {"FOLDER": answer["folder"], self.OUTPUT: answer["folder"], "SESSION": answer["session"]}
