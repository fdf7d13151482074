"""Memory of a run against the length of its recording, up to eight hours, stage by stage.

A short simulated recording is repeated with its times carried on, moved so that each turn of it begins where the one
before ended; after FIELD turns, with a pause, another visit begins at the first place. Of the packets one in THIN is
kept, so that eight hours are gigabytes and still show the ground well enough to be matched: what grows with the time
(poses, positions, equations, windows, layers) is that of a full day, what grows with the points alone is not.

    long_day.py FOLDER MINUTES ...      FOLDER: a recording of `furrowmap simulate` or of the samples
    THIN=1 long_day.py FOLDER 10    all packets: what is bounded by a number of points is filled within ten minutes
    long_day.py FOLDER --runs 50        runs of one turn after another in one process, as a program of the user has them

Each length is a process of its own, whose resident memory is read ten times a second: anonymous memory, which it
needs, mapped files, which the system takes back at will, and both at one moment, as a monitor shows it. Processor time
and memory grow with the length to the power of the printed exponents.
"""

from __future__ import annotations

import gzip
import json
import math
import multiprocessing
import os
import sys
import tempfile
import threading
import tomllib
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from pathlib import Path
from time import perf_counter, process_time

import numpy as np
import tomli_w

from furrowmap import run

THIN = int(os.environ.get("THIN", "29"))
"""Of a VLP-16's 75.4 packets a turn; no divisor, so that all directions are kept in turn."""
PERIOD_S = 61.0
"""Of a turn; longer than the recording."""
FIELD = 18
PAUSE_S = 30.0
RECORD = 16 + 42 + 1206
HOUR_US = 3_600_000_000
POLL_S = 0.1


def main() -> None:
    folder = Path(sys.argv[1])
    if sys.argv[2] == "--runs":
        repeated(folder, int(sys.argv[3]))
        return
    minutes = [float(word) for word in sys.argv[2:]]
    before: tuple[float, float, float] | None = None
    print(f"{'minutes':>8} {'stage':24}{'anonymous MB':>14}{'files MB':>10}{'resident MB':>13}{'seconds':>9}")
    for length in minutes:
        with tempfile.TemporaryDirectory(prefix="long-day-") as made:
            session = spliced(folder, Path(made), round(60.0 * length / PERIOD_S))
            with multiprocessing.get_context("spawn").Pool(1) as pool:
                peaks, timings, processor_s = pool.apply(measured, (str(session), f"{made}/out"))
            for stage, peak in peaks.items():
                print(f"{length:8g} {stage:24}{peak.figures()}{peak.seconds:9.1f}")
            whole = Peak(*(max(getattr(peak, name) for peak in peaks.values()) for name in vars(Peak())))
            print(f"{length:8g} {'whole':24}{whole.figures()}   {timings}, processor {processor_s:.1f} s", flush=True)
            now = (length, processor_s, whole.resident_mb)
            if before is not None:
                ratio = math.log(length / before[0])
                of_time, of_memory = (
                    math.log(one / other) / ratio for one, other in zip(now[1:], before[1:], strict=True)
                )
                print(
                    f"{before[0]:g} to {length:g} minutes: exponents {of_time:.2f} of time, {of_memory:.2f} of memory"
                )
            before = now


def repeated(folder: Path, runs: int) -> None:
    """Memory of this process after each of many runs."""
    print(f"{'runs':>8}{'anonymous MB':>14}{'files MB':>10}")
    with tempfile.TemporaryDirectory(prefix="long-day-") as made:
        session = spliced(folder, Path(made), 1)
        for number in range(1, runs + 1):
            run(session, f"{made}/out")
            anonymous_mb, files_mb = resident_mb()
            print(f"{number:8}{anonymous_mb:14.0f}{files_mb:10.0f}", flush=True)


def resident_mb() -> tuple[float, float]:
    """Anonymous and file-backed resident memory of this process."""
    fields = dict(line.split(":") for line in Path("/proc/self/status").read_text().splitlines())
    anonymous, files = (int(fields[name].split()[0]) / 1024 for name in ("RssAnon", "RssFile"))
    return anonymous, files


@dataclass
class Peak:
    """The greatest resident memory of a stage, and how long it took."""

    anonymous_mb: float = 0.0
    files_mb: float = 0.0
    resident_mb: float = 0.0
    seconds: float = 0.0

    def figures(self) -> str:
        """As a line of the table."""
        return f"{self.anonymous_mb:14.0f}{self.files_mb:10.0f}{self.resident_mb:13.0f}"


@dataclass
class Watch:
    """Reads the process's resident memory in a thread of its own."""

    stage: str = "start"
    peaks: dict[str, Peak] = field(default_factory=dict)
    ended: threading.Event = field(default_factory=threading.Event)

    def watch(self) -> None:
        """Until it is ended."""
        last = perf_counter()
        while not self.ended.wait(POLL_S):
            anonymous_mb, files_mb = resident_mb()
            now, peak = perf_counter(), self.peaks.setdefault(self.stage, Peak())
            peak.anonymous_mb, peak.files_mb = max(peak.anonymous_mb, anonymous_mb), max(peak.files_mb, files_mb)
            peak.resident_mb = max(peak.resident_mb, anonymous_mb + files_mb)
            peak.seconds, last = peak.seconds + now - last, now


def measured(session: str, out: str) -> tuple[dict[str, Peak], dict[str, float], float]:
    """Peaks of the stages of a run, its timings, and the processor time of this process."""
    watch = Watch()
    thread = threading.Thread(target=watch.watch)
    thread.start()

    def progress(stage: str, _: float) -> None:
        watch.stage = stage

    try:
        run(session, out, progress=progress)
    finally:
        watch.ended.set()
        thread.join()
    return watch.peaks, json.loads(Path(out, "report.json").read_text())["timings"], process_time()


def spliced(source: Path, out: Path, turns: int) -> Path:
    """A session of so many turns of a recording."""
    session = tomllib.loads((source / "session.toml").read_text())
    gnss = session["recording"]["gnss"][0]
    lines = (source / gnss).read_text().splitlines()
    moved = _ends(lines)
    packets = _packets(source / session["recording"]["lidar"][0])
    with (out / "recording.pcap").open("wb") as capture, (out / "gnss.nmea").open("w") as log:
        capture.write(packets[0])
        for turn in range(turns):
            later_s = PERIOD_S * turn + PAUSE_S * (turn // FIELD)
            capture.write(_later(packets[1], later_s).tobytes())
            log.write("".join(_carried(line, later_s, (turn % FIELD) * moved) for line in lines))
    session["recording"] |= {"lidar": ["recording.pcap"], "gnss": ["gnss.nmea"]}
    session.pop("field", None)
    (out / "session.toml").write_text(tomli_w.dumps(session))
    return out / "session.toml"


def _packets(capture: Path) -> tuple[bytes, np.ndarray]:
    """The file header, and one data packet in THIN with its record header (n, RECORD)."""
    data = gzip.decompress(capture.read_bytes()) if capture.suffix == ".gz" else capture.read_bytes()
    kept, at, number = [], 24, 0
    while at < len(data):
        size = 16 + int.from_bytes(data[at + 8 : at + 12], "little")
        if size == RECORD:
            if number % THIN == 0:
                kept.append(np.frombuffer(data, np.uint8, RECORD, at))
            number += 1
        at += size
    return data[:24], np.array(kept)


def _later(packets: np.ndarray, later_s: float) -> np.ndarray:
    """The packets with the capture's and the scanner's clock moved on."""
    out, later_us = packets.copy(), round(1e6 * later_s)
    captured = out[:, :8].copy().view("<u4").astype(np.int64)
    us = captured[:, 0] * 1_000_000 + captured[:, 1] + later_us
    out[:, :8] = np.column_stack([us // 1_000_000, us % 1_000_000]).astype("<u4").view(np.uint8)
    stamp = out[:, -6:-2].copy().view("<u4").astype(np.int64)
    out[:, -6:-2] = ((stamp + later_us) % HOUR_US).astype("<u4").view(np.uint8)
    return out


def _ends(lines: list[str]) -> np.ndarray:
    """Way in degrees of latitude and longitude and metres of height from the first position to the last."""
    fixes = [line.split(",") for line in lines if "GGA" in line[:6]]
    return _place(fixes[-1]) - _place(fixes[0])


def _place(gga: list[str]) -> np.ndarray:
    lat, lon = (float(gga[k][:-11]) + float(gga[k][-11:]) / 60.0 for k in (2, 4))
    return np.array([lat, lon, float(gga[9])])


def _carried(line: str, later_s: float, moved: np.ndarray) -> str:
    """A sentence with its time and place moved on; only GGA and GST, whose times have no date, and RMC."""
    words = line.split("*")[0].split(",")
    kind = words[0][-3:]
    if kind not in ("GGA", "GST", "RMC"):
        return ""
    time = datetime.strptime(words[1], "%H%M%S.%f").replace(tzinfo=UTC) + timedelta(seconds=later_s)
    words[1] = f"{time:%H%M%S}.{time.microsecond // 10_000:02d}"
    at = {"GGA": 2, "RMC": 3}.get(kind)
    if at is not None:
        place = _place(["", "", words[at], "", words[at + 2], "", "", "", "", words[9] if kind == "GGA" else "0"])
        lat, lon, height = place + moved
        for k, degrees, width in ((at, lat, 2), (at + 2, lon, 3)):
            whole = int(degrees)
            words[k] = f"{whole:0{width}d}{60.0 * (degrees - whole):011.8f}"
        if kind == "GGA":
            words[9] = f"{height:.4f}"
    text = ",".join(words)
    check = 0
    for byte in text[1:].encode():
        check ^= byte
    return f"{text}*{check:02X}\r\n"


if __name__ == "__main__":
    os.environ.setdefault("OMP_NUM_THREADS", "2")
    main()
