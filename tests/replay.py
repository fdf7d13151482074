"""Sends a recording to this machine at its own speed, as scanner and receiver did.

As a program: python tests/replay.py recording.pcap gnss.nmea 2368:12368,8308:18308 15017 [speed]
"""

from __future__ import annotations

import math
import socket
import sys
import time
from collections.abc import Iterator, Mapping
from heapq import merge
from pathlib import Path

import numpy as np

from furrowmap.core.readers.pcap import Capture
from furrowmap.core.readers.source import Source

Event = tuple[float, int, bytes]
"""Time, UDP port and content of what is sent."""


def packets(capture: Path, ports: Mapping[int, int]) -> Iterator[Event]:
    """The datagrams in a capture to some ports, to be sent to others."""
    with Source(capture) as source:
        for block in Capture(source):
            data = block.data.tobytes()
            port = (block.sender & np.uint64(0xFFFF)).astype(int).tolist()
            rows = zip(block.time_s.tolist(), port, block.offset.tolist(), block.length.tolist(), strict=True)
            yield from ((t_s, ports[to], data[at : at + size]) for t_s, to, at, size in rows if to in ports)


def sentences(log: Path, midnight_s: float, port: int) -> Iterator[Event]:
    """The sentences of an NMEA log, each a fifth of a second after its time."""
    t_s = midnight_s
    for line in log.read_bytes().splitlines(keepends=True):
        fields = line.split(b",")
        if fields[0][3:] in (b"GGA", b"RMC") and fields[1]:
            clock = float(fields[1])
            t_s = midnight_s + clock // 10000 * 3600 + clock // 100 % 100 * 60 + clock % 100
        yield t_s + 0.2, port, line


def replay(events: Iterator[Event], *, speed: float = 1.0, lasts_s: float = math.inf, source: str = "127.0.0.1") -> int:
    """Send events; their number. `source` is the address they come from: 127.0.0.2 is another scanner."""
    sent, first_s, begun_s = 0, math.nan, time.monotonic()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        sender.bind((source, 0))
        for t_s, port, content in events:
            first_s = t_s if math.isnan(first_s) else first_s
            if t_s - first_s > lasts_s:
                break
            wait_s = (t_s - first_s) / speed - (time.monotonic() - begun_s)
            if wait_s > 0.001:
                time.sleep(wait_s)
            sender.sendto(content, ("127.0.0.1", port))
            sent += 1
    return sent


if __name__ == "__main__":
    capture, log, pairs, gnss_port, *speed = sys.argv[1:]
    ports = {int(pair.partition(":")[0]): int(pair.partition(":")[2]) for pair in pairs.split(",")}
    midnight_s = next(packets(Path(capture), ports))[0] // 86_400 * 86_400
    told = merge(packets(Path(capture), ports), sentences(Path(log), midnight_s, int(gnss_port)))
    sys.stdout.write(f"{replay(told, speed=float((speed or ['1'])[0]))} sent\n")
