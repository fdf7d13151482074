"""Machines of this user: profiles in a folder, by their names."""

import os
import re
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import msgspec

from furrowmap.core.runtime.errors import InputError, Notice, UsageError
from furrowmap.core.runtime.file_names import is_file_name, is_portable_name
from furrowmap.core.runtime.plain_reads import read_plain_bytes
from furrowmap.core.session.machine_file import load_machine, machine_of, machine_text
from furrowmap.core.session.opened import resolve, with_phase_centre
from furrowmap.core.session.session_file import load_session
from furrowmap.core.values.machine import Machine, MachineImplement
from furrowmap.exporters.files.atomic import atomic_output, make_folder, refuse_existing
from furrowmap.workflows.share.qgis_plugin import user_data

MACHINES_VARIABLE: Final = "FURROWMAP_MACHINES"
"""Environment variable: another folder, such as one that several people share."""
SUFFIX: Final = ".toml"


@dataclass(frozen=True)
class KnownMachine:
    """A saved machine: the path of its profile, and the profile; None where the file is none."""

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


def machine_for(machine: str | Path, folder: Path | None) -> tuple[Machine, list[Notice]]:
    """The machine for a session in a folder, into which files of `[implement] learned` are copied, and what is missing.

    Without a folder, or if a file is missing, it names none. Raises InputError if there is no such machine.
    """
    path = machine_file(machine)
    profile = load_machine(path)
    try:
        return _with_copies(profile, path, folder / path.name if folder is not None else None, Machine()), []
    except InputError as error:
        return _with_copies(profile, path, None, Machine()), [Notice("machine-no-learned", what=error.words("what"))]


def _with_copies(machine: Machine, source: Path, target: Path | None, before: Machine) -> Machine:
    """The machine with copies beside `target`, and named after it, of the files that `source` names as learned.

    Implements without one have that of `before`. Raises InputError if a file is missing, cannot be
    read, or is not in the source's folder.
    """
    kept = {(tool.name, tool.kind): tool.learned for tool in before.implements}
    tools = list[MachineImplement]()
    for tool in machine.implements:
        learned = kept.get((tool.name, tool.kind))
        if tool.learned is not None and target is not None:
            file = resolve(source, tool.learned)
            try:
                content = read_plain_bytes(file)
            except OSError as error:
                raise InputError("implement-unreadable", path=file, error=error) from error
            learned = re.sub(r'[<>:"/\\|?*]', "_", f"{target.stem}{tool.name and ', '}{tool.name}.npz")
            make_folder(target.parent)
            with atomic_output(target.with_name(learned)) as unfinished:
                unfinished.write_bytes(content)
        tools.append(msgspec.structs.replace(tool, learned=learned))
    return msgspec.structs.replace(machine, implement=next(iter(tools), None), further_implements=tuple(tools[1:]))


def save_machine(session: str | Path, machine: str | Path, *, overwrite: bool = False) -> KnownMachine:
    """Save what a session states of its machine as a profile, with the file of `[implement] learned` beside it.

    A profile that is replaced keeps its `[record]`, and what was learned of implements that the session has as well.

    Args:
        machine: a name, or a file that ends with .toml.

    Raises:
        InputError: if the session cannot be read, names a file that is missing, or states nothing of the machine.
        RefusedError: if the profile exists.
        UsageError: if the name cannot be that of a file.
    """
    target = Path(machine)
    if not str(machine).endswith(SUFFIX):
        if not is_portable_name(f"{machine}{SUFFIX}"):
            raise UsageError("usage.target", machine=str(machine))
        target = machines_folder() / f"{machine}{SUFFIX}"
    stated = load_session(Path(session))
    # A profile lies elsewhere than the file of the antenna's model: it keeps the place of the phase centre.
    antex = stated.antenna.antex if stated.antenna is not None else None
    stated = with_phase_centre(stated, resolve(Path(session), antex) if antex is not None else None)
    found = machine_of(stated, target.stem)
    if found == Machine(name=target.stem):
        raise InputError("machine-empty", session=session)
    refuse_existing(target, overwrite=overwrite)
    before = Machine()
    with suppress(InputError):  # there is none, or it is damaged
        before = load_machine(target)
    found = msgspec.structs.replace(_with_copies(found, Path(session), target, before), record=before.record)
    make_folder(target.parent)
    write_machine(target, found)
    return KnownMachine(target.stem, target, found)


def write_machine(path: Path, machine: Machine) -> None:
    """Write a profile."""
    with atomic_output(path) as unfinished:
        unfinished.write_text(machine_text(machine), encoding="utf-8")
