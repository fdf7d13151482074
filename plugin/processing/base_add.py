# SPDX-License-Identifier: GPL-2.0-or-later
"""`furrowmap farm add` as an algorithm."""

from qgis.core import (
    QgsProcessingOutputNumber,
    QgsProcessingParameterBoolean,
    QgsProcessingParameterCrs,
    QgsProcessingParameterFileDestination,
    QgsProcessingParameterString,
)

from .loading import load_when_done
from .shared import BASE, OPEN, TakesBase, TakesResults, add_open


class BaseAdd(TakesBase, TakesResults):
    """Results of runs into a farm's base map."""

    ID, VERB = "base_add", ("farm", "add")
    CRS, SAME_CRS, ZONE = "CRS", "SAME_CRS", "TIME_ZONE"

    def displayName(self):  # noqa: N802 - the names are QGIS's
        """As the toolbox shows it."""
        return self.tr("Add results to the base map")

    def summary(self):
        """What it does."""
        return self.tr(
            "Puts the results of runs into a farm's base map, a GeoPackage or a PostGIS database, which is made where "
            "it is not there. A session that it has already is replaced by its new result. Either all get into it, or "
            "it stays as it was."
        )

    def initAlgorithm(self, configuration=None):  # noqa: N802, ARG002
        """Its parameters and outputs."""
        self.add_results()
        file = QgsProcessingParameterFileDestination(
            BASE, self.tr("Base map (GeoPackage)"), "GeoPackage (*.gpkg)", optional=True, createByDefault=False
        )
        file.setMetadata({"widget_wrapper": {"dontconfirmoverwrite": True}})  # it is added to, not replaced
        self.add_base(file)
        self.add(
            QgsProcessingParameterCrs(self.CRS, self.tr("CRS of a new base map"), optional=True),
            "--crs",
            self.tr("Left out: that of the first session."),
            advanced=True,
        )
        self.add(
            QgsProcessingParameterBoolean(self.SAME_CRS, self.tr("Refuse sessions of another CRS")),
            "--same-crs",
            self.tr("Otherwise they are transformed."),
            advanced=True,
        )
        self.add(
            QgsProcessingParameterString(self.ZONE, self.tr("Time zone"), optional=True),
            "--time-zone",
            self.tr("Tells the days, such as Asia/Tokyo. Left out: by the longitude."),
            advanced=True,
        )
        add_open(self)
        for name in ("added", "replaced", "unchanged", "sessions"):
            self.addOutput(QgsProcessingOutputNumber(name.upper(), name))

    def outputs(self, answer, parameters, context):
        """What was done, and how many sessions the base has now."""
        file = self.parameterAsFileOutput(parameters, BASE, context)
        if file and self.parameterAsBool(parameters, OPEN, context):
            load_when_done(context, file, self.tr("Base map"))
        counts = {name.upper(): len(answer[name]) for name in ("added", "replaced", "unchanged")}
        return {BASE: file, "SESSIONS": answer["sessions"], **counts}
