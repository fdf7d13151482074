"""A first session file from recordings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from furrowmap.core.session.examination import Examined
from furrowmap.core.session.proposal import common_folder
from furrowmap.core.session.proposal import propose_session as proposal_of
from furrowmap.core.values.errors import Notice, RefusedError, printable
from furrowmap.core.values.progress import Progress, silent
from furrowmap.exporters.files.atomic import atomic_output


@dataclass(frozen=True)
class ProposedSession:
    """A session file that was written.

    Attributes:
        path: of the file.
        found: what the recordings show.
        missing: what a run needs or gains from, and the recordings do not show.
    """

    path: Path
    found: tuple[Notice, ...]
    missing: tuple[Notice, ...]


def propose_session(
    recordings: Sequence[str | Path],
    session_file: str | Path | None = None,
    *,
    overwrite: bool = False,
    progress: Progress = silent,
) -> ProposedSession:
    """Write a commented session file with what recordings show; what they do not show is left as a comment.

    Args:
        recordings: LiDAR captures, GNSS logs, trajectories, task data.
        session_file: the file to write; `session.toml` in their common folder by default.
        overwrite: replace the file.
        progress: is called with each stage.

    Raises:
        InputError: if a recording cannot be read, or no folder holds them all.
        RefusedError: if the file exists.
    """
    paths = [Path(path) for path in recordings]
    target = Path(session_file) if session_file is not None else common_folder(paths) / "session.toml"
    if target.exists() and not overwrite:
        raise RefusedError(
            f"{target} exists already.",
            "It may hold measured values, so it was left as it is.",
            "Give another name with -o, or replace it with --overwrite.",
            code="exists",
        )
    examined = []
    for path in paths:
        progress(f"Reading {printable(path.name)}", 0.0)
        examined.append(Examined.of(path))
    proposal = proposal_of(examined, target.parent)
    with atomic_output(target) as unfinished:
        unfinished.write_text(proposal.text, encoding="utf-8")
    return ProposedSession(target, proposal.found, proposal.missing)
