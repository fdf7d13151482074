"""Every text of a template is in the Japanese catalogue of pages."""

from __future__ import annotations

import html
import re
from collections.abc import Iterator
from importlib.resources import files

import pytest
from jinja2 import nodes

from furrowmap.core.runtime.languages.catalogue import catalogue
from furrowmap.exporters.reports.html_pages import _environment, _source

NAMES = {file.name for file in files("furrowmap.exporters.reports").joinpath("templates").iterdir()}
ENGLISH = {"evaluation.html"}  # figures of a paper, in its terms
SHOWN = {"head", "key", "key_figure", "row", "moved", "worked"}
"""Macros whose constants are shown."""
KNOWN = "\n".join(text for table in catalogue("ja").tables.values() for text in table)


def constants(node: nodes.Node) -> Iterator[str]:
    """The texts of an expression, but for names of attributes and arguments of filters."""
    if isinstance(node, nodes.Const) and isinstance(node.value, str):
        yield node.value
    elif isinstance(node, nodes.Filter | nodes.Call):
        inner = node.node.node if isinstance(node.node, nodes.Getattr) else node.node
        yield from constants(inner) if inner is not None else ()
    elif not isinstance(node, nodes.Getattr | nodes.Getitem | nodes.Compare):
        for child in node.iter_child_nodes():
            yield from constants(child)


def pieces(template: str) -> set[str]:
    """The texts of a template between its tags and values, sentence by sentence."""
    source = _source(template)
    assert source is not None
    tree = _environment().parse(re.sub(r"(?s)<style>.*?</style>", "", source))
    between = "\n".join(data.data if isinstance(data, nodes.TemplateData) else "\n"
                        for output in tree.find_all(nodes.Output) for data in output.nodes)  # fmt: skip
    calls = [call for call in tree.find_all(nodes.Call) if getattr(call.node, "name", "") in SHOWN]
    inside = [text for call in calls for argument in call.args for text in constants(argument)]
    texts = [
        *re.split(r"<[^>]*>|\n", between),
        *(part for text in inside for part in re.split(r"\{.*?\}(?: mm|°)?", text)),
    ]
    sentences = [part for text in texts for part in re.split(r"(?<=[.:!?]) |; ", " ".join(html.unescape(text).split()))]
    return {part.strip(" ,;:.→/") for part in sentences if re.search("[A-Za-z]{4}", part) and part[0] != "#"}


@pytest.mark.parametrize("template", sorted(NAMES - ENGLISH))
def test_texts_of_a_template__have_japanese(template: str) -> None:
    assert {piece for piece in pieces(template) if piece not in KNOWN} <= {"POLICY"}  # of the file's head


def test_pieces__are_found_in_templates() -> None:
    assert sum(len(pieces(template)) for template in NAMES) > 150
    assert {"turning and reversing", "more passes are in the layer passes of field.gpkg"} <= {
        *pieces("report.html"), *pieces("passes.html"),
    }  # fmt: skip
