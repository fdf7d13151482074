"""Writes the tables of readers and devices in docs/reference/readers.md: ``python scripts/reader_reference.py``."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Final

from furrowmap.core.readers.reader import Reader, readers
from furrowmap.core.session.examination import devices

PAGE: Final = Path(__file__).resolve().parents[1] / "docs" / "reference" / "readers.md"
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


def page(text: str) -> str:
    """The page with its tables as they should be."""
    tables = iter((table(), tried()))
    return _TABLE.sub(lambda _: next(tables), text, count=2)


def _row(reader: type[Reader]) -> str:
    gives = ", ".join(data for method, data in GIVES.items() if hasattr(reader, method))
    return f"| `{reader.format}` | {reader.title} | {gives or 'points'} |\n"


def _order(reader: type[Reader]) -> tuple[list[bool], str]:
    return [not hasattr(reader, method) for method in GIVES], reader.format


if __name__ == "__main__":
    PAGE.write_text(page(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
