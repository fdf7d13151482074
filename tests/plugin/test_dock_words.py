"""Errors and warnings in QGIS use the words of its dialogs: no option, no command, no key that the form has."""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from furrowmap.core.runtime.languages.texts import LANGUAGES
from furrowmap.plugin.processing.description import ALGORITHMS

if TYPE_CHECKING:
    from conftest import QgisRoot

CHECKOUT = Path(__file__).resolve().parents[2]
FORM_KEYS = re.compile(
    r"\[(antenna|lidar|imu|camera)\] (xyz_m|rpy_deg)|\[implement\] (width_m|xy_m)|\[field\] boundary|\[crs\] map"
)
COMMANDS = {algorithm.command.split()[0] for algorithm in ALGORITHMS}
OPTIONS = {parameter.option for algorithm in ALGORITHMS for parameter in algorithm.parameters}


def sentences(table: dict[str, Any]) -> Iterator[str]:
    for value in table.values():
        if isinstance(value, dict):
            yield from sentences(value)
        else:
            yield value.replace("{extra}", "photo")


@pytest.fixture(scope="module")
def texts() -> dict[str, list[str]]:
    folder = CHECKOUT / "core" / "runtime" / "languages"
    languages = {path.stem: tomllib.loads(path.read_text(encoding="utf-8")) for path in sorted(folder.glob("*.toml"))}
    for content in languages.values():
        for table in ("name", "texts", "words", "share"):
            content.pop(table, None)
    return {language: list(sentences(content)) for language, content in languages.items()}


@pytest.fixture(scope="module")
def shown(qgis: QgisRoot, texts: dict[str, list[str]], tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    work = tmp_path_factory.mktemp("words")
    (work / "furrowmap").symlink_to(CHECKOUT / "plugin")
    (work / "texts.json").write_text(json.dumps(texts), encoding="utf-8")
    told = qgis.run("python3", Path(__file__).with_name("words_in_qgis.py"), work / "furrowmap", work / "texts.json")
    answer: dict[str, Any] = json.loads(told.splitlines()[-1])
    return answer


@pytest.mark.parametrize("language", LANGUAGES)
def test_messages__have_no_words_of_the_terminal_where_qgis_has_its_own(
    shown: dict[str, Any], texts: dict[str, list[str]], language: str
) -> None:
    changed = 0
    for text, before in zip(shown[language], texts[language], strict=True):
        assert 'pip install ".[' not in text, text
        assert "pip install '.[" not in text, text
        assert not FORM_KEYS.search(text), text
        assert not re.search(r"(?<![\w-])-o(?= で|\b)(?! out)(?!`)", text), text
        left = {f"--{option}" for option in re.findall(r"(?<![\w-])--([a-z][a-z-]+)", text)}
        assert not left & OPTIONS, text
        commands = set(re.findall(r"`furrowmap ([a-z]+)", text))
        assert not commands & COMMANDS, text
        changed += text != before
    assert changed > len(texts[language]) // 12


def test_message__reads_as_a_sentence(shown: dict[str, Any], texts: dict[str, list[str]]) -> None:
    words = dict(zip(texts["en"], shown["en"], strict=True))
    assert (
        words["Choose a folder that you may write to with -o."]
        == "Choose a folder that you may write to under 'Results'."
    )
    antenna = next(text for text in words if text.startswith("The session does not state the position of the antenna"))
    assert "('GNSS antenna', x, y, z)" in words[antenna]
    install = next(text for text in words if text.startswith('Install the extra: pip install ".[photo]"'))
    wanted = "Install the extra: 'Images of cameras (OpenCV, Pillow)' in Settings › Options › furrowmap"
    assert words[install].startswith(wanted)
