"""Pages in Japanese and in other units, and back to what they were."""

from __future__ import annotations

import html
import math
import re

import pytest

from furrowmap.core.runtime.languages.catalogue import translated
from furrowmap.exporters.reports.area_units import (
    ACRE_M2,
    AREA_UNITS,
    area,
    area_words,
    in_area_unit,
    rate_words,
    work_rate,
)
from furrowmap.exporters.reports.page_language import in_language, language_of, unbroken
from tests.exporters.reports.page_texts import texts

PAGE = in_area_unit(
    f"""<!DOCTYPE html>
<html lang="en">
<head>
<title>Two passes beside the barn</title>
<style>body {{ color: black; }}</style>
</head>
<body>
<h1>Two passes beside the barn</h1>
<p class="soft">2026-06-11, 10:59:34 to 11:00:37 (Asia/Tokyo, UTC+09:00)</p>
<p><b>{area(5421.3)} worked in 3 passes, 3.1% of it twice, no strip missed.</b></p>
<div><b>{area(5421.3)}</b><span>worked</span></div>
<div><b>{work_rate(0.53)}</b><span>recorded</span></div>
<h2>Passes</h2>
<table><tr><th>pass</th><th>from</th><th>to</th></tr><tr><td>1</td><td>10:59:34</td><td>11:00:01</td></tr></table>
<h2>Map</h2>
<figure><svg aria-label="Map of the ground worked"></svg><figcaption>Areas in the map&#39;s plane.</figcaption></figure>
<ul class="key"><li>RTK fixed 93%</li></ul>
<footer>furrowmap 0.1.0</footer>
</body>
</html>
""",
    "ha",
)


def test_page__in_japanese_has_no_english_but_names() -> None:
    page = in_language(PAGE, "ja")
    assert language_of(page) == "ja"
    words = {re.sub("<data.*?</data>", "", html.unescape(text)).strip() for text in texts(page)}
    assert "RTK FIX 93%" in words
    assert {word for word in words if re.search(r"[A-Za-z]{4}", word)} == {
        "Two passes beside the barn",
        "2026-06-11, 10:59:34～11:00:37（Asia/Tokyo、UTC+09:00）",
        "furrowmap 0.1.0",
    }
    assert '3 行程で <data class="area" value="5421.3">0.542 ha</data> を作業、うち 3.1% は重複' in page
    assert 'aria-label="作業した範囲の地図"' in page


def test_summary__of_a_field_is_translated_part_by_part() -> None:
    """Its last part is a sentence that the catalogue has; what is before it is not a part of that."""
    said = "34.2 m² worked in 3 passes, 3.1% of it twice, 2.77 m² missed between, 10.0% of the field (341 m²) worked"
    worked = "3 行程で 34.2 m² を作業、うち 3.1% は重複、行程間の作業残し 2.77 m²、圃場（341 m²）の 10.0% を作業"
    assert translated(f"{said}, 304 m² of it not worked yet.", "ja") == f"{worked}、未作業 304 m²。"
    assert translated(f"{said}.", "ja") == f"{worked}。"
    assert translated("9 m² worked in 1 pass, 0.1 m² missed between.", "ja") == (
        "1 行程で 9 m² を作業、行程間の作業残し 0.1 m²。"
    )


def test_page__in_japanese_becomes_the_english_one_again() -> None:
    page = in_language(PAGE, "ja")
    assert in_language(page, "ja") == page
    assert in_language(page, "en") == PAGE


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
        ha, a, acres = (float(area_words(area_m2, unit).split()[0].replace(",", "")) for unit in AREA_UNITS)
        assert math.isclose(ha * 100.0, a, rel_tol=1e-3)
        assert math.isclose(acres * ACRE_M2, area_m2, rel_tol=3e-3)
    assert area_words(42.5, "10a") == "42.5 m²"
    assert area_words(2.773, "acre") == "2.77 m²"
    assert area(math.nan) == work_rate(math.nan) == "unknown"
    assert rate_words(0.0, "10a") == "unknown"


def test_page__that_a_name_imitates_keeps_its_figures() -> None:
    page = in_area_unit(PAGE.replace("beside the barn", html.escape('⟦area x⟧ <data value="1">')), "acre")
    assert "⟦area x⟧ &lt;data value=&quot;1&quot;&gt;" in in_language(page, "ja")


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
    japanese = in_language(unbroken(PAGE), "ja")
    assert japanese == in_language(PAGE, "ja")
    assert in_language(unbroken(japanese), "en") == PAGE
