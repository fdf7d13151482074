# SPDX-License-Identifier: GPL-2.0-or-later
"""Where the products of a run are: in its folder, or waiting in a hidden one where the run was killed after its end."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any


def product(folder: str | Path, name: str) -> Path:
    """Path of a product, which need not exist.

    A run makes all products valid at once, by the file `complete.json` in a hidden folder, and then moves them to their
    places. Where it was killed in between, the next command completes that; QGIS only reads.
    """
    for complete in sorted(Path(folder).glob(".furrowmap-run-*/complete.json")):
        waiting = complete.parent / "products" / name
        gone = read_object(complete).get("gone")
        if waiting.is_file() or (isinstance(gone, list) and name in gone):
            return waiting
    return Path(folder) / name


def read_object(path: Path) -> dict[str, Any]:
    """The JSON object in a file; empty if it cannot be read."""
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return content if isinstance(content, dict) else {}
