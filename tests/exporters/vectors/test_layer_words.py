"""Words of layers: aliases, values and actions in the styles that a GeoPackage holds, in every language."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET

import numpy as np
import pytest

from furrowmap.core.runtime.languages.texts import LANGUAGES, texts_of
from furrowmap.exporters.files.result_folder import packaged_style, packaged_styles
from furrowmap.exporters.vectors.labels import COLUMN_LABELS, FARM_LABELS, LAYER_NAMES, VALUES
from furrowmap.exporters.vectors.qgis_styles import (
    field_extremes,
    finished_style,
    in_language,
    naming_tools,
    with_words,
)

FIELDS = ("pass", "start", "end", "area_m2", "speed_mps", "zone", "kind", "of_another_program")


@pytest.mark.parametrize("language", LANGUAGES)
def test_style__has_names_words_and_actions(language: str) -> None:
    root = ET.fromstring(with_words(packaged_style("passes.qml"), FIELDS, language, report=True))
    assert {"Symbology", "MapTips", "Fields", "Forms", "Actions"} <= set(root.attrib["styleCategories"].split("|"))
    aliases = {one.attrib["field"]: one.attrib["name"] for one in root.iter("alias")}
    assert set(aliases) == set(FIELDS[:-1])
    assert (
        aliases["area_m2"]
        == {"en": "area on the map (m²)", "de": "Fläche auf der Karte (m²)", "ja": "面積・地図平面（m²）"}[language]
    )
    kinds = {field.attrib["name"]: field[0].attrib["type"] for field in root.iter("field")}
    assert kinds == {"area_m2": "Range", "speed_mps": "Range", "zone": "ValueMap", "kind": "ValueMap"}
    (zone,) = (field for field in root.iter("field") if field.attrib["name"] == "zone")
    pairs = {one.attrib["value"]: one.attrib["name"] for one in zone.iter("Option") if "value" in one.attrib}
    assert pairs["headland"] == {"en": "headland", "de": "Vorgewende", "ja": "枕地"}[language]
    actions = [one.attrib for one in root.iter("actionsetting")]
    assert [one["name"] for one in actions] == {
        "en": ["Open report", "Open folder"],
        "de": ["Bericht öffnen", "Ordner öffnen"],
        "ja": ["レポートを開く", "フォルダを開く"],
    }[language]
    assert actions[0]["action"].endswith("|| 'report.html' %]")


def test_style__of_another_file_than_a_run_has_no_actions() -> None:
    root = ET.fromstring(with_words(packaged_style("passes.qml"), FIELDS, "en", report=False))
    assert not list(root.iter("actionsetting"))


@pytest.mark.parametrize("language", LANGUAGES)
def test_style__of_several_tools_names_them_beside_the_number_of_a_pass(language: str) -> None:
    root = ET.fromstring(naming_tools(in_language(packaged_style("passes.qml"), language)))
    (label,) = root.iter("text-style")
    assert label.attrib["fieldName"] == """"tool" || ' ' || "pass\""""
    assert label.attrib["isExpression"] == "1"
    (tip,) = root.iter("mapTip")
    assert str(tip.text).startswith('[% "tool" %]: <b>')
    expressions = [str(one.get("attr")) for one in root.iter("renderer-v2")]
    expressions += [str(one.get("value")) for one in root.iter("Option") if one.get("name") == "expression"]
    for text in expressions:
        assert re.findall(r'(?:minimum|maximum)\(("pass".*?)\)', text) == ['"pass", "tool"'] * text.count("imum(")
        assert "imum(" in text


def test_words__are_all_in_japanese() -> None:
    names = (COLUMN_LABELS, FARM_LABELS, LAYER_NAMES, *VALUES.values())
    words = {word for each in names for word in each.values()}
    for word in words - {"PPP"}:
        assert re.search(r"[ぁ-ヿ一-龥]|RTK FI|RTK FL", texts_of("ja").get(word, word)), word


AGGREGATES = (
    r"\b(minimum|maximum|aggregate|relation_aggregate|array_agg|concatenate\w*|count\w*|sum|mean|median|range)\("
)
"""Functions of QGIS over all features of a layer."""


@pytest.mark.parametrize("name", sorted(packaged_styles()))
@pytest.mark.parametrize("tools", [False, True])
def test_styles__have_numbers_in_place_of_aggregates(name: str, *, tools: bool) -> None:
    """QGIS computes aggregates in threads that draw, and crashes where the project changes meanwhile."""
    fields = set(re.findall(r"&quot;(\w+)&quot;", packaged_style(name)))
    columns = {field: np.array([2.0, 1.0, np.nan]) for field in sorted(fields)}
    if tools:
        columns["tool"] = np.array(["drill", "farmer's harrow", "drill"], object)
    style = finished_style(packaged_style(name), "en", [], field_extremes(columns), tools=tools)
    ET.fromstring(style)
    drawn = style.partition("<mapTip")[0]
    assert not re.findall(AGGREGATES, drawn)


def test_extremes__are_those_of_the_numbers_and_of_each_tool() -> None:
    columns = {
        "pass": np.ma.MaskedArray([1, 7, 3, 9], [False, False, False, True]),
        "depth_m": np.array([np.nan, np.nan, 0.25, np.nan]),
        "tool": np.array(["drill", "drill", "farmer's harrow", "drill"], object),
    }
    found = field_extremes(columns)
    assert found['minimum("pass")'] == "1"
    assert found['maximum("pass")'] == "7"
    assert found['maximum("pass", "tool")'] == """map_get(map('drill', 7, 'farmer''s harrow', 3), "tool")"""
    assert found['minimum("depth_m", "tool")'] == """map_get(map('drill', NULL, 'farmer''s harrow', 0.25), "tool")"""
    assert not [call for call in found if '("tool"' in call]
