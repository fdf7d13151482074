# SPDX-License-Identifier: GPL-2.0-or-later
"""Where sessions and their products are written: beside the recordings, or in a folder that the user chose."""

from __future__ import annotations

import json
import os
import os.path
import shutil
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path

from qgis.core import QgsSettings
from qgis.PyQt.QtCore import QCoreApplication

from ..platforms import resolved
from ..translation import in_marks
from .dropped import home_of

tr = partial(QCoreApplication.translate, "Places")

OUTPUTS_KEY = "furrowmap/outputs"
"""Setting: the folders chosen for products, by session file, as JSON."""
MAX_OUTPUTS = 200
RESULT_END = "_result"
"""End of the name of a folder of products."""


def default_folder(session: Path) -> Path:
    """The folder for the products of a session, the same as on the command line."""
    session = resolved(session)
    return session.parent / f"{session.stem}{RESULT_END}"


def folder_for(session: Path) -> Path:
    """The folder for the products of a session: the one that the user chose, else that beside it."""
    chosen = _chosen().get(str(resolved(session)))
    return Path(chosen) if chosen else default_folder(session)


def choose_folder(session: Path, folder: str | Path) -> None:
    """Keep the folder that the user chose for a session's products; "" for the one beside it."""
    known = {name: chosen for name, chosen in _chosen().items() if name != str(resolved(session))}
    if str(folder).strip() and resolved(Path(folder)) != default_folder(session):
        known[str(resolved(session))] = str(folder).strip()
    QgsSettings().setValue(OUTPUTS_KEY, json.dumps(dict(list(known.items())[-MAX_OUTPUTS:])))


def free_folder_for(session: Path) -> Path:
    """The first folder `NAME_result-2`, `NAME_result-3`, … that does not exist."""
    first = folder_for(session)
    number = 2
    while (folder := first.with_name(f"{first.name}-{number}")).exists():
        number += 1
    return folder


def is_writable(folder: Path) -> bool:
    """Whether files can be made in a folder, or it itself; as far as its attributes say."""
    while not folder.exists() and folder != folder.parent:
        folder = folder.parent
    return folder.is_dir() and os.access(folder, os.W_OK | os.X_OK)


def session_for(recordings: Sequence[Path]) -> Path:
    """The session file of recordings: the first of `session.toml`, `session-2.toml`, … that names them or is new.

    A folder may have the recordings of many drives.
    """
    folder = common_home(recordings)
    number = 1
    while True:
        session = folder / ("session.toml" if number == 1 else f"session-{number}.toml")
        if not session.exists() or _names_all(session, recordings):
            return session
        number += 1


def common_home(recordings: Sequence[Path]) -> Path:
    """The folder that all recordings are in."""
    folders = [str(home_of(path)) for path in recordings]
    try:
        return Path(os.path.commonpath(folders))
    except ValueError:  # on different drives; the worker refuses that
        return Path(folders[0])


def copied(
    paths: Sequence[Path], target: Path, on_share: Callable[[float], None], is_cancelled: Callable[[], bool]
) -> list[Path]:
    """Copy files and folders below `target`, without products of runs; the copies, none if it was cancelled.

    A folder named alone is copied under its name. Raises OSError; FileExistsError before anything is copied if one of
    the names is taken. What was copied before an error or a cancellation is removed.
    """
    sources = list(dict.fromkeys(paths))
    made = [target / path.name for path in sources]
    taken = next((path for path in made if path.exists()), None)
    if taken is not None:
        raise FileExistsError(17, tr("there is a file or folder of this name already"), str(taken))
    files = [pair for path, copy in zip(sources, made, strict=True) for pair in _files(path, copy)]
    whole = sum(path.stat().st_size for path, _ in files) or 1
    free = shutil.disk_usage(target).free
    if whole > free:
        words = tr("{needed:,.1f} GB are needed, {free:,.1f} GB are free")
        raise OSError(28, in_marks(words.format(needed=whole / 1e9, free=free / 1e9)), str(target))
    done = 0
    try:
        for path, copy in files:
            copy.parent.mkdir(parents=True, exist_ok=True)
            with path.open("rb") as read, copy.open("wb") as written:
                while block := read.read(1 << 22):
                    if is_cancelled():
                        _remove(made)
                        return []
                    written.write(block)
                    done += len(block)
                    on_share(done / whole)
    except OSError:
        _remove(made)
        raise
    return made


def _files(path: Path, copy: Path) -> Iterator[tuple[Path, Path]]:
    """The files at or below a path, each with the name of its copy."""
    if path.is_file():
        yield path, copy
        return
    for each in sorted(path.iterdir()):
        if not each.name.startswith(".") and not (each.is_dir() and each.name.endswith(RESULT_END)):
            yield from _files(each, copy / each.name)


def _remove(made: Sequence[Path]) -> None:
    for path in made:
        if path.is_dir():
            shutil.rmtree(path, ignore_errors=True)
        else:
            path.unlink(missing_ok=True)


def _chosen() -> dict[str, str]:
    try:
        known = json.loads(QgsSettings().value(OUTPUTS_KEY, "{}", str))
    except ValueError:
        return {}
    return known if isinstance(known, dict) else {}


def _names_all(session: Path, recordings: Sequence[Path]) -> bool:
    try:
        text = session.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError):
        return False
    return all(path.name in text for path in recordings)
