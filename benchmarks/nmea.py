"""Sentences per second of the NMEA reader, beside pynmeagps on the same log in the same run.

The log is an hour at 10 Hz of GGA, RMC, GST and VTG. Each figure is the best of three readings, the first one (which
may compile) left out; pynmeagps reads once.
"""

from __future__ import annotations

import functools
import operator
import tempfile
import time
import tracemalloc
from pathlib import Path

import pynmeagps

from furrowmap.core.readers.nmea.log import NmeaLog
from furrowmap.core.readers.reader import ReadOptions


def sentence(body: str) -> str:
    return f"${body}*{functools.reduce(operator.xor, body.encode(), 0):02X}\r\n"


def write_log(path: Path, hours: int) -> int:
    """Write `hours` at 10 Hz; returns the number of sentences."""
    epochs = hours * 36_000
    with path.open("w", newline="") as file:
        for k in range(epochs):
            tod = f"{k // 36_000:02d}{k // 600 % 60:02d}{k // 10 % 60:02d}.{k % 10}0"
            place = f"3652.{20_000_000 + k % 10_000_000:08d},N,14001.{21_000_000 + k % 10_000_000:08d},E"
            file.write(sentence(f"GNGGA,{tod},{place},4,14,0.8,231.5425,M,41.3170,M,1.0,0199"))
            file.write(sentence(f"GNRMC,{tod},A,{place},1.944,90.12,110626,,,R,V"))
            file.write(sentence(f"GNGST,{tod},0.011,0.0108,0.0108,0.0,0.0108,0.0108,0.0428"))
            file.write(sentence("GNVTG,90.12,T,,M,1.944,N,3.600,K,R"))
    return 4 * epochs


def best_of(count: int, path: Path) -> float:
    """Seconds of the fastest reading; one before them may compile."""
    seconds = []
    for _ in range(count + 1):
        began = time.perf_counter()
        NmeaLog([path], ReadOptions()).track()
        seconds.append(time.perf_counter() - began)
    return min(seconds[1:])


def peak_mb(path: Path) -> float:
    tracemalloc.start()
    NmeaLog([path], ReadOptions()).track()
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return peak / 1e6


def main() -> None:
    with tempfile.TemporaryDirectory() as folder:
        path, longer = Path(folder, "hour.nmea"), Path(folder, "hours.nmea")
        sentences = write_log(path, 1)
        write_log(longer, 4)
        ours = best_of(3, path)
        began = time.perf_counter()
        with path.open("rb") as stream:
            read = sum(1 for _ in pynmeagps.NMEAReader(stream))
        theirs = time.perf_counter() - began
        assert read == sentences
        print(f"an hour at 10 Hz, {sentences} sentences, {path.stat().st_size / 1e6:.1f} MB")
        print(f"furrowmap  {ours:6.2f} s  {sentences / ours:12,.0f} sentences/s  (to positions in UTC)")
        print(f"pynmeagps  {theirs:6.2f} s  {sentences / theirs:12,.0f} sentences/s  (to messages)")
        print(f"ratio      {theirs / ours:6.0f}")
        print(f"peak memory  {peak_mb(path):.0f} MB an hour, {peak_mb(longer):.0f} MB four hours")


if __name__ == "__main__":
    main()
