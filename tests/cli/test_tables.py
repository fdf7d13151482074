"""Figures in words: units from names, nothing that commands a terminal."""

from __future__ import annotations

from typing import Any

import pytest

from furrowmap.cli.result_tables import MAX_PARCELS, figures, parcel_table, table


@pytest.mark.parametrize(
    ("name", "value", "label", "words"),
    [
        ("duration_s", 59.8, "duration", "59.8 s"),
        ("worked_area_m2", 42.505, "worked area", "42.505 m²"),
        ("roll_deg", -1.5, "roll", "-1.5°"),
        ("points", 7_977_874, "points", "7,977,874"),
        ("year", 2026, "year", "2026"),
        ("height_m", [1.0, 2.5], "height", "1, 2.5 m"),
        ("bounds_m", [[1.0, 2.0], [3.0, 4.0]], "bounds m", "1, 2; 3, 4"),
        ("t0_unix_s", 1_781_141_020.3, "t0", "2026-06-11T01:23:40.300Z"),
        ("sigma_m", None, "sigma m", "unknown"),
        ("whole", True, "whole", "yes"),
        ("gaps", {"count": 2, "longest_s": 5.1}, "gaps", "count 2, longest 5.1 s"),
        ("other_packets", {}, "other packets", "none"),
        ("topics", {"/a": {"messages": 1}, "/b": {"messages": 2}}, "topics", "/a: messages 1\n/b: messages 2"),
        ("scans", {"points": 3, "gaps": {"count": 2, "s": 5}}, "scans", "points 3\ngaps count 2, s 5"),
        ("topic", "/\x1b[31mred", "topic", "/\\x1b[31mred"),
    ],
)
def test_figure__has_its_unit_behind_it(name: str, value: Any, label: str, words: str) -> None:
    assert figures({name: value}) == [(label, words)]


def test_table__aligns_values_and_their_further_lines() -> None:
    assert table([("a", "1"), ("longer", "2\n3")]) == "  a       1\n  longer  2\n          3"


def test_parcels__are_aligned_and_the_rest_is_counted() -> None:
    rows = [{"id": f"P{k}", "height_m": None if k == 1 else 0.123456, "note": "x"} for k in range(MAX_PARCELS + 2)]
    lines = parcel_table(rows, ["height_m"], "parcels.csv").splitlines()
    assert lines[:3] == [" id  height_m", " P0    0.1235", " P1          "]
    assert lines[-1] == "… 2 more in parcels.csv"
    assert len(lines) == MAX_PARCELS + 2
    assert "more" not in parcel_table(rows[:3], ["height_m"], "parcels.csv")
