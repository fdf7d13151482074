"""The options that all verbs have."""

from __future__ import annotations

import logging
from collections.abc import Callable
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from furrowmap.cli.console import Console
from furrowmap.core.values.threads import using_threads
from furrowmap.process import prepare_process

if TYPE_CHECKING:
    from pyproj import CRS

FILE = click.Path(path_type=Path)
"""A path as it is typed: whether it is there and what it holds is told by who reads it, in three lines."""


def common_options(verb: Callable[..., None]) -> Callable[..., None]:
    """Give a verb these options, and as its first argument the console of the call, or that which they describe."""

    @click.option("--json", "as_json", is_flag=True, help="Answer as JSON on standard output.")
    @click.option("-q", "--quiet", is_flag=True, help="No bar, and on standard error only warnings and errors.")
    @click.option("-v", "--verbose", count=True, help="Tell every step; -vv also what libraries tell.")
    @click.option("--log-file", type=FILE, metavar="FILE", help="Add every step, with its time, to this file.")
    @click.option(
        "--threads",
        type=click.IntRange(1),
        metavar="N",
        help="Threads to use [default: FURROWMAP_THREADS, or one a processor, 8 at most].",
    )
    @click.option("--debug", is_flag=True, help="Show the traceback of an error.")
    @wraps(verb)
    def called(
        *,
        as_json: bool,
        quiet: bool,
        verbose: int,
        log_file: Path | None,
        threads: int | None,
        debug: bool,
        **arguments: Any,
    ) -> None:
        del debug  # is looked at where errors end
        _start_log(verbose, log_file)
        prepare_process()
        with using_threads(threads):
            verb(click.get_current_context().obj or Console(as_json, quiet, verbose > 0), **arguments)

    return called


def named_crs(text: str | None) -> CRS | None:
    """The CRS that an option names; None where it is not given.

    Raises:
        InputError: if it names none.
    """
    from furrowmap.core.geodesy.crs_change import crs_of  # brings pyproj, which --help does without

    return crs_of(text) if text is not None else None


def _start_log(verbose: int, log_file: Path | None) -> None:
    """Send furrowmap's steps, and with -vv those of libraries, where the user asked for them; by default nowhere.

    Raises:
        OSError: if the file cannot be opened.
    """
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
