# SPDX-License-Identifier: GPL-2.0-or-later
"""The provider: furrowmap's algorithms in the toolbox, the model designer, batch processing and `qgis_process`."""

from pathlib import Path

from qgis.core import QgsProcessingProvider
from qgis.PyQt.QtGui import QIcon

from .algorithm import CommandAlgorithm, RunAlgorithm
from .description import ALGORITHMS


class FurrowmapProvider(QgsProcessingProvider):
    """One algorithm for each command; they are listed without a worker as well, and then say that it is missing."""

    def id(self) -> str:
        """Never translated: models and scripts name it."""
        return "furrowmap"

    def name(self) -> str:
        """As the toolbox shows it."""
        return "furrowmap"

    def icon(self) -> QIcon:
        """The plugin's icon."""
        return QIcon(str(Path(__file__).parents[1] / "icon.svg"))

    def loadAlgorithms(self) -> None:  # noqa: N802 - the name is QGIS's
        """Add each algorithm."""
        for description in ALGORITHMS:
            self.addAlgorithm((RunAlgorithm if description.command == "run" else CommandAlgorithm)(description))
