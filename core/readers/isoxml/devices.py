"""Devices of task data: their elements, and the connections between them (ISO 11783-10:2015, annex D)."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from furrowmap.core.readers.isoxml.xml import Element

MAX_ELEMENT_LEVELS: Final = 32
"""More than any machine has elements one in another."""
INT32: Final = np.iinfo(np.int32)
SECTION: Final = "4"
UNIT: Final = "5"
CONNECTOR: Final = "6"
NAVIGATION: Final = "7"
"""Kinds of device elements; 1 is the device itself, 2 a function, 3 a bin."""
PARALLEL: Final = frozenset({SECTION, UNIT})
"""Kinds of device elements that are side by side."""


@dataclass(frozen=True)
class DeviceElement:
    """A part of a machine, `DET`, and the id of its parent; "" for the machine itself.

    Attributes:
        kind: 1 device, 2 function, 3 bin, 4 section, 5 unit, 6 connector, 7 navigation reference.
        device: id of its machine.
        name: its designator, or its id.
        number: by which elements of a kind are counted, sections from left to right; 0 where not stated.
        properties: raw values that the description states once, `DPT`, by data dictionary identifier.
    """

    id: str
    kind: str
    parent: str
    device: str
    name: str
    number: int
    properties: Mapping[int, int]


def device_elements(device: Element) -> Iterator[DeviceElement]:
    """The elements of a machine, `DVC`."""
    parts = list(device.all("DET"))
    by_object = {part.get("B"): part.get("A") for part in parts}
    properties = dict(_properties(device))
    for part in parts:
        own = part.get("A")
        parent = by_object.get(part.get("F"), "")
        stated = [properties[ref.get("A")] for ref in part.all("DOR") if ref.get("A") in properties]
        yield DeviceElement(
            id=own,
            kind=part.get("C"),
            parent=parent if parent != own else "",
            device=device.get("A"),
            name=part.get("D") or own,
            number=_whole(part.get("E"), 10) or 0,
            properties=dict(stated),
        )


def _properties(device: Element) -> Iterator[tuple[str, tuple[int, int]]]:
    """The id of each property's object, its data dictionary identifier and its value."""
    for item in device.all("DPT"):
        ddi = _whole(item.get("B"), 16)
        value = _whole(item.get("C"), 10)
        if ddi is not None and value is not None:
            yield item.get("A"), (ddi, value)


def _whole(text: str, base: int) -> int | None:
    """A whole number of 32 bits; None for another text."""
    try:
        number = int(text, base)
    except ValueError:
        return None
    return number if INT32.min <= number <= INT32.max else None


def ancestors(element: str, elements: Mapping[str, DeviceElement]) -> list[str]:
    """Ids of the parents of an element, the direct one first; at most :data:`MAX_ELEMENT_LEVELS`."""
    found: list[str] = []
    while element in elements and (element := elements[element].parent) and element not in found:
        found.append(element)
        if len(found) == MAX_ELEMENT_LEVELS:
            break
    return found
