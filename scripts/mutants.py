"""Do the tests notice a mistake? Makes random mutants of the product's code and runs the tests nearest to each.

A mutant is a copy of the checkout with one change: a comparison flipped, a `raise` removed, two arguments swapped, a
default or a constant changed. It is killed when a test fails. Those that survive are printed with their place: some are
equivalent (they change nothing that anybody can see), the others need a test.

The tests of each mutant run in a fork of this process, which has loaded the libraries already, and times are those of
the processor, so that the result does not depend on what else the machine does.
"""

from __future__ import annotations

import argparse
import ast
import json
import os
import random
import re
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import tomllib
from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from importlib import import_module
from pathlib import Path
from typing import Any, Final, NoReturn

import pytest
from numba.core import caching, config

CHECKOUT: Final = Path(__file__).resolve().parents[1]
COPY: Final = CHECKOUT / "build" / "mutants" / "checkout"
KERNELS: Final = COPY.parent / "kernels"
"""Compiled kernels of the copy."""
LIBRARIES: Final = (
    "geopandas", "hypothesis", "laspy", "numba", "pandas", "pyogrio", "pyproj", "rasterio", "rosbags.typesys", "rich",
    "scipy.interpolate", "scipy.ndimage", "scipy.optimize", "scipy.signal", "scipy.sparse.linalg", "scipy.spatial",
    "shapely",
)  # fmt: skip
PARTS: Final = {
    "core": "furrowmap.core",
    "exporters": "furrowmap.exporters",
    "app": "furrowmap",
    "cli": "furrowmap.cli",
}
LONG: Final = (
    "end_to_end",
    "tests/plugin",
    "tests/benchmarks",
    "notebooks",
    "tutorial",
    "test_docs",
    "test_house",
    "qgis",
)
MOST_FILES: Final = 8
"""Test files that are run on a mutant, the nearest first."""
FARTHEST: Final = 3
"""Imports between a test and the mutated module."""
OF_ALL: Final = (
    "tests/test_neutral_defaults.py",
    "tests/test_frozen_values.py",
    "tests/core/simulator/test_scenario_pages.py",
)
"""Tests that read the source of every module, or hold the defaults of some by a page; run on each mutant besides."""
TEST_S: Final = 60
"""A test that takes longer hangs."""
ALL_TESTS_S: Final = 40
"""No further test is begun after this time."""
TIME_OVER: Final = "the time for tests is over"
PATIENCE_S: Final = 1200
"""Time on the clock for all tests; who takes longer waits for something."""
COMMUTATIVE: Final = ("min", "max", "minimum", "maximum", "fmin", "fmax", "hypot", "logical_and", "logical_or")
_FLIPPED: Final[dict[type[ast.cmpop], type[ast.cmpop]]] = {
    ast.Lt: ast.Gt, ast.Gt: ast.Lt, ast.LtE: ast.GtE, ast.GtE: ast.LtE, ast.Eq: ast.NotEq, ast.NotEq: ast.Eq,
    ast.In: ast.NotIn, ast.NotIn: ast.In, ast.Is: ast.IsNot, ast.IsNot: ast.Is,
}  # fmt: skip


@dataclass(frozen=True)
class Mutant:
    """One change of a file: its kind, where it is, and the source before and after."""

    kind: str
    file: str
    line: int
    start: int
    end: int
    before: str
    after: str
    kernel: bool


class Sites(ast.NodeVisitor):
    """Collects the possible changes of a file."""

    def __init__(self, file: str, source: bytes) -> None:
        self.file, self.source, self.found = file, source, list[Mutant]()
        self._starts = [0]
        for line in source.splitlines(keepends=True):
            self._starts.append(self._starts[-1] + len(line))
        self._kernel = False
        self.visit(ast.parse(source))

    def _add(self, kind: str, node: ast.expr | ast.stmt, after: str) -> None:
        assert node.end_lineno is not None
        assert node.end_col_offset is not None
        start = self._starts[node.lineno - 1] + node.col_offset
        end = self._starts[node.end_lineno - 1] + node.end_col_offset
        before = self.source[start:end].decode()
        self.found.append(Mutant(kind, self.file, node.lineno, start, end, before, after, self._kernel))

    def visit_FunctionDef(self, node: ast.FunctionDef) -> None:
        outer = self._kernel
        self._kernel = outer or any("njit" in ast.unparse(one) for one in node.decorator_list)
        for default in [*node.args.defaults, *(one for one in node.args.kw_defaults if one is not None)]:
            self._constant("default", default)
        for statement in node.body:
            self.visit(statement)
        self._kernel = outer

    def visit_AnnAssign(self, node: ast.AnnAssign) -> None:
        if node.value is not None and (
            "Final" in ast.unparse(node.annotation) or not self._constant("default", node.value)
        ):
            self.visit(node.value)

    def visit_Expr(self, node: ast.Expr) -> None:
        if not isinstance(node.value, ast.Constant):  # a docstring
            self.generic_visit(node)

    def visit_JoinedStr(self, node: ast.JoinedStr) -> None:
        """Python before 3.12 has no places inside of these."""

    def visit_If(self, node: ast.If) -> None:
        if ast.unparse(node.test) != "TYPE_CHECKING":
            self.generic_visit(node)

    def visit_Raise(self, node: ast.Raise) -> None:
        self._add("raise", node, "pass")

    def visit_Compare(self, node: ast.Compare) -> None:
        flipped = ast.Compare(node.left, [_FLIPPED[type(op)]() for op in node.ops], node.comparators)
        self._add("comparison", node, f"({ast.unparse(flipped)})")
        self.generic_visit(node)

    def visit_Call(self, node: ast.Call) -> None:
        ordered = ast.unparse(node.func).rpartition(".")[2] not in COMMUTATIVE
        if ordered and len(node.args) > 1 and not any(isinstance(one, ast.Starred) for one in node.args[:2]):
            first, second, *rest = node.args
            if ast.dump(first) != ast.dump(second):
                swapped = ast.Call(node.func, [second, first, *rest], node.keywords)
                self._add("arguments", node, ast.unparse(swapped))
        self.generic_visit(node)

    def visit_Constant(self, node: ast.Constant) -> None:
        self._constant("constant", node)

    def _constant(self, kind: str, node: ast.expr) -> bool:
        """Add a change of a number or a truth value, if it is one."""
        value = node.value if isinstance(node, ast.Constant) else None
        if isinstance(value, bool):
            self._add(kind, node, str(not value))
        elif isinstance(value, int):
            self._add(kind, node, str(value + 1))
        elif isinstance(value, float):
            self._add(kind, node, repr(2.0 * value if value else 1.0))
        return isinstance(value, int | float)


def chosen(number: int, seed: int, within: str) -> Iterator[Mutant]:
    """Mutants, each kind as often as every other, without end of a kind that has none left."""
    kinds: defaultdict[str, list[Mutant]] = defaultdict(list)
    for part in PARTS:
        for path in sorted((COPY / part).rglob("*.py")):
            file = path.relative_to(COPY).as_posix()
            if file.startswith(within):
                for mutant in Sites(file, path.read_bytes()).found:
                    kinds[mutant.kind].append(mutant)
    dice = random.Random(seed)
    for _ in range(number):
        kind = dice.choice(sorted(kinds))
        yield kinds[kind].pop(dice.randrange(len(kinds[kind])))
        if not kinds[kind]:
            del kinds[kind]


def module_of(file: str) -> str:
    """The import name of a file of the product."""
    part, _, rest = file.removesuffix(".py").removesuffix("/__init__").partition("/")
    return ".".join([PARTS[part], *rest.split("/")]) if rest else PARTS[part]


def imports(path: Path, known: set[str]) -> set[str]:
    """The product's modules that a file imports or names in a text, such as the source of another process."""
    names = set()
    for node in ast.walk(ast.parse(path.read_bytes())):
        if isinstance(node, ast.ImportFrom) and node.module:
            names |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
        elif isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            names.add(node.value)
    return names & known


def loaded_by_name(known: set[str]) -> dict[str, set[str]]:
    """The modules that others load by a name that is made or installed: commands, workflows and readers."""
    project = tomllib.loads((COPY / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    readers = project["entry-points"]["furrowmap.readers"].values()
    return {
        "furrowmap.cli.main": {name for name in known if name.startswith("furrowmap.cli.")} - {"furrowmap.cli.main"},
        "furrowmap": {name for name in known if name.startswith("furrowmap.workflows.")},
        "furrowmap.core.readers.reader": {reader.partition(":")[0] for reader in readers},
    }


def words_of(text: str) -> set[str]:
    """The longer words of a text, and its names."""
    return set(re.findall(r"[A-Za-z]{5,}", text)) | set(re.findall(r"\b[a-z]+_[a-z_]+\b", text))


class Tests:
    """Which test files are nearest to a module."""

    def __init__(self) -> None:
        files = {path.relative_to(COPY).as_posix(): path for part in PARTS for path in (COPY / part).rglob("*.py")}
        self._modules = {module_of(file): path for file, path in files.items()}
        known = set(self._modules)
        loaded = loaded_by_name(known)
        self._importers: defaultdict[str, set[str]] = defaultdict(set)
        for module, path in self._modules.items():
            for name in imports(path, known) | loaded.get(module, set()):
                self._importers[name].add(module)
        self._tests = {
            path: imports(path, known)
            for path in sorted((COPY / "tests").rglob("test_*.py"))
            if not any(word in path.as_posix() for word in LONG)
        }
        self._words = {path: words_of(path.read_text(encoding="utf-8")) for path in self._tests}
        self._common = Counter(word for words in self._words.values() for word in words)

    def _distances(self, file: str) -> dict[str, int]:
        """The modules that import a file, with the number of imports between."""
        distance = {module_of(file): 0}
        front = [*distance]
        while front:
            above = {up for one in front for up in self._importers[one]} - set(distance)
            distance |= dict.fromkeys(above, distance[front[0]] + 1)
            front = [*above]
        return distance

    def users(self, file: str) -> set[str]:
        """The last part of the name of all modules that need a file, itself included."""
        return {module.rpartition(".")[2] for module in self._distances(file)}

    def nearest(self, file: str, line: int) -> list[str]:
        """At most :data:`MOST_FILES`: by the imports between, then by the rare words that they share.

        Those of the definition at `line` count more than those of the rest of `file`.
        """
        distance = self._distances(file)
        source = (COPY / file).read_text(encoding="utf-8")
        here = [node for node in ast.parse(source).body if node.lineno <= line <= (node.end_lineno or 0)]
        words = words_of(source)
        own = words_of("\n".join(ast.get_source_segment(source, node) or "" for node in here))
        ranked = [
            (near, -sum((1.0 + 4.0 * (word in own)) / self._common[word] for word in self._words[path] & words), path)
            for path, names in self._tests.items()
            if (near := min((distance.get(name, 99) for name in names), default=99)) <= FARTHEST
        ]
        return [path.relative_to(COPY).as_posix() for *_, path in sorted(ranked)[:MOST_FILES]]


class Limits:
    """Ends a process whose test takes too long, and begins no further test when all have taken long enough."""

    def pytest_runtest_logstart(self) -> None:
        most = int(time.process_time()) + TEST_S
        resource.setrlimit(resource.RLIMIT_CPU, (most, resource.getrlimit(resource.RLIMIT_CPU)[1]))

    def pytest_runtest_teardown(self, item: pytest.Item) -> None:
        if sum(os.times()[:4]) > ALL_TESTS_S:  # with the processes that tests start
            item.session.shouldstop = TIME_OVER


def run_tests(tests: Sequence[str], kernels: Path, *options: str) -> tuple[bool, list[str]]:
    """Whether tests pass in the copy, or have not failed when the time is over; and which of them failed.

    Neither is so where a test or the process hung or crashed.
    """
    with tempfile.TemporaryFile("w+", errors="replace") as output:
        child = os.fork()
        if not child:
            tests_in_child([*options, *tests], kernels, output.fileno())
        end_s = time.monotonic() + PATIENCE_S
        while (ended := os.waitpid(child, os.WNOHANG))[0] == 0 and time.monotonic() < end_s:
            time.sleep(0.05)
        with suppress(ProcessLookupError):
            os.killpg(child, signal.SIGKILL)  # what the tests started, too
        status = ended[1] if ended[0] else os.waitpid(child, 0)[1]
        output.seek(0)
        said = output.read()
    failed = re.findall(r"^(?:FAILED|ERROR) (.+?)(?: - .*)?$", said, re.MULTILINE)
    return status == 0 or (TIME_OVER in said and not failed), failed


def tests_in_child(arguments: Sequence[str], kernels: Path, output: int) -> NoReturn:
    """Run tests in a process forked for it."""
    os.setsid()
    os.dup2(output, 1)
    os.dup2(output, 2)
    os.chdir(COPY)
    os.environ |= {"PYTHONPATH": str(COPY / "build" / "typing"), "NUMBA_CACHE_DIR": str(kernels)}
    config.reload_config()
    sys.path[:0] = [os.environ["PYTHONPATH"]]
    status = 1
    with suppress(SystemExit):
        usual = ["-q", "-p", "no:cacheprovider", f"--basetemp={COPY.parent / 'tmp'}"]
        status = int(pytest.main([*usual, *arguments], [Limits()]))
    sys.stdout.flush()
    os._exit(status)


def fate(mutant: Mutant, tests: Tests) -> tuple[str, list[str]]:
    """What the nearest tests in the copy make of a mutant, and the test that failed.

    It is "killed" or "survived"; "hung" where a test or the process ended without an answer; "untested" where no test
    imports it.
    """
    nearest = tests.nearest(mutant.file, mutant.line)
    if not nearest:
        return "untested", []
    path = COPY / mutant.file
    source, written = path.read_bytes(), path.stat()
    path.write_bytes(source[: mutant.start] + mutant.after.encode() + source[mutant.end :])
    try:
        with tempfile.TemporaryDirectory(dir=COPY.parent) as folder:
            kernels = KERNELS
            if mutant.kernel:  # numba does not compile callers in other files again when what they call has changed
                kernels = Path(folder) / "kernels"
                shutil.copytree(KERNELS, kernels, copy_function=os.link)
                for stem in tests.users(mutant.file):
                    for cached in kernels.rglob(f"{stem}.*"):
                        cached.unlink()
            passed, failed = run_tests([*OF_ALL, *nearest], kernels, "-x")
    finally:
        path.write_bytes(source)
        os.utime(path, ns=(written.st_atime_ns, written.st_mtime_ns))  # kernels in cache are told by it
    return "survived" if passed else "killed" if failed else "hung", failed


def unclear(fates: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """The mutants whose failing test fails without them, too."""
    tests = sorted({test for one in fates for test in one["failed"]})
    failing = {test for k in range(0, len(tests), 50) for test in run_tests(tests[k : k + 50], KERNELS)[1]}
    return [one for one in fates if failing.intersection(one["failed"])]


def copy_checkout() -> None:
    """The files under version control or about to be, with their times, in :data:`COPY`."""
    shutil.rmtree(COPY, ignore_errors=True)
    listed = subprocess.check_output(["git", "ls-files", "-co", "--exclude-standard"], cwd=CHECKOUT, text=True)
    for name in listed.splitlines():
        target = COPY / name
        target.parent.mkdir(parents=True, exist_ok=True)
        if (CHECKOUT / name).exists():
            shutil.copy2(CHECKOUT / name, target)
    subprocess.run(["make", "--silent", "layout"], cwd=COPY, check=True)
    data = COPY.parent / "shared"
    if not data.exists():
        data.symlink_to(CHECKOUT.parent / "shared")
    layout = COPY / "build" / "typing"
    asked = "import os, furrowmap.process as p; p.keep_kernels(); print(os.environ[p.VARIABLE])"
    compiled = subprocess.check_output([sys.executable, "-c", asked], cwd=CHECKOUT, text=True).strip()
    place = caching.UserWideCacheLocator.get_suitable_cache_subpath
    for part in ("core", "exporters"):
        for folder in {path.parent.relative_to(COPY) for path in (COPY / part).rglob("*.py")}:
            ours = Path(compiled) / place(str(CHECKOUT / folder / "a.py"))
            if ours.is_dir():
                there = KERNELS / place(str(layout / "furrowmap" / folder / "a.py"))
                shutil.copytree(ours, there, dirs_exist_ok=True)


def earlier(seed: int) -> Iterator[Mutant]:
    """The mutants of an earlier batch that were not killed, where the source is still the same there."""
    for one in json.loads((COPY.parent / f"{seed}.json").read_text(encoding="utf-8")):
        mutant = Mutant(**{name: one[name] for name in Mutant.__dataclass_fields__})
        path = COPY / mutant.file
        same = path.exists() and path.read_bytes()[mutant.start : mutant.end] == mutant.before.encode()
        if one["fate"] != "killed" and same:
            yield mutant


def main() -> None:
    """Make the mutants, print the fate of each, and keep all in build/mutants."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("number", type=int)
    parser.add_argument("seed", type=int)
    parser.add_argument("--within", default="", help="only files whose path begins so, such as core/work")
    parser.add_argument("--again", action="store_true", help="those of this seed that were not killed, once more")
    options = parser.parse_args()
    for name in LIBRARIES:
        import_module(name)
    copy_checkout()
    tests, fates = Tests(), list[dict[str, Any]]()
    mutants = earlier(options.seed) if options.again else chosen(options.number, options.seed, options.within)
    kept = COPY.parent / f"{options.seed}{'-again' * options.again}.json"
    for mutant in mutants:
        begin_s = time.monotonic()
        end, failed = fate(mutant, tests)
        took_s = round(time.monotonic() - begin_s)
        change = f"{mutant.before} -> {mutant.after}".replace("\n", " ")
        print(f"{end:8} {took_s:4} s  {mutant.file}:{mutant.line} {mutant.kind}: {change[:200]}", flush=True)
        fates.append(asdict(mutant) | {"fate": end, "failed": failed, "took_s": took_s})
        kept.write_text(json.dumps(fates, indent=1), encoding="utf-8")
    for one in unclear(fates):
        one["fate"] = "unclear"
        print(f"unclear: {one['file']}:{one['line']}: {one['failed'][0]} fails without it, too")
    kept.write_text(json.dumps(fates, indent=1), encoding="utf-8")
    killed = sum(one["fate"] in ("killed", "hung") for one in fates)
    print(f"{killed} of {len(fates)} killed; those that survived are equivalent, or need a test.")


if __name__ == "__main__":
    main()
