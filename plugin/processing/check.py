# SPDX-License-Identifier: GPL-2.0-or-later
"""`furrowmap check` as an algorithm."""

import json

from qgis.core import (
    QgsProcessingOutputBoolean,
    QgsProcessingOutputNumber,
    QgsProcessingOutputString,
    QgsProcessingParameterCrs,
    QgsProcessingParameterEnum,
    QgsProcessingParameterFile,
    QgsProcessingParameterFileDestination,
    QgsProcessingParameterNumber,
)

from .base import ARGUMENT, VerbAlgorithm
from .shared import add_overwrite

FIGURES = ("rmse_vertical_m", "rmse_horizontal_m", "rmse_3d_m")


class Check(VerbAlgorithm):
    """A cloud or a surface against surveyed points."""

    ID, VERB, GROUP = "check", ("check",), "accuracy"
    PRODUCT, POINTS, CRS, SIGMA, TARGETS, DIAMETER = "PRODUCT", "POINTS", "CRS", "SIGMA", "TARGETS", "DIAMETER"
    VERTICAL, HORIZONTAL, TABLE = "VERTICAL", "HORIZONTAL", "TABLE"

    def displayName(self):  # noqa: N802 - the names are QGIS's
        """As the toolbox shows it."""
        return self.tr("Check with surveyed points")

    def summary(self):
        """What it does."""
        return self.tr(
            "Compares a cloud or a surface with surveyed points. RMSE after the ASPRS Positional Accuracy Standards, "
            "Edition 2 (2023), with the points' own accuracy included."
        )

    def initAlgorithm(self, configuration=None):  # noqa: N802, ARG002
        """Its parameters and outputs."""
        self.add(
            QgsProcessingParameterFile(self.PRODUCT, self.tr("Cloud or surface")),
            ARGUMENT,
            self.tr("LAS, LAZ, COPC or GeoTIFF."),
        )
        self.add(
            QgsProcessingParameterFile(self.POINTS, self.tr("Surveyed points")),
            ARGUMENT,
            self.tr("CSV or GeoPackage."),
        )
        self._add_metres(self.SIGMA, self.tr("Accuracy of the survey (m)"), "--points-sigma")
        self._add_metres(self.VERTICAL, self.tr("Required vertical RMSE (m)"), "--require-vertical")
        self._add_metres(self.HORIZONTAL, self.tr("Required horizontal RMSE (m)"), "--require-horizontal")
        self.add(
            QgsProcessingParameterCrs(self.CRS, self.tr("CRS of the points"), optional=True),
            "--crs",
            self.tr("Where their file states none. Left out: that of the product."),
            advanced=True,
        )
        self.add(
            QgsProcessingParameterEnum(
                self.TARGETS,
                self.tr("Discs around the points"),
                ["none", "intensity", "colour"],
                defaultValue="none",
                usesStaticStrings=True,
            ),
            "--targets",
            self.tr("Looked for by this, for the horizontal error."),
            advanced=True,
        )
        self.add(
            QgsProcessingParameterNumber(
                self.DIAMETER,
                self.tr("Diameter of the discs (m)"),
                QgsProcessingParameterNumber.Type.Double,
                0.3,
                minValue=0.001,
            ),
            "--diameter",
            self.tr("Used only where discs are looked for."),
            advanced=True,
        )
        self.add(
            QgsProcessingParameterFileDestination(
                self.TABLE, self.tr("Table of the points"), "CSV (*.csv)", optional=True, createByDefault=False
            ),
            "--table",
            self.tr("A row for each point, with its errors."),
        )
        add_overwrite(self, self.tr("Replace the file"))
        self.addOutput(QgsProcessingOutputString("FINDINGS", self.tr("Findings (JSON)")))
        self.addOutput(QgsProcessingOutputBoolean("MET", self.tr("Meets what is required")))
        for name in FIGURES:
            self.addOutput(QgsProcessingOutputNumber(name.upper(), name))

    def _add_metres(self, name, title, option):
        kind = QgsProcessingParameterNumber.Type.Double
        parameter = QgsProcessingParameterNumber(name, title, kind, None, optional=True, minValue=0.0001)
        self.add(parameter, option, self.tr("Left out: not known, or not required."))

    def outputs(self, answer, parameters, context):
        """The figures, and whether they meet what is required."""
        accuracy = answer["accuracy"]
        return {
            "FINDINGS": json.dumps(answer, ensure_ascii=False, indent=1),
            "MET": all(verdict["met"] for verdict in answer["verdicts"].values()),
            self.TABLE: self.parameterAsFileOutput(parameters, self.TABLE, context),
            **{name.upper(): accuracy.get(name) for name in FIGURES},
        }
