"""How an implement in task data lies to the logged positions: references, connectors and drawbars of its machines.

The positions are those of the navigation reference, of which the device description states the place. Machines are
joined at connectors (ISO 11783-10:2015, `CNN`); the connector's type (157) says whether the joint turns. Without a
navigation reference, positions are taken as those of a machine's reference point, to which all offsets refer.
"""

from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from furrowmap.core.readers.isoxml.devices import CONNECTOR, NAVIGATION, DeviceElement
from furrowmap.core.readers.isoxml.task_sections import OFFSET_X, OFFSET_Y, StatedValues
from furrowmap.core.runtime.errors import Notice
from furrowmap.core.values.sections import Link

CONNECTOR_TYPE: Final = 157
JOINTS_THAT_TURN: Final = frozenset({1, 2, 4, 5, 6, 7, 8, 10})
"""Types of connectors that turn: drawbar, semi-mounted, hook, clevis, piton, CUNA, ball, pivot wagon hitch.

The others are mounted rigidly: 3 on three points, 9 on the chassis; and 0, of an unknown type.
"""
MIN_DRAWBAR_M: Final = 0.3
"""A shorter distance from a joint to a reference point does not lead to an axle."""
Hop = tuple[str, str]
"""The connectors of the machine nearer to the positions and of the next."""


@dataclass(frozen=True)
class ImplementLinks:
    """The links from the logged positions to the reference point of a machine, and whether a joint is between."""

    links: tuple[Link, ...]
    is_drawn: bool
    notices: tuple[Notice, ...]


def implement_links(
    device: str, elements: Mapping[str, DeviceElement], connections: Sequence[tuple[str, str]], stated: StatedValues
) -> ImplementLinks:
    """How a machine is joined to the one that has the logged positions."""
    notices = []
    references = {one.device: one for one in elements.values() if one.kind == NAVIGATION}
    joined = [pair for pair in connections if pair[0] in elements and pair[1] in elements]
    if not joined and device not in references:
        joined = _only_connection(device, elements, references)
        if joined:
            names = " – ".join(elements[one].name for one in joined[0])
            notices.append(Notice("connection-assumed", names=names))
    hops = _hops_from_positions(device, elements, joined, references)
    first = elements[hops[0][0]].device if hops else device
    links = list(_links_from_reference(references.get(first), stated))
    if first not in references:
        notices.append(Notice("sections-from-reference-point", device=first))
    is_drawn = False
    for hop in hops:
        found, doubts = _links_of_hop(hop, elements, stated)
        is_drawn |= any(link.drawbar_m > 0.0 for link in found)
        links += found
        notices += doubts
    return ImplementLinks(tuple(link for link in links if link != Link((0.0, 0.0), 0.0)), is_drawn, tuple(notices))


def _only_connection(
    device: str, elements: Mapping[str, DeviceElement], references: Mapping[str, DeviceElement]
) -> list[tuple[str, str]]:
    """The connection that must be where the only other machine with a navigation reference has one connector."""
    connectors = [one for one in elements.values() if one.kind == CONNECTOR]
    own = [one.id for one in connectors if one.device == device]
    others = [one.id for one in connectors if one.device in references]
    return [(others[0], own[0])] if len(own) == len(others) == 1 == len(references) else []


def _hops_from_positions(
    device: str,
    elements: Mapping[str, DeviceElement],
    joined: Sequence[tuple[str, str]],
    references: Mapping[str, DeviceElement],
) -> list[Hop]:
    """The way from the nearest machine with a navigation reference, else from the furthest one, to a machine."""
    ways: dict[str, list[Hop]] = {device: []}
    order = deque([device])
    while order:
        here = order.popleft()
        if here in references:
            return ways[here]
        for one, other in [*joined, *((b, a) for a, b in joined)]:
            there = elements[one].device
            if elements[other].device == here and there not in ways:
                ways[there] = [(one, other), *ways[here]]
                order.append(there)
    return max(ways.values(), key=len)


def _links_from_reference(reference: DeviceElement | None, stated: StatedValues) -> Iterator[Link]:
    """From the positions to the reference point of their machine, the middle of an axle that does not slip."""
    if reference is None:
        return
    ahead_m = stated.offset_m(reference.id, OFFSET_X) or 0.0
    right_m = stated.offset_m(reference.id, OFFSET_Y) or 0.0
    if ahead_m > MIN_DRAWBAR_M:
        yield Link((0.0, right_m), ahead_m)
    else:
        yield Link((-ahead_m, right_m), 0.0)


def _links_of_hop(
    hop: Hop, elements: Mapping[str, DeviceElement], stated: StatedValues
) -> tuple[list[Link], list[Notice]]:
    """From the reference point of a machine to that of the next."""
    ahead_m = [stated.offset_m(one, OFFSET_X) or 0.0 for one in hop]
    left_m = [-(stated.offset_m(one, OFFSET_Y) or 0.0) for one in hop]
    kinds = [stated.number(one, CONNECTOR_TYPE) for one in hop]
    kind = next((one for one in reversed(kinds) if one), 0)
    rigid = [Link((ahead_m[0] - ahead_m[1], left_m[0] - left_m[1]), 0.0)]
    if kind not in JOINTS_THAT_TURN:
        return rigid, []
    if ahead_m[0] > 0.0 or ahead_m[1] <= MIN_DRAWBAR_M:
        return rigid, [Notice("drawbar-unknown", device=elements[hop[1]].device)]
    return [Link((ahead_m[0], left_m[0]), ahead_m[1]), Link((0.0, -left_m[1]), 0.0)], []
