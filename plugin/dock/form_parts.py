# SPDX-License-Identifier: GPL-2.0-or-later
"""Parts of the dock's pages, and what `furrowmap init` found or missed in recordings, in the words of the form."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from html import escape
from typing import Any

from qgis.PyQt.QtCore import QCoreApplication, QSignalBlocker, Qt
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

tr = partial(QCoreApplication.translate, "Findings")

SAME_WITHIN = 1.001e-3
"""Smallest step of the form's numbers, metres or degrees."""
FORM_CODES = ("no-lidar", "no-positions", "no-crs", "no-mounting", "no-antenna", "no-implement")
"""Codes of what the form itself finds missing."""


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


def fill(boxes: Sequence[QDoubleSpinBox], values: Any) -> None:
    """Set boxes to values without emitting signals; to 0 if the values do not fit."""
    values = values if isinstance(values, list) and len(values) == len(boxes) else [0.0] * len(boxes)
    for box, value in zip(boxes, values, strict=True):
        blocker = QSignalBlocker(box)
        box.setValue(float(value) if isinstance(value, (int, float)) else 0.0)
        del blocker


def values_of(boxes: Sequence[QDoubleSpinBox]) -> list[float]:
    """The values of boxes."""
    return [round(box.value(), box.decimals()) for box in boxes]


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


def findings_html(findings: dict[str, Any] | None, missing: Sequence[str] = ()) -> str:
    """The answer of `furrowmap init` as rich text, and what is still to be filled in.

    Args:
        findings: with `found` and `missing`, notices each; None for a session that was opened again.
        missing: codes of :data:`FORM_CODES`.
    """
    words = {
        "no-lidar": tr("The scanner's recording. Drop it together with the receiver's log."),
        "no-positions": tr("The receiver's log. Drop it together with the scanner's recording."),
        "no-crs": tr("CRS: the recordings contain no position."),
        "no-mounting": tr("Scanner: position and orientation. Until then the surfaces are not usable."),
        "no-antenna": tr("GNSS antenna: position. Until then no accuracy is stated."),
        "no-implement": tr("Implement: width and position. Until then no worked ground is computed."),
    }
    parts = []
    for title, key in ((tr("Found in the recordings"), "found"), (tr("Missing"), "missing")):
        notices = [notice for notice in (findings or {}).get(key) or [] if notice.get("code") not in FORM_CODES]
        texts = [notice.get("text", "") for notice in notices]
        texts += [words[code] for code in missing] if key == "missing" else []
        if texts:
            items = "".join(f"<li>{escape(text, quote=False)}</li>" for text in texts)
            parts.append(f"<b>{title}</b><ul style='margin:2px 0 4px -22px'>{items}</ul>")
    return "".join(parts)
