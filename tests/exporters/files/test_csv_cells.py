"""Cells of CSV files: what a spreadsheet would evaluate or a terminal obey is text; numbers are numbers."""

from __future__ import annotations

import csv
import io
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from pyproj import CRS

from furrowmap.core.accuracy.point_check import CHECK_COLUMNS, PointCheck
from furrowmap.core.readers.vector_file import VectorLayer
from furrowmap.exporters.exchange.vectors import FORMATS
from furrowmap.exporters.files.csv_cells import cell, write_csv_table

DANGEROUS = "=+-@\t\r＝＋－＠"
texts = st.text() | st.builds(str.__add__, st.sampled_from(DANGEROUS), st.text())


def is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return text[-1:].isdigit() or text.endswith(".")


@given(text=texts)
def test_promise_25__no_cell_of_text_is_evaluated_or_obeyed(text: str) -> None:
    shown = cell(text)
    assert isinstance(shown, str)
    assert shown.isprintable()
    assert shown[:1] not in set(DANGEROUS) or is_number(shown)
    assert cell(shown) == shown
    assert next(csv.reader(io.StringIO(f'"{shown.replace(chr(34), chr(34) * 2)}"'))) == [shown]


@pytest.mark.parametrize("text", ["-1.5", "+3", "-.5e-3", "1e5", "12", "B-1", "圃場 7", "a = b", ""])
def test_cell__numbers_and_ordinary_texts_stay_as_they_are(text: str) -> None:
    assert cell(text) == text


@pytest.mark.parametrize(
    ("text", "shown"),
    [("=1+2", "'=1+2"), ("-1-2", "'-1-2"), ("@SUM(A1)", "'@SUM(A1)"), ("+81 90", "'+81 90"), ("－1+cmd", "'－1+cmd"),
     (" \t=a\x1b]0;x\x07", "'=a\\x1b]0;x\\x07"), ("a\r\n=b", "a =b"), ("-inf", "'-inf")],
)  # fmt: skip
def test_cell__begins_with_an_apostrophe_where_it_would_be_a_formula(text: str, shown: str) -> None:
    assert cell(text) == shown


@given(value=st.integers() | st.floats() | st.none() | st.booleans())
def test_cell__what_is_no_text_is_not_touched(value: object) -> None:
    assert cell(value) is value


@given(names=st.lists(texts, min_size=1, max_size=3, unique_by=cell))
def test_promise_25__exported_table_is_harmless_in_cells_and_header(
    names: list[str], tmp_path_factory: pytest.TempPathFactory
) -> None:
    path = tmp_path_factory.getbasetemp() / "hostile.csv"
    values = {f"=f{i}{name}": np.array([name, None], object) for i, name in enumerate(names)}
    points = shapely.points([(-1.5, -3.25), (2.0, 4.0)])
    layer = VectorLayer(points, {**values, "change_m": np.array([-0.25, 1.0])}, CRS("EPSG:6677"))
    write = FORMATS["csv"].write_one
    assert write is not None
    write(path, layer)
    with path.open(encoding="utf-8", newline="") as file:
        header, first, second = csv.reader(file)
    assert [*header[-3:], *first[-3:]] == ["change_m", "e_m", "n_m", "-0.25", "-1.5", "-3.25"]
    assert first[: len(names)] == [cell(name) for name in names]
    assert second[: len(names)] == [""] * len(names)
    assert not any(text[:1] in set(DANGEROUS) for text in header)
    assert pd.read_csv(path)["change_m"].tolist() == [-0.25, 1.0]


def test_promise_25__table_of_surveyed_points_shows_hostile_names_as_text(tmp_path: Path) -> None:
    point = PointCheck("=HYPERLINK(1)\x1b[2J", (-1.5, 2.0, 3.0), (-1.25, 2.0, 2.5))
    write_csv_table(tmp_path / "a.csv", CHECK_COLUMNS, [point.row()])
    with (tmp_path / "a.csv").open(encoding="utf-8", newline="") as file:
        (row,) = csv.DictReader(file)
    assert row["name"] == "'=HYPERLINK(1)\\x1b[2J"
    assert (row["e_m"], row["error_e_m"], row["error_h_m"]) == ("-1.5", "0.25", "-0.5")
