# SPDX-License-Identifier: GPL-2.0-or-later
"""What `furrowmap init` found in recordings and what is missing, in the words of the form."""

from functools import partial

from qgis.PyQt.QtCore import QCoreApplication

from .form_parts import escaped

tr = partial(QCoreApplication.translate, "Findings")


FORM = ("no-lidar", "no-positions", "no-crs", "no-mounting", "no-antenna", "no-implement")
"""Codes of what the form sees itself to be missing."""


def findings_html(findings, missing=()):
    """The answer of `furrowmap init` as rich text, and what is still to be filled in.

    Args:
        findings: with `found` and `missing`, notices each; None for a session that was opened again.
        missing: codes of :data:`FORM`.
    """
    parts = []
    for title, key in ((tr("Found in the recordings"), "found"), (tr("Missing"), "missing")):
        notices = [notice for notice in (findings or {}).get(key) or [] if notice.get("code") not in FORM]
        notices += [{"code": code} for code in missing] if key == "missing" else []
        if notices:
            items = "".join(f"<li>{escaped(_text(notice))}</li>" for notice in notices)
            parts.append(f"<b>{title}</b><ul style='margin:2px 0 4px -22px'>{items}</ul>")
    return "".join(parts)


def _text(notice):
    """The text of a notice; if it is about a field of the form, with the name that the form has for it."""
    asked = {
        "no-lidar": tr("The scanner's recording. Drop it together with the receiver's log."),
        "no-positions": tr("The receiver's log. Drop it together with the scanner's recording."),
        "no-crs": tr("CRS: the recordings contain no position."),
        "no-mounting": tr("Scanner: position and orientation. Until then the surfaces are not usable."),
        "no-antenna": tr("GNSS antenna: position. Until then no accuracy is stated."),
        "no-implement": tr("Implement: width and position. Until then no worked ground is computed."),
    }
    return asked.get(notice.get("code")) or notice.get("text", "")
