"""Words of the report: durations, numbers and areas as a farmer reads them."""

from __future__ import annotations

from xml.etree import ElementTree as ET

import numpy as np
import pytest

from furrowmap.exporters.reports.page_language import chosen
from furrowmap.exporters.reports.quantity_words import NOT_KNOWN, duration_words, number
from furrowmap.exporters.reports.report_page import _median, range_image, range_picture


@pytest.mark.parametrize(
    ("length_s", "words"),
    [
        (0.4, "0 s"), (59.4, "59 s"), (59.6, "1 min 00 s"), (3599.4, "59 min 59 s"), (3599.6, "1 h 00 min"),
        (3661.0, "1 h 01 min"), (90_061.0, "25 h 01 min"),
    ],
)  # fmt: skip
def test_durations(length_s: float, words: str) -> None:
    assert str(duration_words(length_s)) == words


def test_numbers__that_are_not_known_are_called_so() -> None:
    assert str(number(1.25, "{:.1f} m")) == "1.2 m"
    assert number(float("nan"), "{:.1f} m") == number(None, "{:.1f} m") == NOT_KNOWN
    assert str(NOT_KNOWN) == "unknown"
    assert _median(np.array([np.nan, 3.0, 1.0, 2.0])) == 2.0
    assert np.isnan(_median(np.full(3, np.nan)))


def test_depth_picture__of_nothing_is_grey() -> None:
    picture = range_picture(np.full((4, 6), np.nan, np.float32), None)
    assert picture.shape == (4, 6, 3)
    assert set(picture.ravel().tolist()) == {238}


def test_range_image__has_axes_in_degrees_and_lasers_and_the_ranges_of_its_colours() -> None:
    azimuth_deg = np.arange(340.5, 400.0)  # across azimuth 0
    range_m = np.tile(np.linspace(2.0, 5.0, len(azimuth_deg), dtype=np.float32), (16, 1))
    image = ET.fromstring(chosen(range_image(range_m, azimuth_deg, None, "up"), "en"))
    texts = {str(text.text): float(text.get("x", "nan")) for text in image.iter("text")}
    assert {"1", "8", "16", "laser", "azimuth", "range 2.1 m", "4.9 m"} <= set(texts)
    assert {"340°", "350°", "0°", "10°", "20°", "30°", "40°"} <= set(texts)
    assert texts["350°"] - texts["340°"] == pytest.approx((640.0 - 58.0) / 6.0, abs=0.2)


def test_range_picture__shows_what_is_chosen_and_the_rest_pale() -> None:
    range_m = np.full((2, 3), 3.0, np.float32)
    chosen = np.array([[True, False, False], [False, False, False]])
    picture = range_picture(range_m, chosen)
    assert picture[1, 0].tolist() == [253, 231, 37]  # the lowest laser is the last row
    assert (picture[0] == picture[0, 0]).all()
    assert picture[0, 0].min() > 180
