# SPDX-License-Identifier: GPL-2.0-or-later
"""`furrowmap init` as an algorithm."""

from qgis.core import (
    QgsProcessing,
    QgsProcessingOutputFile,
    QgsProcessingOutputString,
    QgsProcessingParameterFileDestination,
    QgsProcessingParameterMultipleLayers,
)

from .base import ARGUMENT, VerbAlgorithm
from .shared import add_overwrite


class Init(VerbAlgorithm):
    """From recordings to a session file."""

    ID, VERB = "init", ("init",)
    RECORDINGS, OUTPUT = "RECORDINGS", "OUTPUT"

    def displayName(self):  # noqa: N802 - the names are QGIS's
        """As the toolbox shows it."""
        return self.tr("Begin a session")

    def summary(self):
        """What it does."""
        return self.tr(
            "Looks at recordings and writes a commented session.toml with what it could find out. What the recordings "
            "do not say, such as how the sensor is mounted, stands in it as a comment, and is told."
        )

    def initAlgorithm(self, configuration=None):  # noqa: N802, ARG002
        """Its parameters and outputs."""
        self.add(
            QgsProcessingParameterMultipleLayers(
                self.RECORDINGS, self.tr("Recordings"), QgsProcessing.SourceType.TypeFile
            ),
            ARGUMENT,
            self.tr("LiDAR captures or bags, GNSS logs, trajectories of one drive."),
        )
        self.add(
            QgsProcessingParameterFileDestination(
                self.OUTPUT, self.tr("Session file"), "TOML (*.toml)", optional=True, createByDefault=False
            ),
            "--output",
            self.tr("Left out: session.toml beside the recordings."),
        )
        add_overwrite(self, self.tr("Replace a session file that is there"))
        self.addOutput(QgsProcessingOutputFile("SESSION", self.tr("Session file")))
        self.addOutput(QgsProcessingOutputString("FOUND", self.tr("Found out")))
        self.addOutput(QgsProcessingOutputString("MISSING", self.tr("Not known from the recordings")))

    def outputs(self, answer, parameters, context):  # noqa: ARG002
        """The file, what was found out, and what only the user knows."""
        lines = {key: "\n".join(notice["text"] for notice in answer[key]) for key in ("found", "missing")}
        return {"SESSION": answer["session"], "FOUND": lines["found"], "MISSING": lines["missing"]}
