"""Where the tests find recordings and a QGIS, and what happens where they are missing."""

from __future__ import annotations

import gc
import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from hypothesis import settings

import furrowmap
from furrowmap.process import keep_blas_single, keep_kernels

if TYPE_CHECKING:
    from playwright.sync_api import Browser

# No deadline, because a first example may compile; the same examples in every run of CI.
settings.register_profile("furrowmap", deadline=None, derandomize=os.environ.get("CI") == "true")
settings.load_profile("furrowmap")
keep_kernels()  # where the command keeps them: compiled once for both
keep_blas_single()  # as the command does: threads of BLAS take fifteen times the processor for small matrices
os.environ.setdefault("OGR_SQLITE_SYNCHRONOUS", "OFF")  # no test cuts the power: each layer would wait for the disk
pytest_plugins = ["tests.codes_met", "tests.kernels_met"]
CHECKOUT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(CHECKOUT / "scripts"))
from installing import locked  # noqa: E402

SHARED_DATA = CHECKOUT.parent / "shared" / "data"


SLOW_FIXTURES = {"browser", "page_scripts", "qgis", "result", "run_once", "shared_data", "simulated", "web_reader"}
"""What takes a QGIS, a browser, npm, the sample recordings, or a whole run."""
SLOW_FOLDERS = (
    "app",
    "core/matching",
    "core/strips",
    "core/simulator",
    "exporters/farm",
    "fuzz",
    "fuzz_sessions",
    "plugin",
)
"""Folders of tests that run whole workflows, or take minutes together."""
SLOW_FILES = (
    "end_to_end",
    "foreign_drivers",
    "from_inertial",
    "implement_in_scenes",
    "imu_check",
    "lies",
    "nasty_polygons",
    "packaging",
    "test_fields",
    "test_poses",
    "tutorial",
    "two_scanners",
    "two_tools",
    "who_is_to_blame",
)
"""Ends of the names of files that simulate and run recordings, solve many flights, build wheels, or read thousands of
files."""


def pytest_collection() -> None:
    """Collect without garbage collection, which would look through all that stays to the end again and again."""
    gc.disable()


def pytest_collection_finish() -> None:
    """What was collected and imported is left out of later garbage collections."""
    gc.freeze()
    gc.enable()


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark as slow what `make quick` leaves out: slow fixtures, slow folders, and files that run from end to end.

    Files with slow tests come first, so that two workers end at the same time.
    """

    @cache  # of hundreds of files, not of their thousands of tests
    def is_slow(path: Path) -> bool:
        place = path.relative_to(CHECKOUT / "tests")
        return any(place.is_relative_to(folder) for folder in SLOW_FOLDERS) or place.stem.endswith(SLOW_FILES)

    for item in items:
        if SLOW_FIXTURES.intersection(getattr(item, "fixturenames", ())) or is_slow(item.path):
            item.add_marker("slow")
    slow_files = {item.path for item in items if item.get_closest_marker("slow")}
    items.sort(key=lambda item: item.path not in slow_files)


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of sample recordings that lies beside the checkout."""
    if not SHARED_DATA.is_dir():
        pytest.skip("the sample recordings (../shared/data) are not beside this checkout")
    return SHARED_DATA


@pytest.fixture(scope="session")
def made_once(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str, Callable[[Path], object]], Path]:
    """A folder that is filled once for the tests of all processes; takes its name and what fills it."""
    base = tmp_path_factory.getbasetemp()
    shared = (base.parent if "PYTEST_XDIST_WORKER" in os.environ else base) / "made_once"
    shared.mkdir(exist_ok=True)

    def filled(name: str, fill: Callable[[Path], object]) -> Path:
        folder, complete = shared / name, shared / f"{name}.complete"
        with locked(shared / f"{name}.lock"):
            if not complete.exists():
                shutil.rmtree(folder, ignore_errors=True)  # of a process that failed
                folder.mkdir()
                fill(folder)
                complete.touch()
        return folder

    return filled


@pytest.fixture(scope="session")
def run_once(
    made_once: Callable[[str, Callable[[Path], object]], Path],
) -> Callable[[str, Callable[[Path], Path]], furrowmap.Result]:
    """Runs a session once for the tests of all processes; takes a name and what writes the session to a folder."""

    def result(name: str, session_in: Callable[[Path], Path]) -> furrowmap.Result:
        folder = made_once(name, lambda folder: furrowmap.run(session_in(folder / "in"), folder / "out"))
        return furrowmap.open_result(folder / "out")

    return result


@dataclass(frozen=True)
class QgisRoot:
    """A real QGIS in a folder of its own; files to open lie in the checkout or among the temporary files."""

    def run(self, *command: str | Path, timeout_s: float = 120.0) -> str:
        """Standard output of a command run inside; its standard error is told where it fails."""
        done = subprocess.run(
            [CHECKOUT / "scripts" / "in_qgis_root.sh", *command],
            cwd=CHECKOUT,
            capture_output=True,
            text=True,
            timeout=timeout_s,
            check=False,
        )
        assert done.returncode == 0, f"{command[0]} ended with {done.returncode}\n{done.stdout}\n{done.stderr}"
        return done.stdout

    def open_layers(self, *paths: Path) -> list[dict[str, Any]]:
        """What QGIS makes of each layer in the files: path, name, provider, valid, error, crs (as EPSG:n), kind
        (vector, raster, point cloud), count of points or features, fields, extent (x and y minima, then maxima) and
        renderer.
        """
        answer = self.run("python3", CHECKOUT / "tests" / "plugin" / "open_layers.py", *paths)
        layers: list[dict[str, Any]] = json.loads(answer.splitlines()[-1])
        return layers


def installed(what: str, script: str, *arguments: str) -> str:
    """What a script of the project prints. Where it cannot install `what`, CI fails and everybody else skips."""
    path = CHECKOUT / "scripts" / script
    command = [sys.executable, path] if path.suffix == ".py" else ["bash", path]
    try:
        done = subprocess.run([*command, *arguments], capture_output=True, text=True, check=True)
    except (OSError, subprocess.CalledProcessError) as error:
        said = [str(error), *(getattr(error, "stderr", None) or "").strip().splitlines()]
        reason = f"no {what} to test with: {said[-1]}"
        pytest.fail(reason) if os.environ.get("CI") == "true" else pytest.skip(reason)
    return done.stdout.strip()


@pytest.fixture(scope="session")
def qgis() -> QgisRoot:
    """QGIS 3.40, built where it is missing."""
    installed("QGIS", "qgis_root.sh")
    return QgisRoot()


@pytest.fixture(scope="session")
def browser() -> Iterator[Browser]:
    """Debian's Chromium."""
    path = installed("browser", "tools_of_tests.py", "chromium")
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        # Chromium's own sandbox needs rights that root in a container does not have; the pages are our own.
        # WebGL is drawn by the processor.
        options = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
        chromium = playwright.chromium.launch(executable_path=path, args=options)
        yield chromium
        chromium.close()


@pytest.fixture(scope="session")
def page_scripts() -> None:
    """The scripts of the page of a shared result, built where they are missing."""
    installed("scripts of the page", "web_bundle.py", "--install")


@pytest.fixture(scope="session")
def web_reader() -> Callable[[str, Path], Any]:
    """What a reader of the web finds in a file of a format (tests/node/read.mjs)."""
    folder = installed("readers of the web", "tools_of_tests.py", "node-readers")

    def read(file_format: str, path: Path) -> Any:
        command = ["node", f"{folder}/read.mjs", file_format, str(path)]
        done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
        assert done.returncode == 0, done.stderr
        return json.loads(done.stdout)

    return read
