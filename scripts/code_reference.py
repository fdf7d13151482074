"""Writes docs/reference/codes.md from the catalogue of messages: ``python scripts/code_reference.py``."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from furrowmap.core.runtime.languages.texts import templates

PAGE: Final = Path(__file__).resolve().parents[1] / "docs" / "reference" / "codes.md"
HEAD: Final = """\
# Codes of errors and warnings

<!-- Written by scripts/code_reference.py from the catalogue of messages. -->

Every error and warning has a code that does not change between versions: `code` in the JSON of an error, and in
`warnings` of `report.json`. `furrowmap explain CODE` prints the messages of a code, and what to do about them.

Warnings do not change the exit status. A run prints them and lists them in its reports.
"""


def page() -> str:
    """The generated page."""
    keys = templates("en")
    errors = sorted({key.partition(".")[0] for key, parts in keys.items() if "what" in parts})
    warnings = sorted({key.partition(".")[0] for key, parts in keys.items() if "text" in parts})
    return "\n".join([HEAD, "## Warnings\n", _list(warnings), "\n## Errors\n", _list(errors), ""])


def _list(codes: list[str]) -> str:
    return ",\n".join(f"`{code}`" for code in codes)


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
