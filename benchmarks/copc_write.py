"""How fast a cloud is written as COPC, beside what others need for the same points in the same run.

    python benchmarks/copc_write.py [SESSION] [--rounds N] [--memory]

SESSION is a session.toml; the points are those its run places. Each way of writing takes its turn in each round, and
the best round counts, because others may use the machine. `--memory` tells the peak memory for the recording once and
four times over instead, each in a process of its own.
"""

from __future__ import annotations

import argparse
import multiprocessing
import resource
import tempfile
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from dataclasses import replace
from pathlib import Path
from time import perf_counter, process_time

import copclib
import lazrs
import numpy as np

from furrowmap.core.geodesy.projection import MapFrame
from furrowmap.core.pipeline.run import run
from furrowmap.core.pointclouds.placed_scans import PlacedScan
from furrowmap.core.session.opened import open_session
from furrowmap.exporters.cloud.copc_file import CopcFormat, las_header
from furrowmap.exporters.cloud.octree import Key, Octree
from furrowmap.exporters.cloud.point_batches import PointBatch, pack
from furrowmap.exporters.cloud.records import Chosen, Records
from furrowmap.exporters.cloud.writer import MEMORY_POINTS, NODE_POINTS, CopcWriter

LOOP = Path(__file__).resolve().parents[2] / "shared" / "data" / "tractor_loop" / "session.toml"
SCAN = (("scan", "uint32", "number of the scan"),)
LAYOUT = las_header(CopcFormat("", (0.0, 0.0, 0.0), extra=SCAN)).point_format.dtype()
LENGTHS = (1, 4)


class Collected:
    """The sink of a run that keeps its points."""

    def __init__(self) -> None:
        self.batches: list[PointBatch] = []
        self.origin_m = (0.0, 0.0, 0.0)
        self.wkt = ""

    def __call__(
        self,
        frame: MapFrame,
        origin_m: tuple[float, float, float],
        frames: object,  # noqa: ARG002
    ) -> Callable[[PlacedScan], None]:
        """Note where the points are."""
        self.origin_m, self.wkt = origin_m, frame.crs.to_wkt("WKT1_GDAL")
        return self.add

    def add(self, placed: PlacedScan) -> None:
        """Keep the points of a scan."""
        scan = placed.scan
        self.batches.append(
            PointBatch(
                placed.xyz_m,
                placed.scan.t_s,
                intensity=scan.intensity,
                return_number=scan.return_number,
                returns=scan.returns,
                extra={"scan": placed.number},
            )
        )

    @property
    def points(self) -> int:
        """Their number."""
        return sum(len(batch) for batch in self.batches)


def write_ours(path: Path, cloud: Collected, memory_points: int = MEMORY_POINTS, times: int = 1) -> None:
    kind = CopcFormat(cloud.wkt, cloud.origin_m, extra=SCAN)
    with CopcWriter(path, kind, memory_points=memory_points) as writer:
        for i in range(times):
            for batch in cloud.batches:
                writer.append(replace(batch, xyz_m=batch.xyz_m + np.array([0.0, 20.0 * i, 0.0])) if i else batch)


def write_lazrs(path: Path, records: Records, *, parallel: bool) -> None:
    """The records as they come, in chunks of 50,000: no packing, no octree, no header."""
    compressor = lazrs.ParLasZipCompressor if parallel else lazrs.LasZipCompressor
    with path.open("wb") as file:
        writer = compressor(file, lazrs.LazVlr.new_for_compression(6, 4))
        writer.compress_many(records.view(np.uint8))
        writer.done()


class CopclibNodes:
    """Nodes on their way into a file of copclib's; the octree is left to its caller."""

    def __init__(self, path: Path, cloud: Collected) -> None:
        scale, offset = copclib.Vector3(0.001, 0.001, 0.001), copclib.Vector3(*cloud.origin_m)
        config = copclib.CopcConfigWriter(6, scale, offset, cloud.wkt, copclib.EbVlr(4))
        self._writer = copclib.FileWriter(str(path), config)

    def put(self, key: Key, parts: Sequence[Chosen]) -> Future[None]:
        """Write a node."""
        records = np.concatenate([part.gathered() for part in parts])
        self._writer.AddNode(copclib.VoxelKey(*key), copclib.VectorChar(records.view(np.int8)))
        done: Future[None] = Future()
        done.set_result(None)
        return done

    def close(self) -> None:
        """Write the hierarchy."""
        self._writer.Close()


def write_copclib(path: Path, cloud: Collected) -> None:
    """Packing and octree as ours, the file by copclib."""
    octree = Octree(LAYOUT, MEMORY_POINTS, NODE_POINTS, path.parent, np.random.default_rng(0))
    for batch in cloud.batches:
        room = octree.room(len(batch))
        extent = pack(batch, room, 0.001)
        octree.filled(len(room), extent.low, extent.high)
    nodes = CopclibNodes(path, cloud)
    octree.finish(nodes.put)
    nodes.close()


def collect(session: Path) -> Collected:
    cloud = Collected()
    run(open_session(session), cloud)
    return cloud


def compare(session: Path, rounds: int, folder: Path) -> None:
    cloud = collect(session)
    records = np.empty(cloud.points, LAYOUT)
    start = 0
    for batch in cloud.batches:
        pack(batch, records[start : start + len(batch)], 0.001)
        start += len(batch)
    n = len(records)
    path = folder / "cloud.copc.laz"
    ways: dict[str, Callable[[], None]] = {
        "furrowmap": lambda: write_ours(path, cloud),
        "furrowmap, a quarter in memory": lambda: write_ours(path, cloud, memory_points=n // 4),
        "lazrs, all cores, records as they come": lambda: write_lazrs(path, records, parallel=True),
        "lazrs, one core, records as they come": lambda: write_lazrs(path, records, parallel=False),
        "copclib, one core, octree as ours": lambda: write_copclib(path, cloud),
    }
    write_ours(path, cloud)  # compiles, and warms the disk
    best = {name: (float("inf"), float("inf")) for name in ways}
    size = dict.fromkeys(ways, 0)
    for _ in range(rounds):
        for name, write in ways.items():
            wall, cpu = perf_counter(), process_time()
            write()
            taken = perf_counter() - wall, process_time() - cpu
            best[name] = min(best[name][0], taken[0]), min(best[name][1], taken[1])
            size[name] = path.stat().st_size
    print(f"{n:,} points, best of {rounds}\n")
    print(f"{'':40} {'M points/s':>10} {'processor s':>12} {'bytes a point':>14}")
    for name, (wall, cpu) in best.items():
        print(f"{name:40} {n / wall / 1e6:10.2f} {cpu:12.2f} {size[name] / n:14.2f}")


def peak_mb(session: Path, times: int, folder: Path, answer: multiprocessing.SimpleQueue[tuple[int, float]]) -> None:
    """What writing takes beyond what the recording's points do themselves."""
    cloud = collect(session)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    write_ours(folder / "cloud.copc.laz", cloud, times=times)
    answer.put((times * cloud.points, (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("session", type=Path, nargs="?", default=LOOP)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--memory", action="store_true")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        if not options.memory:
            compare(options.session, options.rounds, Path(folder))
            return
        spawn = multiprocessing.get_context("spawn")
        for times in LENGTHS:
            answer = spawn.SimpleQueue()
            process = spawn.Process(target=peak_mb, args=(options.session, times, Path(folder), answer))
            process.start()
            process.join()
            if process.exitcode:
                raise SystemExit(process.exitcode)
            points, mb = answer.get()
            print(f"{points:12,} points: {mb:6.0f} MB beyond the points handed over")


if __name__ == "__main__":
    main()
