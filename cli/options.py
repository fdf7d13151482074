"""The options that every command has."""

from __future__ import annotations

import logging
from collections.abc import Callable
from functools import wraps
from pathlib import Path
from typing import Any

import click

from furrowmap.cli.console import Console
from furrowmap.core.runtime.allowances import ALL, allowing
from furrowmap.core.runtime.languages.catalogue import LANGUAGES
from furrowmap.core.runtime.threads import using_threads
from furrowmap.process import prepare_process

FILE = click.Path(path_type=Path)
"""A path as typed. Readers and writers check it, so that their errors have three parts."""


def common_options(command: Callable[..., None]) -> Callable[..., None]:
    """Add the common options to a command, and pass it a Console as its first argument."""

    @click.option("--json", "as_json", is_flag=True, help="Print the result as JSON to standard output.")
    @click.option("-q", "--quiet", is_flag=True, help="Show only warnings and errors, and no progress bar.")
    @click.option("-v", "--verbose", count=True, help="Log every step to standard error; -vv includes libraries.")
    @click.option("--log-file", type=FILE, metavar="FILE", help="Append a log with timestamps to this file.")
    @click.option(
        "--threads",
        type=click.IntRange(1),
        metavar="N",
        help="Number of threads [default: FURROWMAP_THREADS, else the number of processors, at most 8].",
    )
    @click.option(
        "--lang",
        "language",
        type=click.Choice(LANGUAGES),
        help="Language of errors, warnings and reports [default: FURROWMAP_LANG, else en].",
    )
    @click.option("--allow-large", is_flag=True, help="Unpack files however large their content is.")
    @click.option("--allow-damaged", is_flag=True, help="Use clouds without the parts that are damaged.")
    @click.option("--debug", is_flag=True, help="Print a traceback on error.")
    @wraps(command)
    def called(
        *,
        as_json: bool,
        quiet: bool,
        verbose: int,
        log_file: Path | None,
        threads: int | None,
        language: str | None,
        allow_large: bool,
        allow_damaged: bool,
        debug: bool,
        **arguments: Any,
    ) -> None:
        del debug, language  # read in main, where errors are handled
        _start_log(verbose, log_file)
        prepare_process()
        allowed = [what for what, given in zip(ALL, (allow_large, allow_damaged), strict=True) if given]
        with using_threads(threads), allowing(*allowed):
            command(click.get_current_context().obj or Console(as_json, quiet, verbose > 0), **arguments)

    return called


def worker_options(command: Callable[..., None]) -> Callable[..., None]:
    """Add the options that choose the processes that work for a command."""
    scheduler = click.option(
        "--scheduler", metavar="ADDRESS", help="Running Dask scheduler whose workers are used: tcp://HOST:PORT."
    )
    workers = click.option(
        "--workers",
        type=click.IntRange(1),
        metavar="N",
        help="Number of worker processes [default: by cores and memory].",
    )
    return workers(scheduler(command))


def _start_log(verbose: int, log_file: Path | None) -> None:
    """Set up logging of furrowmap, and with -vv of libraries, to standard error and the log file."""
    handlers: list[logging.Handler] = []
    if verbose:
        screen = logging.StreamHandler()
        screen.setFormatter(logging.Formatter("%(levelname)s %(name)s: %(message)s"))
        screen.setLevel(logging.INFO)
        handlers.append(screen)
    if log_file is not None:
        file = logging.FileHandler(log_file, encoding="utf-8", errors="backslashreplace")
        file.setFormatter(logging.Formatter("%(asctime)s %(levelname)s %(name)s: %(message)s"))
        handlers.append(file)
    level = logging.INFO if verbose > 1 else logging.WARNING
    logging.basicConfig(force=True, handlers=handlers or [logging.NullHandler()], level=level)
    logging.getLogger("furrowmap").setLevel(logging.DEBUG)
    logging.captureWarnings(capture=True)
