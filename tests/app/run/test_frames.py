"""How deep the way is from `furrowmap run` to the kernel that registers returns to the ground."""

from __future__ import annotations

import sys
import threading
from pathlib import Path
from types import FrameType
from typing import Any

import pytest

import furrowmap
from furrowmap.cli import run_commands as run_command
from furrowmap.cli.main import command_line
from furrowmap.core.matching.ground_registration import register_ground

CHECKOUT = Path(furrowmap.__file__).resolve().parents[1]
MAX_FRAMES = 12


def ours(frame: FrameType | None) -> list[str]:
    """The functions of furrowmap on a stack, the innermost first."""
    found = []
    while frame is not None:
        file = Path(frame.f_code.co_filename)
        if file.is_relative_to(CHECKOUT) and not file.is_relative_to(CHECKOUT / "tests"):
            found.append(f"{file.relative_to(CHECKOUT).as_posix()} {frame.f_code.co_name}")
        frame = frame.f_back
    return found


def test_kernel_of_the_ground__is_few_frames_below_the_command(
    simulated: furrowmap.Simulated, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By the interpreter's own trace: frames of the thread that waits, and of the one that works for it."""
    main = threading.get_ident()
    stacks = set[tuple[str, ...]]()

    def look(frame: FrameType, event: str, _: Any) -> None:
        if event == "call" and frame.f_code is register_ground.__code__:
            waiting = [] if threading.get_ident() == main else ours(sys._current_frames()[main])
            stacks.add((*ours(frame), *waiting))

    monkeypatch.setenv("FURROWMAP_THREADS", "2")
    threading.setprofile(look)
    try:
        status = command_line(["run", str(simulated.session), "-o", str(tmp_path / "result")])
    finally:
        threading.setprofile(None)
    assert status == 0
    assert len(stacks) >= 2  # of windows, and of the whole session
    for stack in stacks:
        command = f"{Path(run_command.__file__).resolve().relative_to(CHECKOUT).as_posix()} run"
        below = stack[: stack.index(command) + 1]
        assert len(below) <= MAX_FRAMES, " < ".join(below)
