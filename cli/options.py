"""The options that all verbs have."""

from __future__ import annotations

import logging
from collections.abc import Callable
from functools import wraps
from pathlib import Path
from typing import Any

import click

from furrowmap.cli.console import Console
from furrowmap.cli.kernels import keep_kernels

FILE = click.Path(path_type=Path)
"""A path as it is typed: whether it is there and what it holds is told by who reads it, in three lines."""


def common_options(verb: Callable[..., None]) -> Callable[..., None]:
    """Give a verb these options, and as its first argument the console that they describe."""

    @click.option("--json", "as_json", is_flag=True, help="Answer as JSON on standard output.")
    @click.option("-q", "--quiet", is_flag=True, help="No bar and no words but warnings and errors.")
    @click.option("-v", "--verbose", count=True, help="Tell every step; -vv also what libraries tell.")
    @click.option("--log-file", type=FILE, metavar="FILE", help="Add every step, with its time, to this file.")
    @click.option("--debug", is_flag=True, help="Show the traceback of an error.")
    @wraps(verb)
    def called(
        *, as_json: bool, quiet: bool, verbose: int, log_file: Path | None, debug: bool, **arguments: Any
    ) -> None:
        _start_log(verbose, log_file, debug=debug)
        keep_kernels()
        verb(Console(as_json, quiet, verbose > 0), **arguments)

    return called


def _start_log(verbose: int, log_file: Path | None, *, debug: bool) -> None:
    """Send furrowmap's steps, and warnings of libraries, where the user asked for them; by default nowhere.

    Raises:
        OSError: if the file cannot be opened.
    """
    handlers: list[logging.Handler] = []
    if verbose or debug:
        screen = logging.StreamHandler()
        screen.setFormatter(logging.Formatter("%(levelname)s %(name)s: %(message)s"))
        screen.setLevel(logging.DEBUG if verbose > 1 else logging.INFO)
        handlers.append(screen)
    if log_file is not None:
        file = logging.FileHandler(log_file, encoding="utf-8", errors="backslashreplace")
        file.setFormatter(logging.Formatter("%(asctime)s %(levelname)s %(name)s: %(message)s"))
        handlers.append(file)
    logging.basicConfig(force=True, handlers=handlers or [logging.NullHandler()], level=logging.WARNING)
    logging.getLogger("furrowmap").setLevel(logging.DEBUG if verbose > 1 else logging.INFO)
    if verbose > 1:
        logging.getLogger().setLevel(logging.INFO)
    logging.captureWarnings(capture=True)
