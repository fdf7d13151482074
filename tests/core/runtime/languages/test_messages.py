"""Every error and warning of the source has its Japanese, and in it no English sentence."""

from __future__ import annotations

import re
import runpy
from pathlib import Path

import pytest

from furrowmap.core.runtime.errors import InputError, Notice
from furrowmap.core.runtime.languages.catalogue import HOLE, catalogue
from furrowmap.core.runtime.languages.translation import translated, translated_error, translated_notice

CHECKOUT = Path(__file__).resolve().parents[4]
TEMPLATES: dict[str, list[str]] = runpy.run_path(str(CHECKOUT / "scripts" / "message_texts.py"))["templates"]()
ENGLISH = re.compile(r"\b[a-z]{2,} [a-z]{2,}\b")
"""Two words of English beside each other."""
QUOTED = re.compile(
    r"'[^']*'|\"[^\"]*\"|\([^)]*--[^)]*\)|--[a-z-]+(?: [\w.,]+)?|GRANT [A-Z ,]+|（例：[^）]*）|\[[a-z_]+\] [a-z_]+"
)
"""Commands, keys and values, which are the same in every language."""
NAMES = (
    "adjusted standard GPS time",
    "adjusted standard time",
    "cloth-simulation-filter",
    "pip install",
    "furrowmap qgis install",
)


@pytest.mark.parametrize("code", TEMPLATES)
def test_japanese__of_every_text_of_a_code(code: str) -> None:
    known = catalogue("ja").of_code(code)
    for text in TEMPLATES[code]:
        assert text in known, "scripts/message_texts.py lists what is missing"
        values = [f"⟪{k}⟫" for k in range(text.count(HOLE))]
        filled = "".join(part + value for part, value in zip(text.split(HOLE), [*values, ""], strict=True))
        found = translated(" ".join(filled.split()), "ja", code)
        assert re.search(r"[ぁ-ヿ一-龥（：]", found), text
        assert not ENGLISH.search(_without_names(found)), found
        assert re.findall(r"⟪\d+⟫", filled) == sorted(set(re.findall(r"⟪\d+⟫", found)), key=lambda v: int(v[1:-1])), (
            found
        )


def test_catalogue__has_no_message_that_the_source_has_not() -> None:
    written = {text for texts in TEMPLATES.values() for text in texts}
    for code, table in catalogue("ja").tables.items():
        if code != "all":
            assert set(table) <= written, code


def test_error_and_notice__in_japanese() -> None:
    error = InputError(
        "north.gnss: positions come every 3.0 s.", "No cloud was written.", "Rename the file.", code="gnss-rate"
    )
    assert translated_error(error, "ja") == (
        "north.gnss：測位の間隔が 3.0 秒です。", "点群は書き出していません。", "ファイルの名前を変えてください。"
    )  # fmt: skip
    notice = translated_notice(Notice("times-none", "3 of 40 points have no time. It is 0 in the output."), "ja")
    assert notice.text == "40 点中 3 点に時刻がありません。出力では 0 とします。"


def _without_names(text: str) -> str:
    text = re.sub(r"`[^`]*`", "", text)
    for name in NAMES:
        text = text.replace(name, "")
    return QUOTED.sub("", text)
