"""Killed at any moment, a folder holds the old products or the new ones.

A few kills each are a part of every test; `KILLS=50 pytest tests/app/test_killed.py` makes as many, and kills
runs as well.
"""

from __future__ import annotations

import hashlib
import json
import os
import random
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import laspy
import msgspec
import numpy as np
import pyogrio
import pyproj
import pytest
import rasterio

from furrowmap.core.simulator.scenario_file import demo_scenario
from furrowmap.core.simulator.simulate import simulate
from furrowmap.exporters.files.lease import leases
from furrowmap.exporters.files.staging import recover
from tests.exporters.farm.result_folders import write_result

CHECKOUT = Path(__file__).resolve().parents[2]
KILLS = int(os.environ.get("KILLS", "0"))
pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="there is no SIGKILL")


class Mortal:
    """A program that writes products in processes that end early."""

    def __init__(self) -> None:
        self._program = subprocess.Popen(
            [sys.executable, "-m", "tests.app.mortal"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            cwd=CHECKOUT,
            # The day of writing, which GeoPackages tell, shall make no difference.
            env={**os.environ, "OGR_CURRENT_DATE": "2026-06-11T00:00:00Z"},
        )

    def does(self, deed: str, source: Path, target: Path, **end: float) -> dict[str, int]:
        """Its exit status, negative where it was killed, and how many operations it made that change files."""
        assert self._program.stdin is not None
        assert self._program.stdout is not None
        words = {"deed": deed, "source": str(source), "target": str(target), **end}
        self._program.stdin.write(json.dumps(words) + "\n")
        self._program.stdin.flush()
        answer: dict[str, int] = json.loads(self._program.stdout.readline())
        return answer

    def close(self) -> None:
        self._program.communicate()


@pytest.fixture(scope="module")
def program() -> Iterator[Mortal]:
    program = Mortal()
    yield program
    program.close()


def cloud(path: Path, seed: int) -> Path:
    chance = np.random.default_rng(seed)
    header = laspy.LasHeader(version="1.4", point_format=6)
    header.scales, header.offsets = np.full(3, 0.001), np.array([500_000.0, 5_300_000.0, 0.0])
    header.add_crs(pyproj.CRS.from_epsg(32633))
    las = laspy.LasData(header)
    las.x, las.y, las.z = (chance.uniform(0, 20, (3000, 3)) * (1, 1, 0.05) + (500_000, 5_300_000, 100)).T
    las.write(path)
    return path


def session(folder: Path, seed: int) -> Path:
    scenario = demo_scenario()
    drive = msgspec.structs.replace(scenario.drive, pass_m=(3.0,), passes=1)
    return simulate(msgspec.structs.replace(scenario, seed=seed, drive=drive), folder).recording.parent / "session.toml"


def source(deed: str, folder: Path, number: int) -> Path:
    """What one, and what another one of two kinds of products is made of."""
    if deed == "surface":
        return cloud(folder / f"{number}.las", number)
    if deed == "export":
        return write_result(folder / str(number), name=f"Field {number}", day=number)
    return session(folder / str(number), number)


def content(folder: Path, deed: str) -> dict[str, str]:
    """The files of a folder by what is in them; those of a run, which tells how long it took, by its recording."""
    paths = [path for path in sorted(folder.iterdir()) if path.is_file()]
    if deed == "run":
        return {path.name: told_recording(path) for path in paths if told_recording(path)}
    return {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in paths}


def told_recording(path: Path) -> str:
    """The recording that a product of a run tells of; empty where it tells none."""
    if path.suffix == ".tif":
        with rasterio.open(path) as raster:
            return str(raster.tags()["INPUT_1"])
    if path.suffix == ".gpkg":
        return str(pyogrio.read_info(path, layer="trajectory")["dataset_metadata"]["INPUT_1"])
    if path.name == "report.json":
        return "recording.pcap.gz sha256:" + json.loads(path.read_text())["inputs"][0]["sha256"]
    if path.suffix == ".laz":
        with laspy.CopcReader.open(path) as reader:
            words = next(vlr for vlr in reader.header.vlrs if vlr.record_id == 3).record_data_bytes().decode()
        return next(line.split(": ", 1)[1] for line in words.splitlines() if line.startswith("INPUT_1"))
    return ""


@pytest.mark.parametrize("deed", ["surface", "export", "run"])
def test_kill__leaves_the_old_products_or_the_new_ones(tmp_path: Path, program: Mortal, deed: str) -> None:
    if deed == "run" and not KILLS:
        pytest.skip("killing runs takes minutes: say how many with KILLS")
    old, new = source(deed, tmp_path, 1), source(deed, tmp_path, 2)
    target = tmp_path / "products"
    contents = {}
    for each in (new, old):
        begun = time.monotonic()
        whole = program.does(deed, each, target)
        whole_s = time.monotonic() - begun
        assert whole["status"] == 0
        contents[each] = content(target, deed)
    assert contents[new].keys() >= {"surface": {"dsm.tif"}, "export": {"passes.csv"}, "run": {"report.json"}}[deed]
    assert contents[new] != contents[old]
    kept = tmp_path / "kept"
    shutil.copytree(target, kept)
    chance = random.Random(5)
    seen = []
    for number in range(KILLS or 8):
        shutil.rmtree(target)
        shutil.copytree(kept, target)
        if number % 2:
            # The last operations put the products in their places.
            last = chance.random() < 0.7
            first = whole["operations"] - 30 if last else 1
            end = {"operation": chance.randint(max(1, first), whole["operations"])}
        else:
            end = {"seconds": chance.uniform(0.0, whole_s)}
        program.does(deed, new, target, **end)
        recover(target)
        found = content(target, deed)
        assert found in contents.values(), end
        assert not leases(target)
        seen.append(found == contents[new])
    assert False in seen
    assert program.does(deed, new, target)["status"] == 0
    assert content(target, deed) == contents[new]
    assert not [path for path in target.iterdir() if path.name.startswith(".")]
    sys.stderr.write(f"{deed}: {len(seen)} kills, {sum(seen)} left the new products\n")
