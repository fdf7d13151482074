# SPDX-License-Identifier: GPL-2.0-or-later
"""`furrowmap cloud` as an algorithm."""

from qgis.core import (
    QgsProcessingOutputNumber,
    QgsProcessingParameterBoolean,
    QgsProcessingParameterEnum,
    QgsProcessingParameterFileDestination,
    QgsProcessingParameterNumber,
    QgsProcessingParameterString,
)

from .loading import load_when_done
from .shared import OPEN, TakesClouds, add_open, add_overwrite


class Cloud(TakesClouds):
    """One clean cloud of any clouds."""

    ID, VERB, GROUP = "cloud", ("cloud",), "surfaces"
    OUTPUT, DROP_NOISE, GROUND, VOXEL = "OUTPUT", "DROP_NOISE", "GROUND", "VOXEL"

    def displayName(self):  # noqa: N802 - the names are QGIS's
        """As the toolbox shows it."""
        return self.tr("Clean point clouds")

    def summary(self):
        """What it does."""
        return self.tr(
            "Makes one COPC file of LAS, LAZ or COPC clouds, from furrowmap or from anybody else: points that are "
            "alone are told as noise, the ground is told, and the cloud is thinned, as far as each is asked for. "
            "Memory does not grow with the land."
        )

    def initAlgorithm(self, configuration=None):  # noqa: N802, ARG002
        """Its parameters and outputs."""
        number, enum = QgsProcessingParameterNumber, QgsProcessingParameterEnum
        self.add_clouds(self.tr("LAS, LAZ or COPC files in one CRS."))
        self.add_outliers(self.tr("Points that are alone become noise"))
        self.add(
            QgsProcessingParameterBoolean(self.DROP_NOISE, self.tr("Leave noise out")),
            "--drop-noise",
            self.tr("Points of classes 7 and 18 of the clouds as well. Otherwise noise stays, as class 7."),
        )
        self.add(
            enum(
                self.GROUND,
                self.tr("Ground is told by"),
                ["none", "smrf", "csf"],
                defaultValue="none",
                usesStaticStrings=True,
            ),
            "--ground",
            self.tr("Ground becomes class 2, all but noise and the machine class 1. none: classes stay as they are."),
        )
        self.add(
            number(
                self.VOXEL,
                self.tr("One point in each cube of (m)"),
                number.Type.Double,
                None,
                optional=True,
                minValue=0.001,
                maxValue=10.0,
            ),
            "--voxel",
            self.tr("The one nearest to its middle. Left out: all points."),
        )
        self.add_extent()
        self.add(
            QgsProcessingParameterString(self.CLASSES, self.tr("Without classes"), optional=True),
            "--without-class",
            self.tr("Numbers with commas between them; 64,65 is the machine in furrowmap's own clouds."),
            advanced=True,
        )
        self.add_every()
        self.add_crs(self.tr("CRS of the clean cloud"))
        self.add(
            QgsProcessingParameterFileDestination(self.OUTPUT, self.tr("Clean cloud"), "COPC (*.copc.laz)"),
            "--output",
            self.tr("A COPC file, whose name ends in .copc.laz."),
        )
        add_overwrite(self, self.tr("Replace the file"))
        add_open(self)
        self.addOutput(QgsProcessingOutputNumber("POINTS", self.tr("Number of points")))

    def outputs(self, answer, parameters, context):
        """The file and the number of its points."""
        if self.parameterAsBool(parameters, OPEN, context):
            load_when_done(context, answer["output"], self.tr("Clean cloud"))
        return {self.OUTPUT: answer["output"], "POINTS": answer["figures"]["points"]}
