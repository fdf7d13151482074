"""Catalogues of pages, layers, styles and last lines: every entry is in the source, and none of tables is missing."""

from __future__ import annotations

import ast
import re
import tomllib
from collections.abc import Iterator, Mapping
from importlib.resources import files
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import pytest

from furrowmap.core.runtime.languages.texts import LANGUAGES, PLACES_WITH_OWN_WORDS, texts_of
from furrowmap.exporters.reports.evaluation_page import DEFINITION_WORDS
from furrowmap.exporters.vectors import labels
from furrowmap.exporters.vectors.qgis_styles import tip_line
from tests.exporters.reports.test_templates import NAMES, texts
from tests.test_code_reference import sources

CHECKOUT = Path(__file__).resolve().parents[2]
CATALOGUES = ("pages", "layers", "styles", "terminal", "share")
SCRIPTS = ("web/map.js", "web/cloud.js", "exporters/share/share.html")
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
@pytest.mark.parametrize("catalogue", CATALOGUES)
def test_entries__are_of_texts_in_the_source(catalogue: str, language: str) -> None:
    content = files("furrowmap.core.runtime.languages").joinpath(f"{language}_{catalogue}.toml").read_text("utf-8")
    entries = {text for table in tomllib.loads(content).values() for text in table}
    scripts = "".join((CHECKOUT / name).read_text(encoding="utf-8") for name in SCRIPTS)
    assert not {text for text in entries - in_source() if f'"{text}"' not in scripts and f">{text}<" not in scripts}


@pytest.mark.parametrize("language", LANGUAGES[1:])
def test_words_of_tables__are_in_every_language(language: str) -> None:
    known = texts_of(language)
    tables = (labels.COLUMN_LABELS, labels.FARM_LABELS, labels.FARM_LAYER_NAMES, *labels.VALUES.values())
    words = {word for table in tables for word in table.values()}
    assert {*words, *(definition.template for definition in DEFINITION_WORDS)} <= known.keys()
    assert set(labels.SHARED_LAYERS.values()) <= texts_of(language, *PLACES_WITH_OWN_WORDS).keys()


@pytest.mark.parametrize("language", LANGUAGES[1:])
def test_catalogues__have_one_text_for_each_template(language: str) -> None:
    """But for places that have words of their own."""
    found: dict[str, set[str]] = {}
    for file in files("furrowmap.core.runtime.languages").iterdir():
        if file.name.startswith(f"{language}_") and file.name != f"{language}_messages.toml":
            for name, table in tomllib.loads(file.read_text("utf-8")).items():
                for template, text in table.items() if name not in PLACES_WITH_OWN_WORDS else ():
                    found.setdefault(template, set()).add(text)
    assert not {template: texts for template, texts in found.items() if len(texts) > 1}
