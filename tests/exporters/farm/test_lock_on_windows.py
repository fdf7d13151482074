"""The lock of a farm map with Windows's call in place of flock."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from furrowmap.core.runtime.errors import RefusedError
from furrowmap.core.runtime.progress import silent
from furrowmap.exporters.farm.farm_geopackage import exclusive


def test_lock__is_held_by_one_process_and_its_file_stays(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    held: dict[int, int] = {}

    def locking(descriptor: int, mode: int, size: int) -> None:
        assert (mode, size) == (2, 1)
        if os.fstat(descriptor).st_ino in held.values():
            raise PermissionError(13, "Permission denied")
        held[descriptor] = os.fstat(descriptor).st_ino

    def close(descriptor: int) -> None:
        held.pop(descriptor, None)
        closed(descriptor)

    def unlink(path: Path) -> None:
        raise PermissionError(13, "The process cannot access the file", str(path), 32)

    closed = os.close
    monkeypatch.setattr(os, "close", close)
    monkeypatch.setattr(Path, "unlink", unlink)
    monkeypatch.setattr(sys, "platform", "win32")
    monkeypatch.setitem(sys.modules, "msvcrt", SimpleNamespace(locking=locking, LK_NBLCK=2))
    for _ in range(2):
        with exclusive(tmp_path / "farm.gpkg", silent):
            assert len(held) == 1
            with pytest.raises(RefusedError), exclusive(tmp_path / "farm.gpkg", silent, patience_s=0.0):
                pass
        assert not held
        assert (tmp_path / ".farm.gpkg.lock").exists()
