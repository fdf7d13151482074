"""`furrowmap machine`: profiles of machines, with the places of their sensors and tools."""

from __future__ import annotations

from pathlib import Path

import click

import furrowmap
from furrowmap.cli.console import Console
from furrowmap.cli.options import FILE, command, group, overwrite
from furrowmap.cli.tables import table
from furrowmap.core.runtime.errors import printable


@group("Places of sensors and tool, saved once a machine.", "furrowmap machine save session.toml 'Tractor 1, tiller'")
def machine() -> None:
    """Profiles of machines: where antenna, scanner, IMU, camera and tool sit, for `furrowmap init --machine`."""


@command(
    "Save the machine of a session.",
    "furrowmap machine save session.toml 'Tractor 1, tiller'",
    "furrowmap machine save session.toml tractor1.toml",
    group=machine,
)
@click.argument("session", type=FILE)
@click.argument("name", metavar="NAME|FILE")
@overwrite("Replace an existing profile.")
def save(console: Console, session: Path, name: str, *, overwrite: bool) -> None:
    """Save what SESSION states of its machine under NAME, or as FILE to pass on (it ends with .toml)."""
    saved = furrowmap.save_machine(session, name, overwrite=overwrite)
    console.answer({"name": saved.name, "machine": saved.path}, f"Wrote {printable(str(saved.path))}")


@command("List the saved machines.", "furrowmap machine list", name="list", group=machine)
def list_machines(console: Console) -> None:
    """List the saved machines and their files. FURROWMAP_MACHINES names another folder, such as a shared one."""
    found = furrowmap.known_machines()
    rows = [(printable(each.name), _what(each)) for each in found]
    answer = {"machines": [{"name": each.name, "machine": each.path} for each in found]}
    console.answer(answer, table(rows) if rows else "No machines.")


def _what(known: furrowmap.KnownMachine) -> str:
    if known.machine is None:
        return f"not readable: {printable(str(known.path))}"
    parts = [name for name in ("antenna", "lidar", "imu", "camera", "implement") if getattr(known.machine, name)]
    day = f", calibrated {known.machine.calibrated.date}" if known.machine.calibrated is not None else ""
    return f"{', '.join(parts)}{day}"
