# SPDX-License-Identifier: GPL-2.0-or-later
"""What was dropped: the folder of a run or of a preview, sessions, a machine's profile, recordings, or many drives."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from qgis.gui import QgsCustomDropHandler
from qgis.PyQt.QtCore import QMimeData

from ..platforms import resolved
from ..previews import ACCOUNT
from ..products import product
from ..results import CLOUD, FIELD_FILE, REPORT
from .machines import is_machine

RESULTS = "results"
PREVIEW = "preview"
SESSION = "session"
MACHINE = "machine"
RECORDINGS = "recordings"
DRIVES = "drives"
CLOUDS = "clouds"


FINISHED_CLOUDS = (".las", ".laz")
"""Of point clouds without positions of a scanner."""


@dataclass(frozen=True)
class Dropped:
    """What was dropped.

    Attributes:
        kind: "results", "preview", "session", "machine", "recordings", "drives" or "clouds".
        paths: one folder of results or of a preview, one session file, one profile, the recordings of one drive,
            session files and folders of many drives, or finished point clouds.
        machine: profile that was dropped with recordings; None for none.
    """

    kind: str
    paths: tuple[Path, ...]
    machine: Path | None = None


def recognise(paths: Iterable[Path]) -> Dropped | None:
    """Recognise `paths`; None if there are none."""
    paths = tuple(paths)
    if not paths:
        return None
    folder = next(filter(None, map(results_folder, paths)), None)
    if folder is not None:
        return Dropped(RESULTS, (folder,))
    previews = [path.parent if path.name == ACCOUNT else path for path in paths]
    preview = next((folder for folder in previews if (folder / ACCOUNT).is_file()), None)
    if preview is not None:
        return Dropped(PREVIEW, (preview,))
    machine = next(filter(is_machine, paths), None)
    paths = tuple(path for path in paths if path != machine)
    if paths and all(path.suffix.lower() in FINISHED_CLOUDS for path in paths):
        return Dropped(CLOUDS, paths)
    if len(paths) > 1 and all(map(_is_drive, paths)):
        return Dropped(DRIVES, paths, machine)
    sessions = [path / "session.toml" if path.is_dir() else path for path in paths]
    session = next((path for path in sessions if path.suffix.lower() == ".toml" and path.is_file()), None)
    if session is not None:
        return Dropped(SESSION, (session,), machine)
    if machine is not None and not paths:
        return Dropped(MACHINE, (machine,))
    return Dropped(RECORDINGS, paths, machine)


def home_of(recording: Path) -> Path:
    """The folder for the session of a recording: a folder of recordings itself, else the one that it is in."""
    path = resolved(recording)
    return path if path.is_dir() and not _is_recording(path) else path.parent


def _is_recording(folder: Path) -> bool:
    """Whether a folder is one recording: a ROS 2 bag or task data."""
    names = [path.name.lower() for path in folder.iterdir()]
    return any(name in ("metadata.yaml", "taskdata.xml") or name.endswith((".db3", ".mcap")) for name in names)


def _is_drive(path: Path) -> bool:
    """Whether it is a session file, or a folder of recordings."""
    return path.suffix.lower() == ".toml" if path.is_file() else path.is_dir() and not _is_recording(path)


def results_folder(path: Path) -> Path | None:
    """The folder of a run, from itself or its report; None if `path` is neither."""
    folder = path.parent if path.name == REPORT else path
    return (
        folder
        if folder.is_dir() and any(product(folder, name).is_file() for name in (REPORT, FIELD_FILE, CLOUD))
        else None
    )


def local_paths(mime: QMimeData) -> list[Path]:
    """The local files and folders that are dragged."""
    return [Path(url.toLocalFile()) for url in mime.urls() if url.isLocalFile()] if mime.hasUrls() else []


class ResultsDropHandler(QgsCustomDropHandler):
    """Opens folders that a run wrote; QGIS handles everything else."""

    def __init__(self, open_paths: Callable[[Sequence[Path]], None]) -> None:
        super().__init__()
        self._open_paths = open_paths

    def customUriProviderKey(self) -> str:  # noqa: N802 - the names are QGIS's
        """QGIS asks for it; it is not used."""
        return "furrowmap"

    def handleMimeDataV2(self, data: QMimeData) -> bool:  # noqa: N802
        """Open folders of results, or say why not now; returns whether there was one."""
        found = [folder for path in local_paths(data) if path.is_dir() and (folder := results_folder(path))]
        if found:
            self._open_paths(found)
        return bool(found)
