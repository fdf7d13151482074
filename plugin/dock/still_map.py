# SPDX-License-Identifier: GPL-2.0-or-later
"""Steps that change the layers of a project while the map stands still.

QGIS draws in threads that read the files of layers. Opening a GeoPackage changes its journal, so that these threads
find no file for a moment ("unable to open database file"), and QGIS 3.40 may crash where it draws what is replaced.
"""

from __future__ import annotations

import time
from collections.abc import Generator, Sequence
from typing import TypeVar

from qgis.gui import QgsMapCanvas
from qgis.PyQt import sip

LONGEST_DRAWING_S = 3.0
"""A map that takes longer to draw is cancelled."""
Answer = TypeVar("Answer")


def on_still_map(
    canvases: Sequence[QgsMapCanvas], steps: Generator[None, None, Answer]
) -> Generator[None, None, Answer]:
    """Do steps after the maps are drawn, without drawing them again before the last."""
    frozen = [canvas for canvas in canvases if not canvas.isFrozen()]
    for canvas in frozen:
        canvas.freeze(True)  # noqa: FBT003 - Qt's
    try:
        begun = time.monotonic()
        while _drawing(frozen) and time.monotonic() - begun < LONGEST_DRAWING_S:
            yield
        for canvas in _drawing(frozen):
            canvas.stopRendering()
        return (yield from steps)
    finally:
        for canvas in frozen:
            if not sip.isdeleted(canvas):
                canvas.freeze(False)  # noqa: FBT003
                canvas.refresh()


def _drawing(canvases: Sequence[QgsMapCanvas]) -> list[QgsMapCanvas]:
    """Those that are being drawn; the user may have closed others."""
    return [canvas for canvas in canvases if not sip.isdeleted(canvas) and canvas.isDrawing()]
