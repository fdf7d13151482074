"""Scans that were dropped are said, hatched, and worked out again from the recording."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from threading import Event
from typing import Any

import numpy as np
import pytest

import furrowmap
from furrowmap.core.coverage.worked_cells import NOT_SEEN, WORKED
from furrowmap.core.implement.saved import load_implement
from furrowmap.core.live.live_session import LiveSession
from furrowmap.core.readers.arrived_scans import ScanStream
from furrowmap.core.session.opened import open_session
from furrowmap.core.values.gnss import GnssTrack
from furrowmap.workflows.live.feeds import PlayedFeed
from furrowmap.workflows.live.live import LiveWatch, Outlets
from furrowmap.workflows.live.repairs import Lost, Repairs, joined, without
from furrowmap.workflows.live.server import Hub, Pictures
from tests.test_end_to_end import session_folder

LOST_S = (20.0, 32.0)
"""From the start of the recording on: the tool is down for most of it."""


def test_pieces__are_looked_at_once_and_near_ones_together() -> None:
    pieces = joined([Lost(40.0, 50.0), Lost(0.0, 5.0), Lost(12.0, 20.0), Lost(45.0, 60.0)])
    assert pieces == [Lost(0.0, 20.0), Lost(40.0, 60.0)]
    assert without(pieces, [Lost(15.0, 45.0), Lost(59.9, 70.0)]) == [Lost(0.0, 15.0), Lost(45.0, 59.9)]
    assert without(pieces, [Lost(-1.0, 100.0)]) == []
    assert without([Lost(-math.inf, 10.0)], [Lost(2.0, 9.8)]) == [Lost(-math.inf, 2.0)]


@pytest.mark.slow
def test_dropped_scans__are_hatched_at_once_and_worked_out_in_the_end(
    shared_data: Path, run_once: Callable[[str, Callable[[Path], Path]], furrowmap.Result]
) -> None:
    result = run_once("tractor_loop", partial(session_folder, shared_data, "tractor_loop", truth=False))
    file = shared_data / "tractor_loop" / "session.toml"
    opened = open_session(file)
    session = LiveSession(opened.session, opened.frame, load_implement(result.path / "implement.npz"))
    stream = ScanStream(opened.inputs.lidar[0], opened.session.lidar.model)
    said = list[dict[str, Any]]()
    pictures = Pictures()
    page, stop = Hub(pictures.whole), Event()
    reader = page.join()
    assert reader is not None
    repairs = Repairs(file, session)
    watch = LiveWatch(session, opened, stream, Outlets(pictures, page, Hub(), None, None, None), (), repairs)
    assert session.cells is not None
    begin_s, hatched_m2 = math.nan, 0.0
    for piece in PlayedFeed(opened, stream, math.inf, stop).pieces():
        if isinstance(piece.data, GnssTrack):
            session.add_track(piece.data)
        elif isinstance(piece.data, list):
            is_first = bool(piece.data) and math.isnan(begin_s)
            begin_s = float(piece.data[0].t_s[0]) if is_first else begin_s
            is_lost = bool(piece.data) and LOST_S[0] < piece.data[0].t_s[0] - begin_s < LOST_S[1]
            watch.take(piece.data, time.time() - 0.4 if is_lost else piece.due_s, {})
            if is_first:
                time.sleep(1.0)  # what comes at first may be late
            hatched_m2 = max(hatched_m2, session.cells.area_m2(NOT_SEEN))
        while not reader.queue.empty():
            name, _, content = reader.queue.get_nowait().decode().partition("\n")
            if name == "event: figures":
                said.append(json.loads(content.partition("data: ")[2]))
    dropped = watch.summary().dropped
    assert dropped == pytest.approx(10.0 * (LOST_S[1] - LOST_S[0]), abs=3)
    assert said[-1]["dropped"] == dropped
    assert max(one["not_seen_m2"] for one in said) > 5.0
    assert hatched_m2 > 5.0
    watch.end(stop)
    repairs.close()
    session.close()
    assert session.cells.area_m2(NOT_SEEN) == 0.0
    assert session.cells.area_m2(WORKED) == pytest.approx(float(result.report["figures"]["worked_area_m2"]), rel=0.01)
    assert np.all(np.diff(session.cells.swept.t_s) >= 0.0)
