# SPDX-License-Identifier: GPL-2.0-or-later
"""Parameters that several algorithms have: results of runs, clouds, a base map, whether to replace or to open."""

from pathlib import Path

from qgis.core import (
    QgsProcessing,
    QgsProcessingParameterBoolean,
    QgsProcessingParameterCrs,
    QgsProcessingParameterEnum,
    QgsProcessingParameterExtent,
    QgsProcessingParameterFile,
    QgsProcessingParameterMultipleLayers,
    QgsProcessingParameterNumber,
    QgsProcessingParameterString,
)

from .base import ARGUMENT, VerbAlgorithm, crs_words

RESULTS, BASE, DATABASE, DB_SCHEMA = "RESULTS", "BASE", "DATABASE", "SCHEMA"
OVERWRITE, OPEN = "OVERWRITE", "OPEN"


class TakesResults(VerbAlgorithm):
    """Takes the folders of runs, each told by itself or by a file in it, for QGIS's dialog lists only files."""

    def add_results(self):
        """Add the parameter."""
        self.add(
            QgsProcessingParameterMultipleLayers(
                RESULTS, self.tr("Results of runs"), QgsProcessing.SourceType.TypeFile
            ),
            ARGUMENT,
            self.tr("The report.json of each run, which stands for its folder."),
        )

    def words(self, definition, parameters, context):
        """Folders instead of files in them, each once."""
        words = super().words(definition, parameters, context)
        if definition.name() != RESULTS:
            return words
        return list(dict.fromkeys(str(Path(word).parent if Path(word).is_file() else word) for word in words))


class TakesClouds(VerbAlgorithm):
    """Takes clouds: which of their points, only within a box where one is given, and from which CRS into which."""

    CLOUDS, EXTENT, CLASSES, OUTLIERS = "CLOUDS", "EXTENT", "CLASSES", "OUTLIERS"
    EVERY, CRS, DST_CRS = "EVERY", "CRS", "DST_CRS"

    def add_clouds(self, text):
        """Add the parameter."""
        self.add(
            QgsProcessingParameterMultipleLayers(self.CLOUDS, self.tr("Clouds"), QgsProcessing.SourceType.TypeFile),
            ARGUMENT,
            text,
        )

    def add_extent(self):
        """Add the box."""
        self.add(
            QgsProcessingParameterExtent(self.EXTENT, self.tr("Only within"), optional=True),
            "--bbox",
            self.tr("A box, from a layer, the map, or by coordinates."),
            advanced=True,
        )

    def add_outliers(self, label, *, advanced=False):
        """Add how points that are alone are told; the label says what becomes of them."""
        self.add(
            QgsProcessingParameterEnum(
                self.OUTLIERS,
                label,
                ["none", "radius", "statistical"],
                defaultValue="none",
                usesStaticStrings=True,
            ),
            "--outliers",
            self.tr("How they are told: by their number in a radius, or by their distance to the next ones."),
            advanced=advanced,
        )

    def add_every(self):
        """Add the share of points that is taken."""
        number = QgsProcessingParameterNumber
        self.add(
            number(self.EVERY, self.tr("Take every n-th point"), number.Type.Integer, 1, minValue=1),
            "--every",
            self.tr("More than 1 for a quick look."),
            advanced=True,
        )

    def add_crs(self, dst_label):
        """Add the CRS of clouds that state none, and that of the product, which the label names."""
        self.add(
            QgsProcessingParameterCrs(self.CRS, self.tr("CRS of clouds that state none"), optional=True),
            "--crs",
            self.tr("Clouds that state theirs keep it."),
            advanced=True,
        )
        self.add(
            QgsProcessingParameterCrs(self.DST_CRS, dst_label, optional=True),
            "--dst-crs",
            self.tr("In metres. Left out: that of the clouds."),
            advanced=True,
        )

    def fault(self, parameters, context):
        """Classes are numbers."""
        classes = self.parameterAsString(parameters, self.CLASSES, context)
        if classes and not all(part.strip().isdigit() for part in classes.split(",")):
            return self.tr("Classes: {text} are not numbers with commas between them.").format(text=classes)
        return ""

    def words(self, definition, parameters, context):
        """The box by its four coordinates."""
        if definition.name() != self.EXTENT:
            return super().words(definition, parameters, context)
        box = self.parameterAsExtent(parameters, self.EXTENT, context)
        sides = (box.xMinimum(), box.yMinimum(), box.xMaximum(), box.yMaximum())
        return [] if box.isNull() else [",".join(f"{side:.9f}" for side in sides)]

    def arguments(self, parameters, context):
        """With the box its CRS, which QGIS may tell together with it."""
        verb, *rest = super().arguments(parameters, context)
        crs = self.parameterAsExtentCrs(parameters, self.EXTENT, context)
        stated = not self.parameterAsExtent(parameters, self.EXTENT, context).isNull() and crs.isValid()
        return [verb, *([f"--bbox-crs={crs_words(crs)}"] if stated else []), *rest]


class TakesBase(VerbAlgorithm):
    """Takes a base map: a GeoPackage, or the address of a PostGIS database."""

    GROUP = "base"

    def add_base(self, parameter=None):
        """Add the parameters; `parameter` is that of the GeoPackage, which is read by default."""
        self.add(
            parameter
            or QgsProcessingParameterFile(BASE, self.tr("Base map (GeoPackage)"), extension="gpkg", optional=True),
            ARGUMENT,
            self.tr("The farm's GeoPackage."),
        )
        self.add(
            QgsProcessingParameterString(DATABASE, self.tr("Base map in PostGIS instead"), optional=True),
            ARGUMENT,
            self.tr("An address such as postgresql://me@server/farm. Passwords belong into PostgreSQL's own files."),
            advanced=True,
        )
        self.add(
            QgsProcessingParameterString(DB_SCHEMA, self.tr("Schema in PostGIS"), defaultValue="furrowmap"),
            "--schema",
            self.tr("Where the tables lie in the database."),
            advanced=True,
        )

    def fault(self, parameters, context):  # noqa: ARG002 - the base class's signature
        """Exactly one base is needed."""
        given = [name for name in (BASE, DATABASE) if parameters.get(name) not in (None, "")]
        if len(given) == 1:
            return ""
        return self.tr("Choose either a GeoPackage or a PostGIS database.")


def add_overwrite(algorithm, text):
    """Whether what is there may be replaced."""
    algorithm.add(
        QgsProcessingParameterBoolean(OVERWRITE, text, defaultValue=False),
        "--overwrite",
        algorithm.tr("Otherwise what is there is kept, and nothing is done."),
        advanced=True,
    )


def add_open(algorithm):
    """Whether the products are opened."""
    algorithm.add(
        QgsProcessingParameterBoolean(OPEN, algorithm.tr("Open the products, styled"), defaultValue=True),
        None,
        algorithm.tr("Adds them to the project when the work is done."),
    )
