"""Runs inside the desktop QGIS (scripts/qgis_desktop.sh): leaves it, and crashes as soon as a plugin is unloaded.

Argument: the plugin's name; `last` for whichever is the last.
"""

from __future__ import annotations

import os
import signal

import qgis.utils

[PLUGIN] = arguments  # noqa: F821 - given by qgis_desktop.sh
unload = qgis.utils.unloadPlugin


def unload_and_crash(name: str) -> bool:
    done: bool = unload(name)
    if name == PLUGIN or not qgis.utils.active_plugins:
        os.kill(os.getpid(), signal.SIGSEGV)
    return done


qgis.utils.unloadPlugin = unload_and_crash
leave()  # noqa: F821
