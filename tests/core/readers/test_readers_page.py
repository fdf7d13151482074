"""The reference page names every reader, with what it gives."""

from __future__ import annotations

import re
from pathlib import Path

from furrowmap.core.readers.reader import Reader, readers
from furrowmap.core.readers.rosbag.clouds import FIELD_NAMES
from furrowmap.core.readers.rosbag.messages import FIXED_SIGMA_M

PAGE = (Path(__file__).resolve().parents[3] / "docs" / "reference" / "readers.md").read_text(encoding="utf-8")
GIVES = ("scans", "track", "poses", "states")


def row(reader: type[Reader]) -> str:
    gives = " | ".join("yes" if hasattr(reader, method) else "–" for method in GIVES)
    return f"| `{reader.format}` | {reader.title} | {gives} |"


def test_page__lists_every_reader_and_what_it_gives() -> None:
    ours = [reader for reader in readers() if reader.__module__.startswith("furrowmap.")]
    listed = re.findall(r"^\| `[\w-]+` \|.*(?:yes|–) \|$", PAGE, re.MULTILINE)
    assert sorted(listed) == sorted(row(reader) for reader in ours)


def test_page__names_the_fields_of_a_cloud_and_the_bound_of_a_fix() -> None:
    for meaning, names in FIELD_NAMES.items():
        words = {"intensity": "intensity", "ring": "laser", "time": "time"}[meaning]
        assert f"| {words} | {', '.join(f'`{name}`' for name in names)}" in PAGE
    assert f"at most {100 * FIXED_SIGMA_M:.0f} cm" in PAGE
