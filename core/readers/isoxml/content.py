"""The content of TASKDATA.XML: fields with their boundaries, devices and their elements, tasks and their time logs.

ISO 11783-10:2015, annex D, names its elements by three letters and their attributes by one.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Final, TypeVar

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from furrowmap.core.readers.isoxml.files import MAIN, TaskFiles
from furrowmap.core.readers.isoxml.xml import Element, parse_xml
from furrowmap.core.runtime.errors import InputError, Notice

TASK_DATA_ROOT: Final = "ISO11783_TaskData"
EXTERNAL: Final = "XFC"
BOUNDARY_POLYGON: Final = "1"
EXTERIORS: Final = ("1", "")
INTERIOR: Final = "2"
MAX_FIELD_DEG: Final = 1.0
"""No field is wider or higher, in degrees of latitude."""
PARALLEL: Final = frozenset({"4", "5"})
"""Types of device elements that are side by side: sections and units."""


@dataclass(frozen=True)
class Partfield:
    """A field, `PFD`; its boundary is in longitude and latitude, degrees, None if the file has none."""

    id: str
    name: str
    boundary: BaseGeometry | None


@dataclass(frozen=True)
class DeviceElement:
    """A part of a machine, `DET`, and the id of its parent; "" for the machine itself.

    Kinds are 1 device, 2 function, 3 bin, 4 section, 5 unit, 6 connector, 7 navigation reference.
    """

    id: str
    kind: str
    parent: str


@dataclass(frozen=True)
class Task:
    """A task, `TSK`.

    Attributes:
        partfield: id of its field; "" if it has none.
        logs: names of its time logs without suffix, in the order of the file.
        begins: of its time spans as written, with or without a time zone; "" for an open one.
    """

    id: str
    name: str
    partfield: str
    logs: tuple[str, ...]
    begins: tuple[str, ...]


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
    notices = list(files.notices)
    root = parse_xml(files.read(MAIN), files.named(MAIN))
    if root.tag != TASK_DATA_ROOT:
        raise InputError("task-data-missing", main=files.named(MAIN), tag=root.tag[:40])
    items = list(_items(files, root, notices))
    maker = root.get("TaskControllerManufacturer") or root.get("ManagementSoftwareManufacturer")
    partfields = []
    for item in (item for item in items if item.tag == "PFD"):
        name = item.get("C") or item.get("A")
        polygons = [p for p in item.all("PLN") if p.get("A") == BOUNDARY_POLYGON]
        boundary = shapely.union_all([_polygon(p, name, notices) for p in polygons])
        partfields.append(Partfield(item.get("A"), name, None if boundary.is_empty else boundary))
    elements = []
    for device in (item for item in items if item.tag == "DVC"):
        parts = list(device.all("DET"))
        by_number = {part.get("B"): part.get("A") for part in parts}
        for part in parts:
            own, parent = part.get("A"), by_number.get(part.get("F"), "")
            elements.append(DeviceElement(own, part.get("C"), parent if parent != own else ""))
    return TaskData(
        version=f"{root.get('VersionMajor')}.{root.get('VersionMinor')}",
        maker=maker,
        partfields=_by_id(partfields, "partfield", notices),
        elements=_by_id(elements, "device element", notices),
        tasks=tuple(
            Task(
                id=item.get("A"),
                name=item.get("B") or item.get("A"),
                partfield=item.get("E"),
                logs=tuple(log.get("A") for log in item.all("TLG")),
                begins=tuple(span.get("A") for span in item.all("TIM")),
            )
            for item in items
            if item.tag == "TSK"
        ),
        notices=tuple(notices),
    )


def _items(files: TaskFiles, root: Element, notices: list[Notice]) -> Iterator[Element]:
    """The elements of the main file, with external files in place of the references to them."""
    for item in root.children:
        if item.tag != "XFR":
            yield item
            continue
        name = f"{item.get('A')}.XML"
        try:
            external = parse_xml(files.read(name), files.named(name))
        except InputError as error:
            notices.append(Notice("external-file-lost", lines=error.lines[0]))
            continue
        yield from external.children if external.tag == EXTERNAL else ()


_T = TypeVar("_T", Partfield, DeviceElement)


def _by_id(found: list[_T], kind: str, notices: list[Notice]) -> dict[str, _T]:
    by_id: dict[str, _T] = {}
    for one in found:
        if one.id in by_id:
            notices.append(Notice("id-twice", id=one.id, kind=kind))
        else:
            by_id[one.id] = one
    return by_id


def _polygon(item: Element, name: str, notices: list[Notice]) -> BaseGeometry:
    """A polygon with its holes, in version 4 of several exteriors; invalid rings are dropped with a notice."""
    shells: list[BaseGeometry] = []
    holes: list[BaseGeometry] = []
    for ring in item.all("LSG"):
        places = [(_degrees(p.get("D")), _degrees(p.get("C"))) for p in ring.all("PNT")]
        usable = [(lon, lat) for lon, lat in places if abs(lon) <= 180.0 and abs(lat) <= 90.0]
        far = len(usable) > 0 and bool(np.ptp(usable, axis=0).max() > MAX_FIELD_DEG)
        if len(usable) < 3 or len(usable) < len(places) or far or ring.get("A") not in (*EXTERIORS, INTERIOR):
            notices.append(Notice("boundary-ring", name=name, usable=len(usable), places=len(places)))
        else:
            (holes if ring.get("A") == INTERIOR else shells).append(shapely.make_valid(shapely.Polygon(usable)))
    return shapely.difference(shapely.union_all(shells), shapely.union_all(holes))


def _degrees(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return float("inf")
