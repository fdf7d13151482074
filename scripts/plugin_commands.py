"""Writes commands.json and examples.json of plugin/processing from the commands: ``python scripts/plugin_commands.py``.

The plugin builds the parameters of its algorithms from that file, since it cannot import the package. Run the script
after a change of a command's options, and ``scripts/plugin_strings.py`` after it, for the translations.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import click

from furrowmap.cli.calibrate_commands import WithMount, mount
from furrowmap.cli.main import COMMANDS, furrowmap

FILE = Path(__file__).resolve().parents[1] / "plugin" / "processing" / "commands.json"
NOT_IN_QGIS = {
    "explain": "the report and the log name the remedy beside each message",
    "batch": "it works for hours on many sessions, with processes of its own or on a cluster",
    "qgis install": "it installs the plugin that would run it",
    "qgis zip": "it writes the plugin that would run it",
    "record": "it works in the cab, on a machine without a screen",
    "live": "its page is for the phone or tablet in the cab",
    "notebooks": "QGIS opens none",
    "warm-up": "the plugin starts it when it has made its environment",
    "worker": "the plugin starts it and speaks its protocol",
    "report": "the dock opens the report, which a run writes in the language of QGIS",
}
"""Commands that are no algorithms, and why."""
OF_THE_CONSOLE = {"--json", "--quiet", "--verbose", "--log-file", "--lang", "--debug"}
WRITTEN = {"--output", "--table", "--svg"}
"""Options with files that the command writes; it reads those of all others."""
UNITS = {"METRES": "m", "M": "m", "SECONDS": "s", "DEGREES": "°"}
LEAST = 0.0001
"""The minimum in QGIS of a number that has to be positive: a QGIS parameter always allows its minimum."""


def commands() -> Iterator[tuple[str, click.Command]]:
    """Every command that is an algorithm, with its name such as ``base add``."""
    for name in COMMANDS:
        command = furrowmap.get_command(click.Context(furrowmap), name)
        assert command is not None
        below = command.commands if isinstance(command, click.Group) else {}
        named = {f"{name} {word}": each for word, each in below.items()} or {name: command}
        if isinstance(command, WithMount):
            named[f"{name} {mount.name}"] = mount
        yield from ((words, each) for words, each in named.items() if words not in NOT_IN_QGIS)


def options_of(command: click.Command) -> dict[str, dict[str, Any]]:
    """Argument's name or option → its kind, default, limits, unit and help, in the command's order."""
    found = {_name(p): _described(p) for p in command.params if _name(p) not in OF_THE_CONSOLE}
    for name in [name for name in found if f"{name}-crs" in found]:
        found[name]["crs"] = f"{name}-crs"  # an extent or a point in QGIS has a CRS
        del found[f"{name}-crs"]
    return found


def _name(parameter: click.Parameter) -> str:
    return max(parameter.opts, key=len)


def _described(parameter: click.Parameter) -> dict[str, Any]:
    kind = parameter.type
    flag = isinstance(parameter, click.Option) and parameter.is_flag
    default = parameter.to_info_dict()["default"]
    described = {
        "kind": "flag" if flag else _kind(parameter),
        "required": parameter.required or None,
        "default": None if flag else default,
        "unit": UNITS.get(parameter.metavar or ""),
        "label": getattr(parameter, "label", None) or None,
        "help": getattr(parameter, "help", None),
    }
    if isinstance(kind, click.Choice):
        described["choices"] = list(kind.choices)
    if isinstance(kind, click.IntRange | click.FloatRange):
        described |= {"minimum": LEAST if kind.min_open else kind.min, "maximum": kind.max}
    return {key: value for key, value in described.items() if value is not None}


def _kind(parameter: click.Parameter) -> str:
    """How the value is given."""
    metavar = parameter.metavar or ""
    several = parameter.nargs == -1 or parameter.multiple
    if isinstance(parameter.type, click.Path):
        if _name(parameter) not in WRITTEN:
            return "files" if several else "file"
        return "new folder" if metavar == "DIR" else "new file"
    if isinstance(parameter.type, click.Choice):
        return "choice"
    if isinstance(parameter.type, click.types.IntParamType):
        return "integer"
    if isinstance(parameter.type, click.types.FloatParamType):
        return "number"
    if metavar == "W,S,E,N":
        return "extent"
    if metavar == "X,Y":
        return "point"
    if metavar == "CRS":
        return "crs"
    return "texts" if several else "numbers" if "," in metavar else "text"


def content() -> str:
    """The file as it should be: a line for each argument and option."""
    blocks = []
    for name, command in commands():
        lines = [
            f"  {json.dumps(option)}: {json.dumps(facts, ensure_ascii=False)}"
            for option, facts in options_of(command).items()
        ]
        blocks.append(f"{json.dumps(name)}: {{\n" + ",\n".join(lines) + "\n}")
    return "{\n" + ",\n".join(blocks) + "\n}\n"


def examples() -> str:
    """The file of examples as it should be: the first of each command's help."""
    found = {name: (command.epilog or "").splitlines()[2].strip() for name, command in commands()}
    return json.dumps(found, indent=1, ensure_ascii=False) + "\n"


if __name__ == "__main__":
    FILE.with_name("examples.json").write_text(examples(), encoding="utf-8")
    FILE.write_text(content(), encoding="utf-8")
