"""Texts of the product: English from the template, other languages from their catalogues, values as they were."""

from __future__ import annotations

import pickle

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from furrowmap.core.runtime.errors import InputError
from furrowmap.core.runtime.json_text import from_kept_json, kept_json, plain
from furrowmap.core.runtime.languages.texts import LANGUAGES, LIST_STYLES, Text, joined, texts_of


@given(st.integers(), st.text(min_size=1))
def test_text__in_english_is_its_template_with_the_values(line: int, name: str) -> None:
    text = Text("line {line:,} names {name!r} {name:and|but} not {{this}}", line=line, name=name)
    assert str(text) == f"line {line:,} names {name!r} {'and' if name else 'but'} not {{this}}"


def test_text__in_another_language_with_texts_within() -> None:
    within = Text("heights of positions, {positions:and}", positions=(Text("heights"), Text("positions"), "a.laz"))
    assert str(within) == "heights of positions, heights, positions and a.laz"
    error = InputError("surface-unusable", path="dsm.tif", why=Text("heights"))
    assert "高さ" in error.lines_in("ja")[0]
    assert "heights" in error.lines[0]


@pytest.mark.parametrize(
    ("style", "said"), [("", "0, 1, 2"), (";", "0; 1; 2"), ("and", "0, 1 and 2"), ("or", "0, 1 or 2"), (".", "0 1 2")]
)
def test_list__has_the_separators_of_its_style(style: str, said: str) -> None:
    assert joined(range(3), style, "en") == said
    assert [joined(range(n), style, "en") for n in range(2)] == ["", "0"]
    assert joined([Text("heights"), Text("positions")], "", "ja") == "高さ、測位"


def test_text__that_a_language_lacks_is_english() -> None:
    assert Text("no catalogue has {number:.1f} of these", number=2.25).in_language("ja") == (
        "no catalogue has 2.2 of these"
    )
    with pytest.raises(ValueError, match="no catalogue"):
        texts_of("xx")


def test_text__comes_back_from_another_process_and_from_a_file() -> None:
    text = Text("line {line} names {name}", line=3, name=(Text("heights"), 2.5, "a"))
    assert pickle.loads(pickle.dumps(text)) == text
    assert from_kept_json(kept_json(text), Text) == text
    assert plain(text) == str(text)
    with pytest.raises(msgspec.DecodeError):
        from_kept_json(b"{", Text)


@pytest.mark.parametrize("language", LANGUAGES[1:])
def test_separators__of_lists_are_in_every_language(language: str) -> None:
    assert {mark for style in LIST_STYLES.values() for mark in style} <= texts_of(language).keys()
