# SPDX-License-Identifier: GPL-2.0-or-later
"""`furrowmap run` as an algorithm."""

from pathlib import Path

from qgis.core import (
    QgsProcessingOutputFolder,
    QgsProcessingOutputNumber,
    QgsProcessingOutputString,
    QgsProcessingParameterBoolean,
    QgsProcessingParameterFile,
    QgsProcessingParameterFolderDestination,
)

from ..results import open_results
from .base import VerbAlgorithm

FIGURES = ("worked_area_m2", "overlap_area_m2", "missed_area_m2", "passes", "points")


class Run(VerbAlgorithm):
    """From a session to its products."""

    ID = "run"
    SESSION, OUTPUT, OVERWRITE, OPEN = "SESSION", "OUTPUT", "OVERWRITE", "OPEN"

    def displayName(self):  # noqa: N802 - the names are QGIS's
        """As the toolbox shows it."""
        return self.tr("Run a session")

    def shortHelpString(self):  # noqa: N802
        """What it does."""
        return self.tr(
            "Computes the georeferenced point cloud of the recording that a session describes, sees in the scans "
            "whether the implement was in the ground, and writes the ground worked, surfaces and a report."
        )

    def initAlgorithm(self, configuration=None):  # noqa: N802, ARG002
        """Its parameters and outputs."""
        self.add(
            QgsProcessingParameterFile(self.SESSION, self.tr("Session"), extension="toml"),
            self.tr("The session.toml beside the recording; 'Begin a session' writes one."),
        )
        self.add(
            QgsProcessingParameterFolderDestination(self.OUTPUT, self.tr("Folder for the products")),
            self.tr("Products of the same session in it are replaced."),
        )
        self.add(
            QgsProcessingParameterBoolean(
                self.OVERWRITE, self.tr("Replace products of another session"), defaultValue=False
            ),
            advanced=True,
        )
        self.add(
            QgsProcessingParameterBoolean(self.OPEN, self.tr("Open the products, styled"), defaultValue=True),
        )
        self.addOutput(QgsProcessingOutputFolder("FOLDER", self.tr("Folder of the products")))
        self.addOutput(QgsProcessingOutputString("REPORT", self.tr("Report to read (HTML)")))
        for name in FIGURES:
            self.addOutput(QgsProcessingOutputNumber(name.upper(), name))

    def arguments(self, parameters, context):
        """`run SESSION -o FOLDER`."""
        self.folder = self.parameterAsString(parameters, self.OUTPUT, context)
        overwrite = ["--overwrite"] if self.parameterAsBool(parameters, self.OVERWRITE, context) else []
        self.opened = self.parameterAsBool(parameters, self.OPEN, context)
        return ["run", self.parameterAsFile(parameters, self.SESSION, context), "-o", self.folder, *overwrite]

    def outputs(self, answer, parameters, context):  # noqa: ARG002
        """The folder, the report and the figures."""
        figures = answer.get("figures", {})
        return {
            "FOLDER": self.folder,
            self.OUTPUT: self.folder,
            "REPORT": str(Path(self.folder) / "report.html"),
            **{name.upper(): figures.get(name) for name in FIGURES},
        }

    def postProcessAlgorithm(self, context, feedback):  # noqa: N802
        """Open the products, in the main thread."""
        folder = getattr(self, "folder", None)
        if folder and getattr(self, "opened", False) and not feedback.isCanceled() and context.project() is not None:
            open_results(folder, context.project())
        return {}
