"""The plugin under PyQt6 with `qgis.PyQt` mapped to it, as far as that goes without QGIS 4."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from tests.conftest import installed

CHECKOUT = Path(__file__).resolve().parents[2]
SCRIPT = CHECKOUT / "scripts" / "plugin_under_qt6.py"
PAGES = {"StartPage", "RunPage", "ResultPage", "BatchPage", "SessionPage", "VehicleView"}


def under_qt6(folder: Path) -> subprocess.CompletedProcess[str]:
    python = installed("PyQt6", "tools_of_tests.py", "pyqt6")
    return subprocess.run([python, "-I", SCRIPT, folder], capture_output=True, text=True, check=False)


@pytest.mark.skipif(sys.platform != "linux", reason="wheels of PyQt6 for this Linux")
def test_modules__are_imported_and_pages_shown_under_qt_6(tmp_path: Path) -> None:
    (tmp_path / "furrowmap").symlink_to(CHECKOUT / "plugin")
    ended = under_qt6(tmp_path)
    done = json.loads(ended.stdout)
    assert (ended.returncode, done["failed"], done["unknown"]) == (0, {}, [])
    modules = set((CHECKOUT / "plugin").rglob("*.py"))
    assert len(done["imported"]) == len(modules) > 40
    assert {name.rpartition(".")[2] for name, _, _ in done["shown"]} >= PAGES
    assert all(width > 0 and height > 0 for _, width, height in done["shown"])


@pytest.mark.skipif(sys.platform != "linux", reason="wheels of PyQt6 for this Linux")
def test_names__that_only_qt_5_has_are_found(tmp_path: Path) -> None:
    """Among them an enumeration without its scope."""
    (tmp_path / "planted" / "furrowmap").mkdir(parents=True)
    for path in (CHECKOUT / "plugin").iterdir():
        (tmp_path / "planted" / "furrowmap" / path.name).symlink_to(path)
    source = "from qgis.PyQt.QtCore import Qt\nfrom qgis.PyQt.QtWidgets import QDialog\n\n\ndef show() -> object:\n"
    source += "    return QDialog.exec_, Qt.AlignLeft, Qt.AlignmentFlag.AlignLeft\n"
    (tmp_path / "planted" / "furrowmap" / "planted.py").write_text(source)
    ended = under_qt6(tmp_path / "planted")
    assert ended.returncode == 1
    assert sorted(json.loads(ended.stdout)["unknown"]) == ["planted.py: QDialog.exec_", "planted.py: Qt.AlignLeft"]
