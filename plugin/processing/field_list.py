# SPDX-License-Identifier: GPL-2.0-or-later
"""The fields of a farm map as a list to choose from, in the dialog of an algorithm, of a batch and of a model."""

from __future__ import annotations

import sqlite3
from collections import Counter
from collections.abc import Sequence
from contextlib import closing
from pathlib import Path
from typing import Any
from urllib.parse import quote

from qgis.core import QgsProcessingContext, QgsProcessingParameterDefinition
from qgis.gui import QgsAbstractProcessingParameterWidgetWrapper, QgsProcessingGui
from qgis.PyQt.QtWidgets import QComboBox, QWidget

FARM_MAP = "FARM_MAP"
"""The parameter with the farm map whose fields are listed."""
DIALOGS = {"Batch": QgsProcessingGui.WidgetType.Batch, "Model": QgsProcessingGui.WidgetType.Modeler}
"""First letters of the classes of dialogs, and what they are."""


def fields_of(farm_map: str) -> list[str]:
    """The fields of a farm map in a GeoPackage, by their names; by their ids where several have the same name."""
    if not Path(farm_map).is_file():
        return []
    try:
        address = f"file:{quote(str(Path(farm_map)))}?mode=ro"
        with closing(sqlite3.connect(address, uri=True)) as database:
            rows = [(str(one), str(name or "")) for one, name in database.execute("select field, name from fields")]
    except sqlite3.Error:
        return []
    number = Counter(name for _, name in rows)
    return sorted(name if name and number[name] == 1 else field for field, name in rows)


class FieldListWrapper(QgsAbstractProcessingParameterWidgetWrapper):
    """A box that lists the fields of the farm map; other texts, such as of a map in PostGIS, may be entered."""

    def __init__(
        self, parameter: QgsProcessingParameterDefinition, dialog: Any, *_: Any, **__: Any
    ) -> None:  # as Processing calls it
        name = type(dialog).__name__
        kind = next((kind for begin, kind in DIALOGS.items() if name.startswith(begin)), None)
        super().__init__(parameter, QgsProcessingGui.WidgetType.Standard if kind is None else kind)

    def createWidget(self) -> QWidget:  # noqa: N802 - the names are QGIS's
        """The box, without fields until the farm map is chosen."""
        box = QComboBox(objectName="furrowmapFields", editable=True)
        box.editTextChanged.connect(lambda _text: self.widgetValueHasChanged.emit(self))
        return box  # not kept: QGIS makes another object of Python for it

    def setWidgetValue(self, value: Any, context: QgsProcessingContext) -> None:  # noqa: N802, ARG002
        """Show a value."""
        self.wrappedWidget().setEditText("" if value is None else str(value))

    def widgetValue(self) -> str:  # noqa: N802
        """The chosen or entered field."""
        return str(self.wrappedWidget().currentText())

    def postInitialize(self, wrappers: Sequence[QgsAbstractProcessingParameterWidgetWrapper]) -> None:  # noqa: N802
        """Follow the farm map of the same dialog."""
        for wrapper in wrappers:
            if wrapper.parameterDefinition().name() == FARM_MAP:
                wrapper.widgetValueHasChanged.connect(self._list)
                self._list(wrapper)

    def _list(self, wrapper: QgsAbstractProcessingParameterWidgetWrapper) -> None:
        """List the fields of the chosen map; what was entered stays."""
        box = self.wrappedWidget()
        entered = box.currentText()
        names = fields_of(str(wrapper.parameterValue() or ""))
        box.clear()
        box.addItems(names)
        box.setEditText(entered or (names[0] if len(names) == 1 else ""))
