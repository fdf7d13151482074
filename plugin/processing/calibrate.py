# SPDX-License-Identifier: GPL-2.0-or-later
"""`furrowmap calibrate` as an algorithm."""

import json

from qgis.core import (
    QgsProcessingOutputBoolean,
    QgsProcessingOutputString,
    QgsProcessingParameterBoolean,
    QgsProcessingParameterFile,
)

from .base import ARGUMENT, VerbAlgorithm


class Calibrate(VerbAlgorithm):
    """The scanner's mounting and the clocks' offset."""

    ID, VERB = "calibrate", ("calibrate",)
    SESSION, WRITE = "SESSION", "WRITE"

    def displayName(self):  # noqa: N802 - the names are QGIS's
        """As the toolbox shows it."""
        return self.tr("Calibrate the mounting")

    def summary(self):
        """What it does."""
        return self.tr(
            "Estimates from the recording itself how the scanner is mounted and how its clock lies to that of the GNSS "
            "receiver: the ground is level on the mean of a session, and ground seen twice lies in one place."
        )

    def initAlgorithm(self, configuration=None):  # noqa: N802, ARG002
        """Its parameters and outputs."""
        self.add(
            QgsProcessingParameterFile(self.SESSION, self.tr("Session"), extension="toml"),
            ARGUMENT,
            self.tr("The session.toml beside the recording."),
        )
        self.add(
            QgsProcessingParameterBoolean(self.WRITE, self.tr("Write what was found into the session")),
            "--write",
            self.tr("Its other lines stay as they are."),
        )
        self.addOutput(QgsProcessingOutputString("FINDINGS", self.tr("Findings (JSON)")))
        self.addOutput(QgsProcessingOutputBoolean("WRITTEN", self.tr("Written into the session")))

    def outputs(self, answer, parameters, context):  # noqa: ARG002
        """Angles, height and offset, each with its sigma."""
        return {"FINDINGS": json.dumps(answer, ensure_ascii=False, indent=1), "WRITTEN": answer["written"]}
