# SPDX-License-Identifier: GPL-2.0-or-later
"""Parts of the session's form."""

from qgis.PyQt.QtCore import QSignalBlocker, Qt
from qgis.PyQt.QtWidgets import QFormLayout, QGroupBox, QHBoxLayout, QLabel, QVBoxLayout, QWidget

LEAST = 1.001e-3
"""Smallest step of the form's numbers, metres or degrees."""


def group_box(title, on_toggle=None):
    """A titled group with a form; it can be unchecked if there is an `on_toggle` to call."""
    group = QGroupBox(title)
    if on_toggle is not None:
        group.setCheckable(True)
        group.toggled.connect(on_toggle)
    form = QFormLayout(group)
    form.setFieldGrowthPolicy(QFormLayout.FieldGrowthPolicy.ExpandingFieldsGrow)
    return group, form


def row_of(text, boxes):
    """Boxes side by side below their label."""
    row = QWidget()
    layout = QVBoxLayout(row)
    layout.setContentsMargins(0, 0, 0, 0)
    layout.addWidget(QLabel(text))
    inside = QHBoxLayout()
    for box in boxes:
        box.setMinimumWidth(70)
        inside.addWidget(box)
    layout.addLayout(inside)
    return row


def small_text(name="", text=""):
    """An explanation in smaller type, which can be selected."""
    label = QLabel(text, objectName=name)
    label.setWordWrap(True)
    label.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
    font = label.font()
    font.setPointSizeF(font.pointSizeF() * 0.9)
    label.setFont(font)
    return label


def fill(boxes, values):
    """Set boxes to values without emitting signals; to 0 if the values do not fit."""
    values = values if isinstance(values, list) and len(values) == len(boxes) else [0.0] * len(boxes)
    for k, box in enumerate(boxes):
        value = values[k]
        blocker = QSignalBlocker(box)
        box.setValue(float(value) if isinstance(value, (int, float)) else 0.0)
        del blocker


def values_of(boxes):
    """The values of boxes."""
    return [round(box.value(), box.decimals()) for box in boxes]


def same_value(one, other):
    """Whether two values of a machine, or lists of them, are the same as the form shows them."""
    if isinstance(one, list) and isinstance(other, list):
        return len(one) == len(other) and all(map(same_value, one, other))
    if isinstance(one, str) or isinstance(other, str) or one is None or other is None:
        return one == other
    return abs(one - other) <= LEAST


def texts_of(value):
    """The items of a list as text; none if it is not a list."""
    return [str(item) for item in value] if isinstance(value, list) else []


def escaped(text):
    """Plain text as rich text."""
    return str(text).replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;")
