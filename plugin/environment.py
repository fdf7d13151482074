# SPDX-License-Identifier: GPL-2.0-or-later
"""Environment variables of the worker's process: the user's, without what QGIS has set for itself."""

import os
import sys
from pathlib import Path

# Each of these breaks another interpreter, GDAL or PROJ.
REMOVED = (
    "PYTHONHOME",
    "PYTHONPATH",
    "PYTHONEXECUTABLE",
    "PYTHONSTARTUP",
    "PYTHONNOUSERSITE",
    "GDAL_DATA",
    "GDAL_DRIVER_PATH",
    "PROJ_DATA",
    "PROJ_LIB",
    "QT_PLUGIN_PATH",
    "QT_QPA_PLATFORM_PLUGIN_PATH",
)
SEARCHED = ("PATH", "LD_LIBRARY_PATH", "DYLD_LIBRARY_PATH", "DYLD_FRAMEWORK_PATH")
"""Search paths, from which QGIS's own folders are removed."""


def worker_environment(variables, prefix):
    """The variables for the worker.

    Args:
        variables: those of QGIS's process.
        prefix: folder in which QGIS is installed; its folders are removed from the search paths. None for a QGIS of the
            system, which shares its folders.
    """
    kept = {name: value for name, value in variables.items() if name.upper() not in REMOVED}
    for name in SEARCHED:
        if name in kept and prefix is not None:
            kept[name] = os.pathsep.join(f for f in kept[name].split(os.pathsep) if f and not _within(f, prefix))
    return kept | {"PYTHONUTF8": "1", "PYTHONUNBUFFERED": "1"}


def own_prefix(application_prefix):
    """The folder that only QGIS uses: of an installer or a bundle; None where it is part of the system.

    Args:
        application_prefix: `QgsApplication.prefixPath()`.
    """
    prefix = Path(application_prefix)
    if sys.platform == "win32":  # C:/Program Files/QGIS 3.40/apps/qgis: the libraries are in the folder above
        return prefix.parents[1] if prefix.parent.name.lower() == "apps" else prefix
    if sys.platform == "darwin":
        bundle = next((p for p in (prefix, *prefix.parents) if p.suffix == ".app"), None)
        return bundle or prefix
    return None if prefix in (Path("/usr"), Path("/usr/local")) else prefix


def _within(folder, prefix):
    try:
        return Path(folder).resolve().is_relative_to(Path(prefix).resolve())
    except OSError:
        return False
