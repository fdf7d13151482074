# SPDX-License-Identifier: GPL-2.0-or-later
"""`furrowmap farm remove` as an algorithm."""

from qgis.core import QgsProcessingOutputNumber, QgsProcessingParameterString

from .base import ARGUMENT
from .shared import TakesBase


class BaseRemove(TakesBase):
    """Sessions out of a base map."""

    ID, VERB = "base_remove", ("farm", "remove")
    SESSION = "SESSION"

    def displayName(self):  # noqa: N802 - the names are QGIS's
        """As the toolbox shows it."""
        return self.tr("Remove sessions from the base map")

    def summary(self):
        """What it does."""
        return self.tr("Takes sessions out of a base map. The folders of their results stay as they are.")

    def initAlgorithm(self, configuration=None):  # noqa: N802, ARG002
        """Its parameters and outputs."""
        self.add_base()
        self.add(
            QgsProcessingParameterString(self.SESSION, self.tr("Sessions"), multiLine=True),
            ARGUMENT,
            self.tr("A line each: its identity, or how that begins, or its name."),
        )
        self.addOutput(QgsProcessingOutputNumber("REMOVED", self.tr("Number removed")))
        self.addOutput(QgsProcessingOutputNumber("SESSIONS", self.tr("Number of sessions")))

    def words(self, definition, parameters, context):
        """A word for each line."""
        words = super().words(definition, parameters, context)
        if definition.name() != self.SESSION:
            return words
        return [line.strip() for word in words for line in word.splitlines() if line.strip()]

    def outputs(self, answer, parameters, context):  # noqa: ARG002
        """How many were removed, and are left."""
        return {"REMOVED": len(answer["removed"]), "SESSIONS": answer["sessions"]}
