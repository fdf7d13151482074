"""The reference page lists every product of a run."""

from __future__ import annotations

import runpy
from pathlib import Path

CHECKOUT = Path(__file__).resolve().parents[3]
PAGE = (CHECKOUT / "docs" / "reference" / "products.md").read_text(encoding="utf-8")


def test_page__is_what_the_script_writes() -> None:
    script = runpy.run_path(str(CHECKOUT / "scripts" / "product_reference.py"))
    assert script["page"](PAGE) == PAGE, "run scripts/product_reference.py"
    assert "| `cloud.copc.laz` | points" in PAGE
