# SPDX-License-Identifier: GPL-2.0-or-later
"""furrowmap inside QGIS. Importing this costs nothing until QGIS asks for the plugin."""


def classFactory(iface):  # noqa: N802 - the name is QGIS's
    """The plugin, for QGIS's plugin manager."""
    from .entry import FurrowmapPlugin

    return FurrowmapPlugin(iface)
