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

from ..previews import open_preview
from ..results import open_results
from .base import ARGUMENT, VerbAlgorithm
from .shared import OPEN, add_open, add_overwrite

FIGURES = ("worked_area_m2", "overlap_area_m2", "missed_area_m2", "passes", "points")


class Run(VerbAlgorithm):
    """From a session to its products."""

    ID, VERB = "run", ("run",)
    SESSION, PREVIEW, OUTPUT = "SESSION", "PREVIEW", "OUTPUT"

    def displayName(self):  # noqa: N802 - the names are QGIS's
        """As the toolbox shows it."""
        return self.tr("Run a session")

    def summary(self):
        """What it does."""
        return self.tr(
            "Computes the georeferenced point cloud of the recording that a session describes, sees in the scans "
            "whether the implement was in the ground, and writes the ground worked, surfaces and a report."
        )

    def initAlgorithm(self, configuration=None):  # noqa: N802, ARG002
        """Its parameters and outputs."""
        self.add(
            QgsProcessingParameterFile(self.SESSION, self.tr("Session"), extension="toml"),
            ARGUMENT,
            self.tr("The session.toml beside the recording; 'Begin a session' writes one."),
        )
        self.add(
            QgsProcessingParameterBoolean(self.PREVIEW, self.tr("Only a preview"), defaultValue=False),
            "--preview",
            self.tr(
                "In seconds: the track and a coarse surface of few scans, neither matched nor searched for the "
                "implement. Products of a run stay as they are."
            ),
        )
        self.add(
            QgsProcessingParameterFolderDestination(self.OUTPUT, self.tr("Folder for the products")),
            "--output",
            self.tr("Products of the same session in it are replaced."),
        )
        add_overwrite(self, self.tr("Replace products of another session"))
        add_open(self)
        self.addOutput(QgsProcessingOutputFolder("FOLDER", self.tr("Folder of the products")))
        self.addOutput(QgsProcessingOutputString("REPORT", self.tr("Report to read (HTML)")))
        for name in FIGURES:
            self.addOutput(QgsProcessingOutputNumber(name.upper(), name))

    def outputs(self, answer, parameters, context):
        """The folder, the report and the figures; a preview has no report and no ground worked."""
        self.folder = answer["folder"]
        self.previewed = self.parameterAsBool(parameters, self.PREVIEW, context)
        self.opened = self.parameterAsBool(parameters, OPEN, context)
        figures = answer.get("figures", {})
        return {
            "FOLDER": self.folder,
            self.OUTPUT: self.folder,
            "REPORT": "" if self.previewed else str(Path(self.folder) / "report.html"),
            **{name.upper(): figures.get(name) for name in FIGURES},
        }

    def postProcessAlgorithm(self, context, feedback):  # noqa: N802
        """Open the products, in the main thread."""
        folder = getattr(self, "folder", None)
        if folder and self.opened and not feedback.isCanceled() and context.project() is not None:
            (open_preview if self.previewed else open_results)(folder, context.project())
        return {}
