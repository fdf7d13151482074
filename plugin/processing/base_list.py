# SPDX-License-Identifier: GPL-2.0-or-later
"""`furrowmap farm list` as an algorithm."""

import json

from qgis.core import QgsProcessingOutputNumber, QgsProcessingOutputString

from .shared import TakesBase


class BaseList(TakesBase):
    """Which sessions a base map has."""

    ID, VERB = "base_list", ("farm", "list")

    def displayName(self):  # noqa: N802 - the names are QGIS's
        """As the toolbox shows it."""
        return self.tr("List the sessions of the base map")

    def summary(self):
        """What it does."""
        return self.tr("Tells which sessions are in a base map: identity, day, ground worked, name.")

    def initAlgorithm(self, configuration=None):  # noqa: N802, ARG002
        """Its parameters and outputs."""
        self.add_base()
        self.addOutput(QgsProcessingOutputString("SESSIONS", self.tr("Sessions (JSON)")))
        self.addOutput(QgsProcessingOutputNumber("COUNT", self.tr("Number of sessions")))

    def outputs(self, answer, parameters, context):  # noqa: ARG002
        """The sessions."""
        sessions = answer["sessions"]
        return {"SESSIONS": json.dumps(sessions, ensure_ascii=False, indent=1), "COUNT": len(sessions)}
