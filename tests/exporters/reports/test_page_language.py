"""Pages in Japanese and in other units, and back to what they were."""

from __future__ import annotations

import html
import math
import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from furrowmap.core.runtime.errors import printable
from furrowmap.core.runtime.languages.texts import Text
from furrowmap.exporters.reports.area_units import (
    ACRE_M2,
    AREA_UNITS,
    area,
    area_text,
    in_area_unit,
    rate_words,
    work_rate,
)
from furrowmap.exporters.reports.page_language import has_other_languages, in_language, in_page, language_of, unbroken
from tests.exporters.reports.page_texts import texts


def text_of(template: str, /, **values: object) -> str:
    """A text of a page that has no language yet, as HTML."""
    return html.escape(in_page(Text(template, **values)))


MADE = f"""<!DOCTYPE html>
<html lang="en">
<head>
<title>Two passes beside the barn</title>
<style>body {{ color: black; }}</style>
</head>
<body>
<h1>Two passes beside the barn</h1>
<p><b>{text_of("{area} worked in {passes} passes", area=area(5421.3), passes=3)}</b></p>
<div><b>{area(5421.3)}</b><span>{text_of("worked")}</span></div>
<div><b>{work_rate(0.53)}</b><span>{text_of("recorded")}</span></div>
<h2>{text_of("Passes")}</h2>
<table><tr><th>{text_of("pass")}</th></tr><tr><td>1</td><td>10:59:34</td></tr></table>
<figure><svg aria-label="{text_of("Map of the ground worked")}"></svg></figure>
<ul class="key"><li>{text_of("{fix} {share:.0%}", fix=Text("RTK fixed"), share=0.93)}</li></ul>
<footer>furrowmap 0.1.0</footer>
</body>
</html>
"""
"""A page as templates make it."""
PAGE = in_area_unit(in_language(MADE, "en"), "ha")


def test_page__in_japanese_has_no_english_but_names() -> None:
    page = in_language(PAGE, "ja")
    assert language_of(page) == "ja"
    words = {re.sub("<data.*?</data>", "", html.unescape(text)).strip() for text in texts(page)}
    assert "RTK FIX 93%" in words
    assert {word for word in words if re.search(r"[A-Za-z]{4}", word)} == {
        "Two passes beside the barn",
        "furrowmap 0.1.0",
    }
    assert '3 行程で <data class="area" value="5421.3">0.542 ha</data> を作業' in page
    assert 'aria-label="作業した範囲の地図"' in page


def test_page__in_japanese_becomes_the_english_one_again() -> None:
    page = in_language(PAGE, "ja")
    assert in_language(page, "ja") == page
    assert in_language(page, "en") == PAGE
    assert in_area_unit(in_language(MADE, "ja"), "ha") == page
    with pytest.raises(ValueError, match="no catalogue"):
        in_language(PAGE, "xx")


def test_page__keeps_the_unit_of_its_areas_in_another_language() -> None:
    """Also of those in sentences, wherever the sentence has them."""
    page = in_area_unit(in_language(PAGE, "ja"), "10a")
    english = in_language(page, "en")
    assert "⟦" not in english
    assert '<data class="area" value="5421.3">54.21 a</data> worked in 3 passes' in english
    assert in_area_unit(english, "ha") == PAGE


def test_page__without_texts_of_the_product_keeps_none() -> None:
    assert has_other_languages(PAGE)
    page = in_language('<html lang="en"><head></head><body>北の畑 & 1</body></html>', "ja")
    assert page == '<html lang="ja"><head></head><body>北の畑 & 1</body></html>'
    assert not has_other_languages(page)


@given(st.text(), st.text())
def test_text__of_a_page_has_any_name_in_it(name: str, other: str) -> None:
    """Names with tags, quotes, brackets of marks or line ends are what they were, on one line."""
    made = f'<html lang="en"><head></head><p>{text_of("Map: {tool}", tool=name)}</p><p>{html.escape(other)}</p></html>'
    for language, begin in (("en", "Map: "), ("ja", "地図：")):
        page = in_language(in_language(made, language), language)
        body = page.partition("</head>")[2]
        assert body.count("<p>") == 2
        first, second = (html.unescape(part.partition("</p>")[0]) for part in body.split("<p>")[1:])
        assert first == printable(f"{begin}{name}")
        assert second == other


@pytest.mark.parametrize(
    ("unit", "words", "rate"),
    [("ha", "0.542 ha", "0.53 ha/h"), ("10a", "54.21 a", "11.3 min/10 a"), ("acre", "1.340 acres", "1.31 acres/h")],
)
def test_page__in_another_unit(unit: str, words: str, rate: str) -> None:
    page = in_area_unit(PAGE, unit)
    assert page.count(f">{words}</data>") == 2
    assert f">{rate}</data>" in page
    assert in_area_unit(page, "ha") == PAGE


def test_units__are_the_same_area() -> None:
    for area_m2 in (1_000.0, 54_213.0, 1e6):
        ha, a, acres = (float(str(area_text(area_m2, unit)).split()[0].replace(",", "")) for unit in AREA_UNITS)
        assert math.isclose(ha * 100.0, a, rel_tol=1e-3)
        assert math.isclose(acres * ACRE_M2, area_m2, rel_tol=3e-3)
    assert str(area_text(42.5, "10a")) == "42.5 m²"
    assert str(area_text(2.773, "acre")) == "2.77 m²"
    assert str(area(math.nan)) == str(work_rate(math.nan)) == "unknown"
    assert rate_words(0.0, "10a") == "unknown"


@pytest.mark.parametrize(
    "name", ['⟦area x⟧ <data value="1">', "⟦said 5⟧", '⟦said {"en": 1}⟧', "⟦said {⟧", "⟦said \ud800⟧"]
)
def test_page__that_a_name_imitates_keeps_its_figures(name: str) -> None:
    page = in_area_unit(in_language(MADE.replace("beside the barn", html.escape(name)), "ja"), "acre")
    assert html.escape(name) in page
    assert language_of(in_language(page, "en")) == "en"


@pytest.mark.parametrize(
    ("text", "lines"),
    [
        ("33.43 ± 0.21 m² worked", ["33.43 ± 0.21 m²", "worked"]),
        ("missed (± 95 %)", ["missed", "(± 95 %)"]),
        ("± 0.29°, ± 0.17°", ["± 0.29°,", "± 0.17°"]),
        ("4.2 s in 3 passes, 0.21 ha/h", ["4.2 s", "in", "3", "passes,", "0.21 ha/h"]),
        ("95 %信頼区間、3 行程", ["95 %信頼区間、3 行程"]),
        ("2 mm of 3 metres", ["2 mm", "of", "3", "metres"]),
    ],
)
def test_figures__stay_on_one_line(text: str, lines: list[str]) -> None:
    """A line may break at plain spaces, not within a figure; tags keep theirs."""
    page = unbroken(f'<p class="a ± 1 m">{text}</p>')
    assert page.startswith('<p class="a ± 1 m">')
    said = re.sub("<[^>]*>", "", page)
    assert said.replace("\u00a0", " ") == text
    assert [part.replace("\u00a0", " ") for part in said.split(" ")] == lines


def test_page__with_unbroken_figures_is_translated_and_back() -> None:
    japanese = unbroken(in_language(unbroken(PAGE), "ja"))
    assert japanese == unbroken(in_language(PAGE, "ja"))
    assert unbroken(in_language(japanese, "en")) == unbroken(PAGE)
