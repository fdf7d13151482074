"""`furrowmap record` on the loopback: packets lost and processor time at a rate, and what kills at random moments lose.

    python benchmarks/record.py [--rate 2262] [--seconds 60] [--kills 20]

The packets are as long as those of a VLP-16, of which there are 754 a second, and numbered.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import socket
import struct
import subprocess
import sys
import tempfile
import time
from pathlib import Path

PORT = 52_368
PACKET = b"\xff\xee" + bytes(1198)


def started(folder: Path) -> subprocess.Popen[bytes]:
    """A recording that listens."""
    command = [Path(sys.executable).with_name("furrowmap"), "record", "-o", folder, "--ports", str(PORT), "-q"]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    while not (folder / "status.json").exists():
        time.sleep(0.1)
    return process


def send(rate: int, seconds: float) -> int:
    """Send packets whose last six bytes are those of a VLP-16; their number."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        sent, begun_s = 0, time.monotonic()
        while (passed_s := time.monotonic() - begun_s) < seconds:
            while sent < passed_s * rate:
                stamp_us = sent * 1_000_000 // rate % 3_600_000_000
                sender.sendto(PACKET + struct.pack("<IBB", stamp_us, 0x37, 0x22), ("127.0.0.1", PORT))
                sent += 1
            time.sleep(0.0005)
    return sent


def times_s(folder: Path) -> list[float]:
    """Times of arrival of all whole packets."""
    found = []
    for path in sorted(folder.glob("*.pcap")):
        data, at = path.read_bytes(), 24
        while at + 16 <= len(data):
            seconds, nanoseconds, captured, _ = struct.unpack_from("<IIII", data, at)
            at += 16 + captured
            if at <= len(data):
                found.append(seconds + nanoseconds * 1e-9)
    return found


def main() -> None:
    """Measure, and print what was found."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rate", type=int, default=3 * 754)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--kills", type=int, default=0)
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch, "rate")
        process = started(folder)
        before = Path(f"/proc/{process.pid}/stat").read_text().split()
        sent = send(asked.rate, asked.seconds)
        time.sleep(1.5)
        after = Path(f"/proc/{process.pid}/stat").read_text().split()
        process.terminate()
        process.wait()
        user, system = ((int(after[k]) - int(before[k])) / os.sysconf("SC_CLK_TCK") for k in (13, 14))
        status = json.loads((folder / "status.json").read_text())
        buffer = status["sockets"][0]["granted_bytes"]
        print(f"{sent} packets sent, {len(times_s(folder))} recorded; buffer {buffer} bytes")
        share = 100 * (user + system) / asked.seconds
        print(f"processor: {share:.1f} % of a core ({user:.2f} s user, {system:.2f} s system)")
        print(f"longest time that a power cut would have lost: {status['disk']['most_unsynced_s']:.2f} s")
        lost_s = []
        for k in range(asked.kills):
            folder = Path(scratch, f"kill{k}")
            process = started(folder)
            send(asked.rate, random.uniform(0.3, 2.0))
            process.kill()
            killed_s = time.time()
            process.wait()
            lost_s.append(killed_s - max(times_s(folder), default=killed_s - 9.0))
        if lost_s:
            print(f"{len(lost_s)} kills: the last packet was {min(lost_s):.3f} to {max(lost_s):.3f} s before the kill")


if __name__ == "__main__":
    main()
