# SPDX-License-Identifier: GPL-2.0-or-later
"""`furrowmap farm mosaic` as an algorithm."""

from qgis.core import (
    QgsProcessingOutputNumber,
    QgsProcessingParameterBoolean,
    QgsProcessingParameterCrs,
    QgsProcessingParameterEnum,
    QgsProcessingParameterNumber,
    QgsProcessingParameterRasterDestination,
)

from .shared import TakesBase, add_overwrite

PRODUCTS = ("dsm", "dsm_before", "change")


class BaseMosaic(TakesBase):
    """The surfaces of a base map's sessions in one raster."""

    ID, VERB = "base_mosaic", ("farm", "mosaic")
    PRODUCT, DST_CRS, CELL, MEAN, OUTPUT = "PRODUCT", "DST_CRS", "CELL", "MEAN", "OUTPUT"

    def displayName(self):  # noqa: N802 - the names are QGIS's
        """As the toolbox shows it."""
        return self.tr("Mosaic of the base map's surfaces")

    def summary(self):
        """What it does."""
        return self.tr(
            "Puts the surfaces of the sessions in a base map into one raster. The latest session wins where they "
            "overlap. A .vrt is a small file that refers to the surfaces where they lie; a .tif is a cloud-optimised "
            "GeoTIFF with all their bands."
        )

    def initAlgorithm(self, configuration=None):  # noqa: N802, ARG002
        """Its parameters and outputs."""
        self.add_base()
        self.add(
            QgsProcessingParameterEnum(
                self.PRODUCT, self.tr("Surface"), PRODUCTS, defaultValue="dsm", usesStaticStrings=True
            ),
            "--product",
            self.tr("dsm: as left; dsm_before: before the tool came; change: the difference."),
        )
        self.add(
            QgsProcessingParameterCrs(self.DST_CRS, self.tr("CRS of the raster"), optional=True),
            "--dst-crs",
            self.tr("Left out: that of the surfaces."),
            advanced=True,
        )
        self.add(
            QgsProcessingParameterNumber(
                self.CELL,
                self.tr("Cell (m)"),
                QgsProcessingParameterNumber.Type.Double,
                None,
                optional=True,
                minValue=0.001,
            ),
            "--cell",
            self.tr("Left out: that of the surfaces."),
            advanced=True,
        )
        self.add(
            QgsProcessingParameterBoolean(self.MEAN, self.tr("Mean of all sessions")),
            "--mean",
            self.tr("Instead of the cells of the latest session."),
            advanced=True,
        )
        self.add(
            QgsProcessingParameterRasterDestination(self.OUTPUT, self.tr("Mosaic")),
            "--output",
            self.tr("A .tif or a .vrt."),
        )
        add_overwrite(self, self.tr("Replace the file"))
        self.addOutput(QgsProcessingOutputNumber("SURFACES", self.tr("Number of surfaces")))

    def outputs(self, answer, parameters, context):
        """The raster."""
        path = self.parameterAsOutputLayer(parameters, self.OUTPUT, context)
        return {self.OUTPUT: path, "SURFACES": answer["surfaces"]}
