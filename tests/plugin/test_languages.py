"""A result that was written in English, opened in a Japanese QGIS: every word is Japanese, values and tips included."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import TYPE_CHECKING

from tests.exporters.farm.result_folders import write_result
from tests.exporters.vectors.test_style_words import SYMBOLS

if TYPE_CHECKING:
    from conftest import QgisRoot

CHECKOUT = Path(__file__).resolve().parents[2]
NAMES = {"POSIX", "SBAS", "GNSS", "IMU", "FIX", "FLOAT", "deg", "mps"}


def test_result__is_japanese_in_a_japanese_qgis(qgis: QgisRoot, tmp_path: Path) -> None:
    result = write_result(tmp_path / "result")
    (tmp_path / "furrowmap").symlink_to(CHECKOUT / "plugin")
    script = Path(__file__).with_name("words_in_qgis.py")
    found = json.loads(qgis.run("python3", script, tmp_path / "furrowmap", result).splitlines()[-1])
    assert {"passes", "coverage", "trajectory", "misses"} <= found["layers"].keys()
    assert found["layers"]["passes"]["map tips"][0].startswith("<b>行程 1</b>")
    for name, kinds in {**found["layers"], "surfaces": {"names": found["surfaces"]}}.items():
        for kind, texts in kinds.items():
            for text in texts:
                latin = re.findall(r"[A-Za-z]{2,}", re.sub(r"<[^>]*>", " ", text))
                assert set(latin) <= SYMBOLS | NAMES, (name, kind, text)
