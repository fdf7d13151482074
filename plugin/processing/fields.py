# SPDX-License-Identifier: GPL-2.0-or-later
"""`furrowmap fields` as an algorithm."""

import json
from pathlib import Path

from qgis.core import (
    QgsProcessingOutputNumber,
    QgsProcessingOutputString,
    QgsProcessingParameterCrs,
    QgsProcessingParameterFile,
    QgsProcessingParameterFileDestination,
    QgsProcessingParameterNumber,
    QgsProcessingParameterString,
)

from .base import ARGUMENT, VerbAlgorithm
from .loading import load_when_done
from .shared import OPEN, add_open, add_overwrite


class Fields(VerbAlgorithm):
    """What a machine worked, from its own log."""

    ID, VERB, GROUP = "fields", ("fields",), "exchange"
    TASKDATA, OUTPUT, WIDTH, TASK, CRS = "TASKDATA", "OUTPUT", "WIDTH", "TASK", "CRS"

    def displayName(self):  # noqa: N802 - the names are QGIS's
        """As the toolbox shows it."""
        return self.tr("Worked ground from task data (ISOXML)")

    def summary(self):
        """What it does."""
        return self.tr(
            "Computes what a machine worked in each field from its own log, ISO 11783-10 task data, without a scanner: "
            "passes, overlaps, strips missed and their areas."
        )

    def initAlgorithm(self, configuration=None):  # noqa: N802, ARG002
        """Its parameters and outputs."""
        self.add(
            QgsProcessingParameterFile(self.TASKDATA, self.tr("Task data")),
            ARGUMENT,
            self.tr("TASKDATA.XML in its folder, or a .zip of the folder."),
        )
        self.add(
            QgsProcessingParameterNumber(
                self.WIDTH, self.tr("Working width (m)"), QgsProcessingParameterNumber.Type.Double, None, optional=True
            ),
            "--width",
            self.tr("Left out: the widest that the logs show."),
        )
        self.add(
            QgsProcessingParameterString(self.TASK, self.tr("Only the task"), optional=True),
            "--task",
            self.tr("Its id or name."),
            advanced=True,
        )
        self.add(
            QgsProcessingParameterCrs(self.CRS, self.tr("CRS of the map"), optional=True),
            "--crs",
            self.tr("Left out: one that fits the place."),
            advanced=True,
        )
        self.add(
            QgsProcessingParameterFileDestination(self.OUTPUT, self.tr("Worked ground"), "GeoPackage (*.gpkg)"),
            "--output",
            self.tr("Takes passes, overlaps and misses of all fields."),
        )
        add_overwrite(self, self.tr("Replace the file"))
        add_open(self)
        self.addOutput(QgsProcessingOutputString("FIELDS", self.tr("Figures by field (JSON)")))
        self.addOutput(QgsProcessingOutputNumber("WORKED_AREA_M2", "worked_area_m2"))

    def words(self, definition, parameters, context):
        """The folder of TASKDATA.XML instead of the file."""
        words = super().words(definition, parameters, context)
        if definition.name() != self.TASKDATA:
            return words
        return [str(Path(word).parent) if word.lower().endswith(".xml") else word for word in words]

    def outputs(self, answer, parameters, context):
        """The file and the figures."""
        if self.parameterAsBool(parameters, OPEN, context):
            load_when_done(context, answer["output"], self.tr("Worked ground"))
        worked = [field["worked_area_m2"] for field in answer["fields"] if field["worked_area_m2"] is not None]
        return {
            self.OUTPUT: answer["output"],
            "FIELDS": json.dumps(answer["fields"], ensure_ascii=False, indent=1),
            "WORKED_AREA_M2": sum(worked),
        }
