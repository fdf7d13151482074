# SPDX-License-Identifier: GPL-2.0-or-later
"""The form of a session: findings in the recordings, the measured dimensions, and a drawing of the vehicle."""

from functools import partial
from pathlib import Path

from qgis.core import QgsCoordinateReferenceSystem
from qgis.gui import QgsFileWidget, QgsProjectionSelectionWidget
from qgis.PyQt.QtCore import Qt, pyqtSignal
from qgis.PyQt.QtWidgets import (
    QComboBox,
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
from .form_parts import escaped, fill, group_box, row_of, same_value, small_text, texts_of, values_of
from .machines import PLACES, machine_names, machine_path, read_places
from .session_lines import NotSimpleError, SessionLines
from .vehicle_view import Placement, VehicleView

MAX_OFFSET_M = 15.0
"""Largest offset from the rear axle that a session may have."""
UNKNOWN = "FILL-IN"
"""What `furrowmap init` writes for required values that are not in the recordings."""


class SessionPage(QWidget):
    """The form.

    Signals:
        run_wanted: with the saved session file.
        preview_wanted: likewise.
        saved: likewise.
        left: back, without saving.
        replace_wanted: with the session file, to run it in place of the products of another recording.
        keep_wanted: with the session file, to run it into a folder of its own.
        machine_wanted: with the saved session file and a name, to save its machine.
        machine_replaced: likewise, in place of a saved machine of this name.
        calibration_wanted: with the saved session file and the name of its machine, or "".
    """

    run_wanted = pyqtSignal(object)
    preview_wanted = pyqtSignal(object)
    saved = pyqtSignal(object)
    left = pyqtSignal()
    replace_wanted = pyqtSignal(object)
    keep_wanted = pyqtSignal(object)
    machine_wanted = pyqtSignal(object, str)
    machine_replaced = pyqtSignal(object, str)
    calibration_wanted = pyqtSignal(object, str)

    def __init__(self, parent=None):
        super().__init__(parent)
        self._path = self._lines = self._found = None
        self._files = []
        inside = QWidget()
        layout = QVBoxLayout(inside)
        self.findings = small_text("furrowmapFindings")
        self.vehicle = VehicleView()
        layout.addWidget(self._error())
        layout.addWidget(self.findings)
        layout.addWidget(self._session_group())
        layout.addWidget(self._machine_group())
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
        self.preview = small_text("furrowmapPreviewWords")
        self.preview.hide()
        whole = QVBoxLayout(self)
        whole.setContentsMargins(0, 0, 0, 0)
        whole.addWidget(self._scroll, 1)
        whole.addWidget(self.preview)
        whole.addWidget(self._buttons())

    def show_session(self, path, findings=None):
        """Read a session file into the form.

        Args:
            findings: the answer of `furrowmap init`, shown above the form.

        Raises:
            NotSimpleError: if the form cannot edit the file.
            OSError, UnicodeDecodeError: if it cannot be read.
        """
        self._lines = SessionLines(Path(path).read_text(encoding="utf-8"))
        self._path = Path(path)
        lines = self._lines
        self.name.setText(str(lines.get("", "name") or ""))
        files = [*texts_of(lines.get("recording", "lidar")), *texts_of(lines.get("recording", "gnss"))]
        files += [*texts_of(lines.get("trajectory", "files")), *texts_of(lines.get("implement", "states"))]
        self._files = files
        words = {UNKNOWN: self.tr("(missing: drop the recording here)")}
        self.recordings.setText("\n".join(words.get(file, file) for file in files))
        code = lines.get("crs", "map")
        self.crs.setCrs(QgsCoordinateReferenceSystem("" if code in (None, UNKNOWN) else str(code)))
        self._fill_places({place: lines.get(*place) for place in PLACES})
        self.boundary.setDefaultRoot(str(self._path.parent))
        self.boundary.setFilePath(str(lines.get("field", "boundary") or ""))
        self._found = findings
        self.error.hide()
        self.show_preview_status("")
        self.show_machines()
        self._draw()
        self.findings.setText(findings_html(findings, self.missing()))
        self._scroll.verticalScrollBar().setValue(0)

    def _fill_places(self, places):
        self.antenna_group.setChecked(places["antenna", "xyz_m"] is not None)
        fill(self.antenna, places["antenna", "xyz_m"])
        fill(self.lidar_xyz, places["lidar", "xyz_m"])
        fill(self.lidar_rpy, places["lidar", "rpy_deg"])
        self.implement_group.setChecked(places["implement", "width_m"] is not None)
        self.kind.setText(str(places["implement", "kind"] or ""))
        fill([self.width_m], [places["implement", "width_m"]])
        fill(self.implement_xy, places["implement", "xy_m"])
        fill([self.depth_m], [places["implement", "working_depth_m"]])

    def places(self):
        """What the form states of the machine, by table and key."""
        with_tool = self.implement_group.isChecked()
        return {
            ("antenna", "xyz_m"): values_of(self.antenna) if self.antenna_group.isChecked() else None,
            ("lidar", "xyz_m"): values_of(self.lidar_xyz),
            ("lidar", "rpy_deg"): values_of(self.lidar_rpy),
            ("implement", "kind"): self.kind.text() if with_tool else None,
            ("implement", "width_m"): self.width_m.value() if with_tool else None,
            ("implement", "xy_m"): values_of(self.implement_xy) if with_tool else None,
            ("implement", "working_depth_m"): self.depth_m.value() if with_tool else None,
        }

    def use_places(self, places):
        """Fill in the places of a machine; what it does not have stays as it is, and so do several implements."""
        kept = "implement" if self._lines.several("implement") else ""
        known = {place: value for place, value in places.items() if value not in (None, "") and place[0] != kept}
        self._fill_places(self.places() | known)
        self._draw()
        self.findings.setText(findings_html(self._found, self.missing()))

    def show_machines(self, chosen=""):
        """List the saved machines; the one with the form's places is selected unless another one is chosen."""
        names = machine_names()
        self.machine.clear()
        self.machine.addItems(names)
        self.machine.setEditText(chosen or next(filter(self._is_of_form, names), ""))

    def _is_of_form(self, name):
        """Whether a saved machine has the places in the form."""
        try:
            saved = read_places(machine_path(name))
        except (OSError, UnicodeDecodeError, NotSimpleError):
            return False
        shown = self.places()
        known = {place: value for place, value in saved.items() if value not in (None, "")}
        return bool(known) and all(same_value(shown[place], value) for place, value in known.items())

    @property
    def path(self):
        """The session file; None before the first."""
        return self._path

    def recordings_beside(self, recordings):
        """The recordings of a session in the form that lacks one, if `recordings` are in its folder; else None."""
        if UNKNOWN not in self._files:
            return None
        folder = self._path.parent.resolve()
        inside = all(Path(path).resolve().is_relative_to(folder) for path in recordings)
        return [folder / name for name in self._files if name != UNKNOWN] if inside else None

    def missing(self):
        """Codes of what is still to be filled in, as `furrowmap init` has them."""
        needed = {
            "no-lidar": UNKNOWN in texts_of(self._lines.get("recording", "lidar")),
            "no-positions": UNKNOWN in texts_of(self._lines.get("recording", "gnss")),
            "no-crs": not self.crs.crs().isValid(),
            "no-mounting": self._without_mounting(),
            "no-antenna": self._without_antenna(),
            "no-implement": not self.implement_group.isChecked(),
        }
        return [code for code, wanted in needed.items() if wanted]

    def _without_mounting(self):
        stated = None not in (self._lines.get("lidar", "xyz_m"), self._lines.get("lidar", "rpy_deg"))
        scans = bool(texts_of(self._lines.get("recording", "lidar")))
        return scans and not stated and not any(values_of(self.lidar_xyz))

    def _without_antenna(self):
        stated = self._lines.get("antenna", "xyz_m") is not None or self._lines.has("trajectory")
        return not (self.antenna_group.isChecked() and any(values_of(self.antenna))) and not (
            stated and (self.antenna_group.isChecked() or self._lines.has("trajectory"))
        )

    def show_error(self, text, *, may_replace):
        """Show why a run failed, in full, above the form.

        Args:
            text: lines of the error.
            may_replace: offer to replace the products in its folder, or to keep both, instead of the last line, which
                names options of the command line.
        """
        what, *rest = text.splitlines()[: 2 if may_replace else None]
        self.error_text.setText("<br>".join([f"<b>{escaped(what)}</b>", *map(escaped, rest)]))
        self.choice.setVisible(may_replace)
        self.replace_machine.hide()
        self.anyway.hide()
        self.error.show()
        self._scroll.verticalScrollBar().setValue(0)

    def show_known_machine(self, text):
        """Show that a machine of this name is saved, with a button that replaces it."""
        remedy = self.tr("Replace its places by those of the form, or type another name.")
        self.show_error(f"{text.splitlines()[0]}\n{remedy}", may_replace=False)
        self.replace_machine.show()

    def show_preview_status(self, text):
        """Show the progress of a preview above the buttons."""
        self.preview.setText(escaped(text))
        self.preview.setVisible(bool(text))

    def fault_of_preview(self):
        """Why the session in the form cannot be previewed; "" if it can."""
        if UNKNOWN in self._files:
            return self.tr(
                "A recording is missing. Drop it here: the scanner's recording and the receiver's log, from one folder."
            )
        if not self.crs.crs().isValid():
            return self.tr("Choose the map's coordinate reference system.")
        return ""

    def fault(self):
        """Why the session in the form cannot be run; "" if it can."""
        fault = self.fault_of_preview()
        if fault:
            return fault
        if self.implement_group.isChecked() and self.width_m.value() <= 0:
            return self.tr("Enter the width of the implement, or uncheck 'Implement'.")
        return ""

    def save(self):
        """Write the form into the session file; other lines of the file are kept.

        Raises:
            OSError: if the file cannot be written.
        """
        lines = self._lines
        lines.set("", "name", self.name.text())
        if self.crs.crs().isValid():
            lines.set("crs", "map", self.crs.crs().authid() or self.crs.crs().toWkt())
        # Zeros that nobody typed are not written: the run takes what is not stated as unknown.
        if not self.antenna_group.isChecked():
            lines.drop("antenna")
        elif any(values_of(self.antenna)) or lines.has("antenna"):
            lines.set("antenna", "xyz_m", values_of(self.antenna))
        placed = any(values_of(self.lidar_xyz))
        if placed or lines.get("lidar", "xyz_m") is not None:
            lines.set("lidar", "xyz_m", values_of(self.lidar_xyz))
        if placed or any(values_of(self.lidar_rpy)) or lines.get("lidar", "rpy_deg") is not None:
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
            if lines.has("implement"):  # another one, which is now the first
                self._fill_places(
                    self.places() | {place: lines.get(*place) for place in PLACES if "implement" in place}
                )
            return
        lines.set("implement", "width_m", self.width_m.value())
        lines.set("implement", "xy_m", values_of(self.implement_xy))
        if self.kind.text() or lines.get("implement", "kind"):
            lines.set("implement", "kind", self.kind.text())
        if self.depth_m.value() > 0:
            lines.set("implement", "working_depth_m", self.depth_m.value())

    def _boundary(self):
        """Path of the boundary for the session file: relative to its folder."""
        chosen = self.boundary.filePath().strip()
        if not chosen:
            return ""
        try:
            return (self._path.parent / chosen).resolve().relative_to(self._path.parent.resolve()).as_posix()
        except ValueError:
            return chosen  # the run refuses a file elsewhere, with the reason

    def _error(self):
        self.error, self.choice = QWidget(objectName="furrowmapError"), QWidget()
        self.error_text = small_text("furrowmapErrorText")
        row = QHBoxLayout(self.choice)
        row.setContentsMargins(0, 0, 0, 0)
        for name, text, signal in (
            ("furrowmapReplace", self.tr("Replace them"), self.replace_wanted),
            ("furrowmapKeepBoth", self.tr("Keep both"), self.keep_wanted),
        ):
            button = QPushButton(text, objectName=name)
            button.clicked.connect(partial(self._run_again, signal))
            row.addWidget(button)
        layout = QVBoxLayout(self.error)
        layout.setContentsMargins(0, 0, 0, 0)
        self.anyway = QPushButton(self.tr("Run without accuracy"), objectName="furrowmapRunAnyway")
        self.anyway.clicked.connect(self._run_anyway)
        layout.addWidget(self.error_text)
        layout.addWidget(self.choice)
        layout.addWidget(self.anyway)
        self.replace_machine = QPushButton(self.tr("Replace the machine"), objectName="furrowmapReplaceMachine")
        self.replace_machine.clicked.connect(partial(self._save_machine, self.machine_replaced))
        layout.addWidget(self.replace_machine)
        self.error.hide()
        return self.error

    def _run_again(self, signal, *_):
        if self._is_saved():
            signal.emit(self._path)

    def _run_anyway(self):
        if self._is_saved():
            self.run_wanted.emit(self._path)

    def _machine_group(self):
        group, form = group_box(self.tr("Machine"))
        self.machine = QComboBox(objectName="furrowmapMachine", editable=True)
        self.machine.setInsertPolicy(QComboBox.InsertPolicy.NoInsert)
        self.machine.lineEdit().setPlaceholderText(self.tr("Choose a saved machine, or type a name"))
        self.machine.activated.connect(self._use_machine)
        row = QWidget()
        layout = QHBoxLayout(row)
        layout.setContentsMargins(0, 0, 0, 0)
        for name, text, slot in (
            ("furrowmapSaveMachine", self.tr("Save as machine"), partial(self._save_machine, self.machine_wanted)),
            ("furrowmapCalibrate", self.tr("Calibrate"), self._calibrate),
        ):
            button = QPushButton(text, objectName=name)
            button.clicked.connect(slot)
            layout.addWidget(button)
        button.setToolTip(
            self.tr("Find the scanner's angles in the recording; write them into the session and the chosen machine.")
        )
        form.addRow(self.machine)
        form.addRow(row)
        return group

    def _use_machine(self, *_):
        name = self.machine.currentText()
        try:
            self.use_places(read_places(machine_path(name)))
        except (OSError, UnicodeDecodeError, NotSimpleError):
            self._show_fault(self.tr("The machine {name} cannot be read.").format(name=name))

    def _save_machine(self, signal, *_):
        name = self.machine.currentText().strip()
        if not name:
            self._show_fault(self.tr("Type a name for the machine."))
        elif {"no-mounting", "no-antenna"} & set(self.missing()):
            self._show_fault(self.tr("Fill in the positions of antenna and scanner first."))
        elif self._is_saved():
            signal.emit(self._path, name)

    def _calibrate(self):
        fault = self.fault()
        if not fault and self._without_mounting():
            fault = self.tr("Fill in the position and the approximate angles of the scanner first.")
        name = self.machine.currentText().strip()
        if not fault and name and name not in machine_names():
            fault = self.tr(
                "No machine {name} is saved. Press 'Save as machine' first, or clear the name to calibrate the session "
                "alone."
            ).format(name=name)
        if fault:
            self._show_fault(fault)
        elif self._is_saved():
            self.calibration_wanted.emit(self._path, name)

    def _session_group(self):
        group, form = group_box(self.tr("Session"))
        self.name = QLineEdit(objectName="furrowmapName")
        self.recordings = QLabel(objectName="furrowmapRecordings")
        self.recordings.setWordWrap(True)
        self.crs = QgsProjectionSelectionWidget()
        self.crs.setObjectName("furrowmapCrs")
        self.crs.setOptionVisible(QgsProjectionSelectionWidget.CrsOption.CrsNotSet, True)  # noqa: FBT003
        self.crs.setNotSetText(self.tr("Not known: choose it"))
        self.crs.crsChanged.connect(self._draw)
        form.addRow(self.tr("Name"), self.name)
        form.addRow(self.tr("Recordings"), self.recordings)
        form.addRow(self.tr("CRS"), self.crs)
        form.addRow(small_text(text=self.tr("A projected CRS in metres, for computation and output.")))
        return group

    def _antenna_group(self):
        self.antenna_group, form = group_box(self.tr("GNSS antenna"), self._draw)
        self.antenna_group.setObjectName("furrowmapAntennaGroup")
        self.antenna = self._metres("furrowmapAntenna", 3)
        form.addRow(row_of(self.tr("x, y, z"), self.antenna))
        form.addRow(
            small_text(
                text=self.tr(
                    "Phase centre of the antenna, from the point on the ground below the middle of the rear axle: "
                    "forward, left, up. A centimetre is accurate enough. Unchecked: not known."
                )
            )
        )
        return self.antenna_group

    def _lidar_group(self):
        self.lidar_group, form = group_box(self.tr("Scanner"))
        self.lidar_xyz = self._metres("furrowmapLidar", 3)
        self.lidar_rpy = [self._spin(f"furrowmapLidarTurn{k}", 360.0, "°", 3, 1.0) for k in range(3)]
        form.addRow(row_of(self.tr("x, y, z"), self.lidar_xyz))
        form.addRow(row_of(self.tr("roll, pitch, yaw"), self.lidar_rpy))
        form.addRow(
            small_text(
                text=self.tr(
                    "Position, and rotation from level with the cable to the rear. A scanner that faces backwards and "
                    "is tilted down has about 0, 40, 180. The run refines the angles; within 2° is accurate enough."
                )
            )
        )
        return self.lidar_group

    def _implement_group(self):
        self.implement_group, form = group_box(self.tr("Implement"), self._draw)
        self.implement_group.setObjectName("furrowmapImplementGroup")
        self.kind = QLineEdit(objectName="furrowmapKind")
        self.width_m = self._spin("furrowmapWidth", MAX_OFFSET_M, " m", 2, 0.05, low=0.0)
        self.implement_xy = self._metres("furrowmapImplementXy", 2)
        self.depth_m = self._spin("furrowmapDepth", 1.0, " m", 2, 0.01, low=0.0)
        form.addRow(self.tr("Kind"), self.kind)
        form.addRow(self.tr("Width"), self.width_m)
        form.addRow(row_of(self.tr("x, y"), self.implement_xy))
        form.addRow(self.tr("Depth"), self.depth_m)
        form.addRow(
            small_text(
                text=self.tr(
                    "Working width, and the middle of the working line relative to the rear axle; x is negative behind "
                    "it. Depth 0 means unknown. Unchecked: no worked ground is computed."
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
        form.addRow(small_text(text=self.tr("Optional: a polygon in the session's folder, to find missed ground.")))
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
            self._show_fault(fault)
        elif self._is_saved():
            self.preview_wanted.emit(self._path)

    def _save_and_run(self):
        fault = self.fault()
        if fault:
            self._show_fault(fault)
        elif {"no-mounting", "no-antenna"} & set(self.missing()):
            self._ask()
        elif self._is_saved():
            self.run_wanted.emit(self._path)

    def _ask(self):
        """Ask before a run whose places are not filled in."""
        self.error_text.setText(findings_html(None, [c for c in self.missing() if c in ("no-mounting", "no-antenna")]))
        self.choice.hide()
        self.replace_machine.hide()
        self.anyway.show()
        self.error.show()
        self._scroll.verticalScrollBar().setValue(0)

    def _is_saved(self):
        """Save; returns whether that succeeded, else shows why not."""
        try:
            self.save()
        except OSError as error:
            self._show_fault(
                self.tr("{path} cannot be written: {reason}.").format(path=self._path, reason=error.strerror)
            )
            return False
        return True

    def _show_fault(self, fault):
        self.findings.setText(f"<b>{escaped(fault)}</b>")
        self._scroll.ensureWidgetVisible(self.findings)

    def _draw(self, *_):
        if self._lines is not None:
            self._mark(self.antenna_group, self.tr("GNSS antenna"), self._without_antenna())
            self._mark(self.lidar_group, self.tr("Scanner"), self._without_mounting())
        checked = self.implement_group.isChecked()
        self.vehicle.show_placement(
            Placement(
                tuple(values_of(self.lidar_xyz)),
                tuple(values_of(self.lidar_rpy)),
                tuple(values_of(self.antenna)) if self.antenna_group.isChecked() else None,
                tuple(values_of(self.implement_xy)) if checked else None,
                self.width_m.value() if checked else 0.0,
                self.depth_m.value() if checked else 0.0,
            )
        )

    def _mark(self, group, title, missing):
        """Say in the title of a group that it is still to be filled in."""
        group.setTitle(self.tr("{title}: not filled in").format(title=title) if missing else title)
        group.setStyleSheet("QGroupBox::title { color: #b45f06; }" if missing else "")

    def _metres(self, name, count):
        return [self._spin(f"{name}{k}", MAX_OFFSET_M, " m", 3, 0.01) for k in range(count)]

    def _spin(self, name, limit, suffix, decimals, step, *, low=None):
        box = QDoubleSpinBox(objectName=name)
        box.setRange(-limit if low is None else low, limit)
        box.setDecimals(decimals)
        box.setSingleStep(step)
        box.setSuffix(suffix)
        box.setFocusPolicy(Qt.FocusPolicy.StrongFocus)
        box.valueChanged.connect(self._draw)
        return box
