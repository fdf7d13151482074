# SPDX-License-Identifier: GPL-2.0-or-later
"""The parts of the form for an IMU, a camera and the parcels of a trial, as flights have them."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from qgis.gui import QgsFileWidget
from qgis.PyQt.QtCore import QCoreApplication
from qgis.PyQt.QtGui import QImageReader
from qgis.PyQt.QtWidgets import QComboBox, QLabel, QVBoxLayout, QWidget

from .form_parts import fill, group_box, metre_boxes, name_within, number_box, row_of, turn_boxes, values_of
from .machines import Places
from .session_lines import SessionLines

tr = partial(QCoreApplication.translate, "FlightParts")

IMU_CHOICES = ("consumer", "industrial", "tactical")
CAMERA_PIXELS = ("width", "height", "fx", "fy", "cx", "cy")
CAMERA_DISTORTION = ("k1", "k2", "p1", "p2")
FLIGHT_VALUES = (
    *((("imu", "files"), ("camera", "table"), ("camera", "files"), ("camera", "model"))),
    *((("parcels", "file"), ("parcels", "treatments"))),
    *(("camera", key) for key in (*CAMERA_PIXELS, *CAMERA_DISTORTION)),
    ("parcels", "net_inset_m"),
)
"""Tables and keys that these parts have beside places."""
MOST_PIXELS = 100_000.0
LOOKING_DOWN = [180.0, 0.0, -90.0]
"""Roll, pitch, yaw of a camera that looks down, with the top of its images forward."""
FLIGHT_TABLES = ("imu", "attitude", "camera", "parcels")
"""A session with one of these tables and no implement is shown as a flight."""


def is_flight(lines: SessionLines) -> bool:
    """Whether a session is one of an aircraft: `furrowmap init` proposes no implement for it, not even as a comment."""
    if lines.has("implement") or not any(map(lines.has, FLIGHT_TABLES)):
        return False
    return "# [implement]" not in lines.text or lines.get("recording", "lidar") is None


class FlightParts(QWidget):
    """Groups for IMU, camera and parcels."""

    def __init__(self, on_change: Callable[..., None]) -> None:
        super().__init__()
        self._folder = Path()
        self._flight = False
        self._with_model = False
        self._filled: dict[Any, Any] = {}
        layout = QVBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        for group in (self._imu_group(on_change), self._camera_group(on_change), self._parcels_group()):
            layout.addWidget(group)

    def show_session(self, lines: SessionLines, folder: Path, *, flight: bool) -> None:
        """Read a session in `folder`: its IMU if it has one, camera and parcels where they are or could be."""
        self._folder = folder
        self._flight = flight
        self.imu_group.setVisible(lines.has("imu"))
        self.camera_group.setVisible(flight or lines.has("camera"))
        self.parcels_group.setVisible(flight or lines.has("parcels"))
        files = lines.get("imu", "files")
        self.imu_files.setText(", ".join(map(str, files)) if isinstance(files, list) else "")
        self.camera_group.setChecked(lines.has("camera"))
        for widget, place in (
            (self.table, ("camera", "table")),
            (self.parcels, ("parcels", "file")),
            (self.treatments, ("parcels", "treatments")),
        ):
            widget.setDefaultRoot(str(folder))
            widget.setFilePath(str(lines.get(*place) or ""))
        self.table.setEnabled(lines.get("camera", "files") is None)
        self._with_model = lines.get("camera", "model") is not None
        fill(self.pixels, [lines.get("camera", key) or 0.0 for key in CAMERA_PIXELS])
        fill(self.distortion, [lines.get("camera", key) or 0.0 for key in CAMERA_DISTORTION])
        for box in (*self.pixels, *self.distortion):
            box.setEnabled(not self._with_model)
        fill(self.net_inset, lines.get("parcels", "net_inset_m"))
        self._fill_size()

    def fill_places(self, places: Places) -> None:
        """Fill in the places of IMU and camera."""
        fill(self.imu_xyz, places["imu", "xyz_m"])
        fill(self.imu_rpy, places["imu", "rpy_deg"])
        self.imu_class.setEditText(str(places["imu", "class"] or ""))
        fill(self.camera_xyz, places["camera", "xyz_m"])
        fill(self.camera_rpy, places["camera", "rpy_deg"] or (LOOKING_DOWN if self._flight else None))

    def begin(self, lines: SessionLines) -> None:
        """The session is shown whole: what differs from now on was changed."""
        self._fill_size()
        self.keep(lines)

    def places(self, lines: SessionLines) -> Places:
        """The places of IMU and camera in the form; None for those that the session does not have."""
        imu = lines.has("imu")
        camera = self._has_camera()
        return {
            ("imu", "xyz_m"): values_of(self.imu_xyz) if imu else None,
            ("imu", "rpy_deg"): values_of(self.imu_rpy) if imu else None,
            ("imu", "class"): self.imu_class.currentText().strip() if imu else None,
            ("camera", "xyz_m"): values_of(self.camera_xyz) if camera else None,
            ("camera", "rpy_deg"): values_of(self.camera_rpy) if camera else None,
        }

    def _values(self, lines: SessionLines) -> dict[Any, Any]:
        """What the groups hold: only a group of which something differs from what was filled in is written."""
        pixels = values_of([*self.pixels, *self.distortion])
        parcels = (self.parcels.filePath(), self.treatments.filePath(), values_of(self.net_inset))
        return {
            "camera": (self._has_camera(), self.table.filePath(), pixels),
            "parcels": parcels,
            **self.places(lines),
        }

    def keep(self, lines: SessionLines) -> None:
        """Take what the groups hold for what the session has."""
        self._filled = self._values(lines)

    def save(self, lines: SessionLines) -> None:
        """Write what was changed in the groups into a session; zeros that nobody typed are not written."""
        now = self._values(lines)
        changed = {name for name, value in now.items() if value != self._filled.get(name)}
        for (table, key), value in self.places(lines).items():
            if (table, key) not in changed and not (table == "camera" and "camera" in changed):
                continue
            typed = any(value) if isinstance(value, list) else bool(value)
            if typed or (value is not None and lines.get(table, key) is not None):
                lines.set(table, key, value)
        if changed & {"camera", ("camera", "xyz_m"), ("camera", "rpy_deg")}:
            self._save_camera(lines)
        if "parcels" in changed:
            self._save_parcels(lines)

    def _save_parcels(self, lines: SessionLines) -> None:
        parcels = name_within(self._folder, self.parcels.filePath())
        if not parcels:
            lines.drop("parcels")
            return
        lines.set("parcels", "file", parcels)
        inset = values_of(self.net_inset)
        treatments = name_within(self._folder, self.treatments.filePath())
        if any(inset) or lines.get("parcels", "net_inset_m") is not None:
            lines.set("parcels", "net_inset_m", inset)
        if treatments:
            lines.set("parcels", "treatments", treatments)
        else:
            lines.drop_key("parcels", "treatments")

    def _save_camera(self, lines: SessionLines) -> None:
        if not self._has_camera():
            lines.drop("camera")
            return
        table = name_within(self._folder, self.table.filePath())
        if table:
            lines.set("camera", "table", table)
        if self._with_model or not any(values_of(self.pixels[2:])):  # the size alone is not written
            return
        for key, value in zip(
            (*CAMERA_PIXELS, *CAMERA_DISTORTION), values_of([*self.pixels, *self.distortion]), strict=True
        ):
            if value or lines.get("camera", key) is not None:
                lines.set("camera", key, int(value) if key in ("width", "height") else value)

    def _has_camera(self) -> bool:
        """Whether images are used."""
        return self.camera_group.isChecked() and not self.camera_group.isHidden()

    def without_imu_place(self, lines: SessionLines) -> bool:
        """Whether the mounting of the session's IMU is still to be filled in."""
        return lines.has("imu") and lines.get("imu", "xyz_m") is None and not any(values_of(self.imu_xyz))

    def without_camera(self) -> bool:
        """Whether images are to be used, but not how they were taken."""
        return self._has_camera() and not (self._with_model or all(values_of(self.pixels)))

    def fault(self) -> str:
        """What of the camera keeps a session from running; "" if nothing."""
        if not self._has_camera():
            return ""
        if not self.table.filePath().strip() and self.table.isEnabled():
            return tr("Choose the camera's table of images, or uncheck 'Camera'.")
        if self.without_camera() and any(values_of(self.pixels[2:])):
            return tr("Enter the size of the images, fx, fy, cx and cy of the camera.")
        return ""

    def _fill_size(self) -> None:
        """Fill in the size of the images from the first one that the table names, where the session states none."""
        if self._with_model or any(values_of(self.pixels[:2])):
            return
        try:
            with (self._folder / self.table.filePath()).open(encoding="utf-8") as lines:
                names = [line.partition(",")[0].strip() for line in (next(lines, ""), next(lines, ""))]
        except (OSError, UnicodeDecodeError):
            return
        size = QImageReader(str(self._folder / names[-1])).size()
        if size.isValid():
            fill(self.pixels[:2], [size.width(), size.height()])

    def _imu_group(self, on_change: Callable[..., None]) -> QWidget:
        self.imu_files = QLabel(objectName="furrowmapImuFiles", wordWrap=True)
        self.imu_xyz = metre_boxes("furrowmapImu", 3, on_change)
        self.imu_rpy = turn_boxes("furrowmapImuTurn", on_change)
        self.imu_class = QComboBox(objectName="furrowmapImuClass", editable=True)
        self.imu_class.addItems(["", *IMU_CHOICES])
        self.imu_class.setToolTip(tr("Its class, or its model, such as VN-200. Empty: industrial."))
        hint = tr(
            "Position of the IMU, and rotation of its axes from forward, left, up. An IMU whose z axis points down has "
            "180, 0, 0."
        )
        rows = [
            (tr("Files"), self.imu_files),
            row_of(tr("x, y, z"), self.imu_xyz),
            row_of(tr("roll, pitch, yaw"), self.imu_rpy),
            (tr("Class"), self.imu_class),
        ]
        self.imu_group = group_box(tr("IMU"), rows, hint, name="furrowmapImuGroup")
        return self.imu_group

    def _camera_group(self, on_change: Callable[..., None]) -> QWidget:
        self.table = QgsFileWidget(objectName="furrowmapImageTable")
        self.table.setFilter(tr("Tables (*.csv)"))
        self.table.fileChanged.connect(self._fill_size)
        self.table.fileChanged.connect(on_change)
        self.pixels = [
            number_box(
                f"furrowmapCamera_{key}", MOST_PIXELS, " px", 0 if key in ("width", "height") else 2, 1.0, low=0.0
            )
            for key in CAMERA_PIXELS
        ]
        self.distortion = [number_box(f"furrowmapCamera_{key}", 10.0, "", 5, 0.001) for key in CAMERA_DISTORTION]
        for box in self.pixels:
            box.valueChanged.connect(on_change)
        self.camera_xyz = metre_boxes("furrowmapCamera", 3, on_change)
        self.camera_rpy = turn_boxes("furrowmapCameraTurn", on_change)
        hint = tr(
            "The table has a row for each image: file and time (UTC). Rotation of the optical frame: x right in the "
            "image, y down, z along the view; looking down with the top of the image forward: 180, 0, -90. Unchecked: "
            "no images are used."
        )
        rows = [
            (tr("Images"), self.table),
            row_of(tr("width, height"), self.pixels[:2]),
            row_of(tr("focal length fx, fy"), self.pixels[2:4]),
            row_of(tr("principal point cx, cy"), self.pixels[4:]),
            row_of(tr("distortion k1, k2"), self.distortion[:2]),
            row_of(tr("distortion p1, p2"), self.distortion[2:]),
            row_of(tr("x, y, z"), self.camera_xyz),
            row_of(tr("roll, pitch, yaw"), self.camera_rpy),
        ]
        self.camera_group = group_box(tr("Camera"), rows, hint, on_change, "furrowmapCameraGroup")
        return self.camera_group

    def _parcels_group(self) -> QWidget:
        self.parcels = QgsFileWidget(objectName="furrowmapParcels")
        self.parcels.setFilter(tr("Polygons (*.geojson *.gpkg *.shp *.kml *.csv)"))
        self.treatments = QgsFileWidget(objectName="furrowmapTreatments")
        self.treatments.setFilter(tr("Tables (*.csv *.xlsx)"))
        self.net_inset = [number_box(f"furrowmapInset{k}", 100.0, " m", 2, 0.05, low=0.0) for k in range(2)]
        hint = tr(
            "Optional: the parcels of a trial, for heights and volumes of the crop. The net parcel lies so far inside. "
            "Treatments: a table with the identifier of each parcel."
        )
        rows = [
            (tr("File"), self.parcels),
            row_of(tr("off each end, off each side"), self.net_inset),
            (tr("Treatments"), self.treatments),
        ]
        self.parcels_group = group_box(tr("Parcels"), rows, hint, name="furrowmapParcelsGroup")
        return self.parcels_group


def remedy_words(setting: dict[str, Any]) -> str:
    """The words of the button that enters a remedy in the form."""
    names = {
        ("imu", "rpy_deg"): tr("roll, pitch, yaw of the IMU"),
        ("imu", "minus_gnss_s"): tr("clock of the IMU minus GNSS time (s)"),
        ("recording", "lidar_minus_gnss_s"): tr("clock of the scanner minus GNSS time (s)"),
        ("implement", "states_minus_gnss_s"): tr("clock of the tool's states minus GNSS time (s)"),
    }
    value = setting["value"]
    place = (setting["table"], setting["key"])
    shown = ", ".join(f"{each:g}" for each in value) if isinstance(value, list) else f"{value}"
    return tr("Enter it: {name} = {value}").format(name=names.get(place, f"[{place[0]}] {place[1]}"), value=shown)
