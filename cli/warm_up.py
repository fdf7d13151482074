"""`furrowmap warm-up`: compilation of kernels ahead of their first use."""

from __future__ import annotations

from time import perf_counter

import click

from furrowmap.cli.console import Console
from furrowmap.cli.options import command


@command("Compile the kernels of all commands for this machine, ahead.", "furrowmap warm-up run", name="warm-up")
@click.argument("commands", nargs=-1, metavar="[COMMAND]...")
def warm_up(console: Console, commands: tuple[str, ...]) -> None:
    """Compile kernels for this machine and keep them in the user's cache: those of COMMANDs, or of all commands.

    Each command compiles by itself what is missing, which takes up to a minute; after this it compiles nothing.
    """
    from furrowmap.warm_up import warm_up as compile_kernels

    start = perf_counter()
    with console.work() as progress:
        compiled = compile_kernels(commands, progress)
    seconds = perf_counter() - start
    words = f"Compiled {compiled} functions in {seconds:.0f} s." if compiled else "All kernels were compiled already."
    console.answer({"compiled": compiled, "seconds": round(seconds, 1)}, words)
