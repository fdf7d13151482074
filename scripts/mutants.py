"""Do the tests notice a mistake? Makes random mutants of the product's code and runs the tests that execute each.

A mutant is a copy of the checkout with one change: a comparison flipped, a `raise` removed, two arguments swapped, a
default or a constant changed. Which tests execute the place is read from the contexts that `make coverage` has recorded
of the same source; for what is compiled, or evaluated at import, those that execute its users count. A mutant is killed
when a test fails. Those that survive are printed with their place: some are equivalent (they change nothing that
anybody can see), the others need a test. Where the type check refuses a survivor, that is told as well.

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
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any, Final, NoReturn
from xml.etree import ElementTree as ET

import pytest
from coverage import CoverageData
from numba.core import config

CHECKOUT: Final = Path(__file__).resolve().parents[1]
BUILD: Final = CHECKOUT / "build" / "mutants"
COVERAGE: Final = CHECKOUT / "build" / "coverage"
"""What `make coverage` leaves: which test executes which line, and how long each takes."""
LIBRARIES: Final = (
    "geopandas", "hypothesis", "laspy", "numba", "pandas", "pyogrio", "pyproj", "rasterio", "rosbags.typesys",
    "scipy.interpolate", "scipy.ndimage", "scipy.optimize", "scipy.signal", "scipy.sparse.linalg", "scipy.spatial",
    "shapely",
)  # fmt: skip
PARTS: Final = ("core", "exporters", "app", "cli")
ELSEWHERE: Final = ("tests/plugin", "tests/benchmarks", "tests/test_house.py", "tests/test_docs.py")
"""Tests of other things than the product's code."""
WHOLE: Final = ("end_to_end", "notebooks", "tutorial", "two_tools", "killed")
"""Tests that run all of it, and take long; they come last."""
OF_DEFAULTS: Final = (
    "tests/test_neutral_defaults.py",
    "tests/test_frozen_values.py",
    "tests/core/simulator/test_scenario_pages.py",
)
"""Tests that read the source of every module, or hold the defaults of some by a page."""
MOST_S: Final = 60.0
"""Expected time of all tests that are run on a mutant, the nearest first."""
AT_A_TIME: Final = 40
"""Tests that a process runs."""
TEST_S: Final = 100
"""A test that takes longer hangs."""
PATIENCE_S: Final = 900
"""Time on the clock for a process; one that takes longer waits for something."""
NEAREST: Final = 5
"""Names that are followed from a place that no test executes to one that a test does."""
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
        self._kernel = outer or any(ast.unparse(one).startswith(("kernel(", "njit(")) for one in node.decorator_list)
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
    for file in product_files():
        if file.startswith(within):
            for mutant in Sites(file, (CHECKOUT / file).read_bytes()).found:
                kinds[mutant.kind].append(mutant)
    dice = random.Random(seed)
    for _ in range(number):
        kind = dice.choice(sorted(kinds))
        yield kinds[kind].pop(dice.randrange(len(kinds[kind])))
        if not kinds[kind]:
            del kinds[kind]


@cache
def product_files() -> tuple[str, ...]:
    """All modules of the product, relative to the checkout."""
    paths = (path for part in PARTS for path in (CHECKOUT / part).rglob("*.py"))
    return tuple(sorted(path.relative_to(CHECKOUT).as_posix() for path in paths))


@dataclass(frozen=True)
class Span:
    """Lines of a file, first and last."""

    file: str
    first: int
    last: int


class Names:
    """Where the product uses a name, and which definition a line belongs to."""

    def __init__(self) -> None:
        self._trees = {file: ast.parse((CHECKOUT / file).read_bytes()) for file in product_files()}
        self._uses: defaultdict[str, set[Span]] = defaultdict(set)
        for file, tree in self._trees.items():
            for node in ast.walk(tree):
                if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Load):
                    self._uses[node.id].add(Span(file, node.lineno, node.lineno))
                elif isinstance(node, ast.Attribute):
                    self._uses[node.attr].add(Span(file, node.lineno, node.lineno))

        self._imported: defaultdict[str, set[str]] = defaultdict(set)
        for path in (CHECKOUT / "tests").rglob("*.py"):
            for node in ast.walk(ast.parse(path.read_bytes())):
                for alias in node.names if isinstance(node, ast.ImportFrom) else ():
                    self._imported[alias.name].add(path.relative_to(CHECKOUT).as_posix())

    def body_at(self, place: Span) -> Span | None:
        """The lines of the innermost function's body that a place is in, or whose default it is."""
        spans = [
            Span(place.file, node.body[0].lineno, node.end_lineno or node.lineno)
            for node in ast.walk(self._trees[place.file])
            if isinstance(node, ast.FunctionDef) and node.lineno <= place.first <= (node.end_lineno or 0)
        ]
        return max(spans, key=lambda span: span.first, default=None)

    def defined(self, place: Span) -> set[str]:
        """The names that are defined around a place: a function, a constant, a class or its field."""
        names, body = set[str](), self._trees[place.file].body
        while around := [one for one in body if _first(one) <= place.first <= (one.end_lineno or 0)]:
            (node,), body = around, []
            if isinstance(node, ast.FunctionDef):
                names = {node.name}
            elif isinstance(node, ast.ClassDef):
                names, body = {node.name}, node.body
            elif isinstance(node, ast.Assign | ast.AnnAssign):
                targets = node.targets if isinstance(node, ast.Assign) else [node.target]
                names |= {one.id for target in targets for one in ast.walk(target) if isinstance(one, ast.Name)}
        return names

    def users(self, place: Span) -> set[Span]:
        """Where the product uses the names that are defined around a place."""
        return {use for name in self.defined(place) for use in self._uses[name]}

    def importing_tests(self, place: Span) -> set[str]:
        """Files of tests that import one of the names that are defined around a place."""
        return {file for name in self.defined(place) for file in self._imported[name]}


def _first(node: ast.stmt) -> int:
    """The first line of a statement, its decorators included."""
    decorators = node.decorator_list if isinstance(node, ast.FunctionDef | ast.ClassDef) else []
    return min([node.lineno, *(one.lineno for one in decorators)])


class Tests:
    """Which tests execute a place.

    Raises:
        SystemExit: if `make coverage` has not recorded it.
    """

    def __init__(self) -> None:
        if not (COVERAGE / "data").is_file():
            raise SystemExit("mutants.py: no record of what tests execute; run `make coverage` first")
        self._data = CoverageData(str(COVERAGE / "data"))
        self._data.read()
        self.names = Names()
        self._seconds: dict[str, float] = {}
        for case in ET.parse(COVERAGE / "tests.xml").iter("testcase"):
            test = f"{case.get('classname', '').replace('.', '/')}.py::{case.get('name')}"
            self._seconds[test] = float(case.get("time", "0"))
        self._of_file: defaultdict[str, list[str]] = defaultdict(list)
        for test in self._seconds:
            self._of_file[test.partition("::")[0]].append(test)
        self._lines: dict[str, Mapping[int, Sequence[str]]] = {}

    def of(self, mutant: Mutant) -> list[list[str]]:
        """The tests of a mutant, the nearest first, in groups for a process each."""
        last = mutant.line + mutant.before.count("\n")
        found = self._executing(Span(mutant.file, mutant.line, last))
        tests = self._ordered(mutant.file, found)
        groups = [tests[k : k + AT_A_TIME] for k in range(0, len(tests), AT_A_TIME)]
        by_source = mutant.kind == "default" or mutant.after in ("True", "False") or not found
        return [list(OF_DEFAULTS), *groups] if by_source else groups

    def _executing(self, place: Span) -> set[str]:
        """Tests that execute a place; else the body of its function; else the users of what is defined there."""
        seen, front, direct = set[Span](), {place}, set[str]()
        if not self._contexts(place):
            direct = {test for file in self.names.importing_tests(place) for test in self._of_file[file]}
        for _ in range(NEAREST):
            for wider in (front, {body for span in front if (body := self.names.body_at(span)) is not None}):
                if found := {test for span in wider for test in self._contexts(span)}:
                    return found | direct
            seen |= front
            front = {user for span in front for user in self.names.users(span)} - seen
        return direct

    def _contexts(self, span: Span) -> set[str]:
        """Tests that execute one of the lines; where their set-up does, those of the same file, which may share it."""
        lines = self._lines.get(span.file)
        if lines is None:
            lines = self._lines[span.file] = self._data.contexts_by_lineno(span.file)
        named = {name for line in range(span.first, span.last + 1) for name in lines.get(line, ()) if name}
        found = set[str]()
        for test, _, phase in (name.rpartition("|") for name in named):
            found.update(self._of_file[test.partition("::")[0]] if phase == "setup" else [test])
        return {test for test in found if not test.startswith(ELSEWHERE)}

    def _ordered(self, file: str, tests: set[str]) -> list[str]:
        """Tests named as the file first, then those of its folder, then others; quick ones first, functions in turn."""
        ranked = list[tuple[bool, int, int, int, str]]()
        turns: defaultdict[str, int] = defaultdict(int)
        for test in sorted(tests, key=lambda test: (self._seconds.get(test, 1.0), test)):
            path = Path(test.partition("::")[0])
            beside = path.parent.relative_to("tests") == Path(file).parent
            near = 0 if path.stem == f"test_{Path(file).stem}" else 1 if beside else 2
            whole = any(word in path.stem for word in WHOLE)
            turns[test.partition("[")[0]] += 1
            ranked.append((whole, turns[test.partition("[")[0]] // 4, near, len(ranked), test))
        chosen, total_s = list[str](), 0.0
        for *_, test in sorted(ranked):
            total_s += self._seconds.get(test, 1.0)
            if chosen and total_s > MOST_S:
                break
            chosen.append(test)
        return chosen


class Limits:
    """Ends a process whose test takes too long."""

    def pytest_runtest_logstart(self) -> None:
        most = int(time.process_time()) + TEST_S
        resource.setrlimit(resource.RLIMIT_CPU, (most, resource.getrlimit(resource.RLIMIT_CPU)[1]))


@dataclass(frozen=True)
class Copy:
    """A copy of the checkout in which mutants are made; several may be worked with at a time."""

    folder: Path

    @property
    def checkout(self) -> Path:
        """Where the files are."""
        return self.folder / "checkout"

    def make(self) -> None:
        """Copy the files under version control or about to be. Kernels are in cache by the content of their sources."""
        shutil.rmtree(self.folder, ignore_errors=True)
        listed = subprocess.check_output(["git", "ls-files", "-co", "--exclude-standard"], cwd=CHECKOUT, text=True)
        for name in listed.splitlines():
            target = self.checkout / name
            target.parent.mkdir(parents=True, exist_ok=True)
            if (CHECKOUT / name).exists():
                shutil.copy(CHECKOUT / name, target)
        subprocess.run(["make", "--silent", "layout"], cwd=self.checkout, check=True)
        (self.folder / "shared").symlink_to(CHECKOUT.parent / "shared")

    def fate(self, mutant: Mutant, groups: Sequence[Sequence[str]]) -> tuple[str, list[str]]:
        """What groups of tests make of a mutant, and the test that failed.

        It is "killed" or "survived"; "hung" where a test or the process ended without an answer; "untested" where no
        test executes it.
        """
        path = self.checkout / mutant.file
        source = path.read_bytes()
        path.write_bytes(source[: mutant.start] + mutant.after.encode() + source[mutant.end :])
        try:
            for group in groups:
                passed, failed = self.run(group, "-x")
                if not passed:
                    return "killed" if failed else "hung", failed
        finally:
            path.write_bytes(source)
        return "survived" if groups else "untested", []

    def run(self, tests: Sequence[str], *options: str) -> tuple[bool, list[str]]:
        """Whether tests pass in the copy, and which failed; neither is so where a test or the process hung."""
        with tempfile.TemporaryFile("w+", errors="replace") as output:
            child = os.fork()
            if not child:
                self._run_here([*options, *tests], output.fileno())
            end_s = time.monotonic() + PATIENCE_S
            while (ended := os.waitpid(child, os.WNOHANG))[0] == 0 and time.monotonic() < end_s:
                time.sleep(0.05)
            with suppress(ProcessLookupError):
                os.killpg(child, signal.SIGKILL)  # what the tests started, too
            status = ended[1] if ended[0] else os.waitpid(child, 0)[1]
            output.seek(0)
            failed = re.findall(r"^(?:FAILED|ERROR) (.+?)(?: - .*)?$", output.read(), re.MULTILINE)
        return status == 0, failed

    def _run_here(self, arguments: Sequence[str], output: int) -> NoReturn:
        """Run tests in this process, which has been forked for it."""
        os.setsid()
        os.dup2(output, 1)
        os.dup2(output, 2)
        os.chdir(self.checkout)
        layout = str(self.checkout / "build" / "typing")
        # QGIS sees the folder of temporary files, and no other of the tests.
        os.environ |= {"PYTHONPATH": layout, "TMPDIR": str(self.folder)}
        sys.path[:0] = [layout]
        import_module("furrowmap.process").keep_kernels()
        config.reload_config()
        status = 1
        with suppress(SystemExit):
            usual = ["-q", "-p", "no:cacheprovider", f"--basetemp={self.folder / 'tmp'}"]
            status = int(pytest.main([*usual, *arguments], [Limits()]))
        sys.stdout.flush()
        os._exit(status)

    def is_refused(self, mutant: Mutant) -> bool:
        """Whether the type check refuses a mutant."""
        path = self.checkout / mutant.file
        source = path.read_bytes()
        path.write_bytes(source[: mutant.start] + mutant.after.encode() + source[mutant.end :])
        try:
            command = [sys.executable, "-m", "mypy", "-p", "furrowmap"]
            return subprocess.run(command, cwd=self.checkout, capture_output=True, check=False).returncode != 0
        finally:
            path.write_bytes(source)


def unclear(copy: Copy, fates: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """The mutants whose failing test fails without them, too."""
    tests = sorted({test for one in fates for test in one["failed"]})
    failing = {test for k in range(0, len(tests), 50) for test in copy.run(tests[k : k + 50])[1]}
    return [one for one in fates if failing.intersection(one["failed"])]


def earlier(kept: Path) -> Iterator[Mutant]:
    """The mutants of an earlier batch that were not killed, where the source is still the same there."""
    for one in json.loads(kept.read_text(encoding="utf-8")):
        mutant = Mutant(**{name: one[name] for name in Mutant.__dataclass_fields__})
        path = CHECKOUT / mutant.file
        same = path.exists() and path.read_bytes()[mutant.start : mutant.end] == mutant.before.encode()
        if one["fate"] not in ("killed", "hung") and same:
            yield mutant


def fates_of(copy: Copy, work: Sequence[tuple[Mutant, list[list[str]]]], kept: Path) -> None:
    """Find the fate of each mutant, print it and keep it in a file."""
    copy.make()
    fates = list[dict[str, Any]]()
    for mutant, groups in work:
        begin_s = time.monotonic()
        end, failed = copy.fate(mutant, groups)
        refused = end in ("survived", "untested") and copy.is_refused(mutant)
        took_s = round(time.monotonic() - begin_s)
        change = f"{mutant.before} -> {mutant.after}".replace("\n", " ")
        told = f"{mutant.file}:{mutant.line} {mutant.kind}: {change[:200]}"
        print(f"{end:8} {took_s:4} s  {told}{' (refused by the type check)' if refused else ''}", flush=True)
        found = {"fate": end, "failed": failed, "refused": refused, "took_s": took_s, "tests": sum(map(len, groups))}
        fates.append(asdict(mutant) | found)
        kept.write_text(json.dumps(fates, indent=1), encoding="utf-8")
    for one in unclear(copy, fates):
        one["fate"] = "unclear"
        print(f"unclear: {one['file']}:{one['line']}: {one['failed'][0]} fails without it, too")
    kept.write_text(json.dumps(fates, indent=1), encoding="utf-8")


def main() -> None:
    """Make the mutants, print the fate of each, and keep all in build/mutants."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("number", type=int)
    parser.add_argument("seed", type=int)
    parser.add_argument("--within", default="", help="only files whose path begins so, such as core/coverage")
    parser.add_argument("--again", action="store_true", help="those of this seed that were not killed, once more")
    parser.add_argument("--jobs", type=int, default=2, help="processes that work at a time")
    options = parser.parse_args()
    for name in LIBRARIES:
        import_module(name)
    BUILD.mkdir(parents=True, exist_ok=True)
    kept = BUILD / f"{options.seed}.json"
    mutants = [*earlier(kept)] if options.again else [*chosen(options.number, options.seed, options.within)]
    kept = BUILD / f"{options.seed}{'-again' * options.again}.json"
    tests = Tests()
    work = [(mutant, tests.of(mutant)) for mutant in mutants]  # here: a fork of this process may not use the record
    parts, children = [kept.with_suffix(f".{k}.json") for k in range(options.jobs)], list[int]()
    for k, part in enumerate(parts):
        children.append(os.fork())
        if not children[-1]:
            fates_of(Copy(BUILD / f"copy{k}"), work[k :: options.jobs], part)
            os._exit(0)
    for child in children:
        os.waitpid(child, 0)
    fates = [one for part in parts for one in json.loads(part.read_text(encoding="utf-8"))]
    kept.write_text(json.dumps(fates, indent=1), encoding="utf-8")
    killed = sum(one["fate"] in ("killed", "hung") for one in fates)
    refused = sum(one["refused"] for one in fates)
    print(f"{killed} of {len(fates)} killed, {refused} others refused by the type check.")
    print("The rest are equivalent, or need a test.")


if __name__ == "__main__":
    main()
