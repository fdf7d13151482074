"""Numbers in the notation of each language: everywhere but in code, which is typed as it stands."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from itertools import product
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from furrowmap.core.runtime.errors import InputError, Notice
from furrowmap.core.runtime.languages.templates import FIGURES, Choice, Hole, parts_of, walk
from furrowmap.core.runtime.languages.texts import (
    CLAUSE,
    LANGUAGES,
    LIST_STYLES,
    NUMBERS,
    TEXT_TABLE,
    Text,
    catalogue,
    figure_text,
    filled,
    in_marks,
    marks_of,
    shown_values,
    templates,
)

WITH_MARKS = [language for language in LANGUAGES if NUMBERS in catalogue(language)]
SPECS = sorted(
    {
        part.spec
        for templates_of in templates("en").values()
        for template in templates_of.values()
        for part in walk(parts_of(template))
        if isinstance(part, Hole) and re.fullmatch(r"[+,]*(\.\d+)?[fge%]|,", part.spec)
    }
)
"""Every format of a number in a message."""
VALUE = 1234.5
CODE = re.compile(r"`[^`]*`")
TYPED = re.compile(r"(?:\w_\w+ = |--[a-z][a-z-]* )\[?\{(\w+)\}")
"""A value behind a key or an option, as a user types it."""


def all_templates(language: str) -> Iterator[tuple[str, str]]:
    """Every English template and that of a language."""
    for key, english in templates("en").items():
        yield from ((english[part], templates(language)[key][part]) for part in english)
    yield from catalogue(language)[TEXT_TABLE].items()


def numeric(template: str) -> dict[str, str]:
    """The names of numbers in a template, and their formats."""
    styles = {*LIST_STYLES, CLAUSE, FIGURES}
    return {
        part.name: part.spec
        for part in walk(parts_of(template))
        if isinstance(part, Hole) and part.spec not in styles and not part.conversion
    }


def said(english: str, own: str, values: Mapping[str, Any], language: str) -> str:
    return filled(parts_of(own), shown_values([parts_of(english)], values.items(), language), language)


def swapped(text: str, language: str) -> str:
    """An independent way from English marks to those of a language: letter by letter."""
    marks = catalogue(language)[NUMBERS]
    return text.translate(str.maketrans({".": marks["decimal"], ",": marks["thousands"]}))


@pytest.mark.parametrize("language", WITH_MARKS)
def test_number__of_every_format_of_every_template_has_the_marks_of_the_language(language: str) -> None:
    seen = 0
    for english, own in all_templates(language):
        formats = numeric(english)
        if not formats:
            continue
        values: dict[str, Any] = {
            name: 1234 if spec.endswith(("d", "x", "X")) else VALUE for name, spec in formats.items()
        }
        others = [part for part in walk(parts_of(english)) if part.name not in formats]
        choices = sorted({part.name for part in others if isinstance(part, Choice)})
        values |= dict.fromkeys((part.name for part in others), "…")
        for chosen in product((True, False), repeat=min(len(choices), 4)):
            text = said(english, own, values | dict(zip(choices, chosen, strict=False)), language)
            outside = CODE.sub("", text)
            for name, spec in formats.items():
                shown = format(values[name], spec)
                assert shown == swapped(shown, language) or shown not in outside, (name, text)
                seen += swapped(shown, language) in outside
    assert seen > 500


@pytest.mark.parametrize("language", WITH_MARKS)
def test_number__that_is_to_be_typed_stands_in_code(language: str) -> None:
    """A comma would change what it means in a session file or on a command line."""
    for english, own in all_templates(language):
        assert not set(TYPED.findall(CODE.sub("", own))) & numeric(english).keys(), own


@given(st.floats(-1e9, 1e9), st.sampled_from(SPECS), st.sampled_from(WITH_MARKS))
def test_number__with_its_marks_swapped_back_is_the_english_one(value: float, spec: str, language: str) -> None:
    english = str(Text(f"{{value:{spec}}}", value=value))
    assert english == format(value, spec)
    own = Text(f"{{value:{spec}}}", value=value).in_language(language)
    marks = catalogue(language)[NUMBERS]
    assert own.translate(str.maketrans({marks["decimal"]: ".", marks["thousands"]: ","})) == english
    assert figure_text(english).in_language(language) == own


def test_numbers__in_german() -> None:
    assert Text("{a:,.1f} m, {b}, {c:.2f}", a=14511.0, b=0.21, c=3).in_language("de") == "14.511,0 m, 0,21, 3,00"
    assert figure_text("+1,234.50 ± 0.21 m²").in_language("de") == "+1.234,50 ± 0,21 m²"
    assert figure_text("1.5°, -0.2°, 90.0°").in_language("de") == "1,5°; -0,2°; 90,0°"
    assert Text("{sizes}", sizes=(1.5, "a.b", 2)).in_language("de") == "1,5, a.b, 2"
    assert Text("{area}", area=figure_text("0.5 ha")).in_language("de") == "0,5 ha"
    assert Text("{area:figures}", area=figure_text("0.5 ha")).in_language("de") == "0,5 ha"


def test_names__keep_their_points() -> None:
    text = Text("{path} {crs} {given!r} {time}", path="0.5/v1.2.las", crs="2011.4", given=0.5, time="09:41:12.345")
    assert text.in_language("de") == "0.5/v1.2.las 2011.4 0.5 09:41:12.345"


def test_code__keeps_the_points_of_numbers() -> None:
    values = {"first": "a", "last": "b", "begin": "c", "end": "d", "offset_s": 3600.5, "stated_s": 0.5, "cause": "e"}
    names = {
        hole.name for part in templates("de")["no-common-time.no-overlap"].values() for hole in walk(parts_of(part))
    }
    error = InputError("no-common-time.no-overlap", **{name: values.get(name, 1) for name in names})
    assert "`lidar_minus_gnss_s = +0.5`" in error.lines_in("de")[0]


def test_warning__has_figures_of_its_strings_in_each_language() -> None:
    notice = Notice(
        "gnss-not-fixed", others=0.125, words="float 3.2 s, single 1,200.0 s", first="2026-05-23T09:41:12.345Z"
    )
    assert "(float 3,2 s, single 1.200,0 s), zuerst um 2026-05-23T09:41:12.345Z" in notice.text_in("de")
    assert "float 3.2 s, single 1,200.0 s" in notice.text
    assert "float 3.2 s, single 1,200.0 s" in notice.text_in("ja")


@pytest.mark.parametrize("language", [language for language in LANGUAGES if language not in WITH_MARKS])
def test_numbers__of_other_languages_are_as_in_english(language: str) -> None:
    assert not marks_of(language)
    assert in_marks("1,234.5 ± 0.2, 3.4", language) == "1,234.5 ± 0.2, 3.4"
