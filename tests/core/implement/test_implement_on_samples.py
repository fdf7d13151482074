"""The sample recordings, against their truth."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from furrowmap.core.implement.heights import ToolHeightTracker
from furrowmap.core.implement.learning import learn_implement
from furrowmap.core.implement.near_scans import NearScans
from furrowmap.core.implement.seen_implement import Hint
from furrowmap.core.implement.states import tool_history
from furrowmap.core.readers.reader import GivesScans, ReadOptions, open_recording
from furrowmap.core.session.session_file import load_session
from furrowmap.core.values.rotation import Mounting
from furrowmap.core.values.scan import Scan
from furrowmap.core.values.tool_states import ToolState


def _scans(file: Path, near_s: float | None = None) -> list[Scan]:
    reader = open_recording([file], ReadOptions(near_s=near_s))
    assert isinstance(reader, GivesScans)
    return list(reader.scans())


@pytest.mark.parametrize("hinted", [True, False])
@pytest.mark.parametrize("name", ["tractor_loop", "tractor_fishtail"])
def test_samples__states_transitions_and_heights_are_true(shared_data: Path, name: str, hinted: bool) -> None:
    session = load_session(shared_data / name / "session.toml")
    truth = np.genfromtxt(
        shared_data / name / "truth" / "implement.csv", delimiter=",", names=True, dtype=None, encoding="ascii"
    )
    true_s, true_m = truth["time_unix_s"], truth["tool_height_m"]
    scans = _scans(shared_data / name / "recording.pcap.gz", float(true_s.mean()))
    assert session.implement is not None
    mounting, depth_m = session.lidar.mounting, session.implement.working_depth_m
    near = NearScans(mounting)
    for scan in scans:
        near.add(scan)
    hint = Hint(session.implement.xy_m, session.implement.width_m) if hinted else None
    learned = learn_implement(near.scans, hint)
    assert learned.implement is not None
    assert learned.notices == ()
    watch = ToolHeightTracker(mounting, learned.implement, depth_m)
    for scan in scans:
        watch.add(scan)
    history = tool_history(watch.heights(), learned.implement, depth_m)

    assert len(history.t_s) == sum(len(scan) > 0 for scan in scans)
    changes = np.flatnonzero(np.diff(truth["state"] == "down")) + 1
    states = history.states
    assert np.array_equal(states.begin_s[1:], states.end_s[:-1])
    assert (states.state[1:] == ToolState.DOWN).tolist() == (truth["state"][changes] == "down").tolist()
    assert np.abs(states.begin_s[1:] - true_s[changes]).max() < 0.03
    clear = np.abs(history.t_s[:, None] - true_s[changes]).min(axis=1) > 0.1
    down = truth["state"][np.searchsorted(true_s, history.t_s)] == "down"
    assert np.array_equal((history.state == ToolState.DOWN)[clear], down[clear])
    assert np.array_equal((history.state == ToolState.UP)[clear], ~down[clear])
    error = history.tool_height_m - np.interp(history.t_s, true_s, true_m)
    assert np.sqrt(np.mean(error**2)) < 0.004
    assert np.abs(error).max() < 0.02


@pytest.mark.parametrize("hint", [None, Hint((-0.8, 0.0), 0.6)])
def test_samples__a_rover_without_an_implement_gets_no_states(shared_data: Path, hint: Hint | None) -> None:
    near = NearScans(Mounting((0.0, 0.0, 0.38)))
    for scan in _scans(shared_data / "rover_real" / "leo_rover_vlp16.pcap.gz"):
        near.add(scan)
    learned = learn_implement(near.scans, hint)
    assert learned.implement is None
    assert len(learned.notices) == 1
