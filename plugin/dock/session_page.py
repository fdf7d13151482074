# SPDX-License-Identifier: GPL-2.0-or-later
"""The form of a session: findings in the recordings, the measured dimensions, and a drawing of the vehicle."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from contextlib import suppress
from functools import partial
from html import escape
from pathlib import Path
from typing import Any

from qgis.core import QgsCoordinateReferenceSystem
from qgis.gui import QgsFileWidget, QgsProjectionSelectionWidget
from qgis.PyQt.QtCore import Qt, QTimer, pyqtSignal
from qgis.PyQt.QtWidgets import QComboBox, QGroupBox, QLabel, QLineEdit, QScrollArea, QVBoxLayout, QWidget

from ..platforms import resolved
from .flight_parts import FLIGHT_VALUES, FlightParts, is_flight, remedy_words
from .form_parts import (
    FILL_IN,
    MAX_OFFSET_M,
    below,
    button,
    fill,
    findings_html,
    group_box,
    is_dark,
    metre_boxes,
    name_within,
    number_box,
    row_of,
    same_value,
    side_by_side,
    small_text,
    texts_of,
    turn_boxes,
    value_of,
    values_of,
)
from .machines import LEARNED_FILE, PLACES, Places, machine_names, machine_path, read_places
from .places import choose_folder, default_folder, folder_for
from .session_lines import NotSimpleError, SessionLines
from .vehicle_view import VehiclePlaces, VehicleView

IMPLEMENT = "implement"
OF_IMPLEMENT = tuple(place for place in PLACES if place[0] == IMPLEMENT)
SHOWN = (
    *((("", "name"), ("crs", "map"), ("recording", "lidar"), ("recording", "gnss"), ("trajectory", "files"))),
    *((("implement", "states"), ("field", "boundary"), *PLACES, *FLIGHT_VALUES)),
)
"""Tables and keys whose values the form has."""
PLACES_ASKED = ("no-mounting", "no-antenna")
"""Codes of missing places: the form asks before it runs a session without them."""


class SessionPage(QWidget):
    """The form.

    Signals:
        run_wanted, preview_wanted, saved: with the saved session file.
        copy_wanted: with the session's folder, which is read-only, to copy it.
        replace_wanted: with the session file, to run it in place of the products of another recording.
        keep_wanted: with the session file, to run it into a folder of its own.
        machine_wanted: with the saved session file and a name, to save its machine.
        machine_replaced: likewise, in place of a saved machine of this name.
        calibration_wanted: with the saved session file and the name of its machine, or "".
    """

    run_wanted = pyqtSignal(object)
    preview_wanted = pyqtSignal(object)
    saved = pyqtSignal(object)
    copy_wanted = pyqtSignal(object)
    left = pyqtSignal()
    replace_wanted = pyqtSignal(object)
    keep_wanted = pyqtSignal(object)
    machine_wanted = pyqtSignal(object, str)
    machine_replaced = pyqtSignal(object, str)
    calibration_wanted = pyqtSignal(object, str)

    def __init__(self) -> None:
        super().__init__()
        self.path = Path()
        self._lines = SessionLines("")
        self._filled: dict[Any, Any] = {}
        self._found: dict[str, Any] | None = None
        self._files: list[str] = []
        self._remedy: dict[str, Any] | None = None
        self._tool = IMPLEMENT
        self._learned: Path | None = None
        self.flight = False
        inside = QWidget()
        layout = QVBoxLayout(inside)
        self.findings = small_text("furrowmapFindings")
        self.vehicle = VehicleView()
        self.flight_parts = FlightParts(self._draw)
        for widget in (
            self._error_part(),
            self.findings,
            self._session_group(),
            self._machine_group(),
            self.vehicle,
            self._antenna_group(),
            self._lidar_group(),
            self.flight_parts,
            self._implement_group(),
            self._field_group(),
            self._output_group(),
        ):
            layout.addWidget(widget)
        layout.addStretch()
        self._scroll = QScrollArea(widgetResizable=True)
        self._scroll.setFrameShape(QScrollArea.Shape.NoFrame)
        self._scroll.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
        self._scroll.setWidget(inside)
        bar = self._scroll.verticalScrollBar().sizeHint().width()
        self._scroll.setMinimumWidth(inside.minimumSizeHint().width() + bar + 2)
        self.preview = small_text("furrowmapPreviewWords")
        self.preview.hide()
        self.remedy = button("furrowmapRemedy", "", self._use_remedy)
        self.remedy.hide()
        run = button("furrowmapRun", self.tr("Save and run"), self._save_and_run)
        run.setDefault(True)
        buttons = side_by_side(
            button("furrowmapBack", self.tr("Back"), self.left.emit),
            button("furrowmapSave", self.tr("Save"), partial(self._save_and, self.saved)),
            button("furrowmapPreview", self.tr("Preview"), self._save_and_preview),
            run,
        )
        whole = QVBoxLayout(self)
        whole.setContentsMargins(0, 0, 0, 0)
        whole.addWidget(self._scroll, 1)
        whole.addWidget(self.preview)
        whole.addWidget(self.remedy)
        whole.addWidget(buttons)

    def show_session(self, path: Path, findings: dict[str, Any] | None = None) -> None:
        """Read a session file into the form, with the answer of `furrowmap init` shown above it.

        Raises NotSimpleError if the form cannot edit the file, OSError or UnicodeDecodeError if it cannot be read.
        """
        lines = SessionLines(path.read_bytes().decode("utf-8"))
        for place in SHOWN:
            lines.get(*place)
        for table in lines.tables(IMPLEMENT):
            for key in ("kind", "width_m", "xy_m", "working_depth_m", "name", "learned"):
                lines.get(table, key)
        self._lines = lines
        self.path = path
        self._learned = None
        self.name.setText(str(lines.get("", "name") or ""))
        of_recording = (("recording", "lidar"), ("recording", "gnss"), ("trajectory", "files"), ("implement", "states"))
        self._files = [file for place in of_recording for file in texts_of(lines.get(*place))]
        self.flight = is_flight(lines)
        self.vehicle_kind.setCurrentIndex(int(self.flight))
        words = {FILL_IN: self.tr("(missing: drop the recording here)")}
        self.recordings.setText("\n".join(words.get(file, file) for file in self._files))
        code = lines.get("crs", "map")
        self.crs.setCrs(QgsCoordinateReferenceSystem("" if code in (None, FILL_IN) else str(code)))
        self.flight_parts.show_session(lines, path.parent, flight=self.flight)
        self._tool = IMPLEMENT
        self._fill_places(self._places_in_lines())
        self._show_tools()
        self._show_hints()
        self.boundary.setDefaultRoot(str(path.parent))
        self.boundary.setFilePath(str(lines.get("field", "boundary") or ""))
        chosen = folder_for(path)
        self.output.setFilePath("" if chosen == default_folder(path) else str(chosen))
        self.output.lineEdit().setPlaceholderText(str(default_folder(path)))
        self.output_fault.hide()
        self._filled = self._values()
        self.flight_parts.begin(lines)
        self._found = findings
        self.error.hide()
        self.show_preview_status("")
        self.show_machines()
        self._draw()
        self._scroll.verticalScrollBar().setValue(0)

    def _values(self) -> dict[Any, Any]:
        """What the form holds, by names of values: only those that differ from what was filled in are written."""
        return {
            "name": self.name.text(),
            "crs": self.crs.crs().toWkt(),
            "boundary": self.boundary.filePath(),
            **self.places(),
        }

    def _edited(self, *names: Any) -> bool:
        """Whether one of the values was changed since the session was read."""
        now = self._values()
        return any(now[name] != self._filled.get(name) for name in names)

    def output_folder(self) -> Path:
        """The folder for the products."""
        return folder_for(self.path)

    def ask_for_output(self, text: str) -> None:
        """Show why the products cannot be written to their folder, and have another one chosen."""
        remedy = self.tr("Choose another folder, then run again.")
        self.output_fault.setText(f"<b>{escaped(text)}</b><br>{escaped(remedy)}")
        self.output_fault.show()
        QTimer.singleShot(0, partial(self._scroll.ensureWidgetVisible, self.output_group))  # once it has its new height
        self.output.setFocus()

    def _change_kind(self, number: int) -> None:
        self.flight = number == 1
        self.flight_parts.show_session(self._lines, self.path.parent, flight=self.flight)
        self._show_hints()
        self._draw()

    def _show_hints(self) -> None:
        """Ask for what the vehicle can have: an aircraft has no implement, and no rear axle to measure from."""
        self.implement_group.setVisible(not self.flight)
        self.lidar_group.setVisible(bool(texts_of(self._lines.get("recording", "lidar"))))
        origin = self.tr(
            "Phase centre of the antenna, from the point on the ground below the middle of the rear axle: "
            "forward, left, up. A centimetre is accurate enough. Unchecked: not known."
        )
        if self.flight:
            origin = self.tr(
                "Phase centre of the antenna in the aircraft's frame: forward, left, up. Any point may be the origin "
                "of that frame; if it is the antenna, 0, 0, 0. A centimetre is accurate enough. Unchecked: not known."
            )
        self.antenna_hint.setText(origin)
        turns = self.tr(
            "Position, and rotation from level with the cable to the rear. A scanner that faces backwards and "
            "is tilted down has about 0, 40, 180. The run refines the angles; within 2° is accurate enough."
        )
        if self.flight:
            turns = self.tr(
                "Position in the same frame, and rotation of the scanner's axes from forward, left, up; its spin axis "
                "is z. One that sweeps across the track has about -90, 0, -90. The run refines the angles; within 2° "
                "is accurate enough."
            )
        names = [str(self._lines.get(table, "name")) for table in self._lines.tables("lidar")]
        if len(names) > 1:
            several = self.tr("Scanners of this session: {}. Shown here is the first; the others stay as they are.")
            turns = f"{several.format(', '.join(names))} {turns}"
        self.lidar_hint.setText(turns)

    def _write_findings(self, missing: Sequence[str]) -> None:
        """List what was found and what is missing; what is below stays where it is on the screen."""
        page = findings_html(self._found, missing, flight=self.flight)
        width = self.findings.width()
        if page != self.findings.text():
            higher = -self.findings.heightForWidth(width)
            self.findings.setText(page)
            higher += self.findings.heightForWidth(width)
            bar = self._scroll.verticalScrollBar()
            bar.setValue(bar.value() + higher if bar.value() else 0)
        if self.anyway.isVisible() and not set(PLACES_ASKED) & set(missing):
            self.error.hide()

    def _fill_places(self, places: Places) -> None:
        self.antenna_group.setChecked(places["antenna", "xyz_m"] is not None)
        fill(self.antenna, places["antenna", "xyz_m"])
        fill(self.lidar_xyz, places["lidar", "xyz_m"])
        fill(self.lidar_rpy, places["lidar", "rpy_deg"])
        self.implement_group.setChecked(places["implement", "width_m"] is not None)
        self.kind.setText(str(places["implement", "kind"] or ""))
        fill([self.width_m], [places["implement", "width_m"]])
        fill(self.implement_xy, places["implement", "xy_m"])
        fill([self.depth_m], [places["implement", "working_depth_m"]])
        self.flight_parts.fill_places(places)

    def places(self) -> Places:
        """The places of the machine in the form, by table and key."""
        with_tool = self._with_implement()
        return {
            ("antenna", "xyz_m"): values_of(self.antenna) if self.antenna_group.isChecked() else None,
            ("lidar", "xyz_m"): values_of(self.lidar_xyz),
            ("lidar", "rpy_deg"): values_of(self.lidar_rpy),
            ("implement", "kind"): self.kind.text() if with_tool else None,
            ("implement", "width_m"): value_of(self.width_m) if with_tool else None,
            ("implement", "xy_m"): values_of(self.implement_xy) if with_tool else None,
            ("implement", "working_depth_m"): value_of(self.depth_m) if with_tool else None,
            LEARNED_FILE: self._learned,
            **self.flight_parts.places(self._lines),
        }

    def _with_implement(self) -> bool:
        return self.implement_group.isChecked() and not self.flight

    def use_machine(self, path: Path) -> None:
        """Fill in the places of a profile."""
        try:
            self.use_places(read_places(path))
        except (OSError, UnicodeDecodeError, NotSimpleError):
            self._show_fault(self.tr("The machine {name} cannot be read.").format(name=path.stem))

    def use_places(self, places: Places) -> None:
        """Fill in the places of a machine; what it does not have stays as it is, and so do several implements.

        What was learned of its implement is copied into the session's folder when the session is saved.
        """
        kept = IMPLEMENT if len(self._lines.tables(IMPLEMENT)) > 1 else ""
        known = {place: value for place, value in places.items() if value not in (None, "") and place[0] != kept}
        self._fill_places({**self.places(), **known})
        self._learned = known.get(LEARNED_FILE)
        self._draw()

    def show_machines(self, chosen: str = "") -> None:
        """List the saved machines; the one with the form's places is selected unless another one is chosen."""
        names = machine_names()
        self.machine.clear()
        self.machine.addItems(names)
        self.machine.setEditText(chosen or next(filter(self._is_of_form, names), ""))

    def _is_of_form(self, name: str) -> bool:
        """Whether a saved machine has the places in the form."""
        try:
            saved = read_places(machine_path(name))
        except (OSError, UnicodeDecodeError, NotSimpleError):
            return False
        shown = self.places()
        # of an IMU and a camera the form shows the places only where the session has them
        asked = {place for place in PLACES if place[0] not in ("imu", "camera") or self._lines.has(place[0])}
        known = {place: value for place, value in saved.items() if value not in (None, "") and place in asked}
        return bool(known) and all(same_value(shown[place], value) for place, value in known.items())

    def recordings_beside(self, recordings: Sequence[Path]) -> list[Path] | None:
        """The recordings of a session in the form that lacks one, if `recordings` are in its folder; else None."""
        if FILL_IN not in self._files:
            return None
        folder = resolved(self.path.parent)
        inside = all(resolved(path).is_relative_to(folder) for path in recordings)
        return [folder / name for name in self._files if name != FILL_IN] if inside else None

    def missing(self) -> list[str]:
        """Codes of what is still to be filled in, as `furrowmap init` has them."""
        needed = {
            "no-lidar": FILL_IN in texts_of(self._lines.get("recording", "lidar")),
            "no-positions": FILL_IN in texts_of(self._lines.get("recording", "gnss")),
            "no-crs": not self.crs.crs().isValid(),
            "no-mounting": self._without_mounting(),
            "no-antenna": self._without_antenna(),
            "no-implement": not self.flight and not self.implement_group.isChecked(),
            "no-imu-mounting": self.flight_parts.without_imu_place(self._lines),
            "camera-uncalibrated": self.flight_parts.without_camera(),
        }
        return [code for code, wanted in needed.items() if wanted]

    def _without_mounting(self) -> bool:
        lines = self._lines
        stated = None not in (lines.get("lidar", "xyz_m"), lines.get("lidar", "rpy_deg"))
        scans = bool(texts_of(lines.get("recording", "lidar")))
        return scans and not stated and not any(values_of(self.lidar_xyz))

    def _without_antenna(self) -> bool:
        if self._lines.has("trajectory"):
            return False
        # On an aircraft the antenna may be the origin; on a tractor that lies on the ground.
        stated = self.flight or self._lines.get("antenna", "xyz_m") is not None
        return not (self.antenna_group.isChecked() and (stated or any(values_of(self.antenna))))

    def show_remedy(self, setting: dict[str, Any] | None) -> None:
        """Offer the value that remedies an error: its table, key and value; None offers nothing."""
        self._remedy = setting
        self.remedy.setVisible(setting is not None)
        if setting is not None:
            self.remedy.setText(remedy_words(setting))

    def _use_remedy(self) -> None:
        """Enter the offered value, and preview the session again."""
        fault = self._written()
        if fault or self._remedy is None:
            self._show_fault(fault)
            return
        self._lines.set(self._remedy["table"], self._remedy["key"], self._remedy["value"])
        self._fill_places(self._places_in_lines())
        self.show_remedy(None)
        self.error.hide()
        self._draw()
        self._save_and_preview()

    def show_error(self, text: str, *, may_replace: bool) -> None:
        """Show why a run failed, in full, above the form.

        Args:
            may_replace: offer to replace the products in its folder, or to keep both, instead of the last line, which
                names options of the command line.
        """
        what, *rest = text.splitlines()[: 2 if may_replace else None]
        self._show_above("<br>".join([f"<b>{escaped(what)}</b>", *map(escaped, rest)]))
        self.choice.setVisible(may_replace)

    def _show_above(self, page: str) -> None:
        """Show rich text above the form, without buttons."""
        self.error_text.setText(page)
        for part in (self.choice, self.anyway, self.replace_machine, self.copy):
            part.hide()
        self.error.show()
        self._scroll.verticalScrollBar().setValue(0)

    def show_known_machine(self, text: str) -> None:
        """Show that a machine of this name is saved, with a button that replaces it."""
        remedy = self.tr("Replace its places by those of the form, or type another name.")
        self.show_error(f"{text.splitlines()[0]}\n{remedy}", may_replace=False)
        self.replace_machine.show()

    def show_preview_status(self, text: str) -> None:
        """Show the progress of a preview above the buttons."""
        self.preview.setText(escaped(text))
        self.preview.setVisible(bool(text))
        self.show_remedy(None)

    def fault_of_preview(self) -> str:
        """Why the session in the form cannot be previewed; "" if it can."""
        if FILL_IN in self._files:
            return self.tr(
                "A recording is missing. Drop it here: the scanner's recording and the receiver's log, from one folder."
            )
        if not self.crs.crs().isValid():
            return self.tr("Choose the map's coordinate reference system.")
        return self.flight_parts.fault()

    def fault(self) -> str:
        """Why the session in the form cannot be run; "" if it can."""
        fault = self.fault_of_preview()
        others = [table for table in self._lines.tables(IMPLEMENT) if table != self._tool]
        widths = [value_of(self.width_m), *(self._lines.get(table, "width_m") or 0.0 for table in others)]
        if not fault and self._with_implement() and min(widths) <= 0:
            return self.tr("Enter the width of the implement, or uncheck 'Implement'.")
        return fault

    def save(self) -> None:
        """Write what was changed in the form into the session file; all else in the file is kept byte by byte."""
        choose_folder(self.path, self.output.filePath())
        lines = self._lines
        if self._edited("name"):
            lines.set("", "name", self.name.text())
        if self._edited("crs") and self.crs.crs().isValid():
            lines.set("crs", "map", self.crs.crs().authid() or self.crs.crs().toWkt())
        # Zeros that nobody typed are not written: the run takes what is not stated as unknown.
        if self._edited(("antenna", "xyz_m")):
            if not self.antenna_group.isChecked():
                lines.drop("antenna")
            elif self.flight or any(values_of(self.antenna)) or lines.has("antenna"):
                lines.set("antenna", "xyz_m", values_of(self.antenna))
        if self._edited(("lidar", "xyz_m"), ("lidar", "rpy_deg")):
            placed = any(values_of(self.lidar_xyz))
            if placed or lines.get("lidar", "xyz_m") is not None:
                lines.set("lidar", "xyz_m", values_of(self.lidar_xyz))
            if placed or any(values_of(self.lidar_rpy)) or lines.get("lidar", "rpy_deg") is not None:
                lines.set("lidar", "rpy_deg", values_of(self.lidar_rpy))
        self._save_implement(lines)
        self.flight_parts.save(lines)
        if self._edited("boundary"):
            boundary = name_within(self.path.parent, self.boundary.filePath())
            if boundary:
                lines.set("field", "boundary", boundary)
            else:
                lines.drop_key("field", "boundary")
        written = lines.text.encode("utf-8")
        if not self.path.is_file() or written != self.path.read_bytes():
            unfinished = self.path.with_name(self.path.name + ".unfinished")
            unfinished.write_bytes(written)
            unfinished.replace(self.path)
        self.flight_parts.keep(lines)
        self._filled = self._values()

    def _save_implement(self, lines: SessionLines) -> None:
        if not self._edited(*OF_IMPLEMENT, LEARNED_FILE):
            return
        if not self._with_implement():
            lines.drop(self._tool)
            self._tool = IMPLEMENT
            if lines.has(IMPLEMENT):  # another one, which is now the first
                self._show_tool(IMPLEMENT)
            return
        lines.set(self._tool, "width_m", value_of(self.width_m))
        lines.set(self._tool, "xy_m", values_of(self.implement_xy))
        if self.kind.text() or lines.get(self._tool, "kind"):
            lines.set(self._tool, "kind", self.kind.text())
        if value_of(self.depth_m) > 0 or lines.get(self._tool, "working_depth_m") is not None:
            lines.set(self._tool, "working_depth_m", value_of(self.depth_m))
        if self._learned is not None:
            with suppress(shutil.SameFileError):  # the profile may be beside the session
                shutil.copyfile(self._learned, self.path.with_name(self._learned.name))
            lines.set(self._tool, "learned", self._learned.name)
            self._learned = None
        tools = lines.tables(IMPLEMENT)
        for number, table in enumerate(tools if len(tools) > 1 else (), 1):  # each of several needs a name of its own
            kind = lines.get(table, "kind")
            name = lines.get(table, "name")
            if not name or (kind and name == self._number_name(number)):
                taken = [lines.get(other, "name") for other in tools if other != table]
                lines.set(table, "name", kind if kind and kind not in taken else self._number_name(number))
        self._show_tools()

    def _number_name(self, number: int) -> str:
        return self.tr("tool {number}").format(number=number)

    def _places_in_lines(self) -> Places:
        """The places in the session's file; of its implements, those of the one that the form shows."""
        tables = [self._tool if table == IMPLEMENT else table for table, _ in PLACES]
        return {place: self._lines.get(table, place[1]) for place, table in zip(PLACES, tables, strict=True)}

    def _show_tools(self) -> None:
        """List the implements, if there are several."""
        tools = self._lines.tables(IMPLEMENT)
        self.tool.clear()
        self.tool.addItems([str(self._lines.get(table, "name") or table) for table in tools])
        self.tool.setCurrentIndex(tools.index(self._tool) if self._tool in tools else 0)
        self.tool.setVisible(len(tools) > 1)

    def _show_tool(self, table: str) -> None:
        """Show another implement of the session in the form."""
        self._tool = table
        of_tool = {place: value for place, value in self._places_in_lines().items() if place[0] == IMPLEMENT}
        self._fill_places({**self.places(), **of_tool})
        self._filled |= {place: self.places()[place] for place in OF_IMPLEMENT}
        self._show_tools()
        self._draw()

    def _choose_tool(self, number: int) -> None:
        chosen = self._lines.tables(IMPLEMENT)[number]
        if self._with_implement():
            self._save_implement(self._lines)
        self._show_tool(chosen)

    def _add_tool(self) -> None:
        self._save_implement(self._lines)
        self._show_tool(self._lines.add(IMPLEMENT))
        self._lines.set(self._tool, "width_m", 0.0)
        self.implement_group.setChecked(True)

    def _error_part(self) -> QWidget:
        self.error_text = small_text("furrowmapErrorText")
        self.choice = side_by_side(
            button("furrowmapReplace", self.tr("Replace them"), partial(self._save_and, self.replace_wanted)),
            button("furrowmapKeepBoth", self.tr("Keep both"), partial(self._save_and, self.keep_wanted)),
        )
        run_anyway = partial(self._save_and, self.run_wanted)
        self.anyway = button("furrowmapRunAnyway", self.tr("Run without accuracy"), run_anyway)
        replace_machine = partial(self._save_machine, self.machine_replaced)
        self.replace_machine = button("furrowmapReplaceMachine", self.tr("Replace the machine"), replace_machine)
        copy_wanted = lambda: self.copy_wanted.emit([self.path.parent])  # noqa: E731
        self.copy = button("furrowmapCopy", self.tr("Copy to a folder of this computer…"), copy_wanted)
        self.error = below(self.error_text, self.choice, self.anyway, self.replace_machine, self.copy)
        self.error.setObjectName("furrowmapError")
        self.error.hide()
        return self.error

    def _machine_group(self) -> QGroupBox:
        self.machine = QComboBox(objectName="furrowmapMachine", editable=True)
        self.machine.setInsertPolicy(QComboBox.InsertPolicy.NoInsert)
        self.machine.lineEdit().setPlaceholderText(self.tr("Choose a saved machine, or type a name"))
        self.machine.activated.connect(lambda _: self.use_machine(machine_path(self.machine.currentText())))
        tip = self.tr("Find the scanner's angles in the recording; write them into the session and the chosen machine.")
        save = partial(self._save_machine, self.machine_wanted)
        buttons = side_by_side(
            button("furrowmapSaveMachine", self.tr("Save as machine"), save),
            button("furrowmapCalibrate", self.tr("Calibrate"), self._calibrate, tip),
        )
        return group_box(self.tr("Machine"), [self.machine, buttons])

    def _save_machine(self, signal: Any) -> None:
        name = self.machine.currentText().strip()
        fault = ""
        if not name:
            fault = self.tr("Type a name for the machine.")
        elif set(PLACES_ASKED) & set(self.missing()):
            fault = self.tr("Fill in the positions of antenna and scanner first.")
        self._save_and(signal, name, fault=fault)

    def _calibrate(self) -> None:
        fault = self.fault()
        if not fault and self._without_mounting():
            fault = self.tr("Fill in the position and the approximate angles of the scanner first.")
        name = self.machine.currentText().strip()
        if not fault and name and name not in machine_names():
            fault = self.tr(
                "No machine {name} is saved. Press 'Save as machine' first, or clear the name to calibrate the session "
                "alone."
            ).format(name=name)
        self._save_and(self.calibration_wanted, name, fault=fault)

    def _session_group(self) -> QGroupBox:
        self.name = QLineEdit(objectName="furrowmapName")
        self.recordings = QLabel(objectName="furrowmapRecordings", wordWrap=True)
        self.crs = QgsProjectionSelectionWidget(objectName="furrowmapCrs")
        self.crs.setOptionVisible(QgsProjectionSelectionWidget.CrsOption.CrsNotSet, True)  # noqa: FBT003
        self.crs.setNotSetText(self.tr("Not known: choose it"))
        self.crs.crsChanged.connect(self._draw)
        self.vehicle_kind = QComboBox(objectName="furrowmapVehicleKind")
        self.vehicle_kind.addItems([self.tr("Tractor or other ground vehicle"), self.tr("Drone or helicopter")])
        self.vehicle_kind.activated.connect(self._change_kind)
        rows = [
            (self.tr("Name"), self.name),
            (self.tr("Recordings"), self.recordings),
            (self.tr("Vehicle"), self.vehicle_kind),
            (self.tr("CRS"), self.crs),
        ]
        hint = self.tr("A projected CRS in metres, for computation and output.")
        return group_box(self.tr("Session"), rows, hint)

    def _antenna_group(self) -> QGroupBox:
        self.antenna = metre_boxes("furrowmapAntenna", 3, self._draw)
        self.antenna_hint = small_text()
        rows = [row_of(self.tr("x, y, z"), self.antenna), self.antenna_hint]
        self.antenna_group = group_box(self.tr("GNSS antenna"), rows, "", self._draw, "furrowmapAntennaGroup")
        return self.antenna_group

    def _lidar_group(self) -> QGroupBox:
        self.lidar_xyz = metre_boxes("furrowmapLidar", 3, self._draw)
        self.lidar_hint = small_text()
        self.lidar_rpy = turn_boxes("furrowmapLidarTurn", self._draw)
        rows = [row_of(self.tr("x, y, z"), self.lidar_xyz), row_of(self.tr("roll, pitch, yaw"), self.lidar_rpy)]
        self.lidar_group = group_box(self.tr("Scanner"), [*rows, self.lidar_hint])
        return self.lidar_group

    def _implement_group(self) -> QGroupBox:
        self.kind = QLineEdit(objectName="furrowmapKind")
        self.width_m = number_box("furrowmapWidth", MAX_OFFSET_M, " m", 2, 0.05, low=0.0)
        self.implement_xy = metre_boxes("furrowmapImplementXy", 2, self._draw)
        self.depth_m = number_box("furrowmapDepth", 1.0, " m", 2, 0.01, low=0.0)
        for box in (self.width_m, self.depth_m):
            box.valueChanged.connect(self._draw)
        hint = self.tr(
            "Working width, and the middle of the working line relative to the rear axle; x is negative behind "
            "it. Depth 0 means unknown. Unchecked: no worked ground is computed."
        )
        self.tool = QComboBox(objectName="furrowmapTool")
        self.tool.activated.connect(self._choose_tool)
        add = button("furrowmapAddTool", self.tr("Add another tool"), self._add_tool)
        rows = [
            self.tool,
            (self.tr("Kind"), self.kind),
            (self.tr("Width"), self.width_m),
            row_of(self.tr("x, y"), self.implement_xy),
            (self.tr("Depth"), self.depth_m),
            add,
        ]
        self.implement_group = group_box(self.tr("Implement"), rows, hint, self._draw, "furrowmapImplementGroup")
        return self.implement_group

    def _field_group(self) -> QGroupBox:
        self.boundary = QgsFileWidget(objectName="furrowmapBoundary")
        self.boundary.setFilter(self.tr("Polygons (*.geojson *.gpkg *.shp *.kml)"))
        hint = self.tr("Optional: a polygon in the session's folder, to find missed ground.")
        return group_box(self.tr("Field"), [(self.tr("Boundary"), self.boundary)], hint)

    def _output_group(self) -> QGroupBox:
        self.output = QgsFileWidget(objectName="furrowmapOutput")
        self.output.setStorageMode(QgsFileWidget.StorageMode.GetDirectory)
        self.output_fault = small_text("furrowmapOutputFault")
        self.output_fault.hide()
        hint = self.tr("Empty: the folder beside the session that is shown in grey.")
        rows = [self.output_fault, (self.tr("Folder"), self.output)]
        self.output_group = group_box(self.tr("Results"), rows, hint)
        return self.output_group

    def _save_and(self, signal: Any, *words: str, fault: str = "") -> None:
        """Save, and emit a signal with the file; show the fault, if there is one, or why the file cannot be written."""
        fault = fault or self._written()
        if fault:
            self._show_fault(fault)
        else:
            signal.emit(self.path, *words)

    def _written(self) -> str:
        """Save; returns why that is not possible, "" if it was."""
        try:
            self.save()
        except OSError as error:
            text = self.tr("{path} cannot be written: {reason}.").format(path=self.path, reason=error.strerror)
            remedy = self.tr("Copy the session and its recordings to a folder of this computer.")
            self._show_above(f"<b>{escaped(text)}</b><br>{escaped(remedy)}")
            self.copy.show()
            return text
        return ""

    def _save_and_preview(self) -> None:
        self._save_and(self.preview_wanted, fault=self.fault_of_preview())

    def _save_and_run(self) -> None:
        fault = self.fault()
        missing = [code for code in self.missing() if code in PLACES_ASKED]
        if missing and not fault:  # ask first
            self._show_above(findings_html(None, missing, flight=self.flight))
            self.anyway.show()
        else:
            self._save_and(self.run_wanted, fault=fault)

    def _show_fault(self, fault: str) -> None:
        """Show a fault in place of the findings, until the form is changed."""
        self.findings.setText(f"<b>{escaped(fault)}</b>")
        self._scroll.ensureWidgetVisible(self.findings)

    def _draw(self, *_: object) -> None:
        missing = self.missing()
        parts = self.flight_parts
        self._write_findings(missing)
        self._mark(self.antenna_group, self.tr("GNSS antenna"), missing="no-antenna" in missing)
        self._mark(self.lidar_group, self.tr("Scanner"), missing="no-mounting" in missing)
        self._mark(parts.imu_group, self.tr("IMU"), missing="no-imu-mounting" in missing)
        self._mark(parts.camera_group, self.tr("Camera"), missing="camera-uncalibrated" in missing)
        places = self.places()
        with_tool = self._with_implement()
        self.vehicle.show_places(
            VehiclePlaces(
                values_of(self.lidar_xyz),
                values_of(self.lidar_rpy),
                places["antenna", "xyz_m"],
                places["implement", "xy_m"],
                value_of(self.width_m) if with_tool else 0.0,
                value_of(self.depth_m) if with_tool else 0.0,
                places["imu", "xyz_m"],
                places["camera", "xyz_m"],
                flies=self.flight,
            )
        )

    def _mark(self, group: QGroupBox, title: str, *, missing: bool) -> None:
        """Say in the title of a group that it is still to be filled in."""
        mark = "#ffb74d" if is_dark(self) else "#b45f06"
        group.setTitle(self.tr("{title}: not filled in").format(title=title) if missing else title)
        group.setStyleSheet(f"QGroupBox::title {{ color: {mark}; }}" if missing else "")


def escaped(text: str) -> str:
    """Plain text as rich text."""
    return escape(text, quote=False)
