"""Check the types of the modules that depend on the platform for Windows and macOS, beside mypy's whole run for Linux.

A whole run takes a minute of processor time a platform. Only these modules can differ: they name sys.platform, or a
name of the standard library that typeshed declares under a condition on it. They are checked alone, each import of
furrowmap or of another package being Any, for Linux as well: what mypy reports for the other platform only is an error.
"""

from __future__ import annotations

import ast
import os
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Final

import mypy

CHECKOUT: Final = Path(__file__).resolve().parents[1]
OTHERS: Final = ("win32", "darwin")
_PARTS: Final = {"app": "furrowmap", **{part: f"furrowmap.{part}" for part in ("core", "exporters", "cli", "plugin")}}
_STUBS: Final = Path(mypy.__file__).parent / "typeshed" / "stdlib"


def main() -> int:
    """Print what mypy reports for another platform and not for Linux; returns how many lines these are."""
    modules = dependent_modules()
    known = set(reported("linux", modules))
    found = {platform: [line for line in reported(platform, modules) if line not in known] for platform in OTHERS}
    for platform, lines in found.items():
        print(*(f"{platform}: {line}" for line in lines), sep="\n", end="\n" if lines else "")
        print(f"{platform}: {len(lines) or 'no'} errors in {len(modules)} modules that depend on the platform")
    return sum(map(len, found.values()))


def dependent_modules() -> list[str]:
    """Import names of the modules that depend on the platform."""
    found = []
    for part, package in _PARTS.items():
        for path in sorted((CHECKOUT / part).rglob("*.py")):
            if depends_on_platform(path.read_text(encoding="utf-8")):
                inner = path.relative_to(CHECKOUT / part).with_suffix("").parts
                found.append(".".join((package, *inner)).removesuffix(".__init__"))
    return found


def depends_on_platform(source: str) -> bool:
    """Whether a module's source names sys.platform, or a name that its imports have on some platforms only."""
    tree = ast.parse(source)
    names, imported = set(_names(tree)), set(_imported(tree))
    return ("sys" in imported and "platform" in names) or any(conditional_names(one) & names for one in imported)


@cache
def conditional_names(module: str) -> frozenset[str]:
    """Names of a module of the standard library that its stub declares under a condition on sys.platform."""
    place = _STUBS.joinpath(*module.split("."))
    path = place / "__init__.pyi" if place.is_dir() else place.with_suffix(".pyi")
    if not path.is_file():
        return frozenset()
    conditions = [node for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))) if isinstance(node, ast.If)]
    return frozenset(name for node in conditions if "platform" in _names(node.test) for name in _declared(node))


def reported(platform: str, modules: list[str]) -> list[str]:
    """The lines that mypy prints for the modules alone, without notes and summary."""
    command = [sys.executable, "-m", "mypy", "--platform", platform, "--follow-imports=skip", "--no-error-summary"]
    cache_dir = os.environ.get("MYPY_CACHE_DIR", ".mypy_cache")
    command += [f"--cache-dir={cache_dir}/{platform}", *(word for module in modules for word in ("-m", module))]
    done = subprocess.run(command, cwd=CHECKOUT, capture_output=True, text=True, encoding="utf-8", check=False)
    if done.returncode > 1:  # 1: there are errors
        raise SystemExit(done.stdout + done.stderr)
    return [line for line in done.stdout.splitlines() if ": note: " not in line]


def _names(tree: ast.AST) -> Iterator[str]:
    for node in ast.walk(tree):
        if isinstance(node, ast.Name):
            yield node.id
        elif isinstance(node, ast.Attribute):
            yield node.attr
        elif isinstance(node, ast.alias):
            yield node.name


def _imported(tree: ast.AST) -> Iterator[str]:
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            yield node.module


def _declared(condition: ast.If) -> Iterator[str]:
    for node in ast.walk(condition):
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            yield node.name
        elif isinstance(node, ast.AnnAssign | ast.Assign):
            targets = [node.target] if isinstance(node, ast.AnnAssign) else node.targets
            yield from (target.id for target in targets if isinstance(target, ast.Name))
        elif isinstance(node, ast.ImportFrom):
            yield from (alias.asname or alias.name for alias in node.names)


if __name__ == "__main__":
    sys.exit(min(main(), 1))
