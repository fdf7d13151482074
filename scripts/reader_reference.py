"""Writes the tables in docs/reference/readers.md: ``python scripts/reader_reference.py``."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path
from typing import Any, Final

from furrowmap.core.readers.reader import Reader, readers
from furrowmap.core.session.examination import devices

PAGE: Final = Path(__file__).resolve().parents[1] / "docs" / "reference" / "readers.md"
MATRIX: Final = PAGE.parents[2] / "tests" / "inputs" / "matrix.toml"
GIVES: Final = {
    "scans": "laser scans",
    "track": "positions",
    "inertial": "IMU",
    "attitude": "attitudes",
    "images": "images",
    "poses": "poses",
    "states": "implement states",
}
"""Methods of readers, and the data that they return."""
_TABLE: Final = re.compile(r"(?<=<!-- Written by scripts/reader_reference\.py -->\n\n)(?:\|.*\n)+")


def table() -> str:
    """The table of furrowmap's own readers, those with laser scans first."""
    ours = [reader for reader in readers() if reader.__module__.startswith("furrowmap.")]
    return "| format | title | data |\n| --- | --- | --- |\n" + "".join(map(_row, sorted(ours, key=_order)))


def tried() -> str:
    """The table of devices: what they were tried on and checked against, and what is not read."""
    keys = ("name", "tried", "checked", "unread")
    rows = "".join(f"| {' | '.join(device[key] for key in keys)} |\n" for device in devices())
    return "| device | tried on | checked against | not read |\n| --- | --- | --- | --- |\n" + rows


def inputs() -> str:
    """The table of properties of inputs, a kind a row: the places that take it, what is read there, what is refused."""
    kinds = tomllib.loads(MATRIX.read_text(encoding="utf-8"))["kinds"]
    head = "| kind | where | read | refused |\n| --- | --- | --- | --- |\n"
    return head + "".join(map(_kind, kinds))


def _kind(kind: dict[str, Any]) -> str:
    names = dict.fromkeys(name for names in kind["places"].values() for name in names)
    options: dict[str, list[str]] = {}
    for name in names:
        words = name.split()
        if len(words) > 1:
            options.setdefault(words[-1], []).append(" ".join(words[:-1]))
    where = [f"`{option}` of {', '.join(f'`{one}`' for one in commands)}" for option, commands in options.items()]
    keys = [name.split(".") for name in names if "." in name and " " not in name]
    where += [f"`[{table}] {key}`" for table, key in keys]
    read = "; ".join(kind["read"])
    either = kind.get("read_or_refused", [])
    read += f"; read or refused, by the place: {'; '.join(either)}" if either else ""
    return f"| {kind['title']} | {'; '.join(where)} | {read} | {'; '.join(kind.get('refused', [])) or '–'} |\n"


def page(text: str) -> str:
    """The page with its tables as they should be."""
    tables = iter((table(), tried(), inputs()))
    return _TABLE.sub(lambda _: next(tables), text, count=3)


def _row(reader: type[Reader]) -> str:
    gives = ", ".join(data for method, data in GIVES.items() if hasattr(reader, method))
    return f"| `{reader.format}` | {reader.title} | {gives or 'points'} |\n"


def _order(reader: type[Reader]) -> tuple[list[bool], str]:
    return [not hasattr(reader, method) for method in GIVES], reader.format


if __name__ == "__main__":
    PAGE.write_text(page(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
