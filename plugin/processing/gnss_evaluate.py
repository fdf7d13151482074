# SPDX-License-Identifier: GPL-2.0-or-later
"""`furrowmap gnss evaluate` as an algorithm."""

import json
from pathlib import Path

from qgis.core import (
    QgsProcessingOutputString,
    QgsProcessingParameterEnum,
    QgsProcessingParameterFile,
    QgsProcessingParameterFolderDestination,
    QgsProcessingParameterNumber,
    QgsProcessingParameterString,
)

from .base import ARGUMENT, VerbAlgorithm
from .shared import add_overwrite

COORDINATES = 3


class GnssEvaluate(VerbAlgorithm):
    """A GNSS log against a reference."""

    ID, VERB, GROUP = "gnss_evaluate", ("gnss", "evaluate"), "accuracy"
    TEST, REFERENCE, POINT, OFFSET = "TEST", "REFERENCE", "POINT", "OFFSET"
    REFERENCE_FIX, MAX_GAP, DATE, OUTPUT = "REFERENCE_FIX", "MAX_GAP", "DATE", "OUTPUT"

    def displayName(self):  # noqa: N802 - the names are QGIS's
        """As the toolbox shows it."""
        return self.tr("Evaluate a GNSS log")

    def summary(self):
        """What it does."""
        return self.tr(
            "Compares the positions in a GNSS log with those of a reference at the same instants: average, standard "
            "deviation and RMSE in 3D, 2D, X, Y and Z, of all epochs and by kind of fix."
        )

    def initAlgorithm(self, configuration=None):  # noqa: N802, ARG002
        """Its parameters and outputs."""
        self.add(
            QgsProcessingParameterFile(self.TEST, self.tr("Log to evaluate")),
            ARGUMENT,
            self.tr("NMEA, or another log that 'Inspect recordings' knows."),
        )
        self.add(
            QgsProcessingParameterFile(self.REFERENCE, self.tr("Reference"), optional=True),
            ARGUMENT,
            self.tr("Another log of the same drive, or a trajectory."),
        )
        self.add(
            QgsProcessingParameterString(self.POINT, self.tr("Or a known point"), optional=True),
            ARGUMENT,
            self.tr("Of an antenna at rest: latitude, longitude, height, with commas between them."),
        )
        self.add(
            QgsProcessingParameterString(self.OFFSET, self.tr("Antenna offset (m)"), defaultValue="0,0,0"),
            "--antenna-offset",
            self.tr("Forward, left, up: from the reference's antenna to that of the log, on one vehicle."),
            advanced=True,
        )
        self.add(
            QgsProcessingParameterEnum(
                self.REFERENCE_FIX,
                self.tr("Epochs of the reference"),
                ["any", "fixed"],
                defaultValue="any",
                usesStaticStrings=True,
            ),
            "--reference-fix",
            self.tr("fixed: leave out those at which the reference is not fixed."),
            advanced=True,
        )
        self.add(
            QgsProcessingParameterNumber(
                self.MAX_GAP,
                self.tr("Interpolate across at most (s)"),
                QgsProcessingParameterNumber.Type.Double,
                None,
                optional=True,
                minValue=0.001,
            ),
            "--max-gap",
            self.tr("Steps of the reference. Left out: 1.5 of its intervals."),
            advanced=True,
        )
        self.add(
            QgsProcessingParameterString(self.DATE, self.tr("Date of the first position"), optional=True),
            "--date",
            self.tr("UTC, as YYYY-MM-DD, for logs without dates."),
            advanced=True,
        )
        self.add(
            QgsProcessingParameterFolderDestination(
                self.OUTPUT, self.tr("Folder for the evaluation"), optional=True, createByDefault=False
            ),
            "--output",
            self.tr("Takes evaluation.json, a page to read, and a table of the epochs."),
        )
        add_overwrite(self, self.tr("Replace an earlier evaluation"))
        self.addOutput(QgsProcessingOutputString("FINDINGS", self.tr("Findings (JSON)")))
        self.addOutput(QgsProcessingOutputString("PAGE", self.tr("Page to read (HTML)")))

    def fault(self, parameters, context):
        """One reference is needed; a point has three coordinates."""
        point = self.parameterAsString(parameters, self.POINT, context)
        if bool(point) == bool(self.parameterAsFile(parameters, self.REFERENCE, context)):
            return self.tr("Choose either a file as the reference, or a known point.")
        if point and len(point.split(",")) != COORDINATES:
            return self.tr("Or a known point: {text} is not latitude, longitude, height.").format(text=point)
        return ""

    def outputs(self, answer, parameters, context):  # noqa: ARG002
        """The figures, and where the page lies."""
        folder = answer.get("output")
        page = str(Path(folder) / "evaluation.html") if folder else ""
        return {"FINDINGS": json.dumps(answer, ensure_ascii=False, indent=1), "PAGE": page, self.OUTPUT: folder}
