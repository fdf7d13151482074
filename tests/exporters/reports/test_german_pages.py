"""Pages in German: the numbers of the English ones, with the marks of German, and none with a decimal point."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from furrowmap.core.crops.dose_response import fit_response
from furrowmap.exporters.reports.evaluation_page import page as evaluation_page
from furrowmap.exporters.reports.html_pages import _environment, _source
from furrowmap.exporters.reports.parcel_sections import parcel_sections
from tests.exporters.reports import test_evaluation_page as evaluation
from tests.exporters.reports.page_texts import decimal_points, in_german, numbers, shown, texts
from tests.exporters.reports.test_page_language import MADE
from tests.exporters.reports.test_parcel_section import parcels
from tests.exporters.reports.test_season_pages import batch, history, ties
from tests.exporters.reports.test_templates import NAMES


def trial() -> str:
    """Parcels with doses, one without a height."""
    dose = np.array([0.0, 12.5, 25.0, 37.5, 50.0])
    rows = [
        replace(row, parcel=replace(row.parcel, block="AB"[k % 2], attributes={"n_kg_ha": float(dose[k])}))
        for k, row in enumerate(parcels([0.4, 0.51, 0.6, math.nan, 0.67], published_height_m=0.45))
    ]
    heights_m = np.array([row.figures.mean_height_m for row in rows])
    return f'<html lang="en"><head></head><body>{parcel_sections(rows, fit_response(dose, heights_m))}</body></html>'


PAGES = {
    "a run": lambda: MADE,
    "batch": batch,
    "ties": ties,
    "history": history,
    "trial": trial,
    "evaluation": lambda: evaluation_page(evaluation.judged()),
    "services": lambda: evaluation_page(evaluation.services()),
}


@pytest.mark.parametrize("made", PAGES.values(), ids=PAGES)
def test_page__in_german_has_the_numbers_of_the_english_one(made: Callable[[], str]) -> None:
    page = made()
    english, german, japanese = (shown(page, language) for language in ("en", "de", "ja"))
    assert numbers(german) == Counter({in_german(number): count for number, count in numbers(english).items()})
    assert not [text for text in texts(german) if decimal_points(text)]
    assert any("," in number for number in numbers(german))
    assert not any("," in number for number in numbers(japanese) - numbers(english))


@pytest.mark.parametrize("template", NAMES)
def test_template__formats_no_number_but_as_figures(template: str) -> None:
    source = _source(template)
    assert source is not None
    formatted = re.findall(r"\.format\((?:[^()]|\((?:[^()]|\([^()]*\))*\))*\)(\s*\|\s*figures)?", source)
    assert all(formatted)
    assert not re.search(r"\|\s*(?:format|round)\b", source)
    assert "figures" in _environment().filters
