"""`states.csv`: times at which the tool was lowered and lifted, in the format that a session can read."""

from __future__ import annotations

import csv
import math
from pathlib import Path

from furrowmap.core.values.clock import iso_utc
from furrowmap.core.values.tool_states import ToolState, ToolStates
from furrowmap.exporters.files.atomic import atomic_output

HEADER = ("time", "t_s", "state", "sigma_s", "confidence", "common_share")


def write_states(path: Path, states: ToolStates) -> None:
    """Write a row for each change of state, with all digits of `t_s`."""
    with atomic_output(path) as unfinished, unfinished.open("w", encoding="utf-8", newline="") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(HEADER)
        for k in range(len(states)):
            begin_s, end_s = float(states.begin_s[k]), float(states.end_s[k])
            word = ToolState(int(states.state[k])).label
            sigma_s, confidence = float(states.begin_sigma_s[k]), float(states.confidence[k])
            table.writerow([*_row(begin_s, word, sigma_s, confidence), repr(states.common_share)])
            if k + 1 == len(states) or states.begin_s[k + 1] > end_s:
                end = _row(end_s, ToolState.UNKNOWN.label, float(states.end_sigma_s[k]), 0.0)
                table.writerow([*end, repr(states.common_share)])


def _row(t_s: float, state: str, sigma_s: float, confidence: float) -> tuple[str, str, str, str, str]:
    sigma = "" if math.isnan(sigma_s) else repr(sigma_s)
    return iso_utc(t_s), repr(t_s), state, sigma, repr(confidence)
