# SPDX-License-Identifier: GPL-2.0-or-later
"""What was dropped: the folder of a run or of a preview, a session file, or recordings."""

from dataclasses import dataclass
from pathlib import Path

from ..previews import ACCOUNT
from ..products import product
from ..results import CLOUD, FIELD_LAYERS, REPORT

RESULTS, PREVIEW, SESSION, RECORDINGS = "results", "preview", "session", "recordings"
_PRODUCTS = (REPORT, FIELD_LAYERS, CLOUD)


@dataclass(frozen=True)
class Dropped:
    """What was dropped.

    Attributes:
        kind: "results", "preview", "session" or "recordings".
        paths: one folder of results or of a preview, one session file, or the recordings.
    """

    kind: str
    paths: tuple


def recognise(paths):
    """Recognise `paths`; None if there are none."""
    paths = tuple(Path(path) for path in paths if str(path))
    if not paths:
        return None
    folder = next((folder for folder in map(results_folder, paths) if folder is not None), None)
    if folder is not None:
        return Dropped(RESULTS, (folder,))
    previews = [path.parent if path.name == ACCOUNT else path for path in paths]
    preview = next((folder for folder in previews if (folder / ACCOUNT).is_file()), None)
    if preview is not None:
        return Dropped(PREVIEW, (preview,))
    session = next((path for path in paths if path.suffix.lower() == ".toml"), None)
    return Dropped(SESSION, (session,)) if session is not None else Dropped(RECORDINGS, paths)


def results_folder(path):
    """The folder of a run, from itself or its report; None if `path` is neither."""
    folder = path.parent if path.name == REPORT else path
    return folder if folder.is_dir() and any(product(folder, name).is_file() for name in _PRODUCTS) else None


def local_paths(mime):
    """The local files and folders that are dragged."""
    return [Path(url.toLocalFile()) for url in mime.urls() if url.isLocalFile()] if mime.hasUrls() else []
