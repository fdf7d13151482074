"""Processes that write products and end early: how many, of which writers, and the program that forks them."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

from tests.conftest import CHECKOUT

KILLS = int(os.environ.get("KILLS", "0"))
ALWAYS = ("cloud", "csv", "farm", "gpkg", "mosaic", "surface")
"""Writers of files, of folders, of databases; they share what the others use."""


class Mortal:
    """A program that writes products in processes that end early."""

    def __init__(self) -> None:
        self._program = subprocess.Popen(
            [sys.executable, "-m", "tests.app.mortal"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
            cwd=CHECKOUT,
            # The day of writing, which GeoPackages state, makes no difference.
            env={**os.environ, "OGR_CURRENT_DATE": "2026-06-11T00:00:00Z"},
        )

    def does(self, deed: str, source: Path, target: Path, **end: object) -> dict[str, Any]:
        """Its exit status, negative where it was killed, and the operations it made that change files, or its error."""
        return self._answer({"deed": deed, "source": str(source), "target": str(target), **end})

    def runs(self, arguments: list[str], folder: Path, **end: Any) -> dict[str, Any]:
        """The exit status of a command in a folder, and what it said to standard error."""
        return self._answer({"arguments": arguments, "folder": str(folder), **end})

    def _answer(self, task: dict[str, Any]) -> dict[str, Any]:
        assert self._program.stdin is not None
        assert self._program.stdout is not None
        self._program.stdin.write(json.dumps(task) + "\n")
        self._program.stdin.flush()
        answer: dict[str, Any] = json.loads(self._program.stdout.readline())
        return answer

    def close(self) -> None:
        self._program.communicate()
