"""A first session file from recordings."""

from collections.abc import Sequence, Set
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from furrowmap.core.runtime.errors import InputError, Notice, RefusedError, printable
from furrowmap.core.runtime.file_names import resolved
from furrowmap.core.runtime.progress import Progress, silent
from furrowmap.core.session.examination import Examined
from furrowmap.core.session.proposal import Proposal, common_folder
from furrowmap.core.session.proposal import propose_session as proposal_of
from furrowmap.core.session.trial_files import TrialFiles
from furrowmap.core.values.machine import Machine
from furrowmap.exporters.files.atomic import atomic_output
from furrowmap.workflows.session.known_machines import machine_for

NOT_RECORDED: Final = frozenset(
    {".toml", ".geojson", ".gpkg", ".kml", ".shp", ".shx", ".dbf", ".prj", ".cpg", ".jpg", ".jpeg", ".png", ".tif"}
    | {".html", ".md", ".npz", ".pdf", ".qgz", ".qml"}
)
"""Suffixes of what else is in a folder of recordings."""
NAMED_FILES: Final = 5
"""Files of a folder without recordings that an error names."""


@dataclass(frozen=True)
class ProposedSession:
    """A session file that was written; what recordings show, with what is unusual about them, and what a run lacks."""

    path: Path
    found: tuple[Notice, ...]
    missing: tuple[Notice, ...]


def propose_session(
    recordings: Sequence[str | Path],
    session_file: str | Path | None = None,
    *,
    machine: str | Path | None = None,
    overwrite: bool = False,
    progress: Progress = silent,
) -> ProposedSession:
    """Write a commented session file with what recordings show; what they do not show is left as a comment.

    Args:
        recordings: LiDAR captures, GNSS logs, IMU logs, trajectories, task data; or a folder of these. They
            may include a table of images, parcels of a trial and their treatments, also sought in their folder.
        session_file: the file to write; `session.toml` in their common folder by default.
        machine: name or file of the profile of the machine that made the recordings; its places are copied, and
            the files of `[implement] learned`.

    Raises:
        InputError: if a recording cannot be read, a folder has none, or no folder holds them all.
        RefusedError: if the file exists.
    """
    paths = [Path(path) for path in recordings]
    inside = [path / "session.toml" if path.is_dir() and not is_recording(path) else path for path in paths]
    target = Path(session_file) if session_file is not None else common_folder(inside) / "session.toml"
    if target.exists() and not overwrite:
        raise RefusedError("exists", target=target)
    folder = target.parent if target.parent.is_dir() else None
    profile, lacking = machine_for(machine, folder) if machine is not None else (None, [])
    proposal, skipped = proposed(paths, target.parent, profile, progress)
    with atomic_output(target) as unfinished:
        unfinished.write_text(proposal.text, encoding="utf-8")
    return ProposedSession(target, proposal.found, (*proposal.missing, *lacking, *skipped))


def proposed(
    paths: Sequence[Path], folder: Path, machine: Machine | None, progress: Progress = silent
) -> tuple[Proposal, list[Notice]]:
    """The proposal of a session file in `folder`, which is not written, and what is not used in it."""
    beside = TrialFiles.among([*paths, *sorted(folder.iterdir() if folder.is_dir() else [])])
    others = {resolved(file) for _, file in beside.titled}
    examined = []
    skipped: list[Notice] = []
    for path in paths:
        progress(f"Reading {printable(path.name)}", 0.0)
        if resolved(path) not in others:
            found, unused = _examined(path, others)
            examined += found
            skipped += unused
    if not examined:
        raise InputError("no-recording", path=paths[0], names=", ".join(printable(path.name) for path in paths))
    return proposal_of(examined, folder, machine, beside), skipped


def _examined(path: Path, others: Set[Path]) -> tuple[list[Examined], list[Notice]]:
    """A recording, or those in a folder without `others`, and what is not used there."""
    if not path.is_dir() or is_recording(path):
        return Examined.each(path), []
    found: list[Examined] = []
    skipped = []
    names = []
    for file in sorted(path.iterdir()):
        if file.name.startswith(".") or file.suffix.lower() in NOT_RECORDED or resolved(file) in others:
            continue
        if file.is_dir() and not is_recording(file):
            continue
        try:
            found += Examined.each(file)
        except InputError as error:
            names.append(printable(file.name))
            skipped.append(Notice("recording-unused", file=printable(file.name), what=error.words("what")))
    if not found:
        there = names or [printable(file.name) for file in sorted(path.iterdir())]
        more = ", …" if len(there) > NAMED_FILES else ""
        raise InputError("no-recording", path=path, names=", ".join(there[:NAMED_FILES]) + more)
    return found, skipped


def is_recording(folder: Path) -> bool:
    """Whether a folder is one recording: a ROS 2 bag or task data."""
    names = [path.name.lower() for path in folder.iterdir()]
    return any(name in ("metadata.yaml", "taskdata.xml") or name.endswith((".db3", ".mcap")) for name in names)
