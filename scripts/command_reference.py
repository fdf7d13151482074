"""Writes docs/reference/commands.md from the help texts of the commands: ``python scripts/command_reference.py``."""

from __future__ import annotations

from pathlib import Path

import click

from furrowmap.cli.calibrate import mount
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
"""


def page() -> str:
    """The generated page."""
    sections = [HEAD, section("furrowmap", furrowmap)]
    for name in COMMANDS:
        command = furrowmap.get_command(click.Context(furrowmap), name)
        assert command is not None
        sections.append(section(f"furrowmap {name}", command))
        if name == "calibrate":
            sections.append(section(f"furrowmap {name} {mount.name}", mount))
        if isinstance(command, click.Group):
            sections += [
                section(f"furrowmap {name} {below_name}", below) for below_name, below in command.commands.items()
            ]
    return "\n".join(sections)


def section(name: str, command: click.Command) -> str:
    """The help of one command under its name."""
    width = {"terminal_width": 100, "max_content_width": 100}
    context = click.Context(command, info_name=name, help_option_names=["-h", "--help"], **width)
    return f"## {name}\n\n```text\n{command.get_help(context)}\n```\n"


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
