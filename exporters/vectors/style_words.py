"""The words that people see in a style of QGIS: labels of classes and map tips, in their language."""

from __future__ import annotations

import re
from typing import Final
from xml.etree import ElementTree as ET

from furrowmap.core.runtime.languages.catalogue import ENGLISH, catalogue
from furrowmap.exporters.files.qgis_project import DOCTYPE
from furrowmap.exporters.vectors.layer_words import VALUES

_CLASSES: Final = ("category", "item", "range", "rule")
"""Elements of renderers that have a label."""
_LINE: Final = re.compile(r"<br>|(?:\[%.*?%\]|(?!<br>).)+", re.DOTALL)
"""A line of a map tip, or its end; an expression may hold one, too."""
_EXPRESSION: Final = re.compile(r"\[%.*?%\]", re.DOTALL)
_LITERAL: Final = re.compile(r"'([^']*)'")
_FIELD: Final = re.compile(f'"({"|".join(VALUES)})"')


def in_language(style: str, language: str) -> str:
    """A style of the product in another language; what the catalogue does not know stays English.

    Each line of a map tip is a text of the catalogue, with {1}, {2}, … for its expressions.

    Args:
        style: QML as packaged, in English.
        language: one of :data:`~furrowmap.core.runtime.languages.catalogue.LANGUAGES`.
    """
    if language == ENGLISH:
        return style
    root = ET.fromstring(style)  # noqa: S314 (a file of this package)
    for tag in _CLASSES:
        for one in root.iter(tag):
            if one.get("label"):
                one.set("label", _known(str(one.get("label")), language))
    for tip in root.iter("mapTip"):
        tip.text = _LINE.sub(lambda line: _line(line[0], language), tip.text or "")
    return DOCTYPE + ET.tostring(root, encoding="unicode") + "\n"


def tip_line(line: str) -> tuple[str, list[str]]:
    """A line of a map tip as a text of the catalogue, and its expressions."""
    expressions = _EXPRESSION.findall(line)
    for number, expression in enumerate(expressions, 1):
        line = line.replace(expression, f"{{{number}}}", 1)
    return line, expressions


def _line(line: str, language: str) -> str:
    text, expressions = tip_line(line)
    told = [_expression(one, language) for one in expressions]
    return re.sub(r"\{(\d+)\}", lambda hole: told[int(hole[1]) - 1], _known(text, language))


def _expression(expression: str, language: str) -> str:
    """An expression with its texts, and the values of fields that have words, in a language."""
    text = _LITERAL.sub(lambda found: f"'{_known(found[1], language)}'", expression)
    return _FIELD.sub(lambda found: _worded(found[1], language), text)


def _worded(field: str, language: str) -> str:
    pairs = ", ".join(f"'{value}', '{_known(word, language)}'" for value, word in VALUES[field].items())
    return f"""coalesce(map_get(map({pairs}), "{field}"), "{field}")"""


def _known(text: str, language: str) -> str:
    return catalogue(language).exact.get(text, text)
