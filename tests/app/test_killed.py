"""Killed at any moment, or on a full disk, every writer leaves the old products or the new ones.

Some writers are a part of every test. `make kills KILLS=200` looks at so many states of each as a kill would leave, and
makes a tenth as many kills.
"""

from __future__ import annotations

import os
import random
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import pytest

from furrowmap.exporters.files.batch_state import STATE
from tests.app.killing import ALWAYS, KILLS, Mortal
from tests.app.writers import WRITERS, settle

SMALL_BYTES = 192 << 20
pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="there is no SIGKILL")


@dataclass
class Scene:
    """A folder with the old product of a writer, and what is known of a new one.

    Attributes:
        deed: name of the writer.
        target: the old product.
        old: source of the old product.
        new: source of the new product.
        contents: of the old product and of the new one.
        operations: that a new product takes.
        seconds: that a new product takes.
        largest: size of its largest file, in bytes.
        kept: copy of the old product.
    """

    deed: str
    target: Path
    old: Path
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
            settle(self.target)
        return WRITERS[self.deed].content(self.target)

    def left(self) -> list[Path]:
        """What an unfinished writer has left."""
        folder = self.target if self.target.is_dir() else self.target.parent
        return [path for path in folder.iterdir() if path.name.startswith(".") and path.name != STATE]


@pytest.fixture(scope="module", params=sorted(WRITERS) if KILLS else ALWAYS)
def scene(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory, program: Mortal) -> Scene:
    deed, folder = request.param, tmp_path_factory.mktemp(request.param)
    writer = WRITERS[deed]
    for name in ("sources", "products"):
        (folder / name).mkdir()
    old, new = (writer.make(folder / "sources", number) for number in (1, 2))
    target = folder / "products" / writer.target
    contents: list[dict[str, str]] = []
    for each in (new, old, new, old):  # the first ones import and compile
        begun_s = time.monotonic()
        said = program.does(deed, each, target)
        assert said.get("operations"), said
        if each == new:
            whole, seconds = said["operations"], time.monotonic() - begun_s
            files = [target] if target.is_file() else [file for file in target.rglob("*") if file.is_file()]
            largest = max(file.stat().st_size for file in files)
        contents.append(writer.content(target))
    assert contents[0] == contents[2] != contents[1] == contents[3]
    shutil.copytree(target.parent, folder / "kept")
    return Scene(deed, target, old, new, (contents[1], contents[0]), whole, seconds, largest, folder / "kept")


def test_promise_20__killed_writer_leaves_the_old_products_or_the_new_ones(scene: Scene, program: Mortal) -> None:
    chance = random.Random(5)
    seen: list[bool] = []
    wanted = KILLS // 10 or 2
    for number in range(3 * wanted):
        if len(seen) == wanted:
            break
        scene.restore()
        if number % 2 == 0:
            # The last operations put the products in their places.
            first = scene.operations - 30 if chance.random() < 0.7 else 1
            end: dict[str, object] = {"operation": chance.randint(max(1, first), scene.operations)}
        else:
            end = {"seconds": chance.uniform(0.01, scene.seconds)}
        ended = program.does(scene.deed, scene.new, scene.target, **end)["status"]
        found = scene.found()
        assert found in scene.contents, end
        if ended < 0:  # it was not killed where chance let it live longer than it needed
            seen.append(found == scene.contents[1])
    assert len(seen) == wanted
    assert "operations" in program.does(scene.deed, scene.new, scene.target)
    assert scene.found() == scene.contents[1]
    assert not scene.left()
    sys.stderr.write(f"{scene.deed}: {len(seen)} kills, {sum(seen)} left the new products\n")


def test_promise_20__files_as_a_kill_would_leave_them_are_the_old_products_or_the_new_ones(
    scene: Scene, program: Mortal
) -> None:
    """Of a writer that is stopped many times on its way, which shows as many states as kills that each begin anew."""
    chance = random.Random(6)
    states = scene.kept.with_name("states")
    seen: list[bool] = []
    wanted = KILLS or 10
    while len(seen) < wanted:
        scene.restore()
        states.mkdir()
        latest = scene.operations - 30  # from which on products are put in their places
        early = chance.sample(range(1, max(latest, 1) + 1), k=min(max(latest, 1), 10))
        operations = sorted({*early, *range(max(latest, 1), scene.operations + 1)})
        pauses = [chance.uniform(0.0, 0.1 * scene.seconds) for _ in range(20)]
        said = program.does(
            scene.deed, scene.new, scene.target, states=str(states), operations=operations, pauses=pauses
        )
        assert said.get("operations"), said
        for state in sorted(states.iterdir())[: wanted - len(seen)]:
            shutil.rmtree(scene.target.parent)
            state.rename(scene.target.parent)
            found = scene.found()
            assert found in scene.contents, state.name
            seen.append(found == scene.contents[1])
        assert "operations" in program.does(scene.deed, scene.new, scene.target)
        assert scene.found() == scene.contents[1]
        assert not scene.left()
        shutil.rmtree(states)
    sys.stderr.write(f"{scene.deed}: {len(seen)} states, {sum(seen)} with the new products\n")


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
        assert not scene.left()


@pytest.fixture(scope="module")
def small_disk(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A file system of its own, which root may make; the products of a batch need 100 MB of it."""
    folder = tmp_path_factory.mktemp("disk")
    program = shutil.which("mount") or "false"
    command = [program, "-t", "tmpfs", "-o", f"size={SMALL_BYTES}", "tmpfs", str(folder)]
    made = subprocess.run(command, capture_output=True, text=True, check=False)
    if made.returncode:
        pytest.skip(f"no file system of a fixed size can be made here: {made.stderr.strip()}")
    yield folder
    subprocess.run(["umount", str(folder)], check=True)


def test_promise_19__full_file_system_leaves_the_old_products_and_room_lets_the_next_run_succeed(
    scene: Scene, program: Mortal, small_disk: Path
) -> None:
    for path in small_disk.iterdir():  # of a test before that failed, a file too
        shutil.rmtree(path) if path.is_dir() else path.unlink()
    products, temporary, ballast = (small_disk / name for name in ("products", "temporary", "ballast"))
    shutil.copytree(scene.kept, products)
    temporary.mkdir()
    there = replace(scene, target=products / scene.target.name)
    new = _written(there, scene.new, program)
    old = _written(there, scene.old, program)
    shutil.copytree(products, small_disk / "kept")
    there = replace(there, kept=small_disk / "kept", contents=(old, new))
    needed = 2 * sum(path.stat().st_size for path in products.rglob("*") if path.is_file()) + (1 << 16)
    chance, refused = random.Random(5), 0
    for _ in range(KILLS // 10 or 2):
        there.restore()
        free = shutil.disk_usage(small_disk).free
        with ballast.open("wb") as file:
            os.posix_fallocate(file.fileno(), 0, max(1, free - int(chance.random() ** 2 * needed)))
        said = program.does(scene.deed, scene.new, there.target, temporary=str(temporary))
        refused += "error" in said
        assert len(said.get("error", (0, 0, 0))) == 3, said
        assert there.found() == (old if "error" in said else new), said
        assert not there.left()
        assert not list(temporary.iterdir())
        ballast.unlink()
    assert _written(there, scene.new, program) == new
    sys.stderr.write(f"{scene.deed}: {KILLS // 10 or 2} full disks, {refused} refused\n")


def _written(scene: Scene, source: Path, program: Mortal) -> dict[str, str]:
    said = program.does(scene.deed, source, scene.target)
    assert said.get("operations"), said
    return scene.found()
