"""The page of codes is that of the source."""

from __future__ import annotations

import re
import runpy
from pathlib import Path

from furrowmap.core.runtime.errors import Notice
from tests.codes_met import MET, listed, named
from tests.core.readers.las.test_hostile import ERRORS, NOTICES

CHECKOUT = Path(__file__).resolve().parents[1]


def test_code_reference__is_what_the_script_writes() -> None:
    page = runpy.run_path(str(CHECKOUT / "scripts" / "code_reference.py"))["page"]
    written = (CHECKOUT / "docs" / "reference" / "codes.md").read_text(encoding="utf-8")
    assert written == page(), "run scripts/code_reference.py"


def test_code_reference__has_every_code_of_the_source() -> None:
    page = (CHECKOUT / "docs" / "reference" / "codes.md").read_text(encoding="utf-8")
    listed = set(re.findall(r"^\| `([a-z0-9-]+)` \|", page, re.MULTILINE))
    source = "".join(
        f.read_text(encoding="utf-8") for part in ("app", "core", "exporters") for f in (CHECKOUT / part).rglob("*.py")
    )
    used = set(re.findall(r'code="([a-z0-9-]+)"', source))
    assert len(used) > 50
    assert not used - listed


def test_codes__are_recorded_as_errors_and_warnings_are_made() -> None:
    assert Notice("made-in-a-test", "text").code in MET
    assert len(listed()) > 300
    met = named({"made-in-a-test", " ".join(("not", "expected", "here"))})
    assert "made-in-a-test" in met
    assert "not expected here" not in met


def test_code_reference__has_every_code_that_hostile_clouds_end_in() -> None:
    page = (CHECKOUT / "docs" / "reference" / "codes.md").read_text(encoding="utf-8")
    listed = set(re.findall(r"^\| `([a-z0-9-]+)` \|", page, re.MULTILINE))
    met = {*ERRORS.values(), *(code for _, codes in NOTICES.values() for code in codes)}
    assert not met - listed
