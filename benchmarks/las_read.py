"""How fast other people's clouds are read, beside laspy reading the same file to the same arrays in the same run.

    python benchmarks/las_read.py [FILE...] [--rounds N] [--points N]

Without FILE, clouds of `--points` points are made for the purpose. Each way of reading takes its turn in each round and
the best round counts, because others may use the machine.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path
from time import perf_counter, process_time

import laspy
import numpy as np

from furrowmap.core.readers.las.cloud import BATCH_POINTS, open_cloud


def read_ours(path: Path) -> tuple[int, float]:
    """Points, and their mean height, so that both ways are seen to read the same."""
    points, total = 0, 0.0
    for batch in open_cloud(path).batches():
        points += len(batch)
        total += float(batch.xyz_m[:, 2].sum())
    return points, total / points


def read_laspy(path: Path) -> tuple[int, float]:
    """The same arrays by laspy with lazrs, in parallel."""
    points, total = 0, 0.0
    with laspy.open(path, laz_backend=laspy.LazBackend.LazrsParallel) as reader:
        timed = "gps_time" in reader.header.point_format.dimension_names
        coloured = "red" in reader.header.point_format.dimension_names
        for chunk in reader.chunk_iterator(BATCH_POINTS):
            xyz = np.stack([chunk.x, chunk.y, chunk.z], axis=1)
            kept = [np.array(chunk[name]) for name in NAMES]
            kept += [np.array(chunk.gps_time) + 1e9 + 315_964_800 - 18] if timed else []
            kept += [np.stack([chunk.red, chunk.green, chunk.blue], axis=1)] if coloured else []
            points += len(xyz)
            total += float(xyz[:, 2].sum())
    return points, total / points


NAMES = ("classification", "intensity", "return_number", "number_of_returns", "point_source_id", "withheld")


def make(folder: Path, points: int) -> list[Path]:
    """A field as format 6 and 7, LAS and LAZ."""
    chance = np.random.default_rng(15)
    paths = []
    for number in (6, 7):
        header = laspy.LasHeader(version="1.4", point_format=number)
        header.scales, header.offsets = np.full(3, 0.001), np.array([500_000.0, 5_000_000.0, 100.0])
        las = laspy.LasData(header)
        las.x = 500_000.0 + np.sort(chance.uniform(0, 300, points)) + chance.normal(0, 0.5, points)
        las.y = 5_000_000.0 + chance.uniform(0, 300, points)
        las.z = 100.0 + 0.02 * chance.standard_normal(points)
        las.gps_time = 3e8 + np.arange(points) * 1e-5
        las.intensity = chance.integers(0, 255, points)
        las.return_number = las.number_of_returns = np.ones(points, np.uint8)
        las.classification = np.full(points, 2, np.uint8)
        for suffix in ("las", "laz"):
            paths.append(folder / f"format{number}.{suffix}")
            las.write(paths[-1])
    return paths


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("files", nargs="*", type=Path)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--points", type=int, default=3_000_000)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        for path in arguments.files or make(Path(folder), arguments.points):
            best = {"furrowmap": float("inf"), "laspy": float("inf")}
            spent = dict(best)
            answers = {}
            for _ in range(arguments.rounds):
                for name, read in (("furrowmap", read_ours), ("laspy", read_laspy)):
                    start, before = perf_counter(), process_time()
                    answers[name] = read(path)
                    best[name] = min(best[name], perf_counter() - start)
                    spent[name] = min(spent[name], process_time() - before)
            points = answers["furrowmap"][0]
            assert points == answers["laspy"][0]
            assert np.isclose(answers["furrowmap"][1], answers["laspy"][1])
            speeds = ", ".join(f"{name} {points / seconds / 1e6:.1f}" for name, seconds in best.items())
            ratios = [times["laspy"] / times["furrowmap"] for times in (best, spent)]
            print(f"{path.name}: {speeds} M points/s; {ratios[0]:.2f} times laspy, by processor time {ratios[1]:.2f}")


if __name__ == "__main__":
    main()
