# SPDX-License-Identifier: GPL-2.0-or-later
"""Folders of results that are dropped on QGIS's window."""

from qgis.gui import QgsCustomDropHandler

from .dropped import local_paths, results_folder


class ResultsDropHandler(QgsCustomDropHandler):
    """Opens folders that a run wrote; QGIS handles everything else.

    Args:
        open_folder: is called with the folder.
    """

    def __init__(self, open_folder):
        super().__init__()
        self._open_folder = open_folder

    def customUriProviderKey(self):  # noqa: N802 - the names are QGIS's
        """QGIS asks for it; it is not used."""
        return "furrowmap"

    def handleMimeDataV2(self, data):  # noqa: N802
        """Open folders of results; returns whether there was one."""
        folders = [results_folder(path) for path in local_paths(data) if path.is_dir()]
        found = [folder for folder in folders if folder is not None]
        for folder in found:
            self._open_folder(folder)
        return bool(found)
