"""Writes into docs/reliability.md, below each promise, the files with its tests (`test_promise_07__what_holds`)."""

from __future__ import annotations

import re
from collections import defaultdict
from pathlib import Path
from typing import Final

CHECKOUT: Final = Path(__file__).resolve().parents[1]
PAGE: Final = CHECKOUT / "docs" / "reliability.md"
PROMISES: Final = range(1, 27)


def tests() -> dict[int, list[str]]:
    """Promise → files with its tests."""
    found: defaultdict[int, list[str]] = defaultdict(list)
    for path in sorted((CHECKOUT / "tests").rglob("*.py")):
        file, text = path.relative_to(CHECKOUT).as_posix(), path.read_text(encoding="utf-8")
        for number in sorted(set(re.findall(r"^ *def test_promise_(\d\d)__", text, re.MULTILINE))):
            found[int(number)].append(file)
    return found


def page() -> str:
    """The page with its lists of tests written again."""
    found = tests()

    def listed(mark: re.Match[str]) -> str:
        files = [f"`{file}`" for file in found[int(mark[1])]]
        lines = [f"- {', '.join(files)}"] * bool(files)
        return "\n".join([f"<!-- tests {mark[1]} -->", "", *lines, *[""] * bool(lines), ""])

    text = PAGE.read_text(encoding="utf-8")
    return re.sub(r"<!-- tests (\d+) -->\n(?:\n*- .*)*\n*", listed, text).rstrip("\n") + "\n"


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
