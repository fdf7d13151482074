"""What holds the house together: who may import whom, what is packaged, and what never gets into the repository."""

from __future__ import annotations

import ast
import re
import shutil
import subprocess
import sys
import tomllib
import zipfile
from functools import cache
from importlib.metadata import packages_distributions
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

CHECKOUT = Path(__file__).resolve().parents[1]
PARTS = ("app", "core", "exporters", "cli")
PROJECT = tomllib.loads((CHECKOUT / "pyproject.toml").read_text(encoding="utf-8"))

# Which rooms of `core` each room may import, besides itself: data flows one way, and no room imports one above it.
ROOMS = {
    "values": [],
    "estimation": ["values"],
    "geodesy": ["values"],
    "readers": ["values"],
    "session": ["geodesy", "readers", "values"],
    "trajectory": ["estimation", "geodesy", "readers", "values"],
    "surfaces": ["values"],
    "implement": ["values"],
    "matching": ["estimation", "geodesy", "readers", "session", "trajectory", "values"],
    "pointclouds": ["geodesy", "implement", "matching", "readers", "session", "surfaces", "values"],
    "work": [
        "geodesy",
        "implement",
        "matching",
        "pointclouds",
        "readers",
        "session",
        "surfaces",
        "trajectory",
        "values",
    ],
    "checking": ["geodesy", "pointclouds", "readers", "values"],
    "evaluation": ["readers", "values"],
    "simulator": [],
}
# What each part may import of furrowmap. The longest name that fits a module rules it.
MAY_IMPORT = {
    **{
        f"furrowmap.core.{room}": [f"furrowmap.core.{name}" for name in (room, *rooms)] for room, rooms in ROOMS.items()
    },
    # The oracle of the tests shares no code with what it judges.
    "furrowmap.core.simulator": [
        "furrowmap.core.simulator",
        "furrowmap.core.values.errors",
        "furrowmap.core.values.progress",
    ],
    # The pipeline composes the rooms, but not the simulator, nor what judges its results.
    "furrowmap.core.pipeline": [
        f"furrowmap.core.{room}" for room in ROOMS if room not in {"simulator", "checking", "evaluation"}
    ],
    "furrowmap.core": [],
    "furrowmap.exporters": [*(f"furrowmap.core.{room}" for room in ROOMS), "furrowmap.exporters"],
    "furrowmap": ["furrowmap"],
    "furrowmap.cli": ["furrowmap"],
}


def repository_files() -> list[Path]:
    """Files that are in the repository or would be, were everything here committed."""
    command = ["git", "ls-files", "--cached", "--others", "--exclude-standard", "-z"]
    listed = subprocess.run(command, cwd=CHECKOUT, capture_output=True, check=True).stdout.decode()
    return [CHECKOUT / name for name in listed.split("\0") if name and (CHECKOUT / name).is_file()]


@cache
def module_files() -> dict[str, Path]:
    """Import name → file, of everything that is furrowmap when installed."""
    return {
        ".".join(("furrowmap", *p.relative_to(CHECKOUT).with_suffix("").parts))
        .replace("furrowmap.app", "furrowmap")
        .removesuffix(".__init__"): p
        for part in PARTS
        for p in sorted((CHECKOUT / part).rglob("*.py"))
    }


def within(module: str, packages: list[str]) -> bool:
    return any(module == package or module.startswith(f"{package}.") for package in packages)


def imports(path: Path) -> set[str]:
    """Modules that a file imports, wherever in it; relative imports are told as such, with their dots."""
    imported = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            imported.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            module = "." * node.level + (node.module or "")
            deeper = {f"{module}.{alias.name}" for alias in node.names} & module_files().keys()
            imported.update(deeper or {module})
    return imported


@pytest.mark.parametrize("module", module_files())
def test_imports__go_one_way(module: str) -> None:
    part = max((name for name in MAY_IMPORT if within(module, [name])), key=len)
    ours = {name for name in imports(module_files()[module]) if name.startswith((".", "furrowmap"))}
    against = {name for name in ours if not within(name, MAY_IMPORT[part])}
    assert against == set(), f"{module} may import only {MAY_IMPORT[part]}"


def test_imports__are_of_declared_packages() -> None:
    project = PROJECT["project"]
    extras = [text for extra in project["optional-dependencies"].values() for text in extra]
    declared = {canonicalize_name(Requirement(text).name) for text in [*project["dependencies"], *extras]}
    providers = packages_distributions()
    standard = sys.stdlib_module_names | {"compression", "_typeshed"}  # new in Python 3.14; the type checkers' own
    undeclared = {
        f"{module}: {top}"
        for module, path in module_files().items()
        for top in {name.split(".")[0] for name in imports(path)} - standard - {"furrowmap", ""}
        if not declared & {canonicalize_name(name) for name in providers.get(top, [])}
    }
    assert undeclared == set()


def test_licences__only_the_plugin_says_gpl() -> None:
    for path in repository_files():
        said = re.findall(r"^# SPDX-License-Identifier: (.+)$", path.read_text("utf-8", "replace"), re.MULTILINE)
        in_plugin = path.suffix == ".py" and path.is_relative_to(CHECKOUT / "plugin")
        assert said == (["GPL-2.0-or-later"] if in_plugin else []), path


def test_packages__are_those_on_disk() -> None:
    on_disk = {
        ".".join(("furrowmap", *p.parent.relative_to(CHECKOUT).parts)).replace("furrowmap.app", "furrowmap")
        for part in (*PARTS, "plugin")
        for p in (CHECKOUT / part).rglob("__init__.py")
    }
    assert set(PROJECT["tool"]["setuptools"]["packages"]) == on_disk


def test_versions__every_dependency_is_pinned_without_an_address() -> None:
    lines = [line for line in (CHECKOUT / "constraints.txt").read_text().splitlines() if not line.startswith("#")]
    assert [line for line in lines if not re.fullmatch(r"[\w.-]+==[\w.+!]+", line)] == []
    pinned = {canonicalize_name(line.split("==")[0]) for line in lines}
    wanted = [
        *PROJECT["build-system"]["requires"],
        *PROJECT["project"]["dependencies"],
        *PROJECT["dependency-groups"]["dev"],
        *PROJECT["dependency-groups"]["bench"],
    ]
    assert {canonicalize_name(Requirement(text).name) for text in wanted} - pinned == set()


def test_changelog__names_the_version() -> None:
    changelog = (CHECKOUT / "CHANGELOG.md").read_text(encoding="utf-8")
    assert f"## [{PROJECT['project']['version']}]" in changelog


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The wheel built from a copy of the repository's files, in a folder with another name than the checkout's."""
    folder = tmp_path_factory.mktemp("wheel")
    for path in repository_files():
        copy = folder / "some checkout" / path.relative_to(CHECKOUT)
        copy.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(path, copy)
    build = [
        sys.executable,
        "-m",
        "pip",
        "wheel",
        "--quiet",
        "--no-build-isolation",
        "--no-deps",
        "--wheel-dir",
        folder,
    ]
    subprocess.run([*build, folder / "some checkout"], check=True)
    (built,) = folder.glob("*.whl")
    return built


def test_wheel__holds_every_module_and_its_data_and_nothing_else(wheel: Path) -> None:
    data = {".typed", ".toml", ".qml", ".html", ".css", ".js"}
    expected = {
        f"furrowmap/{path.relative_to(CHECKOUT).as_posix()}".replace("furrowmap/app/", "furrowmap/")
        for path in repository_files()
        if (path.relative_to(CHECKOUT).parts[0] in PARTS and path.suffix in data | {".py"})
        or path.relative_to(CHECKOUT).parts[0] == "plugin"
    }
    with zipfile.ZipFile(wheel) as archive:
        names = {name for name in archive.namelist() if ".dist-info/" not in name}
        licences = [name for name in archive.namelist() if name.endswith("LICENSE") and ".dist-info/" in name]
    assert names == expected
    assert "furrowmap/py.typed" in names
    assert len(licences) == 2  # furrowmap's own, and the plugin's


def test_wheel__installs_and_imports_as_furrowmap(wheel: Path, tmp_path: Path) -> None:
    install = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--target", tmp_path, wheel]
    subprocess.run(install, check=True)
    packages = PROJECT["tool"]["setuptools"]["packages"]
    code = f"import importlib\nfor name in {packages}: print(importlib.import_module(name).__file__)"
    run = subprocess.run(
        [sys.executable, "-c", code],
        env={"PYTHONPATH": str(tmp_path)},
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=True,
    )
    places = [Path(line) for line in run.stdout.splitlines()]
    assert len(places) == len(packages)
    assert [place for place in places if not place.is_relative_to(tmp_path)] == []


def test_repository__names_no_machine_and_holds_nothing_large() -> None:
    files = repository_files()
    assert [p.name for p in files if p.stat().st_size > 1_000_000] == []
    machine = re.compile(rb"(?<![\w.])/(work|root|home/\w+|Users/\w+)/|(pythonhosted|deb\.debian)\.org")
    named = [f"{p.name}: {match[0].decode()}" for p in files if (match := machine.search(p.read_bytes()))]
    assert named == []
