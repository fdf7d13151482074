# SPDX-License-Identifier: GPL-2.0-or-later
"""`furrowmap crs` as an algorithm."""

import json

from qgis.core import QgsProcessingOutputString, QgsProcessingParameterFile

from .base import ARGUMENT, VerbAlgorithm


class Crs(VerbAlgorithm):
    """What will happen to a session's coordinates."""

    ID, VERB, GROUP = "crs", ("crs",), "accuracy"
    SESSION = "SESSION"

    def displayName(self):  # noqa: N802 - the names are QGIS's
        """As the toolbox shows it."""
        return self.tr("Coordinates of a session")

    def summary(self):
        """What it does."""
        return self.tr(
            "Says what a run will do to a session's coordinates, with figures at the site: frame and epoch, how far "
            "positions are moved, the geoid's height, grid convergence and scale. Nothing is written."
        )

    def initAlgorithm(self, configuration=None):  # noqa: N802, ARG002
        """Its parameters and outputs."""
        self.add(
            QgsProcessingParameterFile(self.SESSION, self.tr("Session"), extension="toml"),
            ARGUMENT,
            self.tr("The session.toml beside the recording."),
        )
        self.addOutput(QgsProcessingOutputString("FINDINGS", self.tr("Findings (JSON)")))

    def outputs(self, answer, parameters, context):  # noqa: ARG002
        """The figures as text."""
        return {"FINDINGS": json.dumps(answer, ensure_ascii=False, indent=1)}
