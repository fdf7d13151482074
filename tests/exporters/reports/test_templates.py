"""Every text of a template is one of the catalogues of all languages."""

from __future__ import annotations

import html
import re
from collections.abc import Iterator
from importlib.resources import files

import pytest
from jinja2 import nodes

from furrowmap.core.runtime.languages.templates import parts_of, walk
from furrowmap.core.runtime.languages.texts import LANGUAGES, texts_of
from furrowmap.exporters.reports.html_pages import _environment, _source

NAMES = sorted(file.name for file in files("furrowmap.exporters.reports").joinpath("templates").iterdir())
SHOWN = {"head", "key", "key_figure", "key_area", "row", "moved", "worked", "sentences", "titled"}
"""Macros and functions whose constants are shown."""
SAME = re.compile(r"\{.*\}|#[0-9a-f]{6}|[a-z]*\.(csv|json|html)|fixed|all|east_m|dashed|text|[xyz]|along|across")
"""Formats, files, keys: what is no text."""


def tree(template: str) -> nodes.Template:
    source = _source(template)
    assert source is not None
    return _environment().parse(re.sub(r"(?s)<style>.*?</style>", "", source))


def texts(template: str) -> Iterator[tuple[str, set[str]]]:
    """The texts of a template, _("…"), with the names of their values."""
    for call in tree(template).find_all(nodes.Call):
        if isinstance(call.node, nodes.Name) and call.node.name == "_":
            (text,) = call.args
            assert isinstance(text, nodes.Const), (template, call.lineno)
            yield text.value, {keyword.key for keyword in call.kwargs}


def plain_constants(node: nodes.Node) -> Iterator[str]:
    """Constants of an expression outside of _("…"), but for arguments of filters and what is compared or looked up."""
    if isinstance(node, nodes.Const):
        yield from [node.value] if isinstance(node.value, str) else []
    elif isinstance(node, nodes.Filter):
        yield from plain_constants(node.node) if node.node is not None else ()
    elif isinstance(node, nodes.Call):
        own = isinstance(node.node, nodes.Name) and node.node.name == "_"
        yield from (
            ()
            if own or isinstance(node.node, nodes.Getattr)
            else (text for argument in node.args for text in plain_constants(argument))
        )
    elif not isinstance(node, nodes.Getattr | nodes.Getitem | nodes.Compare):
        for child in node.iter_child_nodes():
            yield from plain_constants(child)


@pytest.mark.parametrize("template", NAMES)
def test_texts_of_a_template__are_in_every_language_with_their_values(template: str) -> None:
    for text, given in texts(template):
        assert {part.name for part in walk(parts_of(text))} == given, text
        for language in LANGUAGES[1:]:
            assert text in texts_of(language), (language, text)
            assert {part.name for part in walk(parts_of(texts_of(language)[text]))} == given, (language, text)


@pytest.mark.parametrize("template", NAMES)
def test_template__has_no_words_but_texts_of_catalogues(template: str) -> None:
    """Neither between its tags nor in what its macros show."""
    found = tree(template)
    between = "\n".join(data.data if isinstance(data, nodes.TemplateData) else "\n"
                        for output in found.find_all(nodes.Output) for data in output.nodes)  # fmt: skip
    words = re.findall(r"[A-Za-z]{2,}", html.unescape(re.sub(r"<[^>]*>|<meta[^\n]*\n", " ", between)))
    calls = [call for call in found.find_all(nodes.Call) if getattr(call.node, "name", "") in SHOWN]
    inside = {text for call in calls for argument in call.args for text in plain_constants(argument)}
    assert not [word for word in words if word not in ("DOCTYPE", "html")]
    assert not [text for text in inside if re.search("[A-Za-z]{2}", text) and not SAME.fullmatch(text)]


def test_texts__are_found_in_templates() -> None:
    found = {text for template in NAMES for text, _ in texts(template)}
    assert len(found) > 250
    assert {"turning and reversing", "{passes} more passes are in the layer passes of field.gpkg."} <= found
