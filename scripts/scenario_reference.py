"""Writes docs/reference/scenario.md from the definition of the scenario: ``python scripts/scenario_reference.py``."""

from __future__ import annotations

import json
import math
import typing
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec

from furrowmap.core.simulator.scenario import OF_SCENARIO, SOILS, EarlierDrive, Scenario

PAGE = Path(__file__).resolve().parents[1] / "docs" / "reference" / "scenario.md"
HEAD = """\
# scenario.toml

<!-- Written by scripts/scenario_reference.py from the definition of the scenario. -->

The input of `furrowmap simulate SCENARIO -o DIR`. All keys are optional; unknown keys are errors. A line is a key with
its default, its allowed values and its meaning. Names contain units; see [frames and angles](../explanation/frames.md).
Positions in the field are relative to the south-western corner of the ground grid. The output folder contains a
`scenario.toml` with all keys, which reproduces the recording exactly.

With `[flight]`, an aircraft flies: `[drive]`, `[sway]`, `[tractor]`, `[implement]` and `[gnss.clas]` do not matter
then, and `[lidar]` and `[antenna]` are to be stated, for their defaults are a tractor's. Its receiver is `[gnss.rtk]`.
`[imu]` and `[mount]` may be in both kinds of scenario. `furrowmap simulate flight` shows an example. Beyond its edges
the ground grid repeats itself.

```toml
seed = 3

[drive]
turns = "fishtail"
passes = 4
pass_m = [30.0]

[soil]
kind = "ploughed"

[gnss.clas]
outage_s = [[40.0, 45.0]]
```
"""
OPEN = {
    "field": "around the drive",
    "drive": "from the drive",
    "flight": "from the path",
    "soil": "by kind",
    "lidar": "as above",
    "second_lidar": "as above",
    "clock": "as above",
}
"""The default of values that depend on others."""
EARLIER = """
Its tables are `[earlier.drive]`, `[earlier.soil]` and `[earlier.implement]`, with the keys above. Several drives are
several `[[earlier]]`, the first one first. The scenarios of drives on one field have the same `field.size_e_m`,
`field.size_n_m`, `[place]` and `[soil]`, with one `soil.seed`; their `seed`, which makes the errors of sensors and
drivers, differs:

```toml
seed = 12

[field]
size_e_m = 46.0
size_n_m = 34.0

[drive]
start_xy_m = [13.5, 14.8]

[soil]
seed = 3

[[earlier]]
seed = 11
drive.start_xy_m = [13.5, 10.0]
drive.passes = 2
```
"""
KINDS = """\
| kind | random roughness | correlation length | rows: amplitude, spacing | straw or plants | furrows after the pass |
| --- | --- | --- | --- | --- | --- |
"""


def page() -> str:
    """The generated page."""
    parts = [HEAD, section("", Scenario, Scenario())]
    shown: dict[type[msgspec.Struct], str] = {}
    for name, value in tables(Scenario()):
        first = shown.setdefault(type(value), name)
        parts.append(section(name, type(value), value) if first == name else repeated(name, value, first))
        if name == "soil":
            rows = [
                f"| `{kind}` | {s['sigma'] * 1000:.0f} mm | {s['corr'] * 100:.0f} cm | {s['row'] * 1000:.0f} mm, "
                f"{s['spacing'] * 100:.0f} cm | {s['straw'] * 100:.1f} %, {s['height']:.2f} m | "
                f"{s['furrow'] * 1000:.0f} mm |\n"
                for kind, s in SOILS.items()
            ]
            parts.append(KINDS + "".join(rows))
    parts.append(section("[earlier]", EarlierDrive, Scenario()) + EARLIER)
    return "\n".join(parts)


def tables(whole: msgspec.Struct, above: str = "") -> Iterator[tuple[str, msgspec.Struct]]:
    """The tables of a scenario with keys, by name."""
    for name, hint in typing.get_type_hints(type(whole)).items():
        value = getattr(whole, name)
        if value is None:  # a table that may be left out
            value = typing.get_args(hint)[0]()
        if isinstance(value, msgspec.Struct):
            deeper = list(tables(value, f"{above}{name}."))
            yield from deeper or [(above + name, value)]


def section(name: str, kind: type[msgspec.Struct], value: msgspec.Struct) -> str:
    """The section of a table."""
    title = f"## `[{name}]`\n\n{(kind.__doc__ or '').splitlines()[0]}\n" if name else "## Top level\n"
    fresh = {field.name: field.default for field in msgspec.structs.fields(kind)}
    rows = []
    for key, hint in typing.get_type_hints(kind, include_extras=True).items():
        if typing.get_origin(hint) is not Annotated:
            continue
        type_, meta = typing.get_args(hint)
        stated = getattr(value, key) if name.startswith("gnss") else fresh[key]
        values = f" ({allowed})" if (allowed := limits(type_, meta)) else ""
        rows.append(f"- `{key}` = {default(stated, name)}{values}: {meta.description}")
    return "\n".join([title, *rows]) + "\n"


def repeated(name: str, value: msgspec.Struct, first: str) -> str:
    """The section of a table with the keys of an earlier one: its defaults."""
    defaults = ", ".join(f"`{key}` = {default(getattr(value, key), name)}" for key in value.__struct_fields__)
    return f"## `[{name}]`\n\nThe keys of `[{first}]`: {defaults}.\n"


def default(value: Any, table: str) -> str:
    """A default in TOML."""
    first = value[0] if isinstance(value, tuple) and value else value
    if isinstance(first, float) and math.isnan(first):
        return OPEN[table]
    if value == OF_SCENARIO and isinstance(value, int):
        return "as `seed`"
    if value and isinstance(first, tuple):
        return f"{len(value)} boxes"
    return f"`{json.dumps(value, ensure_ascii=False)}`"


def limits(type_: Any, meta: msgspec.Meta) -> str:
    """The valid values of a key."""
    if words := list(literals(type_)):
        return ", ".join(f"`{json.dumps(word)}`" for word in words)
    signs = (("≥", meta.ge), (">", meta.gt), ("≤", meta.le), ("<", meta.lt))
    return ", ".join(f"{sign}{limit:g}" for sign, limit in signs if limit is not None)


def literals(type_: Any) -> Iterator[Any]:
    """The values of a type that lists them."""
    if typing.get_origin(type_) is Literal:
        yield from typing.get_args(type_)
    elif typing.get_origin(type_) not in (tuple, list):
        for part in typing.get_args(type_):
            yield from literals(part)


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
