"""The entry point `furrowmap`: dispatches to the commands and turns errors into messages and exit statuses."""

import logging
import os
import platform
import signal
import sys
import traceback
from collections.abc import Sequence
from importlib import import_module
from itertools import pairwise
from typing import Any, Final, NoReturn

import click

from furrowmap.cli.command_options import CommandGroup, describe_common_options
from furrowmap.cli.console import Console, error_value, put_error, put_json
from furrowmap.cli.interruption import INTERRUPTION, drop_interrupt
from furrowmap.core.runtime.errors import Cancelled, FurrowmapError, UsageError
from furrowmap.core.runtime.languages.texts import LANGUAGES, Text, Words
from furrowmap.core.runtime.settings import using
from furrowmap.core.runtime.write_errors import as_furrowmap_error
from furrowmap.process import keep_out_current_folder, leave_out_unused

COMMANDS: Final = {
    "init": "session_commands", "inspect": "session_commands", "record": "record_commands", "run": "run_commands",
    "live": "live_commands", "batch": "batch_commands", "season": "batch_commands", "surface": "clouds_commands",
    "cloud": "clouds_commands", "colour": "clouds_commands", "features": "clouds_commands",
    "parcels": "crops_commands", "growth": "crops_commands", "canopy": "crops_commands", "tie": "batch_commands",
    "fields": "fields_commands", "plots": "crops_commands", "response": "crops_commands", "export": "share_commands",
    "report": "share_commands", "share": "share_commands", "farm": "farm_commands", "calibrate": "calibrate_commands",
    "machine": "session_commands", "crs": "session_commands", "frames": "session_commands", "gnss": "gnss_commands",
    "check": "clouds_commands", "explain": "installation", "simulate": "session_commands", "warm-up": "installation",
    "notebooks": "installation", "qgis": "installation", "worker": "worker_process",
}  # fmt: skip
"""The module of this package that has each command, as the function of that name, with _ for -."""

log = logging.getLogger("furrowmap.cli")


class Commands(CommandGroup):
    """The commands, each imported on first use."""

    def list_commands(self, ctx: click.Context) -> list[str]:  # noqa: ARG002 (click's signature)
        """Their names."""
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """The command of that name."""
        if cmd_name not in COMMANDS:
            return super().get_command(ctx, cmd_name)
        module = import_module(f"furrowmap.cli.{COMMANDS[cmd_name]}")
        command: click.Command = getattr(module, cmd_name.replace("-", "_"))
        return command

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the options, the commands, and the options of every command."""
        super().format_options(ctx, formatter)
        describe_common_options(ctx, formatter)

    def invoke(self, ctx: click.Context) -> Any:
        """Run the command; on an interruption, click itself would print an empty line first."""
        try:
            return super().invoke(ctx)
        except KeyboardInterrupt:
            raise Cancelled from None


@click.group(
    cls=Commands,
    invoke_without_command=True,
    subcommand_metavar="COMMAND ...",
    context_settings={"help_option_names": ["-h", "--help"]},
    epilog="\b\nExample:\n  furrowmap init recording.pcap gnss.nmea\n  furrowmap run session.toml",
)
@click.option("--version", "versions", is_flag=True, help="Show the versions of furrowmap, Python, PROJ and GDAL.")
@click.option("--json", "as_json", is_flag=True, help="Print the versions as JSON (with --version).")
@click.pass_context
def furrowmap(ctx: click.Context, *, versions: bool, as_json: bool) -> None:
    """Georeferenced point clouds, surfaces and field maps from LiDAR and GNSS on tractors, drones and vehicles."""
    if versions:
        _put_versions(as_json=as_json)
        ctx.exit()
    if ctx.invoked_subcommand is None:
        raise UsageError("usage.no-command", commands=", ".join(COMMANDS))


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
    keep_out_current_folder()
    leave_out_unused()
    sys.unraisablehook = drop_interrupt
    signal.signal(signal.SIGINT, INTERRUPTION)
    signal.signal(signal.SIGTERM, INTERRUPTION)
    if sys.platform == "win32":
        signal.signal(signal.SIGBREAK, INTERRUPTION)  # Ctrl-Break, or the window is closed
    sys.exit(command_line(sys.argv[1:]))


def command_line(arguments: Sequence[str]) -> int:
    """Run the command line, which is without the program's name, and print its errors.

    Returns:
        The exit status: 0 success, 1 failure, 2 usage error, 3 invalid input, 4 refused, 130 interrupted.
    """
    for stream in (sys.stdout, sys.stderr):
        getattr(stream, "reconfigure", lambda **_: None)(errors="backslashreplace")
    try:
        with using(language=asked_language(arguments)):
            status, error = attempt(arguments)
            if error is not None:
                put_error(error)
                if "--json" in arguments:
                    put_json({"error": error_value(error)})
        sys.stdout.flush()
    except BrokenPipeError:
        # The reader closed the pipe. Python flushes again at exit, which must not fail a second time.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    return status


def asked_language(arguments: Sequence[str]) -> str | None:
    """The language that the arguments ask for; None without one, and for one that the command will refuse."""
    joined = [argument.removeprefix("--lang=") for argument in arguments if argument.startswith("--lang=")]
    apart = [after for option, after in pairwise(arguments) if option == "--lang"]
    return next((language for language in (*apart, *joined) if language in LANGUAGES), None)


def attempt(arguments: Sequence[str], console: Console | None = None) -> tuple[int, FurrowmapError | None]:
    """Run the command line; its exit status, and the error that ended it, if any.

    Raises BrokenPipeError if the reader of standard output has closed it.
    """
    try:
        status = furrowmap.main(list(arguments), prog_name="furrowmap", standalone_mode=False, obj=console)
    except (SystemExit, GeneratorExit, BrokenPipeError):
        raise
    except BaseException as raised:  # every error ends here, including panics of native libraries
        error = Cancelled() if INTERRUPTION.asked else _in_three_lines(raised, arguments)
        if "--debug" in arguments:
            traceback.print_exception(raised)
        log.debug("ended by %s", error.code, exc_info=raised)
        return error.exit_status, error
    return int(status or 0), None


def _in_three_lines(raised: BaseException, arguments: Sequence[str]) -> FurrowmapError:
    """Any exception as an error with a remedy."""
    if isinstance(raised, click.Abort):
        return Cancelled()
    if isinstance(raised, click.UsageError):
        return _usage(raised, arguments)
    return as_furrowmap_error(raised)


def _usage(raised: click.UsageError, arguments: Sequence[str]) -> UsageError:
    command = [word for word in arguments[:1] if word in COMMANDS]  # click does not always set the context
    path = raised.ctx.command_path if raised.ctx else " ".join(["furrowmap", *command])
    near = getattr(raised, "possibilities", None)
    return UsageError(
        "usage.parser-message", path=path, message=_in_words(raised), near_list=" or ".join(near) if near else None
    )


def _in_words(raised: click.UsageError) -> Words:
    """What the parser refuses; what it says of values stays in its own words."""
    if isinstance(raised, click.NoSuchOption):
        return Text("No such option {name!r}", name=raised.option_name)
    if isinstance(raised, click.MissingParameter) and raised.param is not None:
        return Text("Missing {name}", name=raised.param.get_error_hint(raised.ctx))
    if isinstance(raised, click.BadParameter) and raised.param is not None:
        hint = raised.param.get_error_hint(raised.ctx)
        return Text("Invalid value for {name}: {why}", name=hint, why=raised.message.rstrip("."))
    return raised.format_message().rstrip(".")
