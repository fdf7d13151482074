# SPDX-License-Identifier: GPL-2.0-or-later
"""The QGIS plugin. Importing this module is cheap; QGIS's plugin manager calls :func:`classFactory`.

Inside QGIS this folder is called `furrowmap`, like the import package. It imports nothing of that package: it starts
`furrowmap worker` in a Python environment outside QGIS and talks to it.
"""

from typing import Any


def classFactory(iface: Any) -> Any:  # noqa: N802 - the name is QGIS's
    """The plugin, for QGIS's plugin manager."""
    from .entry import FurrowmapPlugin

    return FurrowmapPlugin(iface)
