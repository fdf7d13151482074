"""The reference page lists every product of a run."""

from __future__ import annotations

import re
from pathlib import Path

from furrowmap.exporters.files.result_folder import RUN_PRODUCTS

PAGE = (Path(__file__).resolve().parents[3] / "docs" / "reference" / "products.md").read_text(encoding="utf-8")


def test_page__lists_the_products_of_a_run() -> None:
    table = PAGE[PAGE.index("| --- |") : PAGE.index("\n\n", PAGE.index("| --- |"))]
    listed = set(re.findall(r"`([\w.*]+)`", "\n".join(row.split("|")[1] for row in table.splitlines()[1:])))
    shown = {name for name in RUN_PRODUCTS if not name.endswith(".qml") and not re.search(r"_[23]\.", name)}
    assert listed == shown | {"implement_2.npz", "states_2.csv", "*.qml"}
