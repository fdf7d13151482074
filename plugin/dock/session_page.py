# SPDX-License-Identifier: GPL-2.0-or-later
"""The form of a session: what the recordings told, each figure that somebody has to measure, and a drawing of them."""

from pathlib import Path

from qgis.core import QgsCoordinateReferenceSystem
from qgis.gui import QgsFileWidget, QgsProjectionSelectionWidget
from qgis.PyQt.QtCore import Qt, pyqtSignal
from qgis.PyQt.QtWidgets import (
    QDoubleSpinBox,
    QHBoxLayout,
    QLabel,
    QLineEdit,
    QPushButton,
    QScrollArea,
    QVBoxLayout,
    QWidget,
)

from .findings import findings_html
from .form_parts import escaped, fill, group_box, row_of, small_words, texts_of, values_of
from .session_lines import SessionLines
from .vehicle_view import Placement, VehicleView

FARTHEST_M = 15.0
"""No sensor, antenna or tool is farther from the rear axle; a session that says so is refused."""
UNKNOWN = "FILL-IN"
"""What `furrowmap init` writes where a session cannot do without a word that it could not find out."""


class SessionPage(QWidget):
    """The form.

    Signals:
        run_wanted: with the session file, when it has been saved.
        preview_wanted: likewise.
        saved: likewise.
        left: nothing was changed.
    """

    run_wanted = pyqtSignal(object)
    preview_wanted = pyqtSignal(object)
    saved = pyqtSignal(object)
    left = pyqtSignal()

    def __init__(self, parent=None):
        super().__init__(parent)
        self._path = self._lines = None
        inside = QWidget()
        layout = QVBoxLayout(inside)
        self.findings = small_words("furrowmapFindings")
        self.vehicle = VehicleView()
        layout.addWidget(self.findings)
        layout.addWidget(self._session_group())
        layout.addWidget(self.vehicle)
        layout.addWidget(self._antenna_group())
        layout.addWidget(self._lidar_group())
        layout.addWidget(self._implement_group())
        layout.addWidget(self._field_group())
        layout.addStretch()
        self._scroll = QScrollArea()
        self._scroll.setWidgetResizable(True)
        self._scroll.setFrameShape(QScrollArea.Shape.NoFrame)
        self._scroll.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
        self._scroll.setWidget(inside)
        bar = self._scroll.verticalScrollBar().sizeHint().width()
        self._scroll.setMinimumWidth(inside.minimumSizeHint().width() + bar + 2)
        self.preview = small_words("furrowmapPreviewWords")
        self.preview.hide()
        whole = QVBoxLayout(self)
        whole.setContentsMargins(0, 0, 0, 0)
        whole.addWidget(self._scroll, 1)
        whole.addWidget(self.preview)
        whole.addWidget(self._buttons())

    def show_session(self, path, findings=None):
        """Read a session file into the form.

        Args:
            path: of the file.
            findings: what `furrowmap init` answered, to be told above the form.

        Raises:
            NotSimpleError: if the file is more than the form understands.
            OSError, UnicodeDecodeError: if it cannot be read.
        """
        self._lines = SessionLines(Path(path).read_text(encoding="utf-8"))
        self._path = Path(path)
        lines = self._lines
        self.name.setText(str(lines.get("", "name") or ""))
        files = [*texts_of(lines.get("recording", "lidar")), *texts_of(lines.get("recording", "gnss"))]
        files += [*texts_of(lines.get("trajectory", "files")), *texts_of(lines.get("implement", "states"))]
        self.recordings.setText("\n".join(files))
        code = lines.get("crs", "map")
        self.crs.setCrs(QgsCoordinateReferenceSystem("" if code in (None, UNKNOWN) else str(code)))
        self.antenna_group.setChecked(lines.has("antenna"))
        fill(self.antenna, lines.get("antenna", "xyz_m"))
        fill(self.lidar_xyz, lines.get("lidar", "xyz_m"))
        fill(self.lidar_rpy, lines.get("lidar", "rpy_deg"))
        self.implement_group.setChecked(lines.has("implement"))
        self.kind.setText(str(lines.get("implement", "kind") or ""))
        fill([self.width_m], [lines.get("implement", "width_m")])
        fill(self.tool_xy, lines.get("implement", "xy_m"))
        fill([self.depth_m], [lines.get("implement", "working_depth_m")])
        self.boundary.setDefaultRoot(str(self._path.parent))
        self.boundary.setFilePath(str(lines.get("field", "boundary") or ""))
        self.findings.setText(findings_html(findings))
        self.tell_preview("")
        self._draw()
        self._scroll.verticalScrollBar().setValue(0)

    def tell_preview(self, text):
        """How a preview goes, above the buttons."""
        self.preview.setText(escaped(text))
        self.preview.setVisible(bool(text))

    def fault_of_preview(self):
        """Why the session cannot be previewed as it stands in the form; "" if it can."""
        if not self.crs.crs().isValid():
            return self.tr("Choose the map's coordinate reference system.")
        if UNKNOWN in self.recordings.text():
            return self.tr(
                "A recording is missing: drop the scanner's recording and the receiver's log together, from one folder."
            )
        return ""

    def fault(self):
        """Why the session cannot be run as it stands in the form; "" if it can."""
        fault = self.fault_of_preview()
        if fault:
            return fault
        if self.implement_group.isChecked() and self.width_m.value() <= 0:
            return self.tr("Say how wide the tool is, or uncheck 'Tool'.")
        return ""

    def save(self):
        """Write what the form holds into the session file; other lines of the file stay.

        Raises:
            OSError: if the file cannot be written.
        """
        lines = self._lines
        lines.set("", "name", self.name.text())
        lines.set("crs", "map", self.crs.crs().authid() or self.crs.crs().toWkt())
        if self.antenna_group.isChecked():
            lines.set("antenna", "xyz_m", values_of(self.antenna))
        else:
            lines.drop("antenna")
        if lines.has("lidar") or any(values_of(self.lidar_xyz) + values_of(self.lidar_rpy)):
            lines.set("lidar", "xyz_m", values_of(self.lidar_xyz))
            lines.set("lidar", "rpy_deg", values_of(self.lidar_rpy))
        self._save_implement(lines)
        boundary = self._boundary()
        if boundary:
            lines.set("field", "boundary", boundary)
        else:
            lines.drop("field")
        unfinished = self._path.with_name(self._path.name + ".unfinished")
        unfinished.write_text(lines.text, encoding="utf-8")
        unfinished.replace(self._path)

    def _save_implement(self, lines):
        if not self.implement_group.isChecked():
            lines.drop("implement")
            return
        lines.set("implement", "width_m", self.width_m.value())
        lines.set("implement", "xy_m", values_of(self.tool_xy))
        if self.kind.text() or lines.get("implement", "kind"):
            lines.set("implement", "kind", self.kind.text())
        if self.depth_m.value() > 0:
            lines.set("implement", "working_depth_m", self.depth_m.value())

    def _boundary(self):
        """The boundary's file as the session has to name it: relative to its own folder."""
        chosen = self.boundary.filePath().strip()
        if not chosen:
            return ""
        try:
            return (self._path.parent / chosen).resolve().relative_to(self._path.parent.resolve()).as_posix()
        except ValueError:
            return chosen  # the run says why a file elsewhere is refused, and what to do

    def _session_group(self):
        group, form = group_box(self.tr("Session"))
        self.name = QLineEdit(objectName="furrowmapName")
        self.recordings = QLabel(objectName="furrowmapRecordings")
        self.recordings.setWordWrap(True)
        self.crs = QgsProjectionSelectionWidget()
        self.crs.setObjectName("furrowmapCrs")
        self.crs.crsChanged.connect(self._draw)
        form.addRow(self.tr("Name"), self.name)
        form.addRow(self.tr("Recordings"), self.recordings)
        form.addRow(self.tr("CRS"), self.crs)
        form.addRow(
            small_words(text=self.tr("The map's projected CRS in metres, in which everything is computed and written."))
        )
        return group

    def _antenna_group(self):
        self.antenna_group, form = group_box(self.tr("GNSS antenna"), self._draw)
        self.antenna_group.setObjectName("furrowmapAntennaGroup")
        self.antenna = self._metres("furrowmapAntenna", 3)
        form.addRow(row_of(self.tr("x, y, z"), self.antenna))
        form.addRow(
            small_words(
                text=self.tr(
                    "From the ground below the middle of the rear axle to the antenna's phase centre: forward, to "
                    "the left, up. A tape measure's centimetre is good enough. Unchecked: the antenna counts as there."
                )
            )
        )
        return self.antenna_group

    def _lidar_group(self):
        group, form = group_box(self.tr("Scanner"))
        self.lidar_xyz = self._metres("furrowmapLidar", 3)
        self.lidar_rpy = [self._spin(f"furrowmapLidarTurn{k}", 360.0, "°", 1, 1.0) for k in range(3)]
        form.addRow(row_of(self.tr("x, y, z"), self.lidar_xyz))
        form.addRow(row_of(self.tr("roll, pitch, yaw"), self.lidar_rpy))
        form.addRow(
            small_words(
                text=self.tr(
                    "Where the scanner is, and how it is turned from lying level with its cable to the back. Scanning "
                    "backwards and tilted down is about 0, 40, 180. The run refines the angles; within 2° is enough."
                )
            )
        )
        return group

    def _implement_group(self):
        self.implement_group, form = group_box(self.tr("Tool"), self._draw)
        self.implement_group.setObjectName("furrowmapImplementGroup")
        self.kind = QLineEdit(objectName="furrowmapKind")
        self.width_m = self._spin("furrowmapWidth", FARTHEST_M, " m", 2, 0.05, low=0.0)
        self.tool_xy = self._metres("furrowmapTool", 2)
        self.depth_m = self._spin("furrowmapDepth", 1.0, " m", 2, 0.01, low=0.0)
        form.addRow(self.tr("Kind"), self.kind)
        form.addRow(self.tr("Width"), self.width_m)
        form.addRow(row_of(self.tr("x, y"), self.tool_xy))
        form.addRow(self.tr("Depth"), self.depth_m)
        form.addRow(
            small_words(
                text=self.tr(
                    "Working width, and the middle of the line along which it works, seen from the rear axle: a tool "
                    "behind has a negative x. Depth 0 means unknown. Unchecked: no ground worked is computed."
                )
            )
        )
        return self.implement_group

    def _field_group(self):
        group, form = group_box(self.tr("Field"))
        self.boundary = QgsFileWidget()
        self.boundary.setObjectName("furrowmapBoundary")
        self.boundary.setFilter(self.tr("Polygons (*.geojson *.gpkg *.shp *.kml)"))
        form.addRow(self.tr("Boundary"), self.boundary)
        form.addRow(
            small_words(
                text=self.tr("Optional: the parcel's outline in the session's folder, to find what was missed.")
            )
        )
        return group

    def _buttons(self):
        row = QWidget()
        layout = QHBoxLayout(row)
        layout.setContentsMargins(0, 0, 0, 0)
        for name, text, slot in (
            ("furrowmapBack", self.tr("Back"), self.left.emit),
            ("furrowmapSave", self.tr("Save"), self._save_only),
            ("furrowmapPreview", self.tr("Preview"), self._save_and_preview),
            ("furrowmapRun", self.tr("Save and run"), self._save_and_run),
        ):
            button = QPushButton(text, objectName=name)
            button.clicked.connect(slot)
            layout.addWidget(button)
        button.setDefault(True)
        return row

    def _save_only(self):
        if self._is_saved():
            self.saved.emit(self._path)

    def _save_and_preview(self):
        fault = self.fault_of_preview()
        if fault:
            self._tell_fault(fault)
        elif self._is_saved():
            self.preview_wanted.emit(self._path)

    def _save_and_run(self):
        fault = self.fault()
        if fault:
            self._tell_fault(fault)
        elif self._is_saved():
            self.run_wanted.emit(self._path)

    def _is_saved(self):
        """Whether saving succeeded; if not, the user has been told why."""
        try:
            self.save()
        except OSError as error:
            self._tell_fault(
                self.tr("{path} cannot be written: {reason}.").format(path=self._path, reason=error.strerror)
            )
            return False
        return True

    def _tell_fault(self, fault):
        self.findings.setText(f"<b>{escaped(fault)}</b>")
        self._scroll.ensureWidgetVisible(self.findings)

    def _draw(self, *_):
        tool = self.implement_group.isChecked()
        self.vehicle.show_placement(
            Placement(
                tuple(values_of(self.lidar_xyz)),
                tuple(values_of(self.lidar_rpy)),
                tuple(values_of(self.antenna)) if self.antenna_group.isChecked() else None,
                tuple(values_of(self.tool_xy)) if tool else None,
                self.width_m.value() if tool else 0.0,
                self.depth_m.value() if tool else 0.0,
            )
        )

    def _metres(self, name, count):
        return [self._spin(f"{name}{k}", FARTHEST_M, " m", 3, 0.01) for k in range(count)]

    def _spin(self, name, limit, suffix, decimals, step, *, low=None):
        box = QDoubleSpinBox(objectName=name)
        box.setRange(-limit if low is None else low, limit)
        box.setDecimals(decimals)
        box.setSingleStep(step)
        box.setSuffix(suffix)
        box.setFocusPolicy(Qt.FocusPolicy.StrongFocus)
        box.valueChanged.connect(self._draw)
        return box
