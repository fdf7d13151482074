"""docs/reference/commands.md says what the commands themselves say."""

from __future__ import annotations

import runpy
from pathlib import Path

CHECKOUT = Path(__file__).resolve().parents[2]


def test_page__is_what_the_script_writes() -> None:
    page = runpy.run_path(str(CHECKOUT / "scripts" / "command_reference.py"))["page"]
    written = (CHECKOUT / "docs" / "reference" / "commands.md").read_text(encoding="utf-8")
    assert written == page(), "run scripts/command_reference.py"
