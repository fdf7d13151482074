"""Machines of this user: profiles in a folder, by their names."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from furrowmap.core.runtime.errors import InputError, UsageError
from furrowmap.core.runtime.file_names import is_file_name, is_portable_name
from furrowmap.core.session.file import load_session
from furrowmap.core.session.machine import load_machine, machine_of, machine_text
from furrowmap.core.values.machine import Machine
from furrowmap.exporters.files.atomic import atomic_output, refuse_existing
from furrowmap.workflows.share.qgis_plugin import user_data

MACHINES_VARIABLE: Final = "FURROWMAP_MACHINES"
"""Environment variable: another folder, such as one that several people share."""
SUFFIX: Final = ".toml"


@dataclass(frozen=True)
class KnownMachine:
    """A saved machine.

    Attributes:
        path: of its profile.
        machine: the profile; None where the file is none.
    """

    name: str
    path: Path
    machine: Machine | None


def machines_folder() -> Path:
    """The folder of the saved machines, which need not exist."""
    stated = os.environ.get(MACHINES_VARIABLE)
    return Path(stated) if stated else user_data() / "furrowmap" / "machines"


def known_machines() -> list[KnownMachine]:
    """The saved machines, in the order of their names."""
    found = []
    for path in sorted(machines_folder().glob(f"*{SUFFIX}")):
        try:
            machine = load_machine(path)
        except InputError:
            machine = None
        found.append(KnownMachine(path.stem, path, machine))
    return found


def machine_file(machine: str | Path) -> Path:
    """The profile of a machine, given by its name or as a file."""
    file = Path(machine)
    if file.is_file():
        return file
    saved = machines_folder() / f"{machine}{SUFFIX}"
    if is_file_name(str(machine)) and saved.is_file():
        return saved
    names = ", ".join(each.name for each in known_machines())
    raise InputError("no-machine", machine=machine, names=names or None)


def save_machine(session: str | Path, machine: str | Path, *, overwrite: bool = False) -> KnownMachine:
    """Save what a session states of its machine as a profile.

    Args:
        machine: a name, or a file that ends with .toml.

    Raises:
        InputError: if the session cannot be read, or states nothing of the machine.
        RefusedError: if the profile exists.
        UsageError: if the name cannot be that of a file.
    """
    target = Path(machine)
    if not str(machine).endswith(SUFFIX):
        if not is_portable_name(f"{machine}{SUFFIX}"):
            raise UsageError("usage.target", machine=str(machine))
        target = machines_folder() / f"{machine}{SUFFIX}"
    found = machine_of(load_session(Path(session)), target.stem)
    if found == Machine(name=target.stem):
        raise InputError("machine-empty", session=session)
    refuse_existing(target, overwrite=overwrite)
    target.parent.mkdir(parents=True, exist_ok=True)
    write_machine(target, found)
    return KnownMachine(target.stem, target, found)


def write_machine(path: Path, machine: Machine) -> None:
    """Write a profile."""
    with atomic_output(path) as unfinished:
        unfinished.write_text(machine_text(machine), encoding="utf-8")
