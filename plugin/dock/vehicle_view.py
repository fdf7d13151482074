# SPDX-License-Identifier: GPL-2.0-or-later
"""A drawing of the vehicle to scale, from the side and from above, with scanner, antenna and implement."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

from qgis.PyQt.QtCore import QCoreApplication, QPointF, QRectF, QSize, Qt
from qgis.PyQt.QtGui import QColor, QPainter, QPaintEvent, QPen, QPolygonF
from qgis.PyQt.QtWidgets import QWidget

from .scan_plane import scan_direction, spin_axis

tr = partial(QCoreApplication.translate, "VehicleView")

REAR_WHEEL_M = 0.55
FRONT_WHEEL_M = 0.36
WHEELBASE_M = 1.75
TRACK_M = 1.25
TYRE_WIDTH_M = 0.30
"""Dimensions of a compact tractor, drawn for comparison."""
DRAWN_BEAM_M = 3.0
DRAWN_BEYOND_M = 0.5
SCANNER_COLOUR = QColor("#1f78b4")
ANTENNA_COLOUR = QColor("#d95f02")
IMPLEMENT_COLOUR = QColor("#5a3dff")
IMU_COLOUR = QColor("#7b3294")
CAMERA_COLOUR = QColor("#1b9e77")
ROTOR_AT_M = 0.38
ROTOR_M = 0.22
"""Dimensions of a drone, drawn for comparison: a rotor's middle from the origin, along and across, and its radius."""
BODY_COLOUR = QColor("#d9d9d9")
TYRE_COLOUR = QColor("#969696")
GROUND_COLOUR = QColor("#a08060")


@dataclass(frozen=True)
class VehiclePlaces:
    """Positions in the vehicle frame (x forward, y left, z up; metres) of its parts; None where unknown."""

    lidar_xyz_m: Sequence[float] = (0.0, 0.0, 0.0)
    lidar_rpy_deg: Sequence[float] = (0.0, 0.0, 0.0)
    antenna_xyz_m: Sequence[float] | None = None
    implement_xy_m: Sequence[float] | None = None
    implement_width_m: float = 0.0
    implement_depth_m: float = 0.0
    imu_xyz_m: Sequence[float] | None = None
    camera_xyz_m: Sequence[float] | None = None
    flies: bool = False

    @property
    def sensors(self) -> list[tuple[str, Sequence[float], QColor]]:
        """Name, position and colour of each that is known."""
        return [
            (name, place, colour)
            for name, place, colour in (
                (tr("scanner"), self.lidar_xyz_m, SCANNER_COLOUR),
                (tr("antenna"), self.antenna_xyz_m, ANTENNA_COLOUR),
                (tr("IMU"), self.imu_xyz_m, IMU_COLOUR),
                (tr("camera"), self.camera_xyz_m, CAMERA_COLOUR),
            )
            if place is not None
        ]


class VehicleView(QWidget):
    """The drawing; :meth:`show_places` changes it."""

    def __init__(self) -> None:
        super().__init__()
        self._places = VehiclePlaces()
        self.setObjectName("furrowmapVehicle")
        self.setMinimumHeight(250)

    def sizeHint(self) -> QSize:  # noqa: N802 - the names are Qt's
        """As wide as a dock."""
        return QSize(340, 280)

    def show_places(self, places: VehiclePlaces) -> None:
        """Draw other positions."""
        self._places = places
        tip = tr(
            "Above: from the right side. Below: from the top. The origin is on the ground below the middle of the rear "
            "axle. Grey: a compact tractor for comparison. Blue lines: the scan plane."
        )
        if places.flies:
            tip = tr(
                "Above: from the right side. Below: from the top; the nose is on the right. Grey: a drone for "
                "comparison, with the origin on top of it. Blue lines: the scan plane."
            )
        self.setToolTip(tip)
        self.update()

    def paintEvent(self, event: QPaintEvent) -> None:  # noqa: N802, ARG002
        """Draw both views to one scale."""
        painter = QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        painter.fillRect(self.rect(), self.palette().base())
        x_m, y_m, z_m = self._reach()
        scale = min((self.width() - 20) / (x_m[1] - x_m[0]), (self.height() - 46) / (z_m[1] - z_m[0] + y_m[1] - y_m[0]))
        left = 0.5 * (self.width() - scale * (x_m[0] + x_m[1]))
        side = _View(painter, scale, left, 18 + scale * z_m[1], (0, 2))
        above = _View(painter, scale, left, side.y + scale * (-z_m[0] + y_m[1]) + 8, (0, 1))
        self._draw_side(side)
        self._draw_above(above)
        x = self.width() - 10
        y = self.height() - 8
        painter.setPen(QPen(self.palette().text().color(), 1.5))
        painter.drawLine(QPointF(x - scale, y), QPointF(x, y))
        painter.drawText(QPointF(x - scale, y - 4), "1 m")
        left = 6.0
        tool = [] if self._places.flies else [(tr("implement"), (), IMPLEMENT_COLOUR)]
        for name, _, colour in (*self._places.sensors, *tool):
            painter.setPen(colour)
            painter.drawText(QPointF(left, y), name)
            left += painter.fontMetrics().horizontalAdvance(name) + 12
        painter.end()

    def _reach(self) -> list[tuple[float, float]]:
        """The extents of both drawings along x, y and z."""
        p = self._places
        places = [place for _, place, _ in p.sensors]
        if p.implement_xy_m:
            half = 0.5 * p.implement_width_m
            places += [(p.implement_xy_m[0], p.implement_xy_m[1] + s * half, -p.implement_depth_m) for s in (-1, 1)]
        limits = ((-0.9, 2.3), (-0.85, 0.85), (-0.15, 1.3))
        if p.flies:
            limits = ((-0.65, 0.65), (-0.65, 0.65), (-0.5, 0.1))
        return [
            (
                min([low, *(place[k] for place in places)]) - DRAWN_BEYOND_M,
                max([high, *(place[k] for place in places)]) + DRAWN_BEYOND_M,
            )
            for k, (low, high) in enumerate(limits)
        ]

    def _draw_side(self, view: _View) -> None:
        p = self._places
        if p.flies:
            view.polygon([(-0.2, -0.03), (-0.22, -0.15), (0.2, -0.15), (0.26, -0.08), (0.2, -0.03)], BODY_COLOUR)
            for x in (-1.0, 1.0):
                view.line((0.15 * x, -0.08), (ROTOR_AT_M * x, -0.04), TYRE_COLOUR, 3.0)
                view.line((ROTOR_AT_M * x - ROTOR_M, 0.0), (ROTOR_AT_M * x + ROTOR_M, 0.0), TYRE_COLOUR, 2.0)
                view.line((0.12 * x, -0.15), (0.18 * x, -0.45), TYRE_COLOUR, 2.0)
            view.line((-0.3, -0.45), (0.3, -0.45), TYRE_COLOUR, 2.0)
            self._draw_sensors(view, (0.0, 1.0, 0.0))
            view.label(4, 14, tr("side"))
            return
        view.line((-30, 0), (30, 0), GROUND_COLOUR, 1.5)
        view.polygon([(-0.2, 0.6), (-0.2, 1.25), (0.55, 1.25), (0.75, 1.0), (2.05, 0.9), (2.05, 0.5)], BODY_COLOUR)
        view.disc((0, REAR_WHEEL_M), REAR_WHEEL_M, TYRE_COLOUR)
        view.disc((WHEELBASE_M, FRONT_WHEEL_M), FRONT_WHEEL_M, TYRE_COLOUR)
        if p.implement_xy_m:
            x = p.implement_xy_m[0]
            depth = p.implement_depth_m
            view.polygon([(x - 0.25, 0.45), (x + 0.25, 0.45), (x + 0.12, -depth), (x - 0.12, -depth)], IMPLEMENT_COLOUR)
        self._draw_sensors(view, (0.0, 1.0, 0.0))
        view.label(4, 14, tr("side"))

    def _draw_above(self, view: _View) -> None:
        p = self._places
        if p.flies:
            for x, y in ((-1.0, -1.0), (-1.0, 1.0), (1.0, -1.0), (1.0, 1.0)):
                view.line((0.0, 0.0), (ROTOR_AT_M * x, ROTOR_AT_M * y), TYRE_COLOUR, 3.0)
                view.disc((ROTOR_AT_M * x, ROTOR_AT_M * y), ROTOR_M, BODY_COLOUR)
            view.polygon([(-0.2, -0.12), (-0.2, 0.12), (0.2, 0.12), (0.3, 0.0), (0.2, -0.12)], BODY_COLOUR)
            self._draw_sensors(view, (0.0, 0.0, 1.0))
            view.label(4, int(view.y - view.scale * 0.6), tr("top"))
            return
        view.polygon([(-0.3, -0.4), (-0.3, 0.4), (2.05, 0.3), (2.05, -0.3)], BODY_COLOUR)
        for x, radius in ((0.0, REAR_WHEEL_M), (WHEELBASE_M, FRONT_WHEEL_M)):
            for y in (-0.5 * TRACK_M, 0.5 * TRACK_M):
                view.box((x - radius, y - 0.5 * TYRE_WIDTH_M), (x + radius, y + 0.5 * TYRE_WIDTH_M), TYRE_COLOUR)
        if p.implement_xy_m:
            x, y = p.implement_xy_m
            half = 0.5 * p.implement_width_m
            view.box((x - 0.2, y - half), (x + 0.2, y + half), IMPLEMENT_COLOUR)
        self._draw_sensors(view, (0.0, 0.0, 1.0))
        view.label(4, int(view.y - view.scale * 0.85), tr("top"))

    def _draw_sensors(self, view: _View, normal: Sequence[float]) -> None:
        place = self._places.lidar_xyz_m
        along = scan_direction(spin_axis(self._places.lidar_rpy_deg), normal)
        if along is not None:
            for sign in (-1, 1):
                end = [place[k] + sign * DRAWN_BEAM_M * along[k] for k in range(3)]
                view.line(view.flat(place), view.flat(end), SCANNER_COLOUR, 1.0)
        for _, at, colour in self._places.sensors:
            view.mark(view.flat(at), colour, pointed=colour is ANTENNA_COLOUR)


@dataclass(frozen=True)
class _View:
    """One of the two drawings: maps two axes in metres to pixels."""

    painter: QPainter
    scale: float
    x: float
    y: float
    axes: tuple[int, int]

    def at(self, place: Sequence[float]) -> QPointF:
        """The pixel of a position (two coordinates)."""
        return QPointF(self.x + self.scale * place[0], self.y - self.scale * place[1])

    def flat(self, place: Sequence[float]) -> tuple[float, float]:
        """The two of three coordinates that this view shows."""
        return place[self.axes[0]], place[self.axes[1]]

    def line(self, begin: Sequence[float], end: Sequence[float], colour: QColor, width: float) -> None:
        self.painter.setPen(QPen(colour, width))
        self.painter.drawLine(self.at(begin), self.at(end))

    def polygon(self, corners: Sequence[Sequence[float]], colour: QColor) -> None:
        self.painter.setPen(QPen(colour.darker(130), 1))
        self.painter.setBrush(colour)
        self.painter.drawPolygon(QPolygonF([self.at(corner) for corner in corners]))

    def box(self, low: Sequence[float], high: Sequence[float], colour: QColor) -> None:
        self.polygon([low, (low[0], high[1]), high, (high[0], low[1])], colour)

    def disc(self, middle: Sequence[float], radius: float, colour: QColor) -> None:
        self.painter.setPen(QPen(colour.darker(130), 1))
        self.painter.setBrush(colour)
        self.painter.drawEllipse(self.at(middle), self.scale * radius, self.scale * radius)

    def mark(self, place: Sequence[float], colour: QColor, *, pointed: bool = False) -> None:
        at = self.at(place)
        self.painter.setPen(QPen(Qt.GlobalColor.white, 1))
        self.painter.setBrush(colour)
        if pointed:
            corners = [QPointF(at.x() - 6, at.y() + 5), QPointF(at.x() + 6, at.y() + 5), QPointF(at.x(), at.y() - 6)]
            self.painter.drawPolygon(QPolygonF(corners))
        else:
            self.painter.drawRect(QRectF(at.x() - 5, at.y() - 5, 10, 10))

    def label(self, x: float, y: float, text: str) -> None:
        self.painter.setPen(QColor("#808080"))
        self.painter.drawText(QPointF(x, y), text)
