"""What holds the house together: who may import whom, what is packaged, and what never gets into the repository."""

from __future__ import annotations

import ast
import inspect
import re
import runpy
import subprocess
import sys
import tomllib
from functools import cache
from graphlib import CycleError, TopologicalSorter
from importlib import import_module
from importlib.metadata import packages_distributions
from importlib.util import resolve_name
from pathlib import Path
from typing import Any

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from tests.syntax import CHECKOUT, PARTS, files, nodes, tree

PROJECT = tomllib.loads((CHECKOUT / "pyproject.toml").read_text(encoding="utf-8"))
EXTRAS = [text for texts in PROJECT["project"]["optional-dependencies"].values() for text in texts]
GROUPS = [text for texts in PROJECT["dependency-groups"].values() for text in texts if isinstance(text, str)]
UNTESTED = {"open3d"}  # 400 MB

# Which rooms of `core` each room may import, besides itself: data flows one way, and no room imports one above it.
ROOMS = {
    "runtime": [],
    "values": ["runtime"],
    "adjustment": ["runtime", "values"],
    "geodesy": ["runtime", "values"],
    "surfaces": ["runtime", "values"],
    "readers": ["geodesy", "runtime", "values"],
    "session": ["geodesy", "readers", "runtime", "values"],
    "trajectory": ["adjustment", "geodesy", "readers", "runtime", "values"],
    "matching": ["adjustment", "session", "trajectory", "runtime", "values"],
    "strips": ["adjustment", "matching", "surfaces", "trajectory", "runtime", "values"],
    "images": ["adjustment", "readers", "surfaces", "trajectory", "runtime", "values"],
    "pointclouds": ["geodesy", "readers", "surfaces", "runtime", "values"],
    "implement": ["pointclouds", "readers", "runtime", "values"],
    "coverage": ["geodesy", "implement", "pointclouds", "readers", "surfaces", "trajectory", "runtime", "values"],
    "accuracy": ["pointclouds", "readers", "runtime", "values"],
    "crops": ["geodesy", "readers", "surfaces", "runtime", "values"],
    "coregistration": ["crops", "adjustment", "runtime"],
    "features": ["pointclouds", "readers", "surfaces", "runtime", "values"],
    "live": ["geodesy", "matching", "readers", "trajectory", "implement", "coverage", "runtime", "values"],
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
        "furrowmap.core.runtime.errors",
        "furrowmap.core.runtime.plain_reads",
        "furrowmap.core.runtime.progress",
    ],
    # The pipeline composes the rooms, but not the simulator, nor what judges its results.
    "furrowmap.core.pipeline": [f"furrowmap.core.{room}" for room in ROOMS if room not in {"simulator", "accuracy"}]
    + ["furrowmap.core.pipeline"],
    "furrowmap.core": [],
    "furrowmap.exporters": [
        *(f"furrowmap.core.{room}" for room in ROOMS),
        "furrowmap.core.pipeline",
        "furrowmap.exporters",
    ],
    "furrowmap": ["furrowmap"],
    "furrowmap.cli": [
        "furrowmap.cli",
        "furrowmap.core.runtime",
        "furrowmap.core.values",
        "furrowmap.process",
        "furrowmap.settings",
        "furrowmap.warm_up",
        "furrowmap.workflows",
        "furrowmap!",
    ],
}

# The libraries that read foreign files, and the one module of each format that may use them: it turns whatever they
# raise into our errors. In `exporters` and the simulator they write.
BOUNDARIES = {
    "laspy": ["core.readers.las.point_records"],
    "lazrs": ["core.readers.las.laz", "core.readers.las.decoding"],
    "rosbags": ["core.readers.rosbag.ros_messages"],
    "lz4": ["core.readers.rosbag.bag_storage"],
    "bz2": ["core.readers.rosbag.bag_storage"],
    "backports": ["core.readers.ouster.osf", "core.readers.rosbag.bag_storage", "core.readers.source"],
    "compression": ["core.readers.ouster.osf", "core.readers.rosbag.bag_storage", "core.readers.source"],
    "lzma": ["core.readers.source"],
    "gzip": [],
    "tarfile": [],
    "pickle": [],
    "sqlite3": ["core.readers.sqlite_file", "core.readers.rosbag.bag_storage", "workflows.live.background_map"],
    "pmtiles": ["workflows.live.background_map"],
    "zipfile": [
        "workflows.share.qgis_plugin",  # writes alone
        "core.readers.isoxml.content",
        "core.readers.text_table",
        "core.readers.text_table",
        "core.runtime.npz",
    ],
    "PIL": ["core.readers.exif", "core.readers.image_pixels"],
    "xml": ["core.readers.isoxml.xml"],
    "pyogrio": ["core.readers.ogr_layers", "cli.main"],  # the latter: its version
    "jgdtrans": ["core.geodesy.projection"],
    "japan_geoid": ["core.geodesy.projection"],
    "rasterio": [
        *(
            "core.readers.geotiff",
            "core.readers.raster_heights",
            "core.readers.raster_neighbours",
            "core.readers.las.cloud",
            "core.readers.ouster.osf",
        ),
        "core.accuracy.point_check",
        *("core.surfaces.terrain", "results", "workflows.clouds.surface"),
        "cli.main",  # its version
    ],
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
        for p in files(*PARTS)
    }


def within(module: str, packages: list[str]) -> bool:
    """Whether a module is one of the packages or lies in one; a name that ends in `!` stands for itself alone."""
    return any(
        module == package.rstrip("!") or (not package.endswith("!") and module.startswith(f"{package}."))
        for package in packages
    )


@cache
def imports(path: Path) -> set[str]:
    """Modules that a file imports, wherever in it; relative imports are told as such, with their dots."""
    imported = set()
    for node in nodes(path):
        if isinstance(node, ast.Import):
            imported.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            module = "." * node.level + (node.module or "")
            deeper = {f"{module}.{alias.name}" for alias in node.names} & module_files().keys()
            imported.update(deeper or {module})
    return imported


def test_imports__go_one_way() -> None:
    against = {}
    for module, path in module_files().items():
        part = max((name for name in MAY_IMPORT if within(module, [name])), key=len)
        ours = {name for name in imports(path) if name.startswith((".", "furrowmap"))}
        against[module] = {name for name in ours if not within(name, MAY_IMPORT[part])}
    assert {module: names for module, names in against.items() if names} == {}, "MAY_IMPORT says what each may import"


def test_imports__make_no_circle() -> None:
    """Imports in functions and for type checkers count, too; the plugin's are relative."""
    plugin = {
        ".".join(("furrowmap", *path.relative_to(CHECKOUT).with_suffix("").parts)): path for path in files("plugin")
    }
    modules = {name.removesuffix(".__init__"): path for name, path in {**module_files(), **plugin}.items()}
    graph = {}
    for module, path in modules.items():
        package = module if path.stem == "__init__" else module.rpartition(".")[0]
        names = {resolve_name(name, package) for name in imports(path)}
        graph[module] = {name.rstrip(".") for name in names} & modules.keys() - {module}
    assert sum(map(len, graph.values())) > len(modules)
    TopologicalSorter(graph).prepare()  # raises an error that names the modules of a circle


def test_imports__of_libraries_that_read_foreign_files_are_in_one_module_of_each_format() -> None:
    strays = {
        f"{module} imports {library}"
        for module, path in module_files().items()
        if not within(module, ["furrowmap.exporters", "furrowmap.core.simulator"])
        for library in {name.split(".")[0] for name in imports(path)} & BOUNDARIES.keys()
        if module.removeprefix("furrowmap.") not in BOUNDARIES[library]
    }
    assert strays == set()


def test_rasters_and_arrays__of_others_are_opened_by_our_own_functions() -> None:
    """`rasterio.open` follows a VRT of any name where no driver is given; `numpy.load` believes headers."""
    calls = {
        path.relative_to(CHECKOUT).as_posix(): ast.unparse(node)
        for path in module_files().values()
        for node in nodes(path)
        if isinstance(node, ast.Call)
        and getattr(node.func, "attr", "") in ("load", "fromfile", "open")  # the text of every call takes five seconds
        and (
            ast.unparse(node.func) in ("np.load", "numpy.load", "np.fromfile")
            or (ast.unparse(node.func) == "rasterio.open" and "driver" not in {word.arg for word in node.keywords})
        )
    }
    # Written a moment before by the same process; the profile of a new file has its driver.
    written = {"exporters/rasters/cog.py", "exporters/rasters/orthophoto_file.py"}
    assert calls.keys() <= {"app/workflows/clouds/rasters.py", *written}, calls


def test_imports__are_of_declared_packages() -> None:
    declared = {canonicalize_name(Requirement(text).name) for text in (*PROJECT["project"]["dependencies"], *EXTRAS)}
    providers = packages_distributions()
    standard = sys.stdlib_module_names | {"compression", "_typeshed"}  # new in Python 3.14; the type checkers' own
    undeclared = {
        f"{module}: {top}"
        for module, path in module_files().items()
        for top in {name.split(".")[0] for name in imports(path)} - standard - {"furrowmap", ""}
        if not declared & {canonicalize_name(name) for name in providers.get(top, [top])}
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
        *EXTRAS,
        *GROUPS,
    ]
    assert {canonicalize_name(Requirement(text).name) for text in wanted} - pinned == UNTESTED


def test_versions__have_lower_bounds_that_are_tested() -> None:
    wanted = [Requirement(text) for text in (*PROJECT["project"]["dependencies"], *EXTRAS)]
    bounds = {each.name: str(each.specifier) for each in wanted if each.name not in UNTESTED}
    assert [str(each) for each in wanted if not re.fullmatch(r">=[\d.]+", str(each.specifier))] == []
    command = [sys.executable, CHECKOUT / "scripts" / "lowest.py"]
    listed = subprocess.run(command, capture_output=True, text=True, check=True).stdout.split()
    assert set(listed) == {name + bound.replace(">=", "==") for name, bound in bounds.items()}
    lines = (CHECKOUT / "constraints.txt").read_text().splitlines()[1:]
    pinned = {canonicalize_name(name): version for name, version in (line.split("==") for line in lines)}
    assert [e.name for e in wanted if e.name in bounds and pinned[canonicalize_name(e.name)] not in e.specifier] == []


def test_modules__can_be_imported() -> None:
    for module in module_files():
        if not module.endswith("__main__"):
            import_module(module)


def test_changelog__has_a_dated_section_of_the_version_and_a_line_for_each_change() -> None:
    changelog = (CHECKOUT / "CHANGELOG.md").read_text(encoding="utf-8")
    version = re.escape(PROJECT["project"]["version"])
    assert re.search(rf"^## \[{version}\] - \d{{4}}-\d\d-\d\d$", changelog, re.MULTILINE)
    assert re.findall(r"^[ \t]+\S.*", changelog, re.MULTILINE) == []


@pytest.fixture(scope="module")
def house() -> dict[str, Any]:
    """The names of the script that draws the import graph of `core`."""
    return runpy.run_path(str(CHECKOUT / "scripts" / "house_graph.py"))


def test_house__is_drawn_as_it_is(house: dict[str, Any]) -> None:
    nodes = house["places"]()
    arrows = house["graph"](nodes)
    written = (CHECKOUT / "docs" / "development" / "house.md").read_text(encoding="utf-8")
    drawn = (CHECKOUT / "docs" / "images" / "house.svg").read_text(encoding="utf-8")
    assert written == house["page"](nodes, arrows, written), "run scripts/house_graph.py"
    assert drawn == house["picture"](arrows), "run scripts/house_graph.py"


def test_house__has_few_rooms_and_no_circle(house: dict[str, Any]) -> None:
    arrows = house["graph"](house["places"]())
    assert set(arrows) == {*ROOMS, "pipeline"}
    assert len(arrows) <= 21
    assert sum(map(len, arrows.values())) <= 91  # implement and coverage, and strips and matching, have those of each
    assert house["floors"](arrows)["runtime"] == 0  # raises an error where nodes import each other in a circle


def test_house_graph__finds_circles_and_implied_arrows(house: dict[str, Any]) -> None:
    arrows = {"a": {"b", "c"}, "b": {"c"}, "c": set()}
    assert house["floors"](arrows) == {"a": 2, "b": 1, "c": 0}
    assert house["direct"](arrows) == {"a": {"b"}, "b": {"c"}, "c": set()}
    with pytest.raises(CycleError):
        house["floors"]({"a": {"b"}, "b": {"a"}})


def test_core__holds_only_folders() -> None:
    loose = {p.relative_to(CHECKOUT).as_posix() for p in repository_files() if p.parent == CHECKOUT / "core"}
    assert loose == {"core/__init__.py"}


KERNELS = {"njit", "kernel", "kernel_part", "inlined"}
OPTIONS = {"option", "argument"}


@cache
def functions() -> list[tuple[str, ast.FunctionDef, set[str]]]:
    """Every function of the product and the plugin, but kernels: its name, itself, the names of its decorators."""
    found = []
    for path in files(*PARTS, "plugin"):
        of_class = {part: node.name for node in nodes(path) if isinstance(node, ast.ClassDef) for part in node.body}
        for node in nodes(path):
            if isinstance(node, ast.FunctionDef):
                calls = [d.func if isinstance(d, ast.Call) else d for d in node.decorator_list]
                decorators = {ast.unparse(call).rpartition(".")[2] for call in calls}
                if not decorators & KERNELS:
                    method = node.name.startswith("__") and node in of_class
                    found.append((f"{of_class[node]}.{node.name}" if method else node.name, node, decorators))
    return found


@cache
def definitions() -> tuple[dict[str, set[str]], dict[str, dict[str, set[str]]]]:
    """Class name → modules that define it; constant → its value as source → modules that define it so."""
    classes: dict[str, set[str]] = {}
    constants: dict[str, dict[str, set[str]]] = {}
    for path in files(*PARTS, "plugin"):
        module = path.relative_to(CHECKOUT).as_posix()
        for node in nodes(path):
            if isinstance(node, ast.ClassDef):
                classes.setdefault(node.name, set()).add(module)
        for node in tree(path).body:
            targets = node.targets if isinstance(node, ast.Assign) else [getattr(node, "target", None)]
            value = getattr(node, "value", None)
            if isinstance(targets[0], ast.Name) and targets[0].id.isupper() and value is not None:
                constants.setdefault(targets[0].id, {}).setdefault(ast.unparse(value), set()).add(module)
    return classes, constants


def test_names__of_classes_have_one_meaning() -> None:
    assert {name: modules for name, modules in definitions()[0].items() if len(modules) > 1} == {}


def test_names__of_constants_have_one_value() -> None:
    assert {name: values for name, values in definitions()[1].items() if len(values) > 1} == {}


def test_assignments__set_one_name_each() -> None:
    """Exchanges of values and the like are left: at most one in fifty."""
    found = [node for path in files(*PARTS, "plugin") for node in nodes(path) if isinstance(node, ast.Assign)]
    several = [node for node in found if isinstance(node.targets[0], ast.Tuple) and isinstance(node.value, ast.Tuple)]
    assert len(several) <= 0.02 * len(found)


CLOSURES = {"workflows.run.run": (244, 48_250), "core.pipeline.run": (192, 38_000)}
"""Files, and lines in them, that a module imports, directly or not; wanted are 190 and 38,000, 120 and 24,000."""
TOOLS_OF_A_RUN = ("core.accuracy", "core.crops", "core.features", "core.simulator", "settings", "workflows.clouds")
"""What `run` does not need: :mod:`furrowmap.workflows.run.session_run`, which stands above it, chains it."""


@pytest.mark.parametrize("module", CLOSURES)
def test_closure__of_a_run_is_what_it_needs(module: str) -> None:
    """What is imported in functions counts, what is imported for type checkers does not."""
    reached = set[str]()
    waiting = [f"furrowmap.{module}"]
    while waiting:
        name = waiting.pop()
        if name not in reached and name in module_files() and module_files()[name].name != "__init__.py":
            reached.add(name)
            waiting += needed(module_files()[name])
    most_files, most_lines = CLOSURES[module]
    assert len(reached) <= most_files
    assert sum(module_files()[name].read_text(encoding="utf-8").count("\n") for name in reached) <= most_lines
    tools = [f"furrowmap.{name}" for name in TOOLS_OF_A_RUN]
    assert {name for name in reached if within(name, tools)} == set()


def needed(path: Path) -> set[str]:
    """Modules that a file imports but for type checkers, wherever in it."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    for node in ast.walk(tree):
        if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING":
            node.body = [ast.Pass()]
    found = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom):
            found |= {f"{node.module}.{alias.name}" for alias in node.names} | {f"{node.module}"}
        elif isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
    return found & module_files().keys()


def test_stories_of_the_pipeline__can_be_kept_in_mind() -> None:
    """At most 15 names each, arguments included."""
    names = {"run": "run", "tractor": "solve", "placed": "solve", "flight": "solve", "place": "place"}
    names |= {"preview_story": "preview", "without_scans": "run_without_scans"}
    for file, story in names.items():
        function = getattr(import_module(f"furrowmap.core.pipeline.{file}"), story)
        assert inspect.unwrap(function).__code__.co_nlocals <= 15, (file, story)


def test_notices__are_returned() -> None:
    """A step returns what it found beside its value: a list of notices that it is given is one that it appends to."""
    lists = [
        f"{name}({arg.arg})"
        for name, node, _ in functions()
        for arg in arguments(node)
        if arg.annotation is not None and "list[Notice]" in ast.unparse(arg.annotation)
    ]
    assert lists == []


def arguments(node: ast.FunctionDef) -> list[ast.arg]:
    """All arguments by position or name."""
    return [*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs]


def test_functions__are_short() -> None:
    long = {name for name, node, _ in functions() if (node.end_lineno or 0) - node.lineno >= 80}
    assert long == set(), "no function over 80 lines but kernels"


def test_functions__take_few_parameters() -> None:
    wide = set()
    for name, node, decorators in functions():
        if not decorators & OPTIONS and sum(arg.arg not in {"self", "cls"} for arg in arguments(node)) > 10:
            wide.add(name)
    assert wide == set(), "no function with more than 10 parameters but kernels and click's callbacks"


def test_repository__names_no_machine_and_holds_nothing_large() -> None:
    files = repository_files()
    assert [p.name for p in files if p.stat().st_size > 1_000_000] == []
    machine = re.compile(rb"(?<![\w.])/(work|root|home/\w+|Users/\w+)/|(pythonhosted|deb\.debian)\.org")
    named = [f"{p.name}: {match[0].decode()}" for p in files if (match := machine.search(p.read_bytes()))]
    assert named == []
