"""What a reader takes from a drawing: values, by the labels of its axes."""

from __future__ import annotations

import re
from collections.abc import Callable
from xml.etree import ElementTree as ET

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


def reading(labels: list[tuple[float, float]]) -> Callable[[FloatArray | float], FloatArray]:
    """Values by places along an axis with these labels (value, place)."""
    values, places = np.array(labels, np.float64).T
    slope, start = np.polyfit(places, values, 1)
    assert np.abs(start + slope * places - values).max() <= 0.1 * abs(slope), "labels are evenly spaced"
    return lambda place: start + slope * np.asarray(place, np.float64)


def number(text: str) -> float:
    """The number that a label begins with."""
    found = re.match(r"−?[-+\d.e]+", text)
    assert found is not None, text
    return float(found[0].replace("−", "-"))


def corners(shape: ET.Element) -> FloatArray:
    """Corners (n, 2) of a polyline or polygon."""
    return np.array([point.split(",") for point in shape.attrib["points"].split()], np.float64)


def span(shape: ET.Element, axis: str) -> tuple[float, float]:
    """Both ends of a rectangle or line along "x" or "y"."""
    if shape.tag.endswith("line"):
        return float(shape.attrib[f"{axis}1"]), float(shape.attrib[f"{axis}2"])
    begin = float(shape.attrib[axis])
    return begin, begin + float(shape.attrib["width" if axis == "x" else "height"])
