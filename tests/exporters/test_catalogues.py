"""Catalogues of pages, layers, styles and last lines: every entry is in the source, and none of tables is missing."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import pytest

from furrowmap.core.runtime.languages.templates import parts_of, walk
from furrowmap.core.runtime.languages.texts import (
    LANGUAGES,
    LIVE,
    PLACES_WITH_OWN_WORDS,
    SHARE,
    TEXT_TABLE,
    WORDS,
    catalogue,
    texts_of,
)
from furrowmap.exporters.reports.evaluation_page import DEFINITION_WORDS
from furrowmap.exporters.vectors import labels
from furrowmap.exporters.vectors.qgis_styles import tip_line
from tests.exporters.reports.test_templates import NAMES, texts
from tests.test_code_reference import sources

CHECKOUT = Path(__file__).resolve().parents[2]
SCRIPTS = ("web/map.js", "web/cloud.js", "exporters/share/share.html", "exporters/share/live.js")
TABLES = (TEXT_TABLE, WORDS, *PLACES_WITH_OWN_WORDS)
STYLES = ("exporters/styles", "exporters/farm/styles")


def strings(table: Mapping[str, Any]) -> Iterator[str]:
    for value in table.values():
        yield from strings(value) if isinstance(value, Mapping) else [value]


def of_styles() -> Iterator[str]:
    """Labels of classes, lines of map tips, and texts in their expressions."""
    for folder in STYLES:
        for file in sorted((CHECKOUT / folder).glob("*.qml")):
            root = ET.fromstring(file.read_text(encoding="utf-8"))
            yield from (one.get("label", "") for one in root.iter())
            for tip in root.iter("mapTip"):
                for line in re.split(r"(?:<br>)(?![^\[]*%\])", tip.text or ""):
                    text, expressions = tip_line(line)
                    yield text
                    yield from (quoted for one in expressions for quoted in re.findall(r"'([^']*)'", one))


def in_source() -> set[str]:
    """Every text that the source has, whether or not it is shown."""
    constants = (node.value for _, found in sources() for node in found if isinstance(node, ast.Constant))
    found = {text for text in constants if isinstance(text, str)}
    found |= {*strings(labels._LABELS), *of_styles()}
    found |= {text for template in NAMES for text, _ in texts(template)}
    return found | {words.template for words in DEFINITION_WORDS}


@pytest.mark.parametrize("language", LANGUAGES[1:])
@pytest.mark.parametrize("table", [TEXT_TABLE, *PLACES_WITH_OWN_WORDS])
def test_entries__are_of_texts_in_the_source(table: str, language: str) -> None:
    entries = set(catalogue(language)[table])
    scripts = "".join((CHECKOUT / name).read_text(encoding="utf-8") for name in SCRIPTS)
    assert not {text for text in entries - in_source() if f'"{text}"' not in scripts and f">{text}<" not in scripts}


@pytest.mark.parametrize("table", TABLES)
def test_languages__have_the_same_texts_with_the_same_values(table: str) -> None:
    first, *others = (catalogue(language)[table] for language in LANGUAGES[1:])
    assert others
    for other in others:
        assert other.keys() == first.keys()
    for template in first if table == TEXT_TABLE else ():
        wanted = {hole.name for hole in walk(parts_of(template))}
        for language in LANGUAGES[1:]:
            assert {hole.name for hole in walk(parts_of(catalogue(language)[TEXT_TABLE][template]))} <= wanted, template


def test_live_page__has_all_its_texts_in_every_language() -> None:
    script = (CHECKOUT / "exporters" / "share" / "live.js").read_text(encoding="utf-8")
    words = script.partition("const WORDS = {")[2].partition("};")[0]
    texts = set(re.findall(r': "([^"]+)"', words))
    assert len(texts) > 50
    for language in LANGUAGES[1:]:
        assert set(texts_of(language, LIVE)) == texts


@pytest.mark.parametrize("language", LANGUAGES[1:])
def test_words_of_tables__are_in_every_language(language: str) -> None:
    known = texts_of(language)
    tables = (labels.COLUMN_LABELS, labels.FARM_LABELS, labels.FARM_LAYER_NAMES, *labels.VALUES.values())
    words = {word for table in tables for word in table.values()}
    assert {*words, *(definition.template for definition in DEFINITION_WORDS)} <= known.keys()
    assert set(labels.SHARED_LAYERS.values()) <= texts_of(language, SHARE).keys()
