"""The pages on scenarios agree with what the simulator reads."""

from __future__ import annotations

import re
import runpy
from pathlib import Path

import pytest

from furrowmap.core.simulator.scenario import scenario_from

CHECKOUT = Path(__file__).resolve().parents[3]


def test_scenario_reference__is_up_to_date() -> None:
    page = runpy.run_path(str(CHECKOUT / "scripts" / "scenario_reference.py"))["page"]
    written = (CHECKOUT / "docs" / "reference" / "scenario.md").read_text(encoding="utf-8")
    assert written == page(), "run scripts/scenario_reference.py"


@pytest.mark.parametrize("name", ["reference/scenario.md", "how-to/plan-a-sensor-mount.md"])
def test_pages__scenarios_in_them_are_read(name: str) -> None:
    text = (CHECKOUT / "docs" / name).read_text(encoding="utf-8")
    blocks = [block for block in re.findall(r"```toml\n(.*?)```", text, re.DOTALL) if "[trajectory]" not in block]
    assert blocks
    for block in blocks:
        assert scenario_from(block, name).drive.passes >= 1
