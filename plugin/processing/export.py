# SPDX-License-Identifier: GPL-2.0-or-later
"""`furrowmap export` as an algorithm."""

from qgis.core import (
    QgsProcessingOutputMultipleLayers,
    QgsProcessingOutputString,
    QgsProcessingParameterCrs,
    QgsProcessingParameterEnum,
    QgsProcessingParameterFileDestination,
)

from .shared import TakesResults, add_overwrite

FORMATS = ("gpkg", "geoparquet", "flatgeobuf", "geojson", "shapefile", "kml", "csv", "isoxml", "stac")
LAYERS = ("trajectory", "passes", "coverage", "overlaps", "misses", "zones", "tool_path", "events")


class Export(TakesResults):
    """Results in the format of another program."""

    ID, VERB, GROUP = "export", ("export",), "exchange"
    FORMAT, TARGET, LAYERS, DST_CRS = "FORMAT", "TARGET", "LAYERS", "DST_CRS"

    def displayName(self):  # noqa: N802 - the names are QGIS's
        """As the toolbox shows it."""
        return self.tr("Pass results on")

    def summary(self):
        """What it does."""
        return self.tr(
            "Writes the result of a run in the format of another program: GeoPackage, GeoParquet, FlatGeobuf, GeoJSON, "
            "Shapefile, KML, CSV, ISO 11783-10 task data for farm software and terminals, or a STAC catalogue over "
            "many runs. GeoJSON and KML are always in WGS 84."
        )

    def initAlgorithm(self, configuration=None):  # noqa: N802, ARG002
        """Its parameters and outputs."""
        self.add_results()
        self.add(
            QgsProcessingParameterEnum(
                self.FORMAT, self.tr("Format"), FORMATS, defaultValue="gpkg", usesStaticStrings=True
            ),
            "--to",
            self.tr("isoxml is task data as a folder, or a .zip if the target ends so; stac takes many results."),
        )
        self.add(
            QgsProcessingParameterEnum(
                self.LAYERS, self.tr("Only layers"), LAYERS, allowMultiple=True, optional=True, usesStaticStrings=True
            ),
            "--layer",
            self.tr("Left out: all that the result has."),
            advanced=True,
        )
        self.add(
            QgsProcessingParameterCrs(self.DST_CRS, self.tr("CRS of the vectors"), optional=True),
            "--dst-crs",
            self.tr("Left out: that of the session."),
            advanced=True,
        )
        self.add(
            QgsProcessingParameterFileDestination(
                self.TARGET, self.tr("File or folder to write"), optional=True, createByDefault=False
            ),
            "--output",
            self.tr("Left out: beside the result. Formats that hold one layer a file give a folder."),
        )
        add_overwrite(self, self.tr("Replace what is there"))
        self.addOutput(QgsProcessingOutputString("WRITTEN", self.tr("File or folder written")))
        self.addOutput(QgsProcessingOutputMultipleLayers("FILES", self.tr("Files written")))

    def outputs(self, answer, parameters, context):  # noqa: ARG002
        """What was written."""
        return {"WRITTEN": answer["target"], "FILES": answer["files"]}
