"""Styles in Japanese: no label of a class and no line of a map tip stays English, in any style of the product."""

from __future__ import annotations

import re
from collections.abc import Sequence
from importlib.resources import files
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import pytest

from furrowmap.core.runtime.settings import using
from furrowmap.exporters.farm.project import styles
from furrowmap.exporters.vectors.field_layers import Layer
from furrowmap.exporters.vectors.qgis_styles import in_language, write_raster_style

FOLDERS = ("furrowmap.exporters", "furrowmap.exporters.farm")
STYLES = {
    f"{folder}: {file.name}": file.read_text("utf-8")
    for folder in FOLDERS
    for file in files(folder).joinpath("styles").iterdir()
    if file.name.endswith(".qml")
}
SYMBOLS = {"m", "mm", "km", "h", "cm", "ha", "s", "UTC", "RTK", "FIX", "FLOAT", "PPP", "RMSE", "D", "X", "Y", "Z"}
"""Units and names that Japanese writes in Latin letters, too."""
FORMATS = re.compile(r"(yyyy-MM-dd)?[ ]?(HH:mm(:ss(\.zzz)?)?)?")


def words(style: str) -> list[str]:
    """What people read of a style: labels, map tips, and texts in their expressions."""
    root = ET.fromstring(style)
    labels = [
        str(one.get("label"))
        for tag in ("category", "item", "range", "rule")
        for one in root.iter(tag)
        if one.get("label")
    ]
    tips = [tip.text or "" for tip in root.iter("mapTip")]
    shown = [re.sub(r"<[^>]*>", " ", re.sub(r"\[%.*?%\]", " ", tip)) for tip in tips]
    texts = [text for tip in tips for part in re.findall(r"\[%.*?%\]", tip) for text in literals(part)]
    return [*labels, *shown, *(re.sub(r"<[^>]*>", " ", text) for text in texts if not FORMATS.fullmatch(text))]


def literals(expression: str) -> list[str]:
    """Texts of an expression but the values that it looks up: map('down', 'word', …)."""
    maps = re.findall(r"map\(('[^)]*')\)", expression)
    looked_up = [text for one in maps for text in re.findall(r"'([^']*)'", one)[1::2]]
    return looked_up + re.findall(r"'([^']*)'", re.sub(r"map\('[^)]*'\)", "", expression))


@pytest.mark.parametrize("name", sorted(STYLES))
def test_style__has_no_english_word_in_japanese(name: str) -> None:
    for text in words(in_language(STYLES[name], "ja")):
        assert not set(re.findall(r"[A-Za-z]+", text)) - SYMBOLS, text


@pytest.mark.parametrize("name", sorted(STYLES))
def test_style__keeps_its_fields_and_symbols(name: str) -> None:
    ours, theirs = (ET.fromstring(style) for style in (STYLES[name], in_language(STYLES[name], "ja")))
    for tag in ("layer", "symbol", "category", "range", "rule", "labeling"):
        assert len(list(ours.iter(tag))) == len(list(theirs.iter(tag)))
    for mine, other in zip(ours.iter("mapTip"), theirs.iter("mapTip"), strict=True):
        assert set(re.findall(r'"(\w+)"', mine.text or "")) == set(re.findall(r'"(\w+)"', other.text or ""))
        assert (mine.text or "").count("[%") == (other.text or "").count("[%")
    assert in_language(STYLES[name], "en") == STYLES[name]


@pytest.mark.parametrize(("language", "most"), [("en", "2 m and more"), ("de", "2 m und mehr"), ("ja", "2 m 以上")])
def test_raster__has_the_legend_of_its_style_in_the_language_of_the_user(
    tmp_path: Path, language: str, most: str
) -> None:
    with using(language=language):
        write_raster_style(tmp_path / "height_above_ground.tif", "height_above_ground.qml")
    style = (tmp_path / "height_above_ground.qml").read_text(encoding="utf-8")
    assert [one.get("label") for one in ET.fromstring(style).iter("item")][-1] == most


def three(name: str, columns: Sequence[str]) -> Layer:
    """A layer of three features, with the numbers 1 to 3."""
    return Layer(name, "", "", np.full(3, None, object), {column: np.arange(1.0, 4.0) for column in columns})


def test_farm_map__has_numbers_in_place_of_aggregates() -> None:
    names = sorted(name.partition(": ")[2].removesuffix(".qml") for name in STYLES)
    for style in styles(dict.fromkeys(names, ()), [], three).values():
        assert "maximum(" not in style
        assert "minimum(" not in style
    assert "(3 - 1)" in styles({"passes": ("pass",)}, [], three)["passes"]


def test_farm_map__has_its_words_in_the_language_of_the_user() -> None:
    with using(language="ja"):
        found = styles({"coverage": (), "passes": ("pass",), "sessions": ("worked_area_m2", "implement")}, [], three)
    labels = [one.get("label") for one in ET.fromstring(found["coverage"]).iter("category")]
    assert labels == ["その他の日"]
    assert "作業面積" in found["coverage"]
    assert "行程" in found["passes"]
    names = {one.get("field"): one.get("name") for one in ET.fromstring(found["sessions"]).iter("alias")}
    assert names == {"worked_area_m2": "作業面積・地図平面（m²）", "implement": "作業機"}
    assert "ValueMap" not in found["sessions"], "the kind of the tool is no state"
    with using(language="en"):
        assert "other days" in styles({"coverage": ()}, [], three)["coverage"]
