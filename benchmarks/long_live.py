"""Memory of `furrowmap live` over hours: a recording of a VLP-16 played again and again, as fast as it is looked at.

    python benchmarks/long_live.py SESSION [--hours 10]

Each time all stamps are 90 s later and the positions 6 m further north. A reader takes all messages, another one none.
After each ten simulated minutes a third one joins, as a viewer that was cut off: how long until it has the whole
picture, and how large that is.
"""

from __future__ import annotations

import argparse
import time
from collections import Counter
from dataclasses import replace
from pathlib import Path
from queue import Queue

import numpy as np

from furrowmap.core.coverage.worked_cells import WORKED
from furrowmap.core.implement.saved import load_implement
from furrowmap.core.live.live_session import LiveSession
from furrowmap.core.readers.arrived_scans import ScanStream
from furrowmap.core.readers.pcap import Datagrams, datagrams_of
from furrowmap.core.readers.reader import GivesTrack
from furrowmap.core.session.opened import open_session
from furrowmap.workflows.live.live import LiveWatch, Outlets
from furrowmap.workflows.live.repairs import Repairs
from furrowmap.workflows.live.server import Hub, Pictures

LOOP_S = 90.0
NORTH_DEG = 6.0 / 111_000.0
DATA_BYTES, STAMP_AT, HOUR_US = 1206, 1200, 3_600_000_000


def moved(block: Datagrams, by_s: float) -> Datagrams:
    """The datagrams so much later."""
    data = block.data.copy()
    at = (block.offset[block.length == DATA_BYTES] + STAMP_AT)[:, None] + np.arange(4)
    stamp_us = data[at].view("<u4")[:, 0].astype(np.int64) + round(1e6 * by_s)
    data[at] = (stamp_us % HOUR_US).astype("<u4").view(np.uint8).reshape(-1, 4)
    return replace(block, data=data, time_s=block.time_s + by_s)


def resident_mb() -> float:
    """Memory of this process."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * 4096e-6


def main() -> None:
    """Play, and print a line for each ten simulated minutes."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("session", type=Path)
    parser.add_argument("--hours", type=float, default=10.0)
    asked = parser.parse_args()
    opened = open_session(asked.session)
    reader, tool = opened.positions(), opened.inputs.tools[0].learned
    assert isinstance(reader, GivesTrack)
    track = reader.track()
    session = LiveSession(opened.session, opened.frame, load_implement(tool) if tool is not None else None)
    stream = ScanStream(opened.inputs.lidar[0], opened.session.lidar.model)
    pictures = Pictures()
    page, lines = Hub(pictures.whole), Hub()
    outlets = Outlets(pictures, page, lines, None, None, None)
    watch = LiveWatch(session, opened, stream, outlets, (), Repairs(asked.session, session))
    joined = page.join(), page.join(), lines.join()
    taken: Queue[bytes] = joined[0].queue if joined[0] is not None else Queue()
    told_s = 0.0
    for loop in range(round(asked.hours * 3600.0 / LOOP_S)):
        by_s, given = loop * LOOP_S, 0
        here = replace(track, t_s=track.t_s + by_s, lat_deg=track.lat_deg + loop * NORTH_DEG)
        for block in datagrams_of(opened.inputs.lidar, Counter()):
            for part in np.array_split(np.arange(len(block)), max(1, len(block) // 75)):
                some = {name: getattr(block, name)[part] for name in ("offset", "length", "time_s", "sender")}
                scans = stream.push(moved(replace(block, **some), by_s))
                if scans:
                    come = int(np.searchsorted(here.t_s, scans[-1].t_s[-1] - 0.05))
                    session.add_track(here[given:come])
                    given = max(given, come)
                watch.take(scans, time.time(), {})
                while not taken.empty():
                    taken.get()
        if by_s >= told_s:
            told_s += 600.0
            begun_s = time.perf_counter()
            again = page.join()
            assert again is not None
            assert session.cells is not None
            first = again.queue.get()
            page.leave(again)
            whole_ms = 1e3 * (time.perf_counter() - begun_s)
            hectares = session.cells.area_m2(WORKED) * 1e-4
            words = f"{hectares:.3f} ha, picture {len(first) / 1e3:.1f} kB in {whole_ms:.1f} ms"
            print(f"{by_s / 3600.0:5.2f} h  {resident_mb():7.1f} MB  {words}  {watch.summary()}", flush=True)


if __name__ == "__main__":
    main()
