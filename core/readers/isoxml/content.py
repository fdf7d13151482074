"""The content of a set of task data, a folder or a zip archive: fields with boundaries, devices, tasks and time logs.

ISO 11783-10:2015, annex D, names the elements of TASKDATA.XML by three letters and their attributes by one.
"""

import stat
import zipfile
from collections import Counter, defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from hashlib import sha256
from pathlib import Path, PurePosixPath
from typing import Final, TypeVar

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from furrowmap.core.geodesy.longitudes import unwrapped_deg
from furrowmap.core.readers.areas.repair import expect_few_crossings, repaired
from furrowmap.core.readers.isoxml.devices import DeviceElement, device_elements
from furrowmap.core.readers.isoxml.xml import Element, parse_xml
from furrowmap.core.runtime.errors import InputError, Notice
from furrowmap.core.runtime.file_names import is_file_name, leads_out
from furrowmap.core.runtime.languages.texts import Text
from furrowmap.core.runtime.memory import expect_growth, expect_memory
from furrowmap.core.runtime.plain_reads import open_plain

MAIN: Final = "TASKDATA.XML"
MAX_ARCHIVE_FILES: Final = 100_000
MAX_FILE_BYTES: Final = 1 << 30
"""Largest plausible file: the time log of a day has a few megabytes."""


@dataclass(frozen=True)
class TaskFiles:
    """Files of one set by name, ignoring case, because terminals write names in either.

    Attributes:
        path: the folder or archive.
        inside: the set's folder in it; empty where it has one set alone.
    """

    path: Path
    inside: str
    notices: tuple[Notice, ...]
    _readers: dict[str, Callable[[], bytes]]

    def named(self, name: str) -> str:
        """Path of one of the files for messages."""
        return f"{self.path}, {self.id_of(name)}"

    def id_of(self, name: str) -> str:
        """A name or an id that no other set of the folder or archive has."""
        return f"{self.inside}/{name}" if self.inside else name

    def read(self, name: str) -> bytes:
        """The content of a file; InputError if it is missing, too large, or damaged."""
        reader = self._readers.get(name.upper())
        if reader is None:
            raise InputError("task-data-incomplete", path=self.path, name=self.id_of(name))
        try:
            return reader()
        except Exception as error:  # noqa: BLE001 damage ends in errors of many families
            raise InputError("task-data-unreadable.unreadable-file", name=self.named(name), error=error) from None


def open_task_sets(path: Path) -> tuple[TaskFiles, ...]:
    """The sets of files next to each TASKDATA.XML in a folder or archive; `path` may also be that file.

    Of copies of the same TASKDATA.XML the first counts, with a notice. InputError if there is none, or the archive is
    damaged or hostile.
    """
    if not path.is_dir() and path.name.upper() != MAIN:
        return _without_copies(path, _open_archive(path))
    folder = path if path.is_dir() else path.parent
    found = []
    for inside, label in _folders_of_mains(folder, _folder_names(folder)):
        files = [p for p in sorted((folder / inside).iterdir()) if p.is_file() and not leads_out(p, folder / inside)]
        found.append(TaskFiles(folder, label, (), {p.name.upper(): partial(_read_file, p) for p in files}))
    return _without_copies(folder, found)


def _without_copies(path: Path, sets: Sequence[TaskFiles]) -> tuple[TaskFiles, ...]:
    """The sets without those whose main file is that of another."""
    if len(sets) == 1:
        return tuple(sets)
    first: dict[bytes, TaskFiles] = {}
    copies = []
    for files in sets:
        try:
            main = sha256(files.read(MAIN)).digest()
        except InputError:  # which reading the set reports
            main = files.inside.encode(errors="surrogatepass")
        if main in first:
            copies.append(files.inside)
        else:
            first[main] = files
    kept = list(first.values())
    if copies:
        notice = Notice("task-data-copies", path=path, copies=len(copies), names=", ".join(sorted(copies)[:4]))
        kept[0] = replace(kept[0], notices=(*kept[0].notices, notice))
    return tuple(kept)


def is_task_data(path: Path) -> bool:
    """Whether a folder or archive has a TASKDATA.XML, or a file is one."""
    if path.is_dir():
        return bool(_mains(_folder_names(path)))
    if not path.is_file():  # of a device zipfile would look for the end
        return False
    if path.name.upper() == MAIN:
        return True
    try:
        with zipfile.ZipFile(path) as archive:
            return bool(_mains(archive.namelist()))
    except Exception:  # noqa: BLE001 damage ends in errors of many families
        return False


def _folder_names(folder: Path) -> list[str]:
    """Files in the folder and in its subfolders: where terminals put TASKDATA."""
    try:
        files = [p for p in folder.iterdir() if p.is_file()]
        files += [p for below in folder.iterdir() if below.is_dir() for p in below.glob("*") if p.is_file()]
    except OSError:
        return []
    return [p.relative_to(folder).as_posix() for p in files]


def _mains(names: list[str]) -> list[str]:
    """Names of main files, without the resource files of macOS."""
    paths = [PurePosixPath(name) for name in names if MAIN in name.upper()]
    return [p.as_posix() for p in paths if p.name.upper() == MAIN and not any("MACOSX" in part for part in p.parts)]


def _folders_of_mains(path: Path, names: list[str]) -> list[tuple[PurePosixPath, str]]:
    """The folder of each main file inside `path`, and its name in messages: none where it is alone."""
    mains = _mains(names)
    if not mains:
        held = ", ".join(sorted(PurePosixPath(name).name for name in names)[:4]) or "nothing"
        raise InputError("task-data-missing.one-main", path=path, held=held)
    folders = sorted({PurePosixPath(name).parent for name in mains})
    if len(folders) < len(mains):  # names that differ in case
        raise InputError("task-data-ambiguous", path=path, mains=len(mains), mains_list=", ".join(sorted(mains)[:4]))
    return [(folder, folder.as_posix() if len(folders) > 1 else "") for folder in folders]


def _read_file(path: Path) -> bytes:
    if path.stat().st_size > MAX_FILE_BYTES:
        raise OSError(Text("{size:,} bytes is more than any task data", size=path.stat().st_size))
    return path.read_bytes()


def _open_archive(path: Path) -> list[TaskFiles]:
    try:
        with open_plain(path) as file:
            is_archive = file.read(2) == b"PK" or zipfile.is_zipfile(path)
        found = _entries(path) if is_archive else []
    except Exception as error:  # noqa: BLE001 damage ends in errors of many families
        raise InputError("task-data-unreadable", path=path, error=error) from None
    if not is_archive:
        raise InputError("task-data-missing.no-archive", path=path)
    ahead = min((entry.header_offset for entry in found), default=0)
    entries = [entry for entry in found if not entry.filename.endswith("/")]
    expect_growth(path, path.stat().st_size, sum(entry.file_size for entry in entries))
    expect_memory(path, max((entry.file_size for entry in entries), default=0))
    if fault := _hostile_entry(entries):
        raise InputError("archive-hostile", path=path, fault=fault)
    notices = (Notice("archive-foreign-bytes", path=path, ahead=ahead),) * (ahead > 0)
    readers: defaultdict[PurePosixPath, dict[str, Callable[[], bytes]]] = defaultdict(dict)
    for entry in entries:
        name = PurePosixPath(entry.filename)
        readers[name.parent][name.name.upper()] = partial(_read_entry, path, entry)
    folders = _folders_of_mains(path, [entry.filename for entry in entries])
    return [TaskFiles(path, label, notices, readers[inside]) for inside, label in folders]


def _entries(path: Path) -> list[zipfile.ZipInfo]:
    with zipfile.ZipFile(path) as archive:
        return archive.infolist()


def _read_entry(path: Path, entry: zipfile.ZipInfo) -> bytes:
    with zipfile.ZipFile(path) as archive, archive.open(entry) as stream:
        data = stream.read(entry.file_size + 1)
    if len(data) != entry.file_size:
        raise zipfile.BadZipFile(
            Text(
                "{size:,} bytes instead of the {stated:,} that the archive states",
                size=len(data),
                stated=entry.file_size,
            )
        )
    return data


def _hostile_entry(entries: list[zipfile.ZipInfo]) -> Text | None:
    """What is hostile about the first entry that is; None without."""
    if len(entries) > MAX_ARCHIVE_FILES:
        return Text("it has {files:,} files", files=len(entries))
    for entry in entries:
        # A backslash separates folders in archives of some programs for Windows.
        parts = PurePosixPath(entry.filename.replace("\\", "/")).parts
        if not parts or not all(map(is_file_name, parts)):
            return Text("the name {filename!r} points outside the archive", filename=entry.filename)
        if stat.S_ISLNK(entry.external_attr >> 16):
            return Text("{filename!r} is a link", filename=entry.filename)
    return None


TASK_DATA_ROOT: Final = "ISO11783_TaskData"
EXTERNAL: Final = "XFC"
BOUNDARY_POLYGON: Final = "1"
EXTERIORS: Final = ("1", "")
INTERIOR: Final = "2"
MAX_FIELD_DEG: Final = 1.0
"""No field is wider or higher, in degrees of latitude."""


@dataclass(frozen=True)
class Partfield:
    """A field, `PFD`; its boundary is in longitude and latitude, degrees, None if the file has none."""

    id: str
    name: str
    boundary: BaseGeometry | None


@dataclass(frozen=True)
class Task:
    """A task, `TSK`.

    Attributes:
        partfield: id of its field; "" if it has none.
        logs: names of its time logs without suffix, in the order of the file.
        begins: of its time spans as written, with or without a time zone; "" for an open one.
        connections: ids of the two connectors of each connection of two machines, `CNN`.
    """

    id: str
    name: str
    partfield: str
    logs: tuple[str, ...]
    begins: tuple[str, ...]
    connections: tuple[tuple[str, str], ...]


@dataclass(frozen=True)
class TaskData:
    """The content of a set of task data: fields and device elements of all machines by id, tasks in their order."""

    version: str
    maker: str
    partfields: dict[str, Partfield]
    elements: dict[str, DeviceElement]
    tasks: tuple[Task, ...]
    notices: tuple[Notice, ...] = field(default=())


def read_content(files: TaskFiles) -> TaskData:
    """The content of the main file and the external files that it refers to; InputError if that is not task data."""
    root = parse_xml(files.read(MAIN), files.named(MAIN))
    if root.tag != TASK_DATA_ROOT:
        raise InputError("task-data-missing", main=files.named(MAIN), tag=root.tag[:40])
    items, lost = _items(files, root)
    notices = [*files.notices, *lost]
    maker = root.get("TaskControllerManufacturer") or root.get("ManagementSoftwareManufacturer")
    partfields = []
    for item in (item for item in items if item.tag == "PFD"):
        name = item.get("C") or item.get("A")
        polygons = [p for p in item.all("PLN") if p.get("A") == BOUNDARY_POLYGON]
        outlines = [_polygon(p, name) for p in polygons]
        boundary = shapely.union_all([outline for outline, _ in outlines])
        notices += [notice for _, dropped in outlines for notice in dropped]
        partfields.append(Partfield(item.get("A"), name, None if boundary.is_empty else boundary))
    elements = [part for item in items if item.tag == "DVC" for part in device_elements(item)]
    partfields_by_id, again = _by_id(partfields, "partfield")
    elements_by_id, elements_again = _by_id(elements, "device element")
    return TaskData(
        version=f"{root.get('VersionMajor')}.{root.get('VersionMinor')}",
        maker=maker,
        partfields=partfields_by_id,
        elements=elements_by_id,
        tasks=tuple(
            Task(
                id=item.get("A"),
                name=item.get("B") or item.get("A"),
                partfield=item.get("E"),
                logs=tuple(log.get("A") for log in item.all("TLG")),
                begins=tuple(span.get("A") for span in item.all("TIM")),
                connections=tuple((one.get("B"), one.get("D")) for one in item.all("CNN")),
            )
            for item in items
            if item.tag == "TSK"
        ),
        notices=(*notices, *again, *elements_again),
    )


def _items(files: TaskFiles, root: Element) -> tuple[list[Element], list[Notice]]:
    """The elements of the main file, with external files in place of the references to them; each is read once."""
    items: list[Element] = []
    notices: list[Notice] = []
    read: Counter[str] = Counter()
    for item in root.children:
        if item.tag != "XFR":
            items.append(item)
            continue
        name = f"{item.get('A')}.XML"
        read[name] += 1
        if read[name] > 1:
            continue
        try:
            external = parse_xml(files.read(name), files.named(name))
        except InputError as error:
            notices.append(Notice("external-file-lost", lines=error.lines[0]))
            continue
        if external.tag == EXTERNAL:
            items += external.children
    return items, notices + named_again(read)


def named_again(read: Counter[str]) -> list[Notice]:
    """A notice of files that are named more than once: a hostile set of files names one thousands of times."""
    again = [name for name, times in read.items() if times > 1]
    names = ", ".join(again[:3]) + ", …" * (len(again) > 3)
    return [Notice("file-named-again", names=names)] if again else []


_T = TypeVar("_T", Partfield, DeviceElement)


def _by_id(found: list[_T], kind: str) -> tuple[dict[str, _T], list[Notice]]:
    """The first of each id, and a notice of each other."""
    by_id: dict[str, _T] = {}
    notices = []
    for one in found:
        if one.id in by_id:
            notices.append(Notice("id-twice", id=one.id, kind=kind))
        else:
            by_id[one.id] = one
    return by_id, notices


def _polygon(item: Element, name: str) -> tuple[BaseGeometry, list[Notice]]:
    """A polygon with its holes, in version 4 of several exteriors; invalid rings are dropped with a notice."""
    notices = []
    shells: list[BaseGeometry] = []
    holes: list[BaseGeometry] = []
    first_deg: float | None = None
    for ring in item.all("LSG"):
        places = [(_degrees(p.get("D")), _degrees(p.get("C"))) for p in ring.all("PNT")]
        usable = [(lon, lat) for lon, lat in places if abs(lon) <= 180.0 and abs(lat) <= 90.0]
        if usable:
            first_deg = usable[0][0] if first_deg is None else first_deg
            lon_deg = unwrapped_deg(np.array([lon for lon, _ in usable]), first_deg)
            usable = [(lon, lat) for lon, (_, lat) in zip(lon_deg.tolist(), usable, strict=True)]
        far = len(usable) > 0 and bool(np.ptp(usable, axis=0).max() > MAX_FIELD_DEG)
        if len(usable) < 3 or len(usable) < len(places) or far or ring.get("A") not in (*EXTERIORS, INTERIOR):
            notices.append(Notice("boundary-ring", name=name, usable=len(usable), places=len(places)))
        else:
            try:
                outline = repaired(shapely.Polygon(usable))
            except ValueError:
                notices.append(Notice("boundary-ring", name=name, usable=len(usable), places=len(places)))
                continue
            (holes if ring.get("A") == INTERIOR else shells).append(outline)
    try:
        expect_few_crossings(np.array([*shells, *holes, None], object)[:-1])
    except ValueError:
        places_of_all = int(shapely.get_num_coordinates(np.array([*shells, *holes], object)).sum())
        notices.append(Notice("boundary-ring", name=name, usable=0, places=places_of_all))
        return shapely.Polygon(), notices
    return shapely.difference(shapely.union_all(shells), shapely.union_all(holes)), notices


def _degrees(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return float("inf")
