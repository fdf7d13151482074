"""Writes the table of products in docs/reference/products.md: ``python scripts/product_reference.py``."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Final

from furrowmap.exporters.files.result_folder import RUN_PRODUCTS

PAGE: Final = Path(__file__).resolve().parents[1] / "docs" / "reference" / "products.md"
_TABLE: Final = re.compile(r"(?<=<!-- Written by scripts/product_reference\.py -->\n\n)(?:\|.*\n)+")


def page(text: str) -> str:
    """The page with its table as it should be."""
    shown = {name: content for name, content in RUN_PRODUCTS.items() if not re.search(r"\.qml|_[23]\.", name)}
    rows = "".join(f"| `{name}` | {content} |\n" for name, content in shown.items())
    rows += "| `implement_2.npz`, `states_2.csv`, … | the same of the second and third implement of several |\n"
    rows += "| `*.qml` | styles of the rasters of the same names, which QGIS loads with them |\n"
    return _TABLE.sub(lambda _: f"| file | content |\n| --- | --- |\n{rows}", text, count=1)


if __name__ == "__main__":
    PAGE.write_text(page(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
