"""docs/reliability.md: 26 promises, each with the tests named after it."""

from __future__ import annotations

import re
import runpy
from pathlib import Path

CHECKOUT = Path(__file__).resolve().parents[1]
SCRIPT = runpy.run_path(str(CHECKOUT / "scripts" / "reliability_reference.py"))


def test_page__lists_the_tests_of_each_promise() -> None:
    text = SCRIPT["PAGE"].read_text(encoding="utf-8")
    assert text == SCRIPT["page"](), "run make pages"
    assert [int(number) for number in re.findall(r"^### (\d+)\. ", text, re.MULTILINE)] == list(SCRIPT["PROMISES"])


def test_promises__have_a_test_each() -> None:
    assert [number for number in SCRIPT["PROMISES"] if number not in SCRIPT["tests"]()] == []
