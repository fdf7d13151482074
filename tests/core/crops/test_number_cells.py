"""Numbers in cells as people write them: units, thousands, decimal commas, codes of no data, and what is no number."""

from __future__ import annotations

import numpy as np
import pytest

from furrowmap.core.crops.number_cells import checked_numbers, number_cells
from furrowmap.core.runtime.errors import InputError
from furrowmap.core.values.parcel import Attribute

TRUE = np.array([1234.5, 0.0, 988.25, 12345.75])


@pytest.mark.parametrize(
    "cells",
    [
        ["1234.5", "0", "988.25", "12345.75"],
        [1234.5, 0.0, 988.25, 12345.75],
        ["1234,5", "0", "988,25", "12345,75"],
        ["1.234,5", "0", "988,25", "12.345,75"],
        ["1,234.5", "0", "988.25", "12,345.75"],
        ["1 234,5", "0", "988,25", "12\u202f345,75"],
        ["1'234.5", "0", "988.25", "12\u2019345.75"],
        ["1234.5 kg", "0 kg", "988.25 kg", "12345.75kg"],
        ["1.234,5 kg/ha", "0", "988,25 KG/ha", "12.345,75 kg/ha"],
        ["1234.5 kg ha\u207b\u00b9", "0 kg ha\u207b\u00b9", "988.25 kg ha\u207b\u00b9", "12345.75 kg ha\u207b\u00b9"],
        ["\uff11\uff12\uff13\uff14.5", "0", "988.25", "12345.75"],
        ["1.2345e3", "0", "9.8825e2", "1.234575e4"],
    ],
)
def test_numbers__are_the_same_however_they_are_written(cells: list[Attribute]) -> None:
    found = number_cells(cells)
    np.testing.assert_allclose(found.values, TRUE)
    assert (found.faults, found.codes, found.unclear) == ((), (), None)


@pytest.mark.parametrize("text", ["n.a.", "k.A.", "ausgewintert", "12.3?", "<4.5", "80-100", "2017-03-16", "1,2,3"])
def test_what_is_no_number__is_left_out_and_named(text: str) -> None:
    values, notices = checked_numbers(["80", text, None, "", "120", text], "n_kg_ha", list("ABCDEF"))
    np.testing.assert_array_equal(values, [80.0, np.nan, np.nan, np.nan, 120.0, np.nan])
    (notice,) = notices
    assert notice.code == "trial-cells-unread"
    assert notice.text == f"n_kg_ha: 2 of 6 cells hold no number, the first {text!r} (parcel B). They are left out."


def test_units__of_several_kinds_or_of_some_cells_are_no_numbers() -> None:
    assert number_cells(["80 kg", "80 lb"]).faults == (0, 1)
    found = number_cells(["80", "80 plants lodged", "90"])
    assert found.faults == (1,)
    assert number_cells([80.0, "80 kg"]).faults == (1,)


@pytest.mark.parametrize(
    ("cells", "value"),
    [
        (["4.489", "4.488,8"], [4489.0, 4488.8]),
        (["4,489", "988.5"], [4489.0, 988.5]),
        (["4,489", "1,234,567"], [4489.0, 1234567.0]),
        (["0,489", "4,489"], [0.489, 4.489]),
        (["4.489", "3.355"], [4.489, 3.355]),
        (["4,489", 988.5], [4489.0, 988.5]),
    ],
)
def test_a_separator__means_what_other_cells_of_the_column_show(cells: list[Attribute], value: list[float]) -> None:
    np.testing.assert_allclose(checked_numbers(cells, "yield", ["1", "2"])[0], value)


def test_a_comma__that_may_be_either_is_refused_unless_the_table_has_decimal_commas() -> None:
    with pytest.raises(InputError, match=r"yield holds '4,489' \(parcel 2\): the comma may separate") as refused:
        checked_numbers(["988", "4,489"], "yield", ["1", "2"])
    assert refused.value.code == "trial-cells-unclear"
    np.testing.assert_allclose(checked_numbers(["988", "4,489"], "y", ["1", "2"], decimal_comma=True)[0], [988, 4.489])


@pytest.mark.parametrize("code", ["-9999", "-999", "-99.99", "9999", "-32768"])
def test_codes_of_no_data__are_left_out_where_they_are_far_from_the_others(code: str) -> None:
    values, notices = checked_numbers(["7.5", code, "8.25"], "yield", ["1", "2", "3"])
    np.testing.assert_array_equal(values, [7.5, np.nan, 8.25])
    assert [notice.code for notice in notices] == ["trial-cells-nodata"]
    near, none = checked_numbers(["75000", code, "-82500"], "yield", ["1", "2", "3"])
    np.testing.assert_array_equal(near, [75000.0, float(code), -82500.0])
    assert none == []
