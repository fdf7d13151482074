# SPDX-License-Identifier: GPL-2.0-or-later
"""The page of a result: the main figures, warnings, and what can be done with it."""

import html
from functools import partial

from qgis.core import QgsApplication
from qgis.PyQt.QtCore import Qt, pyqtSignal
from qgis.PyQt.QtWidgets import QGridLayout, QMenu, QPushButton, QTextBrowser, QVBoxLayout, QWidget

from ..figures import figures_html
from ..processing.description import COMMAND_OPTIONS
from ..results import read_report, session_name


class ResultPage(QWidget):
    """Shows the report in a folder.

    Signals:
        wanted: with the name of the action: "map", "replay", "report", "folder", "farm", "print" or "back".
        export_wanted: with the name of a format.
    """

    wanted = pyqtSignal(str)
    export_wanted = pyqtSignal(str)

    def __init__(self, parent=None):
        super().__init__(parent)
        layout = QVBoxLayout(self)
        self.text = QTextBrowser(objectName="furrowmapFigures")
        self.text.setFrameShape(QTextBrowser.Shape.NoFrame)
        layout.addWidget(self.text, 1)
        grid = QGridLayout()
        for k, (name, text, tip) in enumerate(
            (
                ("map", self.tr("Add to map"), self.tr("Open the products as styled layers in a group")),
                (
                    "replay",
                    self.tr("Replay"),
                    self.tr("Play the drive in the temporal controller; a visible cloud grows with it"),
                ),
                ("report", self.tr("Open report"), self.tr("Open the HTML report in the browser")),
                ("folder", self.tr("Open folder"), self.tr("Open the folder of the products")),
                ("farm", self.tr("Add to farm map…"), self.tr("One file of all sessions, a layer for each kind")),
                ("print", self.tr("Print…"), self.tr("A layout with map, legend and figures, and a page per pass")),
                ("back", self.tr("Other session"), self.tr("Back to the start page")),
            )
        ):
            button = QPushButton(text, objectName=f"furrowmapDo_{name}")
            button.setToolTip(tip)
            button.clicked.connect(lambda _=False, name=name: self.wanted.emit(name))
            grid.addWidget(button, *divmod(k, 2))
        grid.addWidget(self._export(), 3, 1)
        layout.addLayout(grid)

    def _export(self):
        """The button of the export, with a menu of the formats."""
        button, menu = QPushButton(self.tr("Export"), objectName="furrowmapExport"), QMenu(self)
        for name in COMMAND_OPTIONS["export"]["--to"]["choices"]:
            menu.addAction(name, partial(self.export_wanted.emit, name))
        button.setMenu(menu)
        button.setToolTip(self.tr("GeoJSON, Shapefile, KML, CSV, ISO 11783 task data and others"))
        return button

    def show_folder(self, folder):
        """Show the figures of the run in a folder."""
        report = read_report(folder)
        name = html.escape(session_name(report, folder))
        warnings = [str(in_own_language(w, "text") or "") for w in report.get("warnings") or [] if isinstance(w, dict)]
        page = f"<h3>{name}</h3>{self._alarm(report)}<table>{figures_html(report)}</table>"
        if warnings:
            items = "".join(f"<li>{html.escape(text)}</li>" for text in warnings)
            page += f"<h4>{self.tr('Warnings')}</h4><ul style='margin-left:-20px'>{items}</ul>"
        if not report:
            page += f"<p>{self.tr('This folder has no report, so the accuracy is unknown.')}</p>"
        self.text.setHtml(page)
        self.text.setAlignment(Qt.AlignmentFlag.AlignLeft)

    def _alarm(self, report):
        """What casts doubt on all figures, above them."""
        verdict = report.get("verdict")
        if not isinstance(verdict, dict):
            return ""
        text, doubts = in_own_language(verdict, "text"), in_own_language(verdict, "doubts")
        shown = "".join(f"<p>⚠ {html.escape(str(doubt))}</p>" for doubt in (doubts if isinstance(doubts, list) else []))
        if not text:
            return shown
        title = self.tr("These results contradict each other.")
        return f"<p style='color:#b71c1c'><b>{title}</b><br>{html.escape(str(text))}</p>{shown}"


def in_own_language(table, key):
    """A text of a report in the language of QGIS, where the report has it in that: `text_ja` beside `text`."""
    return table.get(f"{key}_{(QgsApplication.locale() or '')[:2]}") or table.get(key)
