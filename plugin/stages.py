# SPDX-License-Identifier: GPL-2.0-or-later
"""The worker's stages in the user's language."""

from qgis.PyQt.QtCore import QT_TRANSLATE_NOOP, QCoreApplication

STAGES = (
    QT_TRANSLATE_NOOP("Stages", "reading positions"),
    QT_TRANSLATE_NOOP("Stages", "reading scans"),
    QT_TRANSLATE_NOOP("Stages", "looking at scans"),
    QT_TRANSLATE_NOOP("Stages", "matching scans"),
    QT_TRANSLATE_NOOP("Stages", "placing points"),
    QT_TRANSLATE_NOOP("Stages", "finding features"),
    QT_TRANSLATE_NOOP("Stages", "matching images"),
    QT_TRANSLATE_NOOP("Stages", "adjusting images"),
    QT_TRANSLATE_NOOP("Stages", "reading images"),
    QT_TRANSLATE_NOOP("Stages", "looking for the board"),
    QT_TRANSLATE_NOOP("Stages", "hashing inputs"),
    QT_TRANSLATE_NOOP("Stages", "writing cloud"),
    QT_TRANSLATE_NOOP("Stages", "making surfaces"),
    QT_TRANSLATE_NOOP("Stages", "writing layers"),
    QT_TRANSLATE_NOOP("Stages", "writing the preview"),
    QT_TRANSLATE_NOOP("Stages", "work"),
    QT_TRANSLATE_NOOP("Stages", "reading clouds"),
    QT_TRANSLATE_NOOP("Stages", "measuring density"),
    QT_TRANSLATE_NOOP("Stages", "looking for noise"),
    QT_TRANSLATE_NOOP("Stages", "cleaning clouds"),
    QT_TRANSLATE_NOOP("Stages", "filling gaps"),
    QT_TRANSLATE_NOOP("Stages", "exporting"),
    QT_TRANSLATE_NOOP("Stages", "reading results"),
    QT_TRANSLATE_NOOP("Stages", "writing the page"),
    QT_TRANSLATE_NOOP("Stages", "writing the project"),
    QT_TRANSLATE_NOOP("Stages", "writing the farm map"),
    QT_TRANSLATE_NOOP("Stages", "writing the mosaic"),
    QT_TRANSLATE_NOOP("Stages", "waiting for another process"),
)
"""Stages of a run in their order, then those of other commands. Others are shown in English."""


def stage_name(stage):
    """A stage's name in the user's language."""
    return QCoreApplication.translate("Stages", str(stage))
