# SPDX-License-Identifier: GPL-2.0-or-later
"""Parts of the dock's pages, and what `furrowmap init` found or missed in recordings, in the words of the form."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from html import escape
from pathlib import Path
from typing import Any

from qgis.PyQt.QtCore import QCoreApplication, QSignalBlocker, Qt
from qgis.PyQt.QtGui import QPalette
from qgis.PyQt.QtWidgets import (
    QDoubleSpinBox,
    QFormLayout,
    QGroupBox,
    QHBoxLayout,
    QLabel,
    QPushButton,
    QVBoxLayout,
    QWidget,
)

from ..dock_words import in_dock_words
from ..figures import ON_PAPER
from ..platforms import resolved

tr = partial(QCoreApplication.translate, "Findings")

SAME_WITHIN = 1.001e-3
"""Smallest step of the form's numbers, metres or degrees."""
MAX_OFFSET_M = 15.0
"""Largest offset from the origin of the vehicle frame that a session may have."""
FORM_CODES = (
    *("no-lidar", "no-positions", "no-crs", "no-mounting", "no-antenna", "no-implement"),
    *("no-imu-mounting", "camera-uncalibrated"),
)
"""Codes of what the form itself finds missing."""
FILL_IN = "FILL-IN"
"""What `furrowmap init` writes for required values that are not in the recordings."""
DARK = 128
"""A background of less lightness is dark."""
EXACT = "furrowmapExact"
"""Property of a box: the value that was filled in, and what the box made of it, which has fewer decimals."""
UNUSED = "recording-unused"
"""Code of a file or folder that a session does not use."""


def button(name: str, text: str, on_click: Callable[[], Any], tip: str = "") -> QPushButton:
    """A button with an object name."""
    made = QPushButton(text, objectName=name)
    made.setToolTip(tip)
    made.clicked.connect(lambda: on_click())
    return made


def side_by_side(*widgets: QWidget) -> QWidget:
    """Widgets in a row without margins."""
    row = QWidget()
    layout = QHBoxLayout(row)
    layout.setContentsMargins(0, 0, 0, 0)
    for widget in widgets:
        layout.addWidget(widget)
    return row


def below(*widgets: QWidget) -> QWidget:
    """Widgets in a column without margins."""
    column = QWidget()
    layout = QVBoxLayout(column)
    layout.setContentsMargins(0, 0, 0, 0)
    for widget in widgets:
        layout.addWidget(widget)
    return column


def group_box(
    title: str,
    rows: Sequence[tuple[str, QWidget] | QWidget],
    hint: str = "",
    on_toggle: Callable[..., None] | None = None,
    name: str = "",
) -> QGroupBox:
    """A titled group with a form and a hint below it; it can be unchecked if there is an `on_toggle` to call."""
    group = QGroupBox(title, objectName=name)
    if on_toggle is not None:
        group.setCheckable(True)
        group.toggled.connect(on_toggle)
    form = QFormLayout(group)
    form.setFieldGrowthPolicy(QFormLayout.FieldGrowthPolicy.ExpandingFieldsGrow)
    for row in (*rows, small_text(text=hint)) if hint else rows:
        form.addRow(*(row if isinstance(row, tuple) else (row,)))
    return group


def row_of(text: str, boxes: Sequence[QDoubleSpinBox]) -> QWidget:
    """Boxes side by side below their label."""
    for box in boxes:
        box.setMinimumWidth(70)
    return below(QLabel(text), side_by_side(*boxes))


def small_text(name: str = "", text: str = "") -> QLabel:
    """An explanation in smaller type, which can be selected."""
    label = QLabel(text, objectName=name)
    label.setWordWrap(True)
    label.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
    font = label.font()
    font.setPointSizeF(font.pointSizeF() * 0.9)
    label.setFont(font)
    return label


def is_dark(widget: QWidget) -> bool:
    """Whether QGIS has a dark theme."""
    return bool(widget.palette().color(QPalette.ColorRole.Window).lightness() < DARK)


def warning_colour(widget: QWidget) -> str:
    """A red that is legible on the widget."""
    return "#ff8a80" if is_dark(widget) else ON_PAPER


def number_box(
    name: str, limit: float, suffix: str, decimals: int, step: float, *, low: float | None = None
) -> QDoubleSpinBox:
    """A box for a number within ± limit, or from `low` to it."""
    box = QDoubleSpinBox(objectName=name, decimals=decimals, singleStep=step, suffix=suffix)
    box.setRange(-limit if low is None else low, limit)
    box.setFocusPolicy(Qt.FocusPolicy.StrongFocus)
    return box


def metre_boxes(name: str, count: int, on_change: Callable[..., None]) -> list[QDoubleSpinBox]:
    """Boxes for the coordinates of a place in the vehicle frame; `on_change` is called after each change."""
    return _calling(on_change, [number_box(f"{name}{k}", MAX_OFFSET_M, " m", 3, 0.01) for k in range(count)])


def turn_boxes(name: str, on_change: Callable[..., None]) -> list[QDoubleSpinBox]:
    """Boxes for roll, pitch and yaw; `on_change` is called after each change."""
    return _calling(on_change, [number_box(f"{name}{k}", 360.0, "°", 3, 1.0) for k in range(3)])


def _calling(on_change: Callable[..., None], boxes: list[QDoubleSpinBox]) -> list[QDoubleSpinBox]:
    for box in boxes:
        box.valueChanged.connect(on_change)
    return boxes


def name_within(folder: Path, chosen: str) -> str:
    """A chosen file as a session in `folder` names it: relative where it lies within, else as it is; "" for none."""
    chosen = chosen.strip()
    if not chosen:
        return ""
    folder = resolved(folder)
    path = resolved(folder / chosen)
    # The run refuses a file outside of the session's folder, with the reason.
    return path.relative_to(folder).as_posix() if path.is_relative_to(folder) else chosen


def fill(boxes: Sequence[QDoubleSpinBox], values: Any) -> None:
    """Set boxes to values without emitting signals; to 0 if the values do not fit."""
    values = values if isinstance(values, list) and len(values) == len(boxes) else [0.0] * len(boxes)
    for box, value in zip(boxes, values, strict=True):
        blocker = QSignalBlocker(box)
        exact = value if isinstance(value, (int, float)) else 0.0
        box.setValue(float(exact))
        box.setProperty(EXACT, (exact, box.value()))
        del blocker


def values_of(boxes: Sequence[QDoubleSpinBox]) -> list[float]:
    """The values of boxes: exactly as they were filled in where nobody has changed them, else as they are shown."""
    return [value_of(box) for box in boxes]


def value_of(box: QDoubleSpinBox) -> float:
    """The value of a box, as :func:`values_of` has it."""
    exact, shown = box.property(EXACT) or (None, None)
    return exact if exact is not None and box.value() == shown else round(box.value(), box.decimals())


def same_value(one: Any, other: Any) -> bool:
    """Whether two values of a machine, or lists of them, are the same as the form shows them."""
    if isinstance(one, list) and isinstance(other, list):
        return len(one) == len(other) and all(map(same_value, one, other))
    if isinstance(one, str) or isinstance(other, str) or one is None or other is None:
        return bool(one == other)
    return bool(abs(one - other) <= SAME_WITHIN)


def texts_of(value: Any) -> list[str]:
    """The items of a list as text; none if it is not a list."""
    return [str(item) for item in value] if isinstance(value, list) else []


def findings_html(findings: dict[str, Any] | None, missing: Sequence[str] = (), *, flight: bool = False) -> str:
    """The answer of `furrowmap init` as rich text, None for a session opened again, and what is still missing."""
    kind = tr("a flight") if flight else tr("a drive")
    for code, alone in (("no-lidar", tr("positions alone")), ("no-positions", tr("scans alone"))):
        kind = alone if code in missing else kind
    words = {
        "no-lidar": tr("The scanner's recording. Drop it together with the receiver's log."),
        "no-positions": tr("The receiver's log. Drop it together with the scanner's recording."),
        "no-crs": tr("CRS: the recordings contain no position."),
        "no-mounting": tr("Scanner: position and orientation. Until then the surfaces are not usable."),
        "no-antenna": tr("GNSS antenna: position. Until then no accuracy is stated."),
        "no-implement": tr("Implement: width and position. Until then no worked ground is computed."),
        "no-imu-mounting": tr("IMU: position and rotation of its axes. Until then its axes are those of the vehicle."),
        "camera-uncalibrated": tr("Camera: fx, fy, cx and cy. Until then the images are not used."),
    }
    if flight:  # the angles are proposed from the ground and from gravity
        words["no-mounting"] = tr("Scanner: position. Until then no accuracy is stated.")
        words["no-imu-mounting"] = tr("IMU: position. Until then it is taken as that of the antenna.")
    found = (findings or {}).get("found") or []
    others = [notice for notice in (findings or {}).get("missing") or [] if notice.get("code") not in FORM_CODES]
    lists = (
        (tr("Found in the recordings: {kind}").format(kind=kind), found),
        (tr("Missing"), [{"text": words[code]} for code in missing]),
        (tr("To check"), [notice for notice in others if notice.get("code") != UNUSED]),
        (tr("Not used"), [notice for notice in others if notice.get("code") == UNUSED]),
    )
    parts = []
    for title, notices in lists:
        if notices:
            texts = [in_dock_words(str(notice.get("text", ""))) for notice in notices]
            items = "".join(f"<li>{escape(text, quote=False)}</li>" for text in texts)
            parts.append(f"<b>{title}</b><ul style='margin:2px 0 4px -22px'>{items}</ul>")
    return "".join(parts)
