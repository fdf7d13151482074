"""The plugin's modules under PyQt6, as far as that goes without QGIS 4: ``python scripts/plugin_under_qt6.py FOLDER``.

FOLDER holds the plugin's folder `furrowmap`; PyQt6 is the only package that is needed. `qgis.PyQt` is PyQt6 as QGIS 4
maps it. Classes of QGIS itself are placeholders that take any argument and have any attribute; its widgets are empty
ones of Qt. Every module is imported, every name of Qt that the source uses is looked up in PyQt6, and the pages of the
dock are shown on a screen that is none. Prints what was done as JSON; ends with 1 if something failed.
"""

from __future__ import annotations

import ast
import importlib
import json
import os
import sys
import traceback
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")

PYQT = ("QtCore", "QtGui", "QtNetwork", "QtWidgets", "QtXml", "QtTest", "sip")
WIDGETS = {"QgsDockWidget": "QDockWidget", "QgsMapCanvas": "QWidget", "QgsCollapsibleGroupBox": "QGroupBox"}
"""Classes of QGIS that are widgets, and those of Qt that stand for them."""
MOVED = {"QtWidgets": ("QAction", "QActionGroup", "QShortcut")}
"""What Qt 6 has in QtGui, and `qgis.PyQt` of QGIS 4 where it was."""
SHOWN: tuple[tuple[str, str, tuple[Any, ...]], ...] = (
    ("dock.vehicle_view", "VehicleView", ()),
    ("dock.form_parts", "small_text", ("name", "text")),
    ("dock.form_parts", "button", ("name", "text", print)),
    ("dock.pages", "StartPage", ()),
    ("dock.pages", "RunPage", ()),
    ("dock.pages", "ResultPage", ()),
    ("dock.pages", "BatchPage", ()),
    ("dock.session_page", "SessionPage", ()),
)
"""Widgets, and what they are made of."""


class AnyMeta(type):
    """Every attribute of the class is such a class as well."""

    def __getattr__(cls, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        return placeholder(name)

    def __or__(cls, other: object) -> type:  # flags are combined, types in annotations are not evaluated
        return cls

    __ror__ = __or__


class Anything(metaclass=AnyMeta):
    """Takes any arguments; every attribute is such an object."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        del arguments, options

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        return Anything()

    def __call__(self, *arguments: Any, **options: Any) -> Anything:
        del arguments, options
        return Anything()

    def __iter__(self) -> Iterator[Any]:
        return iter(())


def _init_of(base: Any) -> Any:
    """Makes an empty widget of any arguments."""

    def init(self: Any, *arguments: Any, **options: Any) -> None:
        named = {key: value for key, value in options.items() if key == "objectName"}
        base.__init__(self, **named)
        del arguments

    return init


def placeholder(name: str) -> Any:
    """A class of QGIS by its name."""
    widgets = importlib.import_module("PyQt6.QtWidgets")
    if name in WIDGETS or name.endswith("Widget"):
        base = getattr(widgets, WIDGETS.get(name, "QWidget"))
        meta = type("WidgetMeta", (AnyMeta, type(base)), {})
        return meta(name, (base,), {"__init__": _init_of(base), "__getattr__": Anything.__getattr__})
    return AnyMeta(name, (Anything,), {})


class OfQgis(ModuleType):
    """A module of QGIS: every name in it is a placeholder."""

    __path__: list[str] = []  # noqa: RUF012 - as of a package

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        found = placeholder(name)
        setattr(self, name, found)
        return found


def map_modules() -> None:
    """`qgis` and its modules, before the plugin is imported."""
    for name in ("qgis", "qgis.core", "qgis.gui", "qgis.utils", "qgis._3d", "qgis.PyQt"):
        sys.modules[name] = OfQgis(name)
    for name in PYQT:
        source = importlib.import_module(f"PyQt6.{name}")
        module = ModuleType(f"qgis.PyQt.{name}")
        module.__dict__.update({key: value for key, value in vars(source).items() if not key.startswith("__")})
        for moved in MOVED.get(name, ()):
            setattr(module, moved, getattr(importlib.import_module("PyQt6.QtGui"), moved))
        sys.modules[module.__name__] = module
        setattr(sys.modules["qgis.PyQt"], name, module)


def modules_of(folder: Path) -> list[str]:
    """The names of the plugin's modules."""
    paths = sorted(path.relative_to(folder.parent) for path in folder.rglob("*.py"))
    names = [".".join(path.with_suffix("").parts) for path in paths]
    return [name.removesuffix(".__init__") for name in names]


def unknown_names(path: Path) -> Iterator[str]:
    """The dotted names below classes of Qt in a module that PyQt6 does not have, such as `Qt.AlignLeft`."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    known: dict[str, Any] = {}
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("qgis.PyQt."):
            module = sys.modules[node.module or ""]
            known |= {alias.asname or alias.name: getattr(module, alias.name, None) for alias in node.names}
    for node in ast.walk(tree):
        parts: list[str] = []
        part: ast.expr | None = node if isinstance(node, ast.Attribute) else None
        while isinstance(part, ast.Attribute):
            parts.insert(0, part.attr)
            part = part.value
        if isinstance(part, ast.Name) and part.id in known and parts:
            found = known[part.id]
            for at, name in enumerate(parts):
                if not isinstance(found, type | ModuleType):
                    break  # of a value or a method, which is not looked into
                if not hasattr(found, name):
                    yield f"{path.name}: {'.'.join([part.id, *parts[: at + 1]])}"
                    break
                found = getattr(found, name)


def main(folder: Path) -> int:
    """Import, look up, show; the status of the program."""
    map_modules()
    sys.path.insert(0, str(folder))
    plugin = folder / "furrowmap"
    done: dict[str, Any] = {"imported": [], "failed": {}, "unknown": [], "shown": []}
    for name in modules_of(plugin):
        try:
            importlib.import_module(name)
            done["imported"].append(name)
        except (ImportError, AttributeError, TypeError, NameError, ValueError):
            done["failed"][name] = traceback.format_exc(limit=-3)
    for path in sorted(plugin.rglob("*.py")):
        done["unknown"] += unknown_names(path)
    widgets = importlib.import_module("PyQt6.QtWidgets")
    application = widgets.QApplication([])
    for module, name, given in SHOWN:
        widget = getattr(importlib.import_module(f"furrowmap.{module}"), name)(*given)
        widget.resize(300, 200)
        widget.show()
        application.processEvents()
        image = widget.grab().toImage()
        done["shown"].append([f"{module}.{name}", image.width(), image.height()])
    sys.stdout.write(json.dumps(done, indent=1) + "\n")
    return 1 if done["failed"] or done["unknown"] else 0


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1])))
