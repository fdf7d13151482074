"""Charts of a trial: whoever reads them by their axes finds the values of the parcels."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from unicodedata import east_asian_width
from xml.etree import ElementTree as ET

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from furrowmap.core.crops.dose_columns import column_words
from furrowmap.core.crops.dose_response import fit_response
from furrowmap.core.crops.response_values import Estimate, FittedModel, Response
from furrowmap.core.crops.response_words import MODEL_WORDS
from furrowmap.core.runtime.languages.texts import LANGUAGES, Text
from furrowmap.exporters.reports.page_language import chosen
from furrowmap.exporters.reports.trial_charts import (
    GROUP_COLOURS,
    ParcelValues,
    _round_values,
    category_chart,
    residual_chart,
    response_chart,
    standalone,
)
from tests.exporters.reports.drawn import FloatArray, corners, reading, span

DOSE = np.array([0.0, 40.0, 90.0, 160.0, 0.0, 40.0, 90.0, 160.0, np.nan, 40.0])
HEIGHT_M = np.array([0.41, 0.55, 0.62, 0.66, 0.44, 0.57, 0.61, 0.69, 0.90, np.nan])
BLOCK = ["A"] * 4 + ["B"] * 4 + ["A", "B"]
KNOWN = np.isfinite(DOSE) & np.isfinite(HEIGHT_M)
POINTS = ParcelValues(HEIGHT_M, BLOCK, column_words("mean_height_m"), Text("block"))


def response(optimum: Estimate | None = None) -> Response:
    """A response with a curve and a rival where there is an optimum."""
    bare = fit_response(np.zeros(1), np.zeros(1))
    if optimum is None:
        return bare
    dose = np.linspace(0.0, 160.0, 9)
    fitted = 0.4 + 0.3 * dose / 160.0
    models = tuple(
        FittedModel("linear", weight, 1.0, 0.1, 3, 0.02, 0.9, None, {}, optimum, None, fitted + 0.01 * k)
        for k, weight in enumerate((0.7, 0.28, 0.02))
    )
    band = {"band_low": fitted - 0.05 - dose / 4000.0, "band_high": fitted + 0.1}
    return replace(bare, models=models, agronomic=optimum, highest=160.0, dose=dose, **band)


def in_english(chart: str) -> ET.Element:
    return ET.fromstring(chosen(chart, "en"))


def axes(root: ET.Element) -> tuple[FloatArray, FloatArray]:
    """The places of dots, and their values by the labels of the axes: (n, 2) each."""
    labels = [text for text in root.iter("text") if text.text and text.attrib.get("text-anchor") in ("end", "middle")]
    beside = [(float(t.text or ""), float(t.attrib["y"]) - 4.0) for t in labels if t.attrib["x"] == "68.0"]
    below = [(float(t.text or ""), float(t.attrib["x"])) for t in labels if t.attrib["y"] == "336.0" and _is_number(t)]
    places = np.array([(c.attrib["cx"], c.attrib["cy"]) for c in root.iter("circle") if c.attrib["r"] == "3.5"], float)
    across = reading(below)(places[:, 0]) if below else places[:, 0]
    return places, np.column_stack([across, reading(beside)(places[:, 1])])


def _is_number(text: ET.Element) -> bool:
    return (text.text or "").replace(".", "").isdigit()


def test_response_chart__shows_each_parcel_at_its_dose_and_height() -> None:
    chart = response_chart(DOSE, POINTS, response(), "n_kg_ha")
    root = in_english(chart)
    _, read = axes(root)
    assert read == pytest.approx(np.column_stack([DOSE, HEIGHT_M])[KNOWN], abs=0.2)
    assert read[:, 1] == pytest.approx(HEIGHT_M[KNOWN], abs=2e-4)
    words = [text.text for text in ET.fromstring(chosen(chart, "en")).iter("text")]
    assert {"mean height (m)", "n_kg_ha", "block", "A", "B"} <= set(words)
    assert {"0", "50", "100", "150"} <= set(words)
    assert not [*root.iter("polyline"), *root.iter("polygon"), *root.iter("rect")]


@pytest.mark.parametrize(("low", "high"), [(60.0, 120.0), (0.0, 160.0)])
def test_response_chart__shows_the_curve_its_band_a_rival_and_the_optimum(low: float, high: float) -> None:
    found = response(Estimate(80.0, low, high))
    root = in_english(response_chart(DOSE, POINTS, found, "n_kg_ha"))
    places, read = axes(root)
    to_dose, to_height = (np.poly1d(np.polyfit(places[:, k], read[:, k], 1)) for k in range(2))
    (rival, line), (band,) = root.iter("polyline"), root.iter("polygon")
    for drawn, model in ((line, found.models[0]), (rival, found.models[1])):
        assert to_dose(corners(drawn)[:, 0]) == pytest.approx(found.dose, abs=0.05)
        assert to_height(corners(drawn)[:, 1]) == pytest.approx(model.fitted, abs=2e-4)
    above, below = corners(band)[:9], corners(band)[:8:-1]
    for edge, heights_m in ((above, found.band_high), (below, found.band_low)):
        assert to_dose(edge[:, 0]) == pytest.approx(found.dose, abs=0.05)
        assert to_height(edge[:, 1]) == pytest.approx(heights_m, abs=2e-4)
    rate, key = (shape for shape in root.iter("line") if "stroke-dasharray" in shape.attrib)
    assert span(key, "y")[0] > span(rate, "y")[1]  # the legend is below the chart
    assert to_dose(span(rate, "x")) == pytest.approx([80.0, 80.0], abs=0.05)
    (area,) = root.iter("rect")
    assert to_dose(span(area, "x")) == pytest.approx([low, high], abs=0.1)
    for top, bottom in (span(rate, "y"), span(area, "y")):
        assert top < places[:, 1].min() < places[:, 1].max() < bottom
    assert corners(band)[:, 1].max() <= bottom


def test_response_chart__has_no_dashes_at_an_optimum_beyond_the_doses() -> None:
    root = in_english(response_chart(DOSE, POINTS, response(Estimate(160.0, 100.0, 160.0, False, True)), "dose"))
    (key,) = (shape for shape in root.iter("line") if "stroke-dasharray" in shape.attrib)
    assert span(key, "y")[0] > 320.0  # of the legend


def test_residual_chart__has_each_parcel_over_what_is_expected_and_over_the_normal_distribution() -> None:
    residual = np.where(KNOWN, HEIGHT_M - 0.55, np.nan)
    root = in_english(residual_chart(np.where(KNOWN, 0.55 + 0.01 * np.arange(10), np.nan), residual, POINTS))
    dots = np.array([(c.attrib["cx"], c.attrib["cy"]) for c in root.iter("circle") if c.attrib["r"] == "3.5"], float)
    assert len(dots) == 2 * KNOWN.sum()
    left, right = dots[: KNOWN.sum()], dots[KNOWN.sum() :]
    assert (np.diff(left[:, 0]) > 0.0).all()
    assert (np.diff(right[:, 0]) > 0.0).all()
    assert (np.diff(right[:, 1]) <= 0.0).all()  # larger residuals are higher
    assert left[:, 0].max() < right[:, 0].min()
    assert sorted(left[:, 1]) == pytest.approx(sorted(right[:, 1]))
    residual_chart(np.full(10, np.nan), np.full(10, np.nan), POINTS)


@pytest.mark.parametrize("count", [1, 2, 8, 9, 11])
def test_dots__have_the_colour_that_the_legend_gives_their_block(count: int) -> None:
    blocks = [f"{k % count}" for k in range(22)]
    points = ParcelValues(np.linspace(0.2, 0.8, 22), blocks, "height, m", "block")
    root = in_english(response_chart(np.linspace(0.0, 100.0, 22), points, response(), "dose"))
    circles = [*root.iter("circle")]
    dots, legend = circles[:22], circles[22:]
    above = [text for text in root.iter("text") if float(text.attrib["y"]) == 16.0]
    names = [text for text in above if text.attrib["text-anchor"] == "start" and text.text != "height, m"]
    assert len(names) == len(legend) == (min(count, len(GROUP_COLOURS)) if count > 1 else 0)
    for name, mark in zip(names, legend, strict=True):
        assert float(name.attrib["x"]) - float(mark.attrib["cx"]) == pytest.approx(8.0, abs=0.11)
        assert {dot.attrib["fill"] for dot, other in zip(dots, blocks, strict=True) if other == name.text} == {
            mark.attrib["fill"]
        }
    assert len({dot.attrib["fill"] for dot in dots}) == min(count, len(GROUP_COLOURS))
    places = [float(mark.attrib["cx"]) for mark in legend]
    assert all(0.0 < after < before - 20.0 for before, after in pairwise(places))


def test_legend__needs_a_name_of_the_groups() -> None:
    points = ParcelValues(HEIGHT_M, BLOCK, "height, m")
    root = in_english(response_chart(DOSE, points, response(), "dose"))
    assert len([*root.iter("circle")]) == KNOWN.sum()


MEANS = [("N0", 0.42, 0.40, 0.45), ("N90", 0.62, 0.58, 0.63), ("N160", 0.67, 0.61, 0.75)]
TREATMENT = ["N0", "N40", "N90", "N160", "N0", "N40", "N90", "N160", "N0", "N40"]


def test_category_chart__shows_parcels_means_and_intervals() -> None:
    root = in_english(category_chart(TREATMENT, POINTS, MEANS))
    places, read = axes(root)
    chosen = [k for k, name in enumerate(TREATMENT) if name != "N40" and np.isfinite(HEIGHT_M[k])]
    assert read[:, 1] == pytest.approx(HEIGHT_M[chosen], abs=2e-4)
    to_height = np.poly1d(np.polyfit(places[:, 1], read[:, 1], 1))
    at = {text.text: float(text.attrib["x"]) for text in root.iter("text")}
    assert at["N90"] - at["N0"] == pytest.approx(552.0 / 3, abs=0.1)
    strokes = [line for line in root.iter("line") if line.attrib["stroke-width"] != "1"]
    assert len(strokes) == 2 * len(MEANS)
    for (name, mean, low, high), interval, bar in zip(MEANS, strokes[::2], strokes[1::2], strict=True):
        assert span(interval, "x") == pytest.approx([at[name], at[name]], abs=0.1)
        assert to_height(span(interval, "y")) == pytest.approx([low, high], abs=2e-4)
        left, right = span(bar, "x")
        assert 0.5 * (left + right) == pytest.approx(at[name], abs=0.1)
        assert 20.0 < right - left < 30.0
        assert to_height(span(bar, "y")) == pytest.approx([mean, mean], abs=2e-4)
        assert float(bar.attrib["stroke-width"]) > float(interval.attrib["stroke-width"])
    beside = places[:, 0] - [at[TREATMENT[k]] for k in chosen]
    assert beside == pytest.approx([-3.5 if BLOCK[k] == "A" else 3.5 for k in chosen], abs=0.11)


@pytest.mark.parametrize("count", [1, 12, 13, 40])
def test_category_chart__has_room_for_its_names_and_groups(count: int) -> None:
    names = [f"treatment {k}" for k in range(count)]
    points = ParcelValues(np.tile([0.3, 0.4, 0.6], count), ["A", "B", "C"] * count, "height, m", "block")
    root = in_english(category_chart(np.repeat(names, 3).tolist(), points, [(n, 0.4, 0.3, 0.5) for n in names]))
    labels = [text for text in root.iter("text") if (text.text or "").startswith("treatment")]
    step = 552.0 / count
    at = np.array([float(text.attrib["x"]) for text in labels])
    assert at == pytest.approx(74.0 + step * (np.arange(count) + 0.5), abs=0.06)
    assert all(("transform" in text.attrib) == (step < 44.0) for text in labels)
    assert {text.attrib["text-anchor"] for text in labels} == {"end" if step < 44.0 else "middle"}
    places, _ = axes(root)
    beside = places[:, 0].reshape(-1, 3) - at[:, None]
    assert (np.diff(beside, axis=1) > 1.0).all()
    assert np.abs(beside).max() < 0.25 * step
    bars = [span(line, "x") for line in root.iter("line") if line.attrib["stroke-width"] == "3"]
    assert all(right - left < 0.7 * step for left, right in bars)
    assert root.attrib["viewBox"] == "0 0 640 424"


@pytest.mark.parametrize("language", LANGUAGES)
@pytest.mark.parametrize("model", MODEL_WORDS)
def test_keys_of_curves__do_not_run_into_each_other_on_a_phone(model: str, language: str) -> None:
    """There texts have 18 units: a Latin letter takes 0.6 of them at most on average, a Japanese one all."""
    shown = response(Estimate(100.0, 1.0, 90.0, 110.0))
    models = (replace(shown.models[0], name=model), *shown.models[1:])
    chart = response_chart(DOSE, POINTS, replace(shown, models=models), "n_kg_ha")
    root = ET.fromstring(standalone(chart, language).partition("\n")[2])
    below = [text for text in root.iter() if text.tag.endswith("text") and float(text.attrib["y"]) > 370.0]
    assert len(below) == 4
    ends: dict[str, list[tuple[float, float]]] = {}
    for text in below:
        width = sum(18.0 if east_asian_width(letter) in "WF" else 0.6 * 18.0 for letter in text.text or "")
        begin = float(text.attrib["x"])
        ends.setdefault(text.attrib["y"], []).append((begin - 24.0, begin + width))
    for row in ends.values():
        assert [left[1] < right[0] for left, right in pairwise(sorted(row))] == [True]
        assert max(end for _, end in row) <= 640.0


@given(
    middle=st.sampled_from([0.0, 0.4, -25.0, 3e4]),
    reach=st.sampled_from([0.0, 1e-4, 0.3, 7.0, 4e5]),
    values=st.lists(st.integers(-100, 100).map(lambda value: value / 100), min_size=2, max_size=9),
)
def test_charts__of_any_heights_keep_all_within_their_frame(middle: float, reach: float, values: list[float]) -> None:
    heights = middle + reach * np.array(values)
    points = ParcelValues(heights, ["A"] * len(values), "height")
    root = in_english(response_chart(np.arange(float(len(values))), points, response(), "dose"))
    dots = np.array([(c.attrib["cx"], c.attrib["cy"]) for c in root.iter("circle")], float)
    lines = np.array([span(line, "x") for line in root.iter("line")])
    assert len(lines) >= 1
    assert (lines == [74.0, 626.0]).all()
    assert ((dots[:, 0] > 74.0) & (dots[:, 0] < 626.0)).all()
    assert ((dots[:, 1] > 34.0) & (dots[:, 1] < 320.0)).all()
    if np.ptp(values) and reach:
        assert (dots[:, 1].min(), dots[:, 1].max()) == pytest.approx((49.3, 304.7), abs=0.2)  # a margin of 6 %


@given(low=st.floats(-1e5, 1e5), length=st.floats(1e-3, 1e6))
def test_ticks__are_two_to_six_round_values(low: float, length: float) -> None:
    values = np.array(_round_values(low, low + length))
    assert 2 <= len(values) <= 6
    assert values[0] >= low - 1e-6 * length
    assert values[-1] <= low + length + 1e-6 * length
    step = values[1] - values[0]
    assert np.diff(values) == pytest.approx(step, rel=1e-6)
    assert float(f"{step:.3e}"[:5]) in (1.0, 2.0, 2.5, 5.0)
    assert max(values[0] - low, low + length - values[-1]) < step * (1.0 + 1e-6)
    assert 0.2 * length * (1.0 - 1e-6) <= step <= 0.4 * length * (1.0 + 1e-6)


@pytest.mark.parametrize(
    ("end", "step"), [(0.5, 0.1), (5.0, 1.0), (5.1, 2.0), (10.0, 2.0), (10.1, 2.5), (12.5, 2.5), (12.6, 5.0), (25.0, 5)]
)  # fmt: skip
def test_ticks__have_the_least_round_step_of_a_fifth_or_more(end: float, step: float) -> None:
    assert _round_values(0.0, end) == pytest.approx(np.arange(0.0, end + 1e-9, step))
    assert _round_values(-end, 0.0) == pytest.approx(-np.arange(0.0, end + 1e-9, step)[::-1])


@pytest.mark.parametrize(
    ("doses", "low", "high"),
    [([0.0, 0.2], 0.0, 0.2), ([120.0, 160.0], 0.0, 160.0), ([-2.0, -1.0], -2.0, 0.0), ([0.0, 0.0], 0.0, 1.0)],
)  # fmt: skip
def test_response_chart__has_the_doses_from_zero_on_across_its_width(
    doses: list[float], low: float, high: float
) -> None:
    root = in_english(
        response_chart(np.array(doses), ParcelValues(np.array([0.4, 0.6]), "AB", "m"), response(), "dose")
    )
    places = np.array([float(c.attrib["cx"]) for c in root.iter("circle") if c.attrib["r"] == "3.5"])
    assert places == pytest.approx(74.0 + 552.0 * (0.03 + (np.array(doses) - low) / (high - low)) / 1.06, abs=0.06)


def test_charts__of_nothing_known_have_an_axis() -> None:
    nothing = ParcelValues(np.full(2, np.nan), "AB", "height, m")
    for chart in (response_chart(np.arange(2.0), nothing, response(), "dose"), category_chart("AB", nothing, [])):
        root = in_english(chart)
        beside = [text.text for text in root.iter("text") if text.attrib.get("text-anchor") == "end"]
        assert beside == ["0", "0.25", "0.5", "0.75", "1"]


def test_file__of_a_chart_has_a_size_and_a_white_ground() -> None:
    chart = response_chart(DOSE, POINTS, response(), column_words("n_kg_ha"))
    root = ET.fromstring(standalone(chart, "ja").encode())
    words = {text.text for text in root.iter() if text.tag.endswith("text")}
    assert {"平均の高さ（m）", "窒素（kg/ha）", "ブロック", "A"} <= words
    assert root.attrib["viewBox"] == "0 0 640 424"
    assert (root.attrib["width"], root.attrib["height"]) == ("640", "424")
    assert root.tag == "{http://www.w3.org/2000/svg}svg"
    first = root[0]
    assert (first.tag.rpartition("}")[2], first.attrib["fill"]) == ("rect", "#ffffff")
    assert len(root) == len(ET.fromstring(chart)) + 1
