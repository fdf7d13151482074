"""Folders of sessions as people leave them, beside files that nobody named, and what changed in them afterwards."""

from __future__ import annotations

import gzip
import os
import shutil
import stat
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from random import Random
from typing import Final

from furrowmap.exporters.files.result_folder import RUN_PRODUCTS
from tests.fuzz_sessions.grammar import SessionText, names_in
from tests.fuzz_sessions.material import Material, Stock

FOLDERS: Final = (
    "session", "North field", "圃場 1", "a'b\"c", "-rf", "%s", "$(x)", "x\ny", "e\u0301", "[a]*", "{0}", "..x",
    "x.toml", "session.toml", "\u202exyz", "a;b", "#1", "~", "con", "x" * 200, "out", "result.json", " ", "<b>",
)  # fmt: skip
"""Names of folders."""
PRODUCTS: Final = (*RUN_PRODUCTS, "preview.json", "preview_track.gpkg", "preview_dsm.tif", "live.jsonl", "batch.csv",
                   "batch.gpkg", "batch.html", "catalog.json")  # fmt: skip
CANARIES: Final = ("canary.nmea", "canary.csv", "canary.geojson", "canary.gpkg", "canary.zip", "canary.gsb", "linked")
"""Files outside of the sessions' folders. What lies at `linked` is the aim of links, which may have been named."""


@dataclass(frozen=True)
class Place:
    """A folder with everything of one trial.

    Attributes:
        root: the folder.
        session: the session file.
        out: where the products go.
        kept: files in `out` that are no products, and stay as they are.
    """

    root: Path
    session: Path
    out: Path
    kept: tuple[Path, ...]

    @property
    def outside(self) -> Path:
        """The folder with files that nobody named."""
        return self.root / "outside"

    @property
    def temporary(self) -> Path:
        """For temporary files; empty at the end."""
        return self.root / "temporary"

    @property
    def file(self) -> Path:
        """For a command that writes one file, which may be there already; beside a machine, what it has learned."""
        return self.root / "written.toml"

    def may_change(self, path: Path) -> bool:
        """Whether a command may make or replace a path."""
        home = self.session.parent
        others = (self.file, self.root / "home" / "machines")
        default = (
            *others,
            home / f"{self.session.stem}_preview",
            home / f"{self.session.stem}_result",
            home / "live.jsonl",
        )
        allowed = any(path == one or one in path.parents for one in (self.out, *default))
        return path not in self.kept and (allowed or path.match(f"{self.root}/{self.file.stem}*.npz"))


def lay_outside(root: Path, stock: Stock) -> None:
    """Make what sessions share: files that nobody named, a home, a folder of temporary files."""
    for name in ("outside", "temporary", "home"):
        (root / name).mkdir(parents=True)
    for name in CANARIES:
        (root / "outside" / name).write_bytes(_canary(name, stock))


def clear(root: Path) -> None:
    """Take away the sessions and their output, and leave what sessions share."""
    for path in root.iterdir():
        if path.name in ("outside", "temporary"):
            continue
        if path.is_dir() and not path.is_symlink():
            shutil.rmtree(path)
        else:
            path.unlink()
    (root / "home").mkdir()


def lay(root: Path, stock: Stock, texts: list[SessionText], chance: Random) -> Place:
    """Write sessions with their files, the first of which is the one that commands are given."""
    (root / "cards").mkdir()
    names = chance.sample(FOLDERS, len(texts))
    for name, text in zip(names, texts, strict=True):
        folder = root / "cards" / name
        folder.mkdir()
        written = text.text().replace("{outside}", str(root / "outside"))
        (folder / "session.toml").write_bytes(written.encode("utf-8", "surrogateescape"))
        for named in dict.fromkeys(names_in(text.data)):
            one = stock.named(named)
            if one is not None:
                _lay_files(folder, one, stock, chance)
        _lay_others(folder, root / "outside", stock, chance)
    session = root / "cards" / names[0] / "session.toml"
    out, kept = _lay_output(root, session, stock, chance)
    return Place(root, session, out, kept)


def _canary(name: str, stock: Stock) -> bytes:
    """Content that a reader would take, if it were opened."""
    good = {
        ".nmea": "drive_gnss.nmea",
        ".geojson": "drive_boundary.geojson",
        ".gpkg": "field.gpkg",
        ".zip": "field.zip",
    }
    found = stock.named(good.get(Path(name).suffix, "points.csv"))
    assert found is not None
    return next(iter(found.files.values()))


def _lay_files(folder: Path, one: Material, stock: Stock, chance: Random) -> None:
    """The files of a material, now and then damaged, or something else in their place."""
    odd = chance.random() < 0.12
    for k, (name, data) in enumerate(one.files.items()):
        path = folder / name
        if path.exists() or path.is_symlink():
            continue
        path.parent.mkdir(parents=True, exist_ok=True)
        if odd and k == 0:
            chance.choice(ODD_FILES)(path, data, folder, stock, chance)
        else:
            path.write_bytes(data)


def _other(path: Path, data: bytes, folder: Path, stock: Stock, chance: Random) -> None:
    path.write_bytes(next(iter(chance.choice(stock.material).files.values())))


def _cut(path: Path, data: bytes, folder: Path, stock: Stock, chance: Random) -> None:
    path.write_bytes(data[: chance.randrange(len(data))])


def _twice(path: Path, data: bytes, folder: Path, stock: Stock, chance: Random) -> None:
    path.write_bytes(data + data)


def _packed(path: Path, data: bytes, folder: Path, stock: Stock, chance: Random) -> None:
    path.write_bytes(gzip.compress(data, 1, mtime=0))


def _empty(path: Path, data: bytes, folder: Path, stock: Stock, chance: Random) -> None:
    path.write_bytes(b"")


def _zeros(path: Path, data: bytes, folder: Path, stock: Stock, chance: Random) -> None:
    at = chance.randrange(len(data))
    path.write_bytes(data[:at] + b"\0" * 2000 + data[at:])


def _link_out(path: Path, data: bytes, folder: Path, stock: Stock, chance: Random) -> None:
    path.symlink_to(Path(os.path.relpath(folder.parents[1] / "outside" / "linked", path.parent)))


def _link_self(path: Path, data: bytes, folder: Path, stock: Stock, chance: Random) -> None:
    path.symlink_to(chance.choice((path.name, "session.toml", "nowhere", "/dev/zero")))


def _fifo(path: Path, data: bytes, folder: Path, stock: Stock, chance: Random) -> None:
    os.mkfifo(path)


def _directory(path: Path, data: bytes, folder: Path, stock: Stock, chance: Random) -> None:
    path.mkdir()
    (path / chance.choice(("inside.txt", "metadata.yaml", "TASKDATA.XML", "x.db3"))).write_bytes(data[:100])


def _vrt(path: Path, data: bytes, folder: Path, stock: Stock, chance: Random) -> None:
    """A file of GDAL's that names others, whatever the suffix says."""
    place = folder.parents[1] / "outside" / chance.choice(("canary.geojson", "canary.gpkg", "canary.csv"))
    layer = f'<OGRVRTLayer name="{place.stem}"><SrcDataSource relativeToVRT="0">{place}</SrcDataSource></OGRVRTLayer>'
    text = f"<OGRVRTDataSource>{layer}</OGRVRTDataSource>"
    path.write_text(chance.choice((text, "{" + text + "}", f"<!-- {data[:20].hex()} -->{text}")))


ODD_FILES: Final[tuple[Callable[[Path, bytes, Path, Stock, Random], None], ...]] = (
    _other, _cut, _cut, _twice, _packed, _empty, _zeros, _link_out, _link_self, _fifo, _directory, _vrt,
)  # fmt: skip


def _lay_others(folder: Path, outside: Path, stock: Stock, chance: Random) -> None:
    """Things that lie in a folder without being named."""
    if chance.random() > 0.15:
        return
    path = folder / chance.choice(("copy (1)", ".hidden", "live.jsonl", "record.log", "status.json", "x.jpg", "images"))
    if path.exists():
        return
    kind = chance.randrange(5)
    if kind == 0:
        path.symlink_to(outside / "linked")
    elif kind == 1:
        os.mkfifo(path)
    elif kind == 2:
        path.symlink_to(".")
    elif kind == 3:
        _other(path, b"", folder, stock, chance)
    else:
        path.mkdir()
        (path / "x\udcff").write_bytes(b"name that is no UTF-8")


def _lay_output(root: Path, session: Path, stock: Stock, chance: Random) -> tuple[Path, tuple[Path, ...]]:
    """The folder of products, and what in it is none."""
    kind = chance.random()
    if kind < 0.5:
        return root / "out" / "new" if kind < 0.1 else root / "out", ()
    if kind < 0.55:
        return session.parent, ()
    if kind < 0.58:
        (root / "out").write_bytes(b"a file")
        return root / "out" / "below" if kind < 0.565 else root / "out", ()
    if kind < 0.61:
        (root / "elsewhere").mkdir()
        (root / "out").symlink_to("elsewhere" if kind < 0.6 else "nowhere")
        return (root / "elsewhere" if kind < 0.6 else root / "out"), ()
    out = root / "out"
    out.mkdir()
    note = out / "notes.txt"
    note.write_bytes(b"of the user")
    earlier = chance.choice([*stock.results.values(), {}])
    for name, data in earlier.items():
        (out / name).write_bytes(data if chance.random() < 0.95 else data[: len(data) // 2])
    for name in chance.sample(PRODUCTS, chance.choice((0, 1, 1, 3))):
        (out / name).unlink(missing_ok=True)
        _lay_at_product(out / name, root / "outside" / "linked", chance)
    return out, (note,)


def _lay_at_product(path: Path, linked: Path, chance: Random) -> None:
    """A link, a pipe, a folder or nonsense where a product will be."""
    kind = chance.randrange(6)
    if kind == 0:
        path.symlink_to(linked)
    elif kind == 1:
        path.hardlink_to(linked)
    elif kind == 2:
        os.mkfifo(path)
    elif kind == 3:
        path.mkdir()
    elif kind == 4:
        path.symlink_to(linked.parent / "new")
    else:
        path.write_bytes(chance.choice((b"{}", b"[]", b"null", b'{"session": {}, "inputs": [1]}', b"\0" * 100, b"")))


Listing = dict[str, tuple[int | str, ...]]


def listing(root: Path) -> Listing:
    """What is below a folder: kind, number, size and time of change of each path, and the aim of links."""
    found: dict[str, tuple[int | str, ...]] = {}
    for path in _below(str(root)):
        status = os.lstat(path)
        kind = stat.S_IFMT(status.st_mode)
        aim = os.readlink(path) if kind == stat.S_IFLNK else ""  # noqa: PTH115 (thousands of times a second)
        found[path] = (
            (kind, aim) if kind == stat.S_IFDIR else (kind, aim, status.st_ino, status.st_size, status.st_mtime_ns)
        )
    return found


def _below(folder: str) -> Iterator[str]:
    with os.scandir(folder) as entries:
        for entry in entries:
            yield entry.path
            if entry.is_dir(follow_symlinks=False):
                yield from _below(entry.path)
