"""How fast a Velodyne capture becomes scans, beside velodyne-decoder on the same file in the same run.

    python benchmarks/decode.py [RECORDING.pcap[.gz]]

Both start from the file's bytes (unpacked first, as velodyne-decoder reads no compressed files) and end with one cloud
per revolution. The kernels are compiled before the clock starts.
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Callable, Sized
from dataclasses import dataclass
from pathlib import Path

import velodyne_decoder

from furrowmap.core.readers.reader import ReadOptions
from furrowmap.core.readers.source import Source
from furrowmap.core.readers.velodyne.captures import VelodynePcap

SAMPLE = Path(__file__).resolve().parents[2] / "shared" / "data" / "tractor_loop" / "recording.pcap.gz"
ROUNDS = 3


@dataclass(frozen=True)
class DecodingSpeed:
    """Points of a recording, and the best of several rounds of each decoder."""

    points: int
    seconds: float
    seconds_packed: float
    velodyne_decoder_s: float

    @property
    def ratio(self) -> float:
        """How many times as fast as velodyne-decoder."""
        return self.velodyne_decoder_s / self.seconds

    def table(self) -> str:
        """The figures, one decoder a line."""
        lines = [f"{'':28}{'seconds':>10}{'M points/s':>12}"]
        for name, seconds in (
            ("furrowmap", self.seconds),
            ("furrowmap, file as it is", self.seconds_packed),
            ("velodyne-decoder", self.velodyne_decoder_s),
        ):
            lines.append(f"{name:28}{seconds:10.3f}{self.points / seconds / 1e6:12.1f}")
        lines.append(f"{self.points:,} points; {self.ratio:.2f} times as fast as velodyne-decoder")
        return "\n".join(lines)


def measure(recording: Path = SAMPLE) -> DecodingSpeed:
    """Decode a capture by both, in turns."""
    with tempfile.TemporaryDirectory() as folder:
        plain = Path(folder) / "recording.pcap"
        with Source(recording) as source, plain.open("wb") as file:
            while block := source.read(1 << 20):
                file.write(block)
        count_points(furrowmap_scans(plain))
        best = {"plain": float("inf"), "packed": float("inf"), "other": float("inf")}
        points = 0
        for _ in range(ROUNDS):
            points, best["plain"] = timed(lambda: furrowmap_scans(plain), best["plain"])
            _, best["packed"] = timed(lambda: furrowmap_scans(recording), best["packed"])
            _, best["other"] = timed(
                lambda: [scan.points for scan in velodyne_decoder.read_pcap(str(plain))], best["other"]
            )
    return DecodingSpeed(points, best["plain"], best["packed"], best["other"])


def furrowmap_scans(path: Path) -> list[Sized]:
    return list(VelodynePcap([path], ReadOptions()).scans())


def count_points(clouds: list[Sized]) -> int:
    return sum(len(cloud) for cloud in clouds)


def timed(decode: Callable[[], list[Sized]], best_s: float) -> tuple[int, float]:
    start = time.perf_counter()
    clouds = decode()
    seconds = time.perf_counter() - start
    return count_points(clouds), min(best_s, seconds)


if __name__ == "__main__":
    print(measure(*map(Path, sys.argv[1:2])).table())
