"""The source of the product as syntax trees, parsed once for all tests in a process."""

from __future__ import annotations

import ast
from functools import cache
from pathlib import Path
from typing import Final

CHECKOUT: Final = Path(__file__).resolve().parents[1]
PARTS: Final = ("app", "core", "exporters", "cli")
"""The folders of the package; `plugin` is the other one of the product."""


@cache
def files(*parts: str) -> tuple[Path, ...]:
    """The Python files of folders."""
    return tuple(path for part in parts for path in sorted((CHECKOUT / part).rglob("*.py")))


@cache
def tree(path: Path) -> ast.Module:
    """A file's syntax."""
    return ast.parse(path.read_bytes())


@cache
def nodes(path: Path) -> tuple[ast.AST, ...]:
    """All nodes of a file."""
    return tuple(ast.walk(tree(path)))
