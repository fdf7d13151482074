"""Options of commands: those that every command has, and those that describe settings."""

import logging
import math
import textwrap
from collections.abc import Callable, Mapping, Sequence
from dataclasses import MISSING, dataclass, fields
from difflib import get_close_matches
from functools import wraps
from pathlib import Path
from typing import Any, Final

import click

from furrowmap.cli.console import Console
from furrowmap.core.runtime.errors import OptionError, UsageError, printable
from furrowmap.core.runtime.languages.texts import LANGUAGES, Text
from furrowmap.core.runtime.options import Option, options_of
from furrowmap.core.runtime.settings import ALLOWANCES, allowing, using_threads
from furrowmap.core.runtime.write_errors import temporary_elsewhere
from furrowmap.process import prepare_process

Command = Callable[..., None]
Paths = tuple[Path, ...]
Decorator = Callable[[Command], Command]
FILE: Final = click.Path(path_type=Path)
"""A path as typed. Readers and writers check it, so that their errors have three parts."""
VALUE_TYPES: Final[Mapping[str, click.ParamType[Any] | type]] = {
    **dict.fromkeys(("METRES", "M", "SECONDS", "DEGREES", "PRICE", "RATIO"), float),
    **dict.fromkeys(("N", "YEAR"), int),
    **dict.fromkeys(("FILE", "DIR", "FOLDER", "POLYGONS", "SESSION", "TARGET", "OUT.copc.laz"), FILE),
    "DAY": click.DateTime(["%Y-%m-%d"]),
}
"""Type of the value by the metavar of an option; text for others."""
JSON_HELP: Final = "Print the result as JSON to standard output."
POSITION_METAVAR: Final = "LAT,LON,HEIGHT"


class FiniteRange(click.FloatRange):
    """A finite number within limits, if there are any: nan compares as within all of them."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        """The number that a text is."""
        number = float(super().convert(value, param, ctx))
        if not math.isfinite(number):
            self.fail(f"{value} is not a finite number.", param, ctx)
        return number


@dataclass(frozen=True)
class NumberList:
    """What a list of numbers separated by commas may be; `count` is None for any number of them."""

    count: int | None
    is_valid: Callable[[list[float]], bool]
    wanted: Text
    example: str
    value: Callable[[list[float]], object]


NUMBER_LISTS: Final[Mapping[str, NumberList]] = {
    "W,S,E,N": NumberList(
        4,
        lambda box: box[0] < box[2] and box[1] < box[3],
        Text("W,S,E,N with W < E and S < N"),
        "500000,5000000,500100,5000100",
        tuple,
    ),
    "N,N": NumberList(
        None,
        set(range(256)).issuperset,
        Text("a list of classes from 0 to 255 separated by commas"),
        "2,9",
        lambda classes: frozenset(map(int, classes)),
    ),
    "ENDS,SIDES": NumberList(2, lambda widths: min(widths) >= 0.0, Text("two widths in metres"), "1.0,0.11", tuple),
}
"""By the metavar."""


class LabelledOption(click.Option):
    """An option with its label in QGIS."""

    def __init__(self, *names: Any, label: str = "", **facts: Any) -> None:
        super().__init__(*names, **facts)
        self.label = label


class CommonOption(LabelledOption):
    """An option that every command has: the help of a command only names these."""


class DescribedCommand(click.Command):
    """A command whose help describes its own options, and names those that every command has."""

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write both."""
        help_option = self.get_help_option(ctx)
        options = [each for each in self.get_params(ctx) if isinstance(each, click.Option)]
        common = [each for each in options if isinstance(each, CommonOption) or each is help_option]
        describe_options("Options", [each for each in options if each not in common], ctx, formatter)
        with formatter.section("Options of every command, which `furrowmap --help` describes"):
            indent = " " * formatter.current_indent
            names = ", ".join(each.opts[-1] for each in common)
            wrapped = textwrap.fill(
                names, formatter.width, initial_indent=indent, subsequent_indent=indent, break_on_hyphens=False
            )
            formatter.write(f"{wrapped}\n")


def describe_options(
    title: str, options: Sequence[click.Option], ctx: click.Context, formatter: click.HelpFormatter
) -> None:
    """Write a section of a help text, if there is any option."""
    records = [record for option in options if (record := option.get_help_record(ctx)) is not None]
    if records:
        with formatter.section(title):
            formatter.write_dl(records)


def describe_common_options(ctx: click.Context, formatter: click.HelpFormatter) -> None:
    """Write the section of a help text with the options of every command."""
    described = command("")(_nothing)
    described_ctx = click.Context(described, parent=ctx)
    options = [each for each in described.get_params(described_ctx) if isinstance(each, click.Option)]
    describe_options("Options of every command", options, described_ctx, formatter)


def _nothing() -> None:
    """A command without options of its own."""


def behind_the_command(arguments: Sequence[str], own: set[str]) -> list[str]:
    """Arguments of a group with the options of every command that stand before a command behind it.

    Where no command follows them they are left out, unless they are the group's `own`.
    """
    options = [each for each in command("")(_nothing).params if isinstance(each, CommonOption)]
    flags = {name for each in options if each.is_flag or each.count for name in each.opts}
    with_value = {name for each in options for name in each.opts} - flags
    letters = {name[1] for name in flags if not name.startswith("--")}
    at = 0
    while at < len(arguments):
        name, equals, _ = arguments[at].partition("=")
        if name in with_value:
            at += 1 if equals else 2
        elif name in flags or (name[:1] == "-" and name[1:] and letters.issuperset(name[1:])):
            at += 1
        else:
            break
    if at >= len(arguments) or arguments[at].startswith("-"):
        return [*own.intersection(arguments[:at]), *arguments[at:]]
    return [arguments[at], *arguments[:at], *arguments[at + 1 :]]


class CommandGroup(click.Group):
    """A command group.

    Its error for an unknown command suggests the nearest one. Options of every command may stand before the command.
    """

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Parse the group's own arguments."""
        own = {name for each in self.params for name in each.opts}
        return super().parse_args(ctx, args if ctx.resilient_parsing else behind_the_command(args, own))

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """The command of that name; None for an unknown one during shell completion."""
        found = self.commands.get(cmd_name)
        if found is not None or ctx.resilient_parsing:
            return found
        names = self.list_commands(ctx)
        near = next(iter(get_close_matches(cmd_name, names, 1, 0.5)), None)
        path = "furrowmap" if ctx.parent is None else f"furrowmap {self.name}"
        raise UsageError(
            "no-such-verb", path=path, cmd_name=cmd_name, near=near, commands=None if near else ", ".join(names)
        )


def command(
    summary: str,
    *examples: str,
    group: Any = click,
    json_help: str = "",
    **facts: Any,
) -> Callable[[Command], click.Command]:
    """A command, which gets a Console first, with the options that all have; the help begins with the summary.

    `json_help` is the help of --json where it prints something else than the result.
    """

    def decorate(function: Command) -> click.Command:
        @wraps(function)
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
            allowed = [what for what, given in zip(ALLOWANCES, (allow_large, allow_damaged), strict=True) if given]
            with using_threads(threads), allowing(*allowed):
                console = click.get_current_context().obj or Console(as_json, quiet, verbose > 0)
                try:
                    function(console, **arguments)
                finally:
                    elsewhere = temporary_elsewhere()
                    console.warn_all([elsewhere] if elsewhere is not None else [])

        own = called.__dict__.pop("__click_params__", [])  # in reverse
        for common in reversed(_common_options(json_help)):
            common(called)
        called.__dict__["__click_params__"] += own
        described = {"cls": DescribedCommand, "short_help": summary, "epilog": _epilog(examples)}
        made: click.Command = group.command(**described | facts)(called)
        return made

    return decorate


def group(summary: str, *examples: str) -> Callable[[Command], CommandGroup]:
    """A group of commands."""
    facts = {"short_help": summary, "epilog": _epilog(examples), "subcommand_metavar": "COMMAND ..."}
    return click.group(cls=CommandGroup, no_args_is_help=False, **facts)


def _epilog(examples: Sequence[str]) -> str:
    return "\b\nExample:\n" + "\n".join(f"  {line}" for example in examples for line in example.splitlines())


def _common_options(json_help: str) -> Sequence[Decorator]:
    threads = "Number of threads [default: FURROWMAP_THREADS, else the number of processors, at most 8]."
    language = "Language of errors, warnings and reports [default: FURROWMAP_LANG, else en]."
    quiet = {"is_flag": True, "help": "Show only warnings and errors, and no progress bar."}
    verbose = {"count": True, "help": "Log every step to standard error; -vv includes libraries."}
    return (
        flag("--json", json_help, "as_json") if json_help else _common(Option("--json", "", JSON_HELP), "as_json"),
        click.option("-q", "--quiet", cls=CommonOption, **quiet),
        click.option("-v", "--verbose", cls=CommonOption, **verbose),
        _common(Option("--log-file", "FILE", "Append a log with timestamps to this file.")),
        _common(Option("--threads", "N", threads, minimum=1)),
        _common(Option("--lang", "", language, choices=LANGUAGES), "language"),
        _common(Option("--allow-large", "", "Unpack files of any size.")),
        _common(Option("--allow-damaged", "", "Read the undamaged parts of damaged clouds.")),
        _common(Option("--debug", "", "Print a traceback on error.")),
    )


def _common(option: Option, parameter: str = "") -> Decorator:
    return _click_option(option, parameter, kind=CommonOption)


def option(name: str, metavar: str, text: str, parameter: str = "", **facts: Any) -> Decorator:
    """An option of a command; `metavar` implies the type of the value, `facts` are attributes of :class:`Option`."""
    return _click_option(Option(name, metavar, text, **facts), parameter)


def output(metavar: str, text: str, label: str = "", *, required: bool = False) -> Decorator:
    """The option -o, --output."""
    return _click_option(Option("--output", metavar, text, label, required=required), "", "-o")


def flag(name: str, text: str, parameter: str = "", label: str = "") -> Decorator:
    """An option without a value."""
    return option(name, "", text, parameter, label=label)


def overwrite(text: str) -> Decorator:
    """The flag --overwrite."""
    return flag("--overwrite", text)


def files(name: str, metavar: str) -> Decorator:
    """An argument that is one file or more."""
    return click.argument(name, metavar=metavar, nargs=-1, required=True, type=FILE)


def results_among(console: Console, paths: Paths) -> Paths:
    """The results among arguments such as `results/*`, which also names the tables that a batch writes beside them.

    Files are left out, and named, where at least one argument is a folder; GeoPackages of tasks stay.
    """
    stray = [path for path in paths if path.is_file() and (path.suffix != ".gpkg" or path.name == "batch.gpkg")]
    if not stray or not any(path.is_dir() for path in paths):
        return paths
    console.say(f"left out, no results: {printable(', '.join(map(str, stray)))}")
    return tuple(path for path in paths if path not in stray)


def settings_options(settings: type, parameter: str = "settings") -> Decorator:
    """Add the options of a class of settings to a command, which gets an object of the class as `parameter`."""
    described = options_of(settings)
    unset = {each.name for each in fields(settings) if each.default is MISSING}

    def decorate(command: Command) -> Command:
        @wraps(command)
        def called(*args: Any, **values: Any) -> None:
            given = {name: value_of(each, values.pop(f"{parameter}_{name}")) for name, each in described.items()}
            stated = {name: value for name, value in given.items() if value is not None or name in unset}
            command(*args, **{parameter: settings(**stated)}, **values)

        for name, each in reversed(described.items()):
            _click_option(each, f"{parameter}_{name}")(called)
        return called

    return decorate


def _click_option(
    option: Option, parameter: str, *short: str, kind: type[LabelledOption] = LabelledOption
) -> Decorator:
    if not (option.metavar or option.choices):
        facts: dict[str, Any] = {"is_flag": True}
    else:
        facts = {"type": _type(option), "metavar": option.metavar or None}
        facts |= {"required": option.required, "multiple": option.multiple}
        if option.metavar not in NUMBER_LISTS and option.default not in (None, ()):
            facts |= {"default": option.default, "show_default": True}
    names = [*short, option.name, *([parameter] if parameter else [])]
    return click.option(*names, cls=kind, label=option.label, help=option.help, **facts)


def _type(option: Option) -> Any:
    kind = click.Choice(list(option.choices)) if option.choices else VALUE_TYPES.get(option.metavar, str)
    least = option.minimum if option.above is None else option.above
    if kind is float:
        return FiniteRange(least, option.maximum, min_open=option.above is not None)
    if kind is int and least is not None:
        return click.IntRange(int(least))
    return kind


def value_of(option: Option, value: Any) -> Any:
    """The value of a setting for what an option is given, or None; raises UsageError for what the metavar forbids."""
    if isinstance(option.choices, Mapping):
        return option.choices[value]
    if value is None or value == ():
        return None
    if option.metavar == "DAY":
        return value.date()
    if option.metavar == POSITION_METAVAR:
        place = numbers(value)
        if len(place) != 3 or abs(place[0]) > 90.0 or abs(place[1]) > 360.0:
            wanted = Text("LAT,LON,HEIGHT with the latitude first, in degrees and metres")
            raise OptionError(option.name, value, wanted, "43.0645,141.3503,46.2")
        return tuple(place)
    if option.metavar not in NUMBER_LISTS:
        return value
    of_kind = NUMBER_LISTS[option.metavar]
    found = numbers(value)
    wanted = of_kind.wanted
    if not found or len(found) != (of_kind.count or len(found)):
        wanted = Text("a list of {count:{count} |}numbers separated by commas", count=of_kind.count)
    elif of_kind.is_valid(found):
        return of_kind.value(found)
    raise OptionError(option.name, value, wanted, of_kind.example)


def numbers(text: str) -> list[float]:
    """The finite numbers in a text, which commas separate; none if it is anything else."""
    try:
        found = [float(part) for part in text.split(",")]
    except ValueError:
        return []
    return found if all(map(math.isfinite, found)) else []


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
