"""The page's section on crops: parcels without heights, many of them, and doses."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import shapely

from furrowmap.core.crops.dose_columns import column_words
from furrowmap.core.crops.dose_response import fit_response
from furrowmap.core.crops.measure import MeasuredParcel, ParcelFigures
from furrowmap.core.values.parcel import Parcel
from furrowmap.exporters.reports.page_language import chosen
from furrowmap.exporters.reports.parcel_sections import (
    MAX_NAMED_PARCELS,
    MAX_TABLE_PARCELS,
    UNKNOWN_COLOUR,
    parcel_sections,
)

FIGURES = ParcelFigures(
    id="", points=9000, points_m2=500.0, area_m2=18.0, filled=0.01, mean_height_m=0.5, p50_m=0.5, p90_m=0.55,
    p95_m=0.6, p99_m=0.65, volume_m3=9.0, cover=0.98, height_cv=0.1, roughness_m=0.02, lodging=False,
    penetration_m=0.08, soil_sigma_m=0.004, common_sigma_m=0.003, height_sigma_m=0.005,
    volume_sigma_m3=0.09,
)  # fmt: skip


def parcels(heights_m: list[float], **more: float) -> list[MeasuredParcel]:
    found = []
    for k, height_m in enumerate(heights_m):
        gross = shapely.box(3.0 * k, 0.0, 3.0 * k + 2.5, 10.0)
        parcel = Parcel(f"P{k}", gross, gross.buffer(-0.2, join_style="mitre"))
        figures = replace(FIGURES, id=parcel.id, mean_height_m=height_m, lodging=k == 1)
        found.append(MeasuredParcel(parcel, figures, **more))
    return found


def test_no_parcels__no_section() -> None:
    assert not parcel_sections([])


def test_colours__run_from_the_shortest_to_the_tallest_and_the_unknown_is_grey() -> None:
    text = parcel_sections(parcels([0.3, math.nan, 0.7]))
    assert text.count('fill="#f7fcb9"') >= 1
    assert text.count('fill="#004529"') >= 1
    assert f'fill="{UNKNOWN_COLOUR}"' in text
    assert "30.0 cm" in text
    assert "70.0 cm" in text
    assert "may be lodged" in text
    assert "nan" not in text


@pytest.mark.parametrize("heights_m", [[math.nan, math.nan], [0.4, 0.4]])
def test_heights__unknown_or_all_alike_are_drawn(heights_m: list[float]) -> None:
    text = parcel_sections(parcels(heights_m))
    assert "nan" not in text
    assert text.count('class="pass"') == 2


def test_published_method__has_its_columns_where_it_was_computed() -> None:
    without = parcel_sections(parcels([0.4, 0.5]))
    beside = parcel_sections(parcels([0.4, 0.5], published_height_m=0.45, published_volume_m3=8.1))
    assert "published method" not in without
    assert "published method" in beside
    assert "45.0 cm" in beside
    assert "8.10 m³" in beside


def test_response__is_drawn_over_the_dose_of_the_parcels() -> None:
    dose = np.array([0.0, 50.0, 100.0, 150.0, 200.0])
    rows = [
        replace(row, parcel=replace(row.parcel, block="AB"[k % 2], attributes={"n_kg_ha": float(dose[k])}))
        for k, row in enumerate(parcels([0.4, 0.5, 0.6, 0.65, 0.67]))
    ]
    response = fit_response(dose, np.array([row.figures.mean_height_m for row in rows]))
    text = chosen(parcel_sections(rows, response), "en")
    assert text.count("<circle") >= len(dose)
    assert "mean height" in text
    assert f">{column_words('n_kg_ha')}<" in text


def test_many_parcels__are_cut_in_the_table_and_have_no_names_on_the_map() -> None:
    text = chosen(parcel_sections(parcels([0.4] * (MAX_TABLE_PARCELS + 7))), "en")
    assert "7 more parcels are in parcels.csv" in text
    assert text.count("<tr>") == MAX_TABLE_PARCELS + 1
    assert 'class="number"' in text, "the arrow's N"
    assert ">P3</text>" not in text
    few = parcel_sections(parcels([0.4] * MAX_NAMED_PARCELS))
    assert ">P3</text>" in few
