"""Several implements in a file: tables `[[implement]]`, of which one moves the soil."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final

from furrowmap.core.values.machine import MachineImplement
from furrowmap.core.values.session import Implement

TABLE: Final = "implement"
FURTHER: Final = "further_implements"
MOST: Final = 3
"""Implements of one machine: in front, between the axles, behind."""


def apart(data: dict[str, Any]) -> dict[str, Any]:
    """The content of a file with the implement that moves soil as `implement`, the others as `further_implements`.

    It is the one with `moves_soil`, else the rearmost. What is not a list of tables stays as it is.
    """
    tools = data.get(TABLE)
    if not isinstance(tools, list) or not tools or not all(isinstance(tool, dict) for tool in tools):
        return data
    first = min(range(len(tools)), key=lambda k: (tools[k].get("moves_soil") is not True, _x_m(tools[k])))
    return data | {TABLE: tools[first], FURTHER: tools[:first] + tools[first + 1 :]}


def together(data: Mapping[str, Any]) -> dict[str, Any]:
    """The reverse of :func:`apart`: what goes into a file."""
    rest = {key: value for key, value in data.items() if key != FURTHER}
    return rest | {TABLE: [data[TABLE], *data[FURTHER]]} if data.get(FURTHER) else rest


def implement_faults(tools: Sequence[Implement | MachineImplement]) -> Iterator[str]:
    """What is wrong with several implements, or with their names."""
    if len(tools) < 2:
        return
    if len(tools) > MOST:
        yield f"[[implement]] is given {len(tools)} times; at most {MOST} are allowed"
    names = [tool.name.strip() for tool in tools]
    if not all(names):
        yield 'each of several [[implement]] needs a name, such as name = "front roller"'
    if len(set(names)) < len(names):
        yield f"two [[implement]] have the name {next(name for name in names if names.count(name) > 1)!r}"
    if sum(tool.moves_soil for tool in tools) > 1:
        yield "implement.moves_soil is true of more than one [[implement]]"


def _x_m(tool: Mapping[str, Any]) -> int | float:
    """How far forward a tool is, as the file has it, also a whole number of any length; no place is refused later."""
    place = tool.get("xy_m")
    x_m = place[0] if isinstance(place, list) and place else 0.0
    return x_m if isinstance(x_m, int | float) else 0.0
