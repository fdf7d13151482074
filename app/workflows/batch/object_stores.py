"""Recordings and results of a batch in an object store or on a server, by fsspec URLs such as s3:// and sftp://."""

import platform
import posixpath
import secrets
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final
from urllib.parse import urlsplit

import msgspec

from furrowmap.core.runtime.errors import (
    FurrowmapError,
    InputError,
    MissingExtraError,
    RefusedError,
    UsageError,
    printable,
)
from furrowmap.core.runtime.file_names import is_file_name
from furrowmap.core.runtime.json_text import from_kept_json, kept_json
from furrowmap.core.runtime.languages.texts import Text
from furrowmap.core.runtime.urls import without_passwords
from furrowmap.exporters.files.batch_state import SessionOutcome, Stamp, same_files
from furrowmap.exporters.files.lease import PREFIX
from furrowmap.exporters.files.result_folder import PREVIEW_REPORT, REPORT, SESSION_FILE
from furrowmap.workflows.batch.batch_sources import BatchSource, holds_scans

SCHEMES: Final = ("s3", "s3a", "gs", "gcs", "az", "abfs", "abfss", "oss", "sftp", "ssh", "smb", "memory")
"""Stores, and folders of servers that one logs in to. fsspec also opens files of this machine, web pages, whose
redirections and links lead anywhere, and what needs a second address, such as zip:// and reference://."""
MARKER: Final = "complete.json"
"""The file of a result in a store that is written last: what became of the session."""
STORE_BEAT_S: Final = 5.0
"""Time between two changes of a lease's file."""
MAX_STORE_SILENCE_S: Final = 60.0
"""A file that does not change for so long is of a writer that has ended: a store may be busy or out of reach."""
_LOOK_AGAIN_S: Final = 1.0
_WRITES: Final = b"writes "
_ASKS: Final = b"asks "


def is_url(place: str | Path) -> bool:
    """Whether a place is a URL rather than a path."""
    return "://" in str(place)


def expect_store(url: str) -> None:
    """UsageError if a URL is not one of a store, or has "::" in it: fsspec goes on from there to a second address."""
    scheme = url.partition("://")[0]
    if scheme not in SCHEMES or "::" in url:
        raise UsageError("usage.batch-url", url=without_passwords(url), scheme=scheme, schemes=", ".join(SCHEMES))


@dataclass(frozen=True)
class Store:
    """A folder in a store; `url` has no slash at its end."""

    url: str

    @property
    def shown(self) -> str:
        """The URL without a password: what is shown and stored."""
        return without_passwords(self.url)

    def files(self) -> dict[str, Stamp]:
        """All files below the folder, by their path relative to it."""
        system, root = self._opened()
        listed: Mapping[str, Mapping[str, Any]] = system.find(root, detail=True)
        found = {}
        for path, facts in listed.items():
            name = posixpath.relpath(path, root)
            known = [
                facts.get(key) for key in ("ETag", "etag", "md5Hash", "mtime", "LastModified", "modified", "created")
            ]
            mark = next((str(one) for one in known if one is not None), "")
            found[name] = Stamp(f"{self.shown}/{name}", int(facts["size"]), mark)
        return found

    def read(self, name: str) -> bytes | None:
        """The content of a file; None where there is none."""
        system, root = self._opened()
        try:
            content: bytes = system.cat_file(f"{root}/{name}")
        except FileNotFoundError:
            return None
        return content

    def write(self, name: str, content: bytes) -> None:
        """Write a file."""
        system, root = self._opened()
        system.makedirs(posixpath.dirname(f"{root}/{name}"), exist_ok=True)
        system.pipe_file(f"{root}/{name}", content)

    def fetch(self, names: Sequence[str], folder: Path) -> None:
        """Copy files into a folder; InputError if the store names a file that would lie outside of it."""
        system, root = self._opened()
        for name in names:
            if not all(is_file_name(part) for part in name.split("/")):
                raise InputError("batch-file-name", url=self.url, name=name)
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            system.get_file(f"{root}/{name}", str(folder / name))

    def put(self, folder: Path) -> None:
        """Copy the files of a folder, and remove others but the marker, which is removed first, and leases."""
        system, root = self._opened()
        if system.exists(root):
            system.invalidate_cache()
            there = set(self.files())
        else:
            there = set()
        if MARKER in there:
            system.rm_file(f"{root}/{MARKER}")
        system.makedirs(root, exist_ok=True)
        names = [path.name for path in sorted(folder.iterdir()) if path.is_file() and not path.name.startswith(".")]
        for name in names:
            system.put_file(str(folder / name), f"{root}/{name}")
        for name in there - {MARKER, *names}:
            if not name.startswith(PREFIX):
                system.rm_file(f"{root}/{name}")

    @contextmanager
    def held(self) -> Iterator[Callable[[], None]]:
        """Keep others from writing to the folder; RefusedError if another writer is there.

        As in a folder of the disk (:mod:`furrowmap.exporters.files.lease`), but a store has neither folders of one's
        own nor renaming: each writer has a file, which a thread changes, and lists those of others after it has written
        its own. Stores list what has been written (Amazon S3 since 2020), so of any two writers at least one sees the
        other. A writer whose file does not change while one watches has ended; its file is removed. Clocks are not
        compared.

        Yields:
            A function that raises RefusedError if another writer has taken over the folder.
        """
        system, root = self._opened()
        system.makedirs(root, exist_ok=True)
        own = f"{root}/{PREFIX}{secrets.token_hex(8)}"
        stopped = threading.Event()
        holds = threading.Event()
        _write(system, own, 0, holds)
        heart = threading.Thread(target=_beat, args=(system, own, stopped, holds), daemon=True)
        heart.start()

        def expect_held() -> None:
            there = _leases(system, root)
            # one that has just been removed may have been written again by its own thread
            if own not in there or any(_content(system, lease).startswith(_WRITES) for lease in there if lease != own):
                raise RefusedError("output-lost", folder=self.shown)

        try:
            _await_turn(system, root, own, self.shown)
            holds.set()
            _write(system, own, 0, holds)
            yield expect_held
        finally:
            stopped.set()
            heart.join()
            with suppress(Exception):  # it may be gone, or the store out of reach: then others wait a while
                system.rm_file(own)

    def complete(self) -> set[str]:
        """Names of the folders in this one that are whole."""
        system, root = self._opened()
        return {posixpath.basename(posixpath.dirname(path)) for path in system.glob(f"{root}/*/{MARKER}")}

    def _opened(self) -> tuple[Any, str]:
        """The file system and the path in it."""
        expect_store(self.url)  # names that a store lists are in it as well
        try:
            from fsspec.core import url_to_fs

            system, root = url_to_fs(self.url)
        except ImportError as error:
            raise MissingExtraError(
                Text("for {url}", url=self.url),
                "remote",
                Text("Nothing can be read or written there."),
                otherwise=Text("install sshfs or paramiko for SFTP"),
                error=error,
            ) from None
        return system, str(root).rstrip("/")


def find_remote(url: str) -> Iterator[BatchSource]:
    """The sources below a URL, as :func:`~.batch_sources.find_sources` finds them on the disk."""
    store = Store(url.rstrip("/"))
    files = store.files()
    if not files:
        raise InputError("batch-no-store", url=url)
    folders: dict[str, dict[str, Stamp]] = {}
    for name, stamp in files.items():
        folders.setdefault(posixpath.dirname(name), {})[posixpath.basename(name)] = stamp
    results = [home for home, names in folders.items() if REPORT in names or PREVIEW_REPORT in names]
    of_session: list[str] = []
    for home, names in sorted(folders.items()):
        if any(_is_in(home, result) for result in results) or any(part.startswith(".") for part in home.split("/")):
            continue
        made = SESSION_FILE not in names
        if made and (not holds_scans(names) or any(_is_in(home, other) for other in of_session)):
            continue
        of_session.append(home)
        inside = tuple(stamp for name, stamp in sorted(files.items()) if _is_in(name, home))
        parts = tuple(home.split("/")) if home else (posixpath.basename(store.shown),)
        yield BatchSource(Path(SESSION_FILE), parts, made, inside, url=f"{store.url}/{home}".rstrip("/"))


def fetch_session(url: str, stamps: Sequence[Stamp], folder: Path) -> Path:
    """The session file of a source in a store, after its files have been copied into a folder."""
    store = Store(url)
    home = folder / (posixpath.basename(store.shown) or "session")
    store.fetch([posixpath.relpath(one.path, store.shown) for one in stamps], home)
    return home / SESSION_FILE


def put_result(folder: Path, url: str, outcome: SessionOutcome) -> None:
    """Copy a result into a store, its marker last; raises RefusedError if another host is writing it, or took over."""
    store = Store(url)
    with store.held() as expect_held:
        store.put(folder)
        expect_held()
        store.write(MARKER, kept_json(outcome))


def earlier_in_store(url: str, key: str, inputs: Sequence[Stamp]) -> SessionOutcome | None:
    """What the marker of a result in a store says, if it is of the same settings, version and inputs."""
    content = Store(url).read(MARKER)
    try:
        found = from_kept_json(content, SessionOutcome) if content is not None else None
    except msgspec.MsgspecError:
        return None
    if found is None or found.key != key or not same_files(found.inputs, inputs):
        return None
    return replace(found, repeated=True)


def scratch() -> TemporaryDirectory[str]:
    """A folder for copies: in the system's folder of temporary files, which TMPDIR moves."""
    return TemporaryDirectory(prefix="furrowmap-batch-")


def store_failure(url: str, error: Exception) -> FurrowmapError:
    """What a store or its library raised, as an error with a remedy."""
    password = urlsplit(url).password  # some libraries repeat it as part of a path
    told = str(error).replace(f":{password}@", "@") if password else error
    return FurrowmapError("batch-store", url=url, name=type(error).__name__, error=told)


def _is_in(name: str, folder: str) -> bool:
    return not folder or name == folder or name.startswith(f"{folder}/")


def _await_turn(system: Any, root: str, own: str, shown: str) -> None:
    """Wait until no other writer is there; those whose file is later by name give up."""
    seen: dict[str, tuple[bytes, float]] = {}
    while True:
        others = [lease for lease in _leases(system, root) if lease != own]
        for lease in others:
            content = _content(system, lease)
            before, since = seen.get(lease, (b"", 0.0))
            if content != before:
                alive = bool(before)
                seen[lease] = (content, time.monotonic())
                if alive and (lease < own or content.startswith(_WRITES)):
                    host = printable(content.split(b" ", 2)[-1].decode(errors="replace"))
                    raise RefusedError("output-busy", folder=shown, process=None, host=host or None)
            elif time.monotonic() - since > MAX_STORE_SILENCE_S:
                with suppress(FileNotFoundError):
                    system.rm_file(lease)
        if not others:
            return
        time.sleep(_LOOK_AGAIN_S)


def _content(system: Any, lease: str) -> bytes:
    """Of a lease; empty where it has been removed meanwhile."""
    try:
        content: bytes = system.cat_file(lease)
    except FileNotFoundError:
        return b""
    return content


def _leases(system: Any, root: str) -> list[str]:
    system.invalidate_cache()
    listed = [f"{root}/{posixpath.basename(str(path))}" for path in system.ls(root, detail=False)]
    return sorted(path for path in listed if posixpath.basename(path).startswith(PREFIX))


def _write(system: Any, own: str, count: int, holds: threading.Event) -> None:
    state = _WRITES if holds.is_set() else _ASKS
    system.pipe_file(own, state + f"{count:09} {platform.node()}".encode())


def _beat(system: Any, own: str, stopped: threading.Event, holds: threading.Event) -> None:
    """Change the file until `stopped`, unless another writer has removed it."""
    count = 0
    while not stopped.wait(STORE_BEAT_S):
        count += 1
        with suppress(Exception):  # whatever a store raises: the lease is lost if it goes on
            if system.exists(own):
                _write(system, own, count, holds)
