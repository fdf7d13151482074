"""`furrowmap`: finds the verb, and turns every error into three lines and an exit status."""

from __future__ import annotations

import logging
import os
import platform
import signal
import sys
import traceback
from collections.abc import Sequence
from difflib import get_close_matches
from importlib import import_module
from typing import Any, Final, NoReturn

import click

from furrowmap.cli.console import Console, error_value, put_error, put_json
from furrowmap.cli.interruption import INTERRUPTION, Interruption
from furrowmap.core.values.errors import Cancelled, FurrowmapError, UsageError

VERBS: Final = (
    "init",
    "inspect",
    "run",
    "surface",
    "cloud",
    "fields",
    "export",
    "base",
    "calibrate",
    "crs",
    "gnss",
    "check",
    "simulate",
    "qgis",
    "worker",
)
"""Each is the function of that name in the module of that name beside this one."""

log = logging.getLogger("furrowmap.cli")


class Verbs(click.Group):
    """The verbs, each imported when it is asked for."""

    def list_commands(self, ctx: click.Context) -> list[str]:  # noqa: ARG002 (click's signature)
        """Their names."""
        return list(VERBS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """The verb of that name; None where it is asked by a shell that completes words.

        Raises:
            UsageError: if there is none.
        """
        if cmd_name in VERBS:
            verb: click.Command = getattr(import_module(f"furrowmap.cli.{cmd_name}"), cmd_name)
            return verb
        if ctx.resilient_parsing:
            return None
        near = get_close_matches(cmd_name, VERBS, 1, 0.5)
        raise UsageError(
            f"furrowmap: there is no verb {cmd_name!r}.",
            "Nothing was done.",
            f"Did you mean `furrowmap {near[0]}`?" if near else f"Verbs: {', '.join(VERBS)}.",
            code="no-such-verb",
        )

    def invoke(self, ctx: click.Context) -> Any:
        """Do what the verb does; click would put an empty line before the words on an interruption."""
        try:
            return super().invoke(ctx)
        except KeyboardInterrupt:
            raise Cancelled from None


@click.group(
    cls=Verbs,
    invoke_without_command=True,
    subcommand_metavar="VERB ...",
    context_settings={"help_option_names": ["-h", "--help"]},
    epilog="\b\nExample:\n  furrowmap init recording.pcap gnss.nmea\n  furrowmap run session.toml",
)
@click.option("--version", "versions", is_flag=True, help="Show the versions of furrowmap, PROJ and GDAL.")
@click.option("--json", "as_json", is_flag=True, help="With --version: as JSON.")
@click.pass_context
def furrowmap(ctx: click.Context, *, versions: bool, as_json: bool) -> None:
    """Georeferenced point clouds and worked ground from a tractor's LiDAR and GNSS, without an IMU."""
    if versions:
        _put_versions(as_json=as_json)
        ctx.exit()
    if ctx.invoked_subcommand is None:
        raise UsageError(
            "furrowmap: a verb is missing.",
            "Nothing was done.",
            f"Verbs: {', '.join(VERBS)}; `furrowmap --help` says what each does.",
            code="usage",
        )


def _put_versions(*, as_json: bool) -> None:
    from importlib.metadata import version

    import pyogrio
    import pyproj
    import rasterio

    versions = {
        "furrowmap": version("furrowmap"),
        "python": platform.python_version(),
        "proj": pyproj.proj_version_str,
        "gdal_vector": pyogrio.__gdal_version_string__,
        "gdal_raster": rasterio.__gdal_version__,
    }
    if as_json:
        put_json(versions)
    else:
        click.echo(
            "furrowmap {furrowmap}\nPython {python}\nPROJ {proj}\n"
            "GDAL {gdal_vector} (vector), {gdal_raster} (raster)".format(**versions)
        )


def main() -> NoReturn:
    """The console command."""
    signal.signal(signal.SIGINT, INTERRUPTION)
    signal.signal(signal.SIGTERM, INTERRUPTION)
    sys.exit(command_line(sys.argv[1:], INTERRUPTION))


def command_line(arguments: Sequence[str], interruption: Interruption | None = None) -> int:
    """Do what the arguments say.

    Args:
        arguments: without the program's name.
        interruption: what handles the signals, if anything does.

    Returns:
        The exit status: 0 done, 1 failed, 2 wrongly called, 3 the input is at fault, 4 refused, 130 interrupted.
    """
    for stream in (sys.stdout, sys.stderr):
        getattr(stream, "reconfigure", lambda **_: None)(errors="backslashreplace")
    try:
        status, error = attempt(arguments, interruption)
        if error is not None:
            put_error(error)
            if "--json" in arguments:
                put_json({"error": error_value(error)})
        sys.stdout.flush()
    except BrokenPipeError:
        # Whoever read the answer has had enough. Python flushes once more at its end, which must not fail again.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    return status


def attempt(
    arguments: Sequence[str], interruption: Interruption | None = None, console: Console | None = None
) -> tuple[int, FurrowmapError | None]:
    """Do what the arguments say.

    Args:
        arguments: without the program's name.
        interruption: what handles the signals, if anything does.
        console: to talk to, instead of the one that the arguments describe.

    Returns:
        The exit status, and what went wrong if that ended the work.

    Raises:
        BrokenPipeError: if nobody reads the answer.
    """
    try:
        status = furrowmap.main(list(arguments), prog_name="furrowmap", standalone_mode=False, obj=console)
    except (SystemExit, GeneratorExit, BrokenPipeError):
        raise
    except BaseException as raised:  # the one place where errors end, the panics of libraries included
        asked = interruption is not None and interruption.asked
        error = Cancelled() if asked else _in_three_lines(raised, arguments)
        if "--debug" in arguments:
            traceback.print_exception(raised)
        log.debug("ended by %s", error.code, exc_info=raised)
        return error.exit_status, error
    return int(status or 0), None


def _in_three_lines(raised: BaseException, arguments: Sequence[str]) -> FurrowmapError:
    """Whatever was raised as an error that a user can act on."""
    if isinstance(raised, FurrowmapError):
        return raised
    if isinstance(raised, KeyboardInterrupt | click.Abort):
        return Cancelled()
    if isinstance(raised, click.UsageError):
        return _usage(raised, arguments)
    if isinstance(raised, MemoryError):
        return FurrowmapError(
            "The computer's memory did not suffice.",
            "The work stopped; nothing half-written is left.",
            "Close other programs, or work on a part of the recording.",
            code="out-of-memory",
        )
    if isinstance(raised, OSError) and raised.strerror:
        return FurrowmapError(
            f"{raised.filename}: {raised.strerror}." if raised.filename else f"{raised.strerror}.",
            "The system refused a file, so the work stopped; nothing half-written is left.",
            "Check that the folder is there, may be written by you, and has room.",
            code="system",
        )
    return FurrowmapError(
        f"{type(raised).__name__}: {raised}.",
        "This is a fault in furrowmap, not in what you did; nothing half-written is left.",
        "Run the command again with --debug, and report what it shows together with `furrowmap --version`.",
        code="fault",
    )


def _usage(raised: click.UsageError, arguments: Sequence[str]) -> UsageError:
    verb = [word for word in arguments[:1] if word in VERBS]  # click does not always tell where it was
    path = raised.ctx.command_path if raised.ctx else " ".join(["furrowmap", *verb])
    near = getattr(raised, "possibilities", None)
    message = raised.message if near else raised.format_message()
    return UsageError(
        f"{path}: {message.rstrip('.')}.",
        "The command was not understood, so nothing was done.",
        f"Did you mean {' or '.join(near)}?" if near else f"`{path} --help` shows how it is called, with an example.",
        code="usage",
    )
