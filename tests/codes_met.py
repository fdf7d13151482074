"""Which codes of errors and warnings the tests met: a run of all tests fails if one is neither made nor named by any.

A code counts as met if an error or a warning with it was made in a process of pytest, or if a test names it, such as
one that reads it from the JSON of a command.
"""

from __future__ import annotations

import ast
import functools
import os
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest

from furrowmap.core.runtime.errors import FurrowmapError, Notice
from furrowmap.core.runtime.languages.texts import templates

CHECKOUT = Path(__file__).resolve().parents[1]
FOLDER = "FURROWMAP_TEST_CODES"
"""Variable of the environment with the folder to which each process writes the codes it met."""
MET: set[str] = set()


def pytest_configure() -> None:
    """Record the code of each error and warning from here on."""
    os.environ.setdefault(FOLDER, tempfile.mkdtemp(prefix="furrowmap-codes-"))
    for kind in (FurrowmapError, Notice):
        kind.__init__ = _recorded(kind.__init__)  # type: ignore[method-assign]


def _recorded(init: Callable[..., None]) -> Callable[..., None]:
    @functools.wraps(init)
    def recorded(self: Any, /, *parts: Any, **named: Any) -> None:
        init(self, *parts, **named)
        is_constant = sys._getframe(1).f_code.co_name == "<module>"  # made by an import
        if self.code not in MET and not is_constant:
            MET.add(self.code)
            own = Path(os.environ[FOLDER], str(os.getpid()))
            with suppress(PermissionError), own.open("a", encoding="utf-8") as file:  # a test may be another user
                file.write(f"{self.code}\n")

    return recorded


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_sessionfinish(session: pytest.Session) -> Iterator[None]:
    """Compare what all processes met with the page of codes, in the process that started the others."""
    yield
    folder = Path(os.environ[FOLDER])
    if "PYTEST_XDIST_WORKER" in os.environ or not is_whole(session.config):
        return
    met = {code for file in folder.glob("*[0-9]") for code in file.read_text(encoding="utf-8").split()}
    missing = sorted((unmet := listed() - met) - named(unmet))
    if missing:
        sys.stderr.write(f"\nno test makes or names the codes: {', '.join(missing)}\n")
        session.exitstatus = session.exitstatus or pytest.ExitCode.TESTS_FAILED


def is_whole(config: pytest.Config) -> bool:
    """Whether all tests were run, with the sample recordings."""
    paths = [(Path(config.invocation_params.dir) / argument).resolve() for argument in config.args]
    chosen = config.getoption("keyword") or config.getoption("markexpr") or config.getoption("collectonly")
    return paths == [CHECKOUT / "tests"] and not chosen and (CHECKOUT.parent / "shared" / "data").is_dir()


def listed() -> set[str]:
    """The codes of the catalogue of messages."""
    return {key.partition(".")[0] for key in templates("en")}


def named(texts: set[str]) -> set[str]:
    """Those of these texts that are in the tests, but not only where a test expects not to find them."""
    found: set[str] = set()
    for file in (CHECKOUT / "tests").rglob("*.py"):
        source = file.read_text(encoding="utf-8")
        if file == Path(__file__) or not any(text in source for text in texts):
            continue
        nodes = list(ast.walk(ast.parse(source)))
        others = {
            id(part)
            for node in nodes
            if isinstance(node, ast.Compare) and any(isinstance(op, (ast.NotIn, ast.NotEq)) for op in node.ops)
            for part in ast.walk(node)
        }
        found |= {
            node.value
            for node in nodes
            if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in others
        }
    return found & texts
