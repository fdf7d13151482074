"""Which kernels the product calls in the tests, with arguments of which types.

A run of all tests fails if app/kernels.toml lacks any of them: `furrowmap warm-up` would not compile those. They are
added to the file, so that nobody writes it by hand.
"""

from __future__ import annotations

import json
import os
import sys
import tomllib
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest
from numba.core import dispatcher
from numba.core import types as numba_types
from numba.np import numpy_support

from furrowmap.warm_up import LIST
from tests.codes_met import FOLDER, is_whole

MET: set[str] = set()
"""Lines of the list."""
types: Any = numba_types
Dispatcher: Any = dispatcher.Dispatcher
compile_for_args = Dispatcher._compile_for_args


def pytest_configure() -> None:
    """Record the first call of each kernel with arguments of each types from here on."""
    Dispatcher._compile_for_args = _recorded


def _recorded(self: Any, *args: Any, **named: Any) -> Any:
    name, caller = self.py_func.__module__, sys._getframe(1).f_globals.get("__name__", "")
    if name.startswith("furrowmap.") and caller.startswith("furrowmap."):
        line = line_of(f"{name}.{self.py_func.__name__}", map(self.typeof_pyval, args))
        if line not in MET:
            MET.add(line)
            own = Path(os.environ[FOLDER], f"{os.getpid()}.kernels")
            with suppress(PermissionError), own.open("a", encoding="utf-8") as file:  # a test may be another user
                file.write(f"{line}\n")
    return compile_for_args(self, *args, **named)


def line_of(kernel: str, arguments: Iterator[Any]) -> str:
    """The kernel and the types of its arguments, as the list has them."""
    return f"{kernel.removeprefix('furrowmap.')} ({''.join(f'{text_of(each)}, ' for each in arguments).strip()})"


def text_of(kind: Any) -> str:
    """A type of numba as an expression of names of numba and of the kernel's module."""
    if isinstance(kind, types.Array):
        if kind.mutable and kind.aligned:
            ends = {"C": [":"] * (kind.ndim - 1) + ["::1"], "F": ["::1"] + [":"] * (kind.ndim - 1)}
            return f"{text_of(kind.dtype)}[{', '.join(ends.get(kind.layout, [':'] * kind.ndim))}]"
        return f"Array({text_of(kind.dtype)}, {kind.ndim}, '{kind.layout}', {not kind.mutable}, aligned={kind.aligned})"
    if isinstance(kind, types.Record):
        return f"numba.from_dtype(np.dtype({numpy_support.as_dtype(kind).descr}))"
    if isinstance(kind, types.BaseTuple):
        named = f", {class_text(kind.instance_class)}" if isinstance(kind, types.BaseNamedTuple) else ""
        return f"BaseTuple.from_types([{', '.join(map(text_of, kind.types))}]{named})"
    return "boolean" if isinstance(kind, types.Boolean) else str(kind)


def class_text(kind: type) -> str:
    """A class of named tuples as an expression of what :func:`furrowmap.warm_up.types_of` knows."""
    return f"class_of('{kind.__module__.removeprefix('furrowmap.')}.{kind.__name__}')"


def listed() -> set[str]:
    """The lines of the list."""
    commands = tomllib.loads(LIST.read_text(encoding="utf-8")).values()
    return {f"{name} {signature}" for kernels in commands for name, every in kernels.items() for signature in every}


def add_to_list(lines: list[str]) -> None:
    """Write the list with these lines in its last part."""
    text = LIST.read_text(encoding="utf-8")
    commands: dict[str, dict[str, list[str]]] = tomllib.loads(text)
    for name, _, signature in (line.partition(" ") for line in lines):
        commands["others"].setdefault(name, []).append(signature)
    parts = [text[: text.index("[")].rstrip()]
    for command, kernels in commands.items():
        entries = (f'"{name}" = {json.dumps(signatures)}' for name, signatures in kernels.items())
        parts.append("\n".join([f"[{command}]", *entries]))
    LIST.write_text("\n\n".join(parts) + "\n", encoding="utf-8")


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_sessionfinish(session: pytest.Session) -> Iterator[None]:
    """Compare what all processes met with the list, in the process that started the others."""
    yield
    if "PYTEST_XDIST_WORKER" in os.environ or not is_whole(session.config):
        return
    files = Path(os.environ[FOLDER]).glob("*.kernels")
    met = {line for file in files for line in file.read_text(encoding="utf-8").splitlines()}
    if missing := sorted(met - listed()):
        add_to_list(missing)
        sys.stderr.write("\napp/kernels.toml lacked these, which are now in it:\n" + "\n".join(missing) + "\n")
        session.exitstatus = session.exitstatus or pytest.ExitCode.TESTS_FAILED
