"""The reference page lists every reader with the data that it provides."""

from __future__ import annotations

import runpy
from pathlib import Path

from furrowmap.core.readers.reader import readers
from furrowmap.core.readers.rosbag.cloud_messages import FIELD_NAMES
from furrowmap.core.readers.rosbag.ros_messages import FIXED_SIGMA_M

CHECKOUT = Path(__file__).resolve().parents[3]
PAGE = (CHECKOUT / "docs" / "reference" / "readers.md").read_text(encoding="utf-8")


def test_page__is_what_the_script_writes() -> None:
    script = runpy.run_path(str(CHECKOUT / "scripts" / "reader_reference.py"))
    assert script["page"](PAGE) == PAGE, "run scripts/reader_reference.py"
    assert script["table"]() in PAGE


def test_page__has_every_reader() -> None:
    ours = [reader for reader in readers() if reader.__module__.startswith("furrowmap.")]
    for reader in ours:
        methods = {
            "scans": "laser scans",
            "track": "positions",
            "inertial": "IMU",
            "attitude": "attitudes",
            "images": "images",
            "poses": "poses",
            "states": "implement states",
        }
        gives = ", ".join(data for method, data in methods.items() if hasattr(reader, method)) or "points"
        row = f"| `{reader.format}` | {reader.title} | {gives} |"
        assert row in PAGE.splitlines()


def test_page__names_the_fields_of_a_cloud_and_the_bound_of_a_fix() -> None:
    for meaning, names in FIELD_NAMES.items():
        words = {"intensity": "intensity", "ring": "laser", "time": "time"}[meaning]
        assert f"| {words} | {', '.join(f'`{name}`' for name in names)}" in PAGE
    assert f"at most {100 * FIXED_SIGMA_M:.0f} cm" in PAGE
