"""The page of the Python API documents exactly what `furrowmap` exports."""

from __future__ import annotations

import re
from pathlib import Path

import furrowmap

PAGE = Path(__file__).resolve().parents[2] / "docs" / "reference" / "api.md"


def test_api_page__documents_every_exported_name() -> None:
    page = PAGE.read_text(encoding="utf-8")
    exported = set(getattr(furrowmap, "__all__", ()))
    documented = set(re.findall(r"^::: furrowmap\.([\w.]+)$", page, re.MULTILINE))
    constants = {name for name in exported if name.startswith("__")}
    assert documented == exported - constants
    assert {name for name in constants if f"`furrowmap.{name}`" not in page} == set()


def test_exported_names__are_there_and_described() -> None:
    for name in getattr(furrowmap, "__all__", ()):
        assert name.startswith("__") or getattr(furrowmap, name).__doc__, name
