"""The one way in for vector files that GDAL reads: GeoPackage, FlatGeobuf and Shapefile, of anybody.

GDAL chooses a driver by content, name and neighbours, and pyogrio cannot name the driver. Some drivers open what a
file names: virtual layers, services, addresses. Here the first bytes decide, and GDAL gets a name that leaves one
driver; all three formats begin with bytes among which no text is found, in which other drivers look for theirs.
"""

import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.readers.sqlite_file import SQLITE_MAGIC, check_sqlite
from furrowmap.core.readers.text_encoding import decoded, known_page
from furrowmap.core.runtime.errors import Notice
from furrowmap.core.runtime.file_names import leads_out
from furrowmap.core.runtime.memory import expect_disk
from furrowmap.core.runtime.plain_reads import open_plain
from furrowmap.core.runtime.write_errors import scratch_directory, writing_scratch

FLATGEOBUF_MAGIC: Final = b"fgb"
SHAPEFILE_MAGIC: Final = b"\0\0\x27\x0a"
LAYER_MAGIC: Final = (SQLITE_MAGIC, FLATGEOBUF_MAGIC, SHAPEFILE_MAGIC)
"""The first bytes of GeoPackage, FlatGeobuf and Shapefile."""
_FLATGEOBUF: Final = (b"fgb\x03fgb", 7)
"""Bytes of the format's version 3, before that of the patch."""
_SHAPEFILE_PARTS: Final = (".shp", ".shx", ".dbf", ".prj", ".cpg")
_STATED_PAGE: Final = ".page"
_LANGUAGES: Final = {
    0x01: "437", 0x02: "850", 0x03: "1252", 0x13: "932", 0x26: "866", 0x4D: "936", 0x4E: "949", 0x4F: "950",
    0x64: "852", 0x65: "866", 0x78: "950", 0x79: "949", 0x7A: "936", 0x7B: "932", 0x7C: "874", 0xC8: "1250",
    0xC9: "1251", 0xCA: "1254", 0xCB: "1253",
}  # fmt: skip
"""Code pages by the language byte of a .dbf. That for 'ANSI', 0x57, stands for whatever the writer's system used."""
_MAX_TEXT_PART: Final = 1_000_000
_SHX_HEADER: Final = 100
MAX_CELLS: Final = 50_000_000
"""Values of a layer (features times fields) beyond which each needs a byte in the file."""


def list_layers(path: Path) -> list[tuple[str, str | None]]:
    """Name and type of geometry of each layer, None for a table without; errors as :func:`read_layer_arrays`."""
    with _for_one_driver(path) as named:
        return [(str(name), kind) for name, kind in _pyogrio().list_layers(named)]


def layer_info(path: Path, layer: str | None = None, *, bounds: bool = False) -> dict[str, Any]:
    """What pyogrio's `read_info` tells of a layer, by default the first; errors as :func:`read_layer_arrays`."""
    with _for_one_driver(path) as named:
        return dict(_pyogrio().read_info(named, layer=layer, force_total_bounds=bounds))


def read_layer_arrays(
    path: Path, layer: str | None = None, *, times_as_text: bool = False
) -> tuple[dict[str, Any], NDArray[np.object_] | None, list[NDArray[Any]]]:
    """A layer, by default the first: what it is, its geometries as WKB (None of a table without), and its columns.

    Raises:
        ValueError: if the file has another format, refers to others, computes what it shows, or states more features
            than it can hold.
        Exception: of GDAL and SQLite, which have no family of their own, if it is damaged.
    """
    with _for_one_driver(path) as named:
        about = _pyogrio().read_info(named, layer=layer, force_feature_count=True)
        size = sum(part.stat().st_size for part in _parts(named))
        features = int(about["features"])
        cells = features * (len(about["fields"]) + 1)
        if features > size or cells > max(size, MAX_CELLS):
            raise ValueError(f"it states {features:,} features with {len(about['fields'])} fields in {size:,} bytes")
        meta, _, wkb, columns = _pyogrio().raw.read(named, layer=layer, datetime_as_string=times_as_text)
        meta["layer_metadata"] = about["layer_metadata"]
        if _is_shp(named):
            meta["fields"], columns, meta["notices"] = _in_code_page(path, named, meta["fields"], columns)
        return meta, wkb, columns


def _pyogrio() -> Any:
    import pyogrio.raw  # a tenth of a second, and most sessions name no vector file

    pyogrio.set_gdal_config_options({"GDAL_PAM_ENABLED": False})  # it would write `.aux.xml` beside a GeoPackage
    return pyogrio


@contextmanager
def _for_one_driver(path: Path) -> Iterator[Path]:
    """As :func:`_named`; ValueError where pyogrio finds no layer, of which it raises IndexError."""
    with _named(path) as named:
        try:
            yield named
        except IndexError:
            raise ValueError("it has no layer") from None


@contextmanager
def _named(path: Path) -> Iterator[Path]:
    """A path of the file for which GDAL has one driver, that of the file's first bytes; a copy where it needs one."""
    with open_plain(path) as file:
        head = file.read(64)
    if head.startswith(SHAPEFILE_MAGIC):
        with scratch_directory() as folder:
            with writing_scratch():
                copied = _copied_shapefile(path, folder)
            yield copied
        return
    if head.startswith(SQLITE_MAGIC):
        suffix = ".gpkg"
        check_sqlite(path)
    elif head.startswith(_FLATGEOBUF[0]):
        suffix = ".fgb"
    else:
        raise ValueError("it is neither a GeoPackage nor a FlatGeobuf or a Shapefile")
    path = path.absolute()
    if path.suffix == suffix and "!" not in path.name and not path.as_posix().startswith("/vsi"):
        yield path
        return
    with scratch_directory() as folder:
        copy = folder / f"layer{suffix}"
        with writing_scratch():
            expect_disk(path, folder, path.stat().st_size)
            shutil.copyfile(path, copy)
            if Path(f"{path}-wal").is_file():
                shutil.copyfile(f"{path}-wal", f"{copy}-wal")
        yield copy


def _in_code_page(
    path: Path, named: Path, names: Sequence[str], columns: list[NDArray[Any]]
) -> tuple[NDArray[np.object_], list[NDArray[Any]], list[Notice]]:
    """Names and columns of a Shapefile, whose bytes GDAL was told are Latin-1, in its code page."""
    texts = [k for k, column in enumerate(columns) if column.dtype == object]
    cells = [str(name) for name in names]
    for k in texts:
        cells += [cell for cell in columns[k] if isinstance(cell, str)]
    stated = _stated_code_page(named)
    page = known_page(stated)
    found = decoded([cell.encode("latin-1") for cell in cells], page)
    if found is None:
        return np.array(names, object), columns, [Notice("code-page.no-known-page", path=path.name)]
    renewed = iter(found.texts)
    fields = np.array([next(renewed) for _ in names], object)
    new = list(columns)
    for k in texts:
        new[k] = np.array([next(renewed) if isinstance(cell, str) else cell for cell in columns[k]], object)
    if stated and found.page != page and found.example:
        return fields, new, [found.notice("code-page.wrong", path.name, stated=stated)]
    return fields, new, [found.notice("code-page.not-stated", path.name)] if found.open else []


def _stated_code_page(named: Path) -> str:
    """What the .cpg says, else the language of the .dbf; empty if neither does."""
    copied = named.with_suffix(_STATED_PAGE)
    if copied.is_file() and (text := copied.read_text("latin-1").strip("\ufeffï»¿ \t\r\n\0")):
        return text[:40]
    table = named.with_suffix(".dbf")
    head = table.read_bytes()[:30] if table.is_file() else b""
    return _LANGUAGES.get(head[29], "") if len(head) == 30 else ""


def _parts(path: Path) -> list[Path]:
    return [part for end in _SHAPEFILE_PARTS if (part := path.with_suffix(end)).is_file()] if _is_shp(path) else [path]


def _is_shp(path: Path) -> bool:
    return path.suffix == _SHAPEFILE_PARTS[0]


def _copied_shapefile(path: Path, folder: Path) -> Path:
    """The Shapefile in a folder of its own; its other files are links to no other folder."""
    stem = path.stem.casefold()
    folder_of_file = path.absolute().parent
    beside = [other for other in folder_of_file.iterdir() if other.stem.casefold() == stem]
    for part in [path, *beside]:
        end = part.suffix.lower() if part != path else _SHAPEFILE_PARTS[0]
        target = folder / f"layer{end}"
        if end not in _SHAPEFILE_PARTS or target.exists() or not part.is_file():
            continue
        if part != path and leads_out(part, folder_of_file):
            raise ValueError(f"its file '{part.name}' is a link to another folder")
        size = part.stat().st_size
        if end in (".prj", ".cpg") and size > _MAX_TEXT_PART:
            raise ValueError(f"its file '{part.name}' has {size:,} bytes")
        expect_disk(part, folder, size)
        shutil.copyfile(part, target)
    stated = folder / "layer.cpg"
    if stated.exists():
        stated.rename(stated.with_suffix(_STATED_PAGE))
    stated.write_text("ISO-8859-1")  # each byte as it is, see `_in_code_page`
    _check_index(folder / "layer.shx", (folder / "layer.shp").stat().st_size)
    return folder / "layer.shp"


def _check_index(index: Path, size: int) -> None:
    """Raises ValueError if records overlap (ESRI Shapefile Technical Description, 1998): each would be read again."""
    if not index.is_file():
        raise ValueError("its file .shx is missing")
    entries = np.frombuffer(index.read_bytes()[_SHX_HEADER:], ">i4")
    words = entries[: len(entries) // 2 * 2].reshape(-1, 2).astype(np.int64)
    words = words[words[:, 1] > 0]
    words = words[np.argsort(words[:, 0], kind="stable")]
    ends = words[:, 0] + words[:, 1] + 4
    if (words[1:, 0] < ends[:-1]).any() or (words[:, 0] < 0).any() or (len(ends) and 2 * int(ends[-1]) > size):
        raise ValueError("its file .shx is damaged: it refers to the same bytes of the .shp twice, or beyond its end")
