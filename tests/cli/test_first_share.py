"""What a terminal shows while a command has only begun."""

from __future__ import annotations

import io
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import furrowmap
from furrowmap.cli.main import command_line


class Terminal(io.StringIO):
    """Standard error that says it is a terminal, and keeps what is written."""

    def isatty(self) -> bool:
        return True


@pytest.mark.parametrize(("command", "function"), [("crs", "site_coordinates"), ("inspect", "inspect")])
def test_a_stage_that_has_begun_is_not_shown_as_done(
    command: str, function: str, shared_data: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What the terminal shows when the work begins."""
    terminal, seen = Terminal(), list[str]()
    work: Callable[..., Any] = getattr(furrowmap, function)

    def watched(*arguments: Any) -> Any:
        seen.append(terminal.getvalue())
        return work(*arguments)

    monkeypatch.setattr(furrowmap, function, watched)
    file = shared_data / "tractor_loop" / ("session.toml" if command == "crs" else "gnss.nmea")
    with monkeypatch.context() as patched:
        patched.setattr(sys, "stderr", terminal)
        patched.setattr(sys, "stdout", Terminal())  # libraries that are loaded meanwhile keep it
        assert command_line([command, str(file)]) == 0
    assert "eading" in seen[0]
    assert "100 %" not in seen[0]
    assert "100 %" in terminal.getvalue()[len(seen[0]) :]
