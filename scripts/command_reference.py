"""Writes docs/reference/commands.md from the commands' own help: ``python scripts/command_reference.py``."""

from __future__ import annotations

from pathlib import Path

import click

from furrowmap.cli.main import VERBS, furrowmap

PAGE = Path(__file__).resolve().parents[1] / "docs" / "reference" / "commands.md"
HEAD = """\
# Commands

<!-- Written by scripts/command_reference.py from the commands' own help. -->

Answers go to standard output, words to standard error. Every command answers as JSON with `--json`.

| exit status | meaning |
| --- | --- |
| 0 | done |
| 1 | failed |
| 2 | called wrongly |
| 3 | the input is at fault |
| 4 | refused: the result would not be what it claims to be |
| 130 | interrupted; nothing half-written is left |

An error is three lines: what is wrong and where, what that means, what to do about it.
"""


def page() -> str:
    """The page as it should be."""
    sections = [HEAD, section("furrowmap", furrowmap)]
    for verb in VERBS:
        command = furrowmap.get_command(click.Context(furrowmap), verb)
        assert command is not None
        sections.append(section(f"furrowmap {verb}", command))
        if isinstance(command, click.Group):
            sections += [section(f"furrowmap {verb} {name}", below) for name, below in command.commands.items()]
    return "\n".join(sections)


def section(name: str, command: click.Command) -> str:
    """One command's help under its name."""
    width = {"terminal_width": 100, "max_content_width": 100}
    context = click.Context(command, info_name=name, help_option_names=["-h", "--help"], **width)
    return f"## {name}\n\n```text\n{command.get_help(context)}\n```\n"


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
