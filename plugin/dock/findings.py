# SPDX-License-Identifier: GPL-2.0-or-later
"""What a look at recordings found out and what it did not, in the words of the form."""

from qgis.PyQt.QtCore import QCoreApplication

from .form_parts import escaped


def findings_html(findings):
    """The answer of `furrowmap init` as rich text; empty where there is none.

    Args:
        findings: with `found` and `missing`, notices each.
    """
    parts = []
    for title, key in ((tr("Found out"), "found"), (tr("To be filled in"), "missing")):
        notices = (findings or {}).get(key) or []
        if notices:
            items = "".join(f"<li>{escaped(_words(notice))}</li>" for notice in notices)
            parts.append(f"<b>{title}</b><ul style='margin:2px 0 4px -22px'>{items}</ul>")
    return "".join(parts)


def _words(notice):
    """A notice; what the form asks for is told by the form's names, not by the keys of the session file."""
    asked = {
        "no-lidar": tr("The scanner's recording: drop it together with the receiver's log."),
        "no-positions": tr("The receiver's log: drop it together with the scanner's recording."),
        "no-crs": tr("CRS: no recording tells where it was made."),
        "no-mounting": tr("Scanner: where it is and how it is turned. Until then there is no surface worth the name."),
        "no-antenna": tr("GNSS antenna: where it is. Until then it counts as on the ground below the rear axle."),
        "no-implement": tr("Tool: how wide it is and where. Until then no ground worked is computed."),
    }
    return asked.get(notice.get("code")) or notice.get("text", "")


def tr(text):
    """`text` in the user's language."""
    return QCoreApplication.translate("Findings", text)
