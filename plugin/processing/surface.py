# SPDX-License-Identifier: GPL-2.0-or-later
"""`furrowmap surface` as an algorithm."""

from pathlib import Path

from qgis.core import (
    QgsProcessingOutputFolder,
    QgsProcessingOutputRasterLayer,
    QgsProcessingParameterEnum,
    QgsProcessingParameterFolderDestination,
    QgsProcessingParameterNumber,
    QgsProcessingParameterString,
)

from .loading import load_when_done
from .shared import OPEN, TakesClouds, add_open, add_overwrite

RASTERS = ("dsm", "dtm", "height_above_ground", "hillshade", "slope", "roughness", "low_spots")
SHOWN = ("low_spots.gpkg", "dsm.tif", "dtm.tif", "height_above_ground.tif", "slope.tif", "roughness.tif")


class Surface(TakesClouds):
    """Surfaces of any cloud."""

    ID, VERB, GROUP = "surface", ("surface",), "surfaces"
    OUTPUT, CELL, STATISTIC = "OUTPUT", "CELL", "STATISTIC"
    GROUND, FILL, TILLAGE = "GROUND", "FILL", "TILLAGE"

    def displayName(self):  # noqa: N802 - the names are QGIS's
        """As the toolbox shows it."""
        return self.tr("Surfaces of point clouds")

    def summary(self):
        """What it does."""
        return self.tr(
            "Makes surfaces of LAS, LAZ or COPC clouds, from furrowmap or from anybody else: heights of all points "
            "(DSM) and of the ground (DTM), height above ground, hillshade, slope, roughness, and low spots that hold "
            "water. Memory does not grow with the land."
        )

    def initAlgorithm(self, configuration=None):  # noqa: N802, ARG002
        """Its parameters and outputs."""
        number, enum = QgsProcessingParameterNumber, QgsProcessingParameterEnum
        self.add_clouds(self.tr("LAS, LAZ or COPC files; together they lie on one grid."))
        self.add(
            number(self.CELL, self.tr("Cell (m)"), number.Type.Double, None, optional=True, minValue=0.001),
            "--cell",
            self.tr("Side of a cell. Left out: the least round one with four points in it."),
        )
        self.add(
            enum(
                self.GROUND,
                self.tr("Ground is told by"),
                ["auto", "class", "smrf", "csf", "none"],
                defaultValue="auto",
                usesStaticStrings=True,
            ),
            "--ground-method",
            self.tr("auto: by the clouds' own classes where they have them, else by the SMRF filter."),
        )
        self.add(
            number(self.FILL, self.tr("Fill gaps up to (m)"), number.Type.Double, 0.0, minValue=0.0),
            "--fill",
            self.tr("From heights seen around them; nothing is filled outside."),
        )
        self.add_extent()
        self.add(
            QgsProcessingParameterString(self.CLASSES, self.tr("Only classes"), optional=True),
            "--class",
            self.tr("Numbers with commas between them, such as 2,9. Left out: all but noise."),
            advanced=True,
        )
        self.add(
            QgsProcessingParameterString(self.STATISTIC, self.tr("Height of a cell"), defaultValue="median"),
            "--statistic",
            self.tr("median, trimmed, mean, min, max, or a percentile such as p90."),
            advanced=True,
        )
        self.add_outliers(self.tr("Leave out points that are alone"), advanced=True)
        self.add_every()
        self.add(
            number(self.TILLAGE, self.tr("Direction of tillage (°)"), number.Type.Double, None, optional=True),
            "--tillage",
            self.tr("Clockwise from grid north: random roughness is then told without the marks of the tool."),
            advanced=True,
        )
        self.add_crs(self.tr("CRS of the surfaces"))
        self.add(
            QgsProcessingParameterFolderDestination(self.OUTPUT, self.tr("Folder for the surfaces")),
            "--output",
            self.tr("Takes cloud-optimised GeoTIFFs and surfaces.json."),
        )
        add_overwrite(self, self.tr("Replace earlier surfaces"))
        add_open(self)
        self.addOutput(QgsProcessingOutputFolder("FOLDER", self.tr("Folder of the surfaces")))
        for name in RASTERS:
            self.addOutput(QgsProcessingOutputRasterLayer(name.upper(), name))

    def outputs(self, answer, parameters, context):
        """The folder and the rasters in it."""
        folder = Path(answer["folder"])
        written = [name for name in SHOWN if name in answer["products"]]
        if self.parameterAsBool(parameters, OPEN, context):
            for name in written:
                load_when_done(context, folder / name, folder.name)
        rasters = {name.upper(): str(folder / f"{name}.tif") for name in RASTERS if f"{name}.tif" in answer["products"]}
        return {"FOLDER": str(folder), self.OUTPUT: str(folder), **rasters}
