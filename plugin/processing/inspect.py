# SPDX-License-Identifier: GPL-2.0-or-later
"""`furrowmap inspect` as an algorithm."""

import json

from qgis.core import QgsProcessing, QgsProcessingOutputString, QgsProcessingParameterMultipleLayers

from .base import ARGUMENT, VerbAlgorithm


class Inspect(VerbAlgorithm):
    """What files are and hold."""

    ID, VERB = "inspect", ("inspect",)
    FILES = "FILES"

    def displayName(self):  # noqa: N802 - the names are QGIS's
        """As the toolbox shows it."""
        return self.tr("Inspect recordings")

    def summary(self):
        """What it does."""
        return self.tr("Says what recordings are and hold: model, points, span, clocks and how they disagree, fixes.")

    def initAlgorithm(self, configuration=None):  # noqa: N802, ARG002
        """Its parameters and outputs."""
        self.add(
            QgsProcessingParameterMultipleLayers(self.FILES, self.tr("Recordings"), QgsProcessing.SourceType.TypeFile),
            ARGUMENT,
            self.tr("Captures, bags, GNSS logs, trajectories, clouds."),
        )
        self.addOutput(QgsProcessingOutputString("FINDINGS", self.tr("Findings (JSON)")))

    def outputs(self, answer, parameters, context):  # noqa: ARG002
        """The findings as text; a file that could not be read has its error among them."""
        return {"FINDINGS": json.dumps(answer, ensure_ascii=False, indent=1)}
