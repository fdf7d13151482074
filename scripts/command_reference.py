"""Writes docs/reference/commands.md from the help texts of the commands: ``python scripts/command_reference.py``."""

from __future__ import annotations

import inspect
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import click

from furrowmap.cli.calibrate_commands import mount
from furrowmap.cli.command_options import CommonOption, describe_common_options
from furrowmap.cli.main import COMMANDS, furrowmap

PAGE = Path(__file__).resolve().parents[1] / "docs" / "reference" / "commands.md"
HEAD = """\
# Commands

<!-- Written by scripts/command_reference.py from the help texts of the commands. -->

Results go to standard output; progress, warnings and errors go to standard error. `--json` prints the result as JSON.

| exit status | meaning |
| --- | --- |
| 0 | success |
| 1 | failure |
| 2 | usage error |
| 3 | invalid or unreadable input |
| 4 | refused, or a required accuracy not met |
| 130 | interrupted; no partial files are left |

An error message has three lines: what is wrong and where, what that means, and what to do.

`furrowmap COMMAND --help` describes the options of a command; so do the algorithms in QGIS.
"""


WIDTH: Final = {"terminal_width": 100, "max_content_width": 100}


def page() -> str:
    """The generated page."""
    return "\n".join([HEAD, _common(), *(section(name, command) for name, command in all_commands())])


def all_commands() -> Iterator[tuple[str, click.Command]]:
    """Every command under its full name, groups before their commands."""
    yield "furrowmap", furrowmap
    for name in COMMANDS:
        command = furrowmap.get_command(click.Context(furrowmap), name)
        assert command is not None
        yield f"furrowmap {name}", command
        if name == "calibrate":
            yield f"furrowmap {name} {mount.name}", mount
        if isinstance(command, click.Group):
            yield from ((f"furrowmap {name} {below_name}", below) for below_name, below in command.commands.items())


def section(name: str, command: click.Command) -> str:
    """A command: its usage, what it does, the names of its options and its examples."""
    own = [
        option for option in command.params if isinstance(option, click.Option) and not isinstance(option, CommonOption)
    ]
    names = ", ".join(f"`{max(option.opts, key=len)}`" for option in own)
    text = [f"## {name}", f"```text\n{_usage(name, command)}\n```", _paragraphs(command)]
    if isinstance(command, click.Group):
        context = click.Context(command)
        below = [(word, command.get_command(context, word)) for word in command.list_commands(context)]
        text.append("\n".join(f"- `{word}`: {one.get_short_help_str(100)}" for word, one in below if one is not None))
    return "\n\n".join([*text, *[f"Options: {names}."] * bool(names)]) + "\n"


def full_help(name: str) -> str:
    """What `--help` prints for a command by its full name."""
    command = dict(all_commands())[name]
    return command.get_help(click.Context(command, info_name=name, help_option_names=["-h", "--help"], **WIDTH))


def _usage(name: str, command: click.Command) -> str:
    usage = command.get_usage(click.Context(command, info_name=name, **WIDTH)).removeprefix("Usage: ")
    return "\n".join([usage, *(line.strip() for line in (command.epilog or "").splitlines() if "furrowmap " in line)])


def _paragraphs(command: click.Command) -> str:
    """The description without the help's layout."""
    parts = inspect.cleandoc(command.help or "").replace("\b\n", "").split("\n\n")
    return "\n\n".join(" ".join(part.split()) for part in parts)


def _common() -> str:
    context = click.Context(furrowmap, help_option_names=["-h", "--help"], **WIDTH)
    formatter = context.make_formatter()
    describe_common_options(context, formatter)
    _, _, described = formatter.getvalue().strip().partition("\n")
    return (
        f"## Options of every command\n\nThey may stand before the command or behind it.\n\n```text\n{described}\n```\n"
    )


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
