"""Killed at any moment, or on a full disk, every writer leaves the old products or the new ones.

A few kills of some writers are a part of every test; `KILLS=200 pytest tests/app/test_killed.py` makes as many of each.
"""

from __future__ import annotations

import json
import os
import random
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from furrowmap.exporters.files.staging import recover
from tests.app.writers import WRITERS
from tests.conftest import CHECKOUT

KILLS = int(os.environ.get("KILLS", "0"))
ALWAYS = ("cloud", "csv", "farm", "gpkg", "mosaic", "surface")
"""Writers of files, of folders, of databases; they share what the others use."""
pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="there is no SIGKILL")


class Mortal:
    """A program that writes products in processes that end early."""

    def __init__(self) -> None:
        self._program = subprocess.Popen(
            [sys.executable, "-m", "tests.app.mortal"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
            cwd=CHECKOUT,
            # The day of writing, which GeoPackages state, makes no difference.
            env={**os.environ, "OGR_CURRENT_DATE": "2026-06-11T00:00:00Z"},
        )

    def does(self, deed: str, source: Path, target: Path, **end: float) -> dict[str, Any]:
        """Its exit status, negative where it was killed, and the operations it made that change files, or its error."""
        assert self._program.stdin is not None
        assert self._program.stdout is not None
        words = {"deed": deed, "source": str(source), "target": str(target), **end}
        self._program.stdin.write(json.dumps(words) + "\n")
        self._program.stdin.flush()
        answer: dict[str, Any] = json.loads(self._program.stdout.readline())
        return answer

    def close(self) -> None:
        self._program.communicate()


@pytest.fixture(scope="module")
def program() -> Iterator[Mortal]:
    program = Mortal()
    yield program
    program.close()


@dataclass
class Scene:
    """A folder with the old product of a writer, and what is known of a new one.

    Attributes:
        deed: name of the writer.
        target: the old product.
        new: source of the new product.
        contents: of the old product and of the new one.
        operations: that a new product takes.
        seconds: that a new product takes.
        largest: size of its largest file, in bytes.
        kept: copy of the old product.
    """

    deed: str
    target: Path
    new: Path
    contents: tuple[dict[str, str], dict[str, str]]
    operations: int
    seconds: float
    largest: int
    kept: Path

    def restore(self) -> None:
        shutil.rmtree(self.target.parent)
        shutil.copytree(self.kept, self.target.parent)

    def found(self) -> dict[str, str]:
        """What a reader finds."""
        if self.target.is_dir():
            recover(self.target)
        return WRITERS[self.deed].content(self.target)


@pytest.fixture(scope="module", params=sorted(WRITERS) if KILLS else ALWAYS)
def scene(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory, program: Mortal) -> Scene:
    deed, folder = request.param, tmp_path_factory.mktemp(request.param)
    writer = WRITERS[deed]
    for name in ("sources", "products"):
        (folder / name).mkdir()
    old, new = (writer.make(folder / "sources", number) for number in (1, 2))
    target = folder / "products" / writer.target
    contents, whole, seconds, largest = [], {}, 0.0, 0
    for each in (new, old):
        begun_s = time.monotonic()
        said = program.does(deed, each, target)
        assert said.get("operations"), said
        contents.append(writer.content(target))
        if each == new:
            whole, seconds = said, time.monotonic() - begun_s
            files = [target] if target.is_file() else list(target.iterdir())
            largest = max(file.stat().st_size for file in files)
    assert contents[0] != contents[1]
    shutil.copytree(target.parent, folder / "kept")
    return Scene(deed, target, new, (contents[1], contents[0]), whole["operations"], seconds, largest, folder / "kept")


def test_promise_20__killed_writer_leaves_the_old_products_or_the_new_ones(scene: Scene, program: Mortal) -> None:
    chance = random.Random(5)
    seen = []
    for number in range(KILLS or 4):
        scene.restore()
        if number % 2 == 0:
            # The last operations put the products in their places.
            first = scene.operations - 30 if chance.random() < 0.7 else 1
            end: dict[str, float] = {"operation": chance.randint(max(1, first), scene.operations)}
        else:
            end = {"seconds": chance.uniform(0.01, scene.seconds)}
        program.does(scene.deed, scene.new, scene.target, **end)
        found = scene.found()
        assert found in scene.contents, end
        seen.append(found == scene.contents[1])
    assert "operations" in program.does(scene.deed, scene.new, scene.target)
    assert scene.found() == scene.contents[1]
    folder = scene.target if scene.target.is_dir() else scene.target.parent
    assert not [path for path in folder.iterdir() if path.name.startswith(".")]
    sys.stderr.write(f"{scene.deed}: {len(seen)} kills, {sum(seen)} left the new products\n")


def test_promise_19__full_disk_leaves_the_old_products_and_an_error_in_three_lines(
    scene: Scene, program: Mortal
) -> None:
    chance = random.Random(5)
    scene.restore()
    sizes = [1, scene.largest - 1, *(chance.randint(1, scene.largest - 1) for _ in range(KILLS // 10))]
    for size in sizes:
        said = program.does(scene.deed, scene.new, scene.target, bytes=size)
        assert len(said.get("error", ())) == 3, (size, said)
        assert scene.found() == scene.contents[0]
        folder = scene.target if scene.target.is_dir() else scene.target.parent
        assert not [path for path in folder.iterdir() if path.name.startswith(".")]
