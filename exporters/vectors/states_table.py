"""`states.csv`: times at which the tool was lowered and lifted, in the format that a session can read."""

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
            word = ToolState(int(states.state[k])).label
            rows = [(states.begin_s[k], word, states.begin_sigma_s[k], states.confidence[k])]
            if k + 1 == len(states) or states.begin_s[k + 1] > states.end_s[k]:
                rows.append((states.end_s[k], ToolState.UNKNOWN.label, states.end_sigma_s[k], 0.0))
            for t_s, state, sigma_s, confidence in rows:
                sigma = "" if math.isnan(sigma_s) else repr(float(sigma_s))
                texts = iso_utc(float(t_s)), repr(float(t_s)), state, sigma, repr(float(confidence))
                table.writerow([*texts, repr(states.common_share)])
