"""The parts of the dock that need no QGIS, each as a module."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from types import ModuleType

import pytest

CHECKOUT = Path(__file__).resolve().parents[3]


def module_of_dock(name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(f"dock_{name}", CHECKOUT / "plugin" / "dock" / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="session")
def session_lines() -> ModuleType:
    return module_of_dock("session_lines")


@pytest.fixture(scope="session")
def scan_plane() -> ModuleType:
    return module_of_dock("scan_plane")
