"""Words of the report: durations, numbers and areas as a farmer reads them."""

from __future__ import annotations

import numpy as np
import pytest

from furrowmap.exporters.reports.page_parts import duration_words
from furrowmap.exporters.reports.report_page import _depth_picture, _median, _number


@pytest.mark.parametrize(
    ("length_s", "words"),
    [
        (0.4, "0 s"), (59.4, "59 s"), (59.6, "1 min 00 s"), (3599.4, "59 min 59 s"), (3599.6, "1 h 00 min"),
        (3661.0, "1 h 01 min"), (90_061.0, "25 h 01 min"),
    ],
)  # fmt: skip
def test_durations(length_s: float, words: str) -> None:
    assert duration_words(length_s) == words


def test_numbers__that_are_not_known_are_called_so() -> None:
    assert _number(1.25, 1, " m") == "1.2 m"
    assert _number(float("nan"), 1, " m") == "unknown"
    assert _median(np.array([np.nan, 3.0, 1.0, 2.0])) == 2.0
    assert np.isnan(_median(np.full(3, np.nan)))


def test_depth_picture__of_nothing_is_grey() -> None:
    picture = _depth_picture(np.full((4, 6), np.nan, np.float32), None)
    assert picture.shape == (4, 6, 3)
    assert set(picture.ravel().tolist()) == {238}
