"""The last lines of six runs, word by word. The reports are those of real runs, without what the lines leave out."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, Final

import pytest

from furrowmap.core.runtime.languages.texts import LANGUAGES
from furrowmap.workflows.run.words import run_words

RUNS: Final = Path(__file__).with_name("last_lines")
NAMES: Final = ("drive", "contradicted-drive", "flight-with-parcels", "no-implement", "no-mounting", "log-alone")


def report(name: str) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((RUNS / f"{name}.json").read_text(encoding="utf-8"))
    return found


@pytest.mark.parametrize("language", LANGUAGES)
@pytest.mark.parametrize("name", NAMES)
def test_last_lines__are_these(name: str, language: str) -> None:
    shown = run_words(report(name), Path("result"), language)
    assert f"{shown}\n" == (RUNS / f"{name}.{language}.txt").read_text(encoding="utf-8")


@pytest.mark.parametrize("name", NAMES)
def test_last_lines__name_one_cause_at_most(name: str) -> None:
    """What follows from it, and what else was found, is in the report."""
    content = report(name)
    shown = run_words(content, Path("result"), "en")
    first, *others = [*content["verdict"]["findings"], {"text": "nothing", "follows": []}]
    assert first["text"][:40] in shown
    assert not [one["text"] for one in (*first["follows"], *others[:-1]) if one["text"][:60] in shown]


def test_last_lines__count_further_findings() -> None:
    content = report("no-mounting")
    second = {"code": "boundary-apart", "text": "The boundary is elsewhere.", "follows": []}
    content["verdict"]["findings"].append(second)
    content["warnings"].append({"code": "boundary-apart", "follows": None})
    assert "Further findings in the report: 1." in run_words(content, Path("result"), "en")


def test_last_lines__of_several_tools_name_each() -> None:
    content = report("drive")
    figures = content["figures"]
    content["figures"] |= {"tools": [figures | {"name": "harrow"}, figures | {"name": "drill"}]}
    shown = run_words(content, Path("result"), "en")
    assert shown.count("  worked, harrow") == shown.count("  worked, drill") == 1


def test_last_lines__of_a_drive_with_the_tool_up_all_the_time() -> None:
    content = report("drive")
    content["figures"]["passes"] = 0
    assert "the implement was never in the ground" in run_words(content, Path("result"), "en")
