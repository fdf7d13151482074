"""The folders of results that a farm map names: somebody else's map may name any folder of this computer."""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from furrowmap.core.runtime.errors import Notice
from furrowmap.core.runtime.file_names import is_network_path, resolved
from furrowmap.exporters.farm.edit import KnownSession
from furrowmap.exporters.farm.farm_results import products_digest


@dataclass(frozen=True)
class NamedFolders:
    """What a farm map names.

    Attributes:
        results: sessions and their folders: below that of the map, or with the very products that the map was made
            from. They need not be there.
        foreign: sessions whose folders are not read, because they are neither.
    """

    results: tuple[tuple[KnownSession, Path], ...]
    foreign: tuple[KnownSession, ...]


def named_folders(farm_map: Path | None, sessions: Sequence[KnownSession]) -> NamedFolders:
    """The folders of a map's sessions; `farm_map` None for a database, which has none of its own."""
    own = farm_map.absolute().parent if farm_map is not None else None
    results = [(session, Path(session.folder)) for session in sessions if _may_be_read(session, own)]
    kept = {session.session for session, _ in results}
    return NamedFolders(tuple(results), tuple(session for session in sessions if session.session not in kept))


def _may_be_read(session: KnownSession, own: Path | None) -> bool:
    folder = Path(session.folder)
    if is_network_path(session.folder) and (own is None or not folder.is_relative_to(own)):
        return False  # asking for it would send the user's name and a hash of the password there
    with suppress(OSError, ValueError):
        if own is not None and resolved(folder).is_relative_to(resolved(own)):
            return True
        return not folder.exists() or products_digest(folder) == session.digest
    return False


def foreign_notices(foreign: Sequence[KnownSession]) -> tuple[Notice, ...]:
    """That the folders of these sessions are not read; nothing for none."""
    return (Notice("folders-foreign", count=len(foreign), folder=foreign[0].folder),) if foreign else ()
