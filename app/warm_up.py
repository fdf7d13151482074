"""Compilation of kernels: ahead of their first use, in one process a core, and what is said where it happens later."""

import gc
import os
import subprocess
import sys
import tomllib
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import contextmanager, nullcontext, suppress
from importlib import import_module
from multiprocessing import get_context
from pathlib import Path
from types import ModuleType
from typing import Any, Final

import numba
from numba.core import event
from numba.core.errors import NumbaError

from furrowmap.core.runtime.languages.texts import Text, joined
from furrowmap.core.runtime.progress import Progress, silent
from furrowmap.core.runtime.settings import language_of_user, threads
from furrowmap.process import CACHE_VARIABLE, prepare_process

LIST: Final = Path(__file__).with_name("kernels.toml")
"""Kernels by the first command that calls them, in the order of their calls, with the types of the arguments."""
MOST_KERNELS: Final = "run"
"""The command with the most kernels; commands without any of their own call some of them."""
FIRST_SHARE: Final = 1 / 3
"""A command that is helped compiles so many of its kernels itself. The other process then stays ahead of it. If it
began with the last ones, nothing would be left to compile while the command calculates, and a core would be idle."""
LAST_SHARE: Final = 1 / 6
"""Of the last kernels the other process begins with the last one: a command that has caught up compiles the others."""
KERNELS_A_SECOND: Final = 1
"""Compiled by one process, what they call included, on a slow computer; for an estimate."""
WORTH_SAYING_S: Final = 5.0
"""Compilation that takes less than this is not reported."""


def warm_up(commands: Collection[str] = (), progress: Progress = silent) -> int:
    """Compile kernels for this machine, in as many processes as there may be threads.

    Args:
        commands: those whose kernels are compiled; by default all.
        progress: is called with the share of the kernels that are done.

    Returns:
        Number of compilations, those of numba's own functions included; what is in the cache is not compiled again.
    """
    modules = _listed(commands).items()
    total = sum(len(kernels) for _, kernels in modules)
    done = 0
    compiled = 0
    stage = "compiling kernels"
    progress(stage, 0.0)
    processes = min(threads(), len(modules))
    with get_context("spawn").Pool(processes, prepare_process) if processes > 1 else nullcontext() as pool:
        for kernels, news in (pool.imap_unordered if pool else map)(_compile_module, modules):
            done = done + kernels
            compiled = compiled + news
            progress(stage, done / total)
    return compiled


@contextmanager
def reporting_compilation(say: Callable[[str], None], command: str | None) -> Iterator[None]:
    """Within it, `say` is called once if kernels are compiled, and another process helps the `command`, if one runs."""
    if command == "warm-up":
        yield
        return
    helper: subprocess.Popen[bytes] | None = None

    def begun() -> None:
        nonlocal helper
        own = _listed([command]) if command else {}
        seconds = sum(map(len, (own or _listed([MOST_KERNELS])).values())) / KERNELS_A_SECOND / threads()
        if seconds >= WORTH_SAYING_S:
            text = Text("Compiling kernels for this machine, once: up to {seconds:.0f} s.", seconds=seconds)
            more = Text("furrowmap warm-up compiles everything in advance.")
            say(joined((text, more), ".", language_of_user()))
        if command and own and threads() > 1:
            options = ["--quiet", "--threads", str(threads() - 1)]
            helper = subprocess.Popen(  # noqa: S603 (this interpreter)
                [sys.executable, "-P", "-m", "furrowmap", "warm-up", command, *options],
                stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
            )  # fmt: skip

    watch = _Compilations(begun)
    try:
        with _watching(watch):
            if command and not any(Path(os.environ[CACHE_VARIABLE]).glob("*")) and _listed([command]):
                watch.on_start(None)  # the other process starts while this one imports
            yield
    finally:
        if helper is not None:
            helper.kill()  # what it has compiled is in the cache; it would not end before what it is compiling
            helper.wait()


def _listed(commands: Collection[str]) -> dict[str, list[tuple[str, str]]]:
    """Name and types of the arguments of the listed kernels of these commands, or of all, by module.

    They are in the order for a process that helps a command.
    """
    modules: dict[str, list[tuple[str, str]]] = {}
    for command, kernels in tomllib.loads(LIST.read_text(encoding="utf-8")).items():
        if commands and command not in commands:
            continue
        every = [*kernels.items()]
        first = round(FIRST_SHARE * len(every))
        last = round((1.0 - LAST_SHARE) * len(every))
        for name, signatures in every[first:last] + every[last:][::-1] + every[:first]:
            module, _, kernel = name.rpartition(".")
            modules.setdefault(module, []).extend((kernel, signature) for signature in signatures)
    return modules


def _compile_module(work: tuple[str, Sequence[tuple[str, str]]]) -> tuple[int, int]:
    """Compile kernels of a module where they are not in the cache; their number, and that of compilations."""
    name, kernels = work
    watch = _Compilations()
    with _watching(watch):
        module = import_module(f"furrowmap.{name}")
        for kernel, signature in kernels:
            with suppress(NumbaError, TypeError, IndexError):  # of other types meanwhile: compiled at its first call
                getattr(module, kernel).compile(types_of(signature, module))
    return len(kernels), watch.count


def types_of(signature: str, module: ModuleType) -> tuple[Any, ...]:
    """The types of arguments that the list states, with numba's names and those of the kernel's module."""
    names = {**vars(module), **vars(numba.types), "numba": numba, "class_of": _class_of}
    types: tuple[Any, ...] = eval(signature, names)  # noqa: S307 (furrowmap's own list)
    return types


def _class_of(path: str) -> type:
    """A class of named tuples by its module and name."""
    module, _, name = path.rpartition(".")
    found: type = getattr(import_module(f"furrowmap.{module}"), name)
    return found


class _Compilations(event.Listener):  # type: ignore[misc]  # numba has no types
    """Counts compilations, and says when they begin."""

    def __init__(self, begun: Callable[[], None] = lambda: None) -> None:
        self._begun = begun
        self.count = 0

    def on_start(self, _event: Any) -> None:
        """A kernel, or one that it calls."""
        self.count += 1
        if self.count == 1:
            gc.set_threshold(100_000)  # Python looks less often through what numba keeps: 4 % of the time
            self._begun()

    def on_end(self, _event: Any) -> None:
        """Its end."""


@contextmanager
def _watching(watch: _Compilations) -> Iterator[None]:
    collections = gc.get_threshold()
    event.register("numba:compile", watch)
    try:
        yield
    finally:
        event.unregister("numba:compile", watch)
        gc.set_threshold(*collections)
