# SPDX-License-Identifier: GPL-2.0-or-later
"""The provider: furrowmap's algorithms in the toolbox, the modeler, batch processing and `qgis_process`."""

from pathlib import Path

from qgis.core import QgsProcessingProvider
from qgis.PyQt.QtGui import QIcon

from .base_add import BaseAdd
from .base_list import BaseList
from .base_mosaic import BaseMosaic
from .base_remove import BaseRemove
from .calibrate import Calibrate
from .check import Check
from .cloud import Cloud
from .crs import Crs
from .export import Export
from .fields import Fields
from .gnss_evaluate import GnssEvaluate
from .init import Init
from .inspect import Inspect
from .run import Run
from .simulate import Simulate
from .surface import Surface

ALGORITHMS = (
    Init,
    Inspect,
    Run,
    Calibrate,
    Simulate,
    Surface,
    Cloud,
    Fields,
    Export,
    BaseAdd,
    BaseList,
    BaseRemove,
    BaseMosaic,
    Crs,
    GnssEvaluate,
    Check,
)


class FurrowmapProvider(QgsProcessingProvider):
    """One algorithm for each verb; each is there even where no worker is, and says so when asked to work."""

    def id(self):
        """Never translated: models and scripts name it."""
        return "furrowmap"

    def name(self):
        """As the toolbox shows it."""
        return "furrowmap"

    def icon(self):
        """The plugin's own."""
        return QIcon(str(Path(__file__).parents[1] / "icon.svg"))

    def loadAlgorithms(self):  # noqa: N802 - the name is QGIS's
        """Add each."""
        for algorithm in ALGORITHMS:
            self.addAlgorithm(algorithm())
