"""What `pip install furrowmap` without extras brings, and that it suffices for all but what the extras are for."""

from __future__ import annotations

import subprocess
import sys
import tomllib
from importlib.metadata import packages_distributions, requires
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

import furrowmap
from furrowmap.core.runtime.errors import InputError
from furrowmap.workflows.gnss.evaluate import evaluation_table
from tests.core.readers.small_bags import ROS1, mixed, write_bag1

CHECKOUT = Path(__file__).resolve().parents[3]
# Each is described in docs/development/dependencies.md, or needed by one that is. Weigh its size before one is added.
BASE = {
    *(
        "affine",
        "attrs",
        "backports-zstd",
        "certifi",
        "click",
        "click-plugins",
        "cligj",
        "japan-geoid",
        "jgdtrans",
        "jinja2",
        "laspy",
    ),
    *("lazrs", "llvmlite", "markupsafe", "msgspec", "numba", "numpy", "packaging", "pyogrio", "pyparsing", "pyproj"),
    *("rasterio", "scipy", "shapely", "tomli-w", "tzdata", "tzfpy"),
}
COMMANDS = """
import sys
for name in {blocked}:
    sys.modules[name] = None
from furrowmap.cli.main import command_line
for line in {lines}:
    assert command_line([*line.split(), "--quiet"]) == 0, line
"""


def base_installation() -> set[str]:
    """All packages that furrowmap needs without extras."""
    found: set[str] = set()
    waiting = tomllib.loads((CHECKOUT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["dependencies"]
    while waiting:
        one = Requirement(waiting.pop())
        name = canonicalize_name(one.name)
        if name not in found and (not one.marker or one.marker.evaluate({"extra": ""})):
            found.add(name)
            waiting += requires(name) or []
    return found


def test_base_installation__has_no_other_packages_than_these() -> None:
    found = base_installation()
    assert found <= BASE
    assert {"numba", "pyogrio", "rasterio"} <= found


def test_base_installation__suffices_to_run_export_and_share(simulated: furrowmap.Simulated, tmp_path: Path) -> None:
    base = base_installation() | {"furrowmap"}
    blocked = [
        name
        for name, owners in packages_distributions().items()
        if name.isidentifier() and not base & {canonicalize_name(owner) for owner in owners}
    ]
    assert {"geopandas", "lz4", "pandas", "rosbags"} <= set(blocked)
    lines = [f"run {simulated.session} -o run", "share run -o page", "surface run/cloud.copc.laz -o surfaces"]
    lines += [f"export run --to {to} -o run.{to}" for to in ("gpkg", "flatgeobuf", "shapefile", "kml", "csv", "isoxml")]
    command = [sys.executable, "-c", COMMANDS.format(blocked=blocked, lines=lines)]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert {path.name for path in tmp_path.iterdir()} >= {"run", "page", "surfaces", "run.gpkg", "run.csv", "run.kml"}


def test_bags__without_their_extra_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    bag = write_bag1(tmp_path / "drive.bag", mixed(ROS1))
    monkeypatch.setitem(sys.modules, "rosbags", None)
    with pytest.raises(InputError, match="package rosbags or lz4 is not installed") as refused:
        furrowmap.inspect(bag)
    assert refused.value.code == "extra-missing"
    assert 'pip install ".[bags]"' in refused.value.remedy


@pytest.mark.parametrize("package", ["geopandas", "pandas"])
def test_tables__without_their_extra_are_refused(
    package: str, result: furrowmap.Result, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(InputError, match=f"{package} is not installed") as refused:
        _ = result.trajectory if package == "geopandas" else evaluation_table({})
    assert 'pip install ".[notebooks]"' in refused.value.remedy
