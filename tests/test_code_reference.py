"""Every message of the source is in the catalogue, with its values, and every one of the catalogue in the source."""

from __future__ import annotations

import ast
import re
import runpy
from collections.abc import Iterator
from pathlib import Path

import pytest

from furrowmap.core.runtime.errors import InputError, Notice
from furrowmap.core.runtime.file_signatures import FILE_KINDS
from furrowmap.core.runtime.languages.messages import holes
from furrowmap.core.runtime.languages.templates import parts_of, walk
from furrowmap.core.runtime.languages.texts import LANGUAGES, templates, texts_of
from tests.codes_met import MET, listed, named
from tests.core.readers.las.test_hostile import ERRORS, NOTICES
from tests.syntax import PARTS, files, nodes

CHECKOUT = Path(__file__).resolve().parents[1]
TABLES_OF_TEXTS = {
    "core/runtime/file_signatures.py",
    "core/runtime/errors.py",
    "core/runtime/languages/texts.py",
}
"""Files that make texts of a table, which has a test of its own: kinds of files, parts of messages, labels."""
DOORS = {
    "MissingExtraError",
    "OptionError",
    "unreadable",
    "_unreadable",
    "unusable",
    "unused",
    "_bad",
    "_invalid",
    "_bad_columns",
    "contradicting",
}
"""Functions that make an error of a reason."""
PROSE = re.compile(r"(?<![-\w])[a-z]{2,} [a-z]{2,}")
"""Two words beside each other, but for an option and its value."""
MAKERS = {"FurrowmapError", "UsageError", "InputError", "RefusedError", "Notice"}
TAKE_REASONS = MAKERS | DOORS


def sources() -> Iterator[tuple[str, tuple[ast.AST, ...]]]:
    """Each file of the product, and all nodes of its syntax."""
    for path in files(*PARTS):
        yield str(path.relative_to(CHECKOUT)), nodes(path)


def test_messages__are_made_with_the_values_of_their_sentences() -> None:
    made = 0
    for name, found in sources():
        for call in found:
            if isinstance(call, ast.Call) and isinstance(call.func, ast.Name) and call.func.id in MAKERS:
                given = {keyword.arg for keyword in call.keywords}
                chosen = call.args[0]
                for key in [chosen.body, chosen.orelse] if isinstance(chosen, ast.IfExp) else [chosen]:
                    if isinstance(key, ast.Constant) and None not in given:
                        made += 1
                        assert given == set(holes(str(key.value))), (name, call.lineno, key.value)
    assert made > 500


def test_texts__are_in_every_language_with_their_values() -> None:
    for name, found in sources():
        for call in found:
            if isinstance(call, ast.Call) and isinstance(call.func, ast.Name) and call.func.id == "Text":
                given = {keyword.arg for keyword in call.keywords}
                chosen = call.args[0]
                if name in TABLES_OF_TEXTS:
                    continue
                for template in [chosen.body, chosen.orelse] if isinstance(chosen, ast.IfExp) else [chosen]:
                    assert isinstance(template, ast.Constant), (name, call.lineno)
                    english = str(template.value)
                    assert names_in(english) == given, (name, call.lineno, english)
                    for language in LANGUAGES[1:]:
                        assert names_in(texts_of(language).get(english, "")) == given, (name, call.lineno, english)
                        assert english in texts_of(language), (name, call.lineno, english)


def test_reasons__are_texts_and_no_english_strings() -> None:
    """What is given to messages, and to those that make errors of a door, is shown in the reader's language."""
    for name, tree in sources():
        for call in tree:
            if isinstance(call, ast.Call) and ast.unparse(call.func) in TAKE_REASONS:
                key = isinstance(call.func, ast.Name) and call.func.id in MAKERS
                for given in [*call.args[key:], *(keyword.value for keyword in call.keywords)]:
                    assert not [words for words in plain_strings(given) if PROSE.search(words)], (name, call.lineno)


def plain_strings(node: ast.AST) -> Iterator[str]:
    """The strings in an expression that are not those of a text."""
    if isinstance(node, ast.Call) and ast.unparse(node.func) == "Text":
        return
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        yield node.value
    for inner in ast.iter_child_nodes(node):
        yield from plain_strings(inner)


def test_texts__of_file_formats_are_in_every_language() -> None:
    for text in {text for _, kind in FILE_KINDS for text in (kind.name, kind.remedy)}:
        for language in LANGUAGES[1:]:
            assert text.template in texts_of(language), text


def names_in(template: str) -> set[str]:
    return {part.name for part in walk(parts_of(template))}


def test_messages__of_the_catalogue_are_used() -> None:
    texts = {node.value for _, found in sources() for node in found if isinstance(node, ast.Constant)}
    pieces = {
        "".join(v.value if isinstance(v, ast.Constant) else "*" for v in node.values)
        for _, found in sources()
        for node in found
        if isinstance(node, ast.JoinedStr)
    }
    patterns = [re.compile(re.escape(piece).replace(r"\*", "[a-z0-9-]+")) for piece in pieces if "." in piece]
    for key in templates("en"):
        assert key in texts or any(pattern.fullmatch(key) for pattern in patterns), key


def test_code_reference__is_what_the_script_writes() -> None:
    page = runpy.run_path(str(CHECKOUT / "scripts" / "code_reference.py"))["page"]
    written = (CHECKOUT / "docs" / "reference" / "codes.md").read_text(encoding="utf-8")
    assert written == page(), "run scripts/code_reference.py"


def test_codes__are_recorded_as_errors_and_warnings_are_made() -> None:
    assert Notice("made-in-a-test", text="text").code in MET
    assert len(listed()) > 300
    met = named({"made-in-a-test", " ".join(("not", "expected", "here"))})
    assert "made-in-a-test" in met
    assert "not expected here" not in met


def test_code_reference__has_every_code_that_hostile_clouds_end_in() -> None:
    met = {*ERRORS.values(), *(code for _, codes in NOTICES.values() for code in codes)}
    assert not met - listed()


def test_message_with_other_values__is_an_error_of_the_program() -> None:
    with pytest.raises(KeyError, match="no-such-file"):
        InputError("no-such-file", elephants=3)
