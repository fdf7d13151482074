"""The progress bar on a terminal."""

from __future__ import annotations

import os
import re
import sys

import pytest

pty = pytest.importorskip("pty", reason="no terminals to open")

WORK = """
from furrowmap.cli.console import Console
with Console().work(passing={passing}) as progress:
    for stage in ("reading", "走査の照合"):
        for share in (0.0, 0.5, 0.25, 1.0):
            progress(stage, share)
    progress("reading", 0.1)
    Console().say("half of it")
    {end}
"""


def shown(passing: bool, end: str = "pass", work: str = WORK) -> list[str]:
    """The lines that a terminal shows in the end; without the time at the end of a bar."""
    child, terminal = pty.fork()
    if child == 0:
        os.execv(sys.executable, [sys.executable, "-c", work.format(passing=passing, end=end)])
    said = b""
    try:
        while block := os.read(terminal, 4096):
            said += block
    except OSError:  # Linux's end of a terminal
        pass
    os.close(terminal)
    os.waitpid(child, 0)
    lines = said.decode().replace("\r\n", "\n").split("\n")
    return [re.sub(r"^.*\r\x1b\[2K| \d+:\d\d$", "", line) for line in lines]


def test_bar__of_each_stage_is_full_in_the_end() -> None:
    lines = shown(passing=False)
    full = [f"{stage} [{'#' * 30}] 100 %" for stage in ("reading", "走査の照合")]
    assert lines == [full[0], "half of it", full[1], ""]


def test_bar__is_removed_after_passing_work() -> None:
    assert shown(passing=True) == ["half of it", ""]


PLANNED = """
from furrowmap.cli.console import Console
from furrowmap.core.runtime.progress import Step
STEPS = (Step("reading scans", 1.0), Step("matching scans", 1.0), Step("placing points", 1.0),
         Step("writing cloud", 1.0, beside=True), Step("making surfaces", 1.0, beside=True))
with Console().work(steps=STEPS) as progress:
    for stage, share in (("reading scans", 0.5), ("something else", 0.9), ("placing points", 0.0),
                         ("making surfaces", 0.5), ("writing cloud", 0.5)):
        progress(stage, share)
        print(f"{{stage}}: after", flush=True)
    {end}
"""
"""The matching of this run falls away."""


def test_bar__of_steps_that_are_known_ahead_is_one_for_all() -> None:
    lines = shown(passing=False, work=PLANNED)
    assert lines[0] == "steps: reading scans, matching scans, placing points, writing cloud, making surfaces"
    assert [re.findall(r"(\d+) %", line)[-1] for line in lines if "after" in line] == ["10", "10", "40", "70", "80"]
    assert lines[-2] == f"writing cloud [{'#' * 30}] 100 %"


def test_bar__stays_as_it_is_above_an_error() -> None:
    lines = shown(passing=False, end="progress('writing', 0.5); raise KeyboardInterrupt")
    assert f"writing [{'#' * 15}{'.' * 15}]  50 %" in lines
    assert lines[-2] == "KeyboardInterrupt"
