"""Coordinates of KML as programs write them: each way gives the same corners, or is refused."""

from pathlib import Path

import numpy as np
import pyproj
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from furrowmap.core.readers.vector_file import read_polygons
from furrowmap.core.runtime.errors import InputError

KML = (
    '<?xml version="1.0"?><kml xmlns="http://www.opengis.net/kml/2.2"><Placemark><Polygon><outerBoundaryIs>'
    "<LinearRing><coordinates>{}</coordinates></LinearRing></outerBoundaryIs></Polygon></Placemark></kml>"
)
WRITTEN = {
    "standard": (",", " "),
    "a line each": (",", "\n"),
    "spaces behind commas": (", ", " "),
    "spaces around commas": (" , ", "\n"),
    "commas between tuples": (",", ","),
    "commas and spaces between tuples": (",", ", "),
    "commas and lines between tuples": (",", ",\n"),
    "lines and commas between tuples": (",", "\n,"),
    "spaces behind all commas": (", ", ", "),
}
"""What stands within tuples and between them."""


def unreadable(why: str) -> InputError:
    return InputError("within-unreadable", path="field.kml", why=why, formats="")


def corners_of(text: str, folder: Path) -> np.ndarray:
    path = folder / "field.kml"
    path.write_text(KML.format(text), "utf-8")
    (shape,) = read_polygons(path, unreadable).shapes
    return shapely.get_coordinates(shape)


@given(
    lon=st.floats(-179.0, 179.0),
    lat=st.floats(-80.0, 80.0),
    height_m=st.none() | st.floats(-400.0, 4000.0),
    sides=st.integers(3, 12),
    size_deg=st.floats(0.0002, 0.01),
    written=st.sampled_from(sorted(WRITTEN)),
    a_line=st.integers(1, 4),
    closed=st.booleans(),
    ends_with_comma=st.booleans(),
)
def test_corners__however_the_tuples_are_written(
    lon: float,
    lat: float,
    height_m: float | None,
    sides: int,
    size_deg: float,
    written: str,
    a_line: int,
    closed: bool,
    ends_with_comma: bool,
    tmp_path_factory: pytest.TempPathFactory,
) -> None:
    angles = np.linspace(0.0, 2.0 * np.pi, sides, endpoint=False)
    corners = np.round(np.column_stack([lon + size_deg * np.cos(angles), lat + size_deg * np.sin(angles)]), 9)
    ring = np.vstack([corners, corners[:1]])
    within, between = WRITTEN[written]
    rest = [] if height_m is None else [f"{height_m:.2f}"]
    tuples = [within.join([f"{x:.9f}", f"{y:.9f}", *rest]) for x, y in (ring if closed else corners)]
    lines = [between.join(tuples[k : k + a_line]) for k in range(0, len(tuples), a_line)]
    text = "\n".join(lines) + "," * ends_with_comma
    nearest = 10.0 * np.ptp(ring, axis=0).max()
    apart = max(np.ptp([lon, lat, *([] if height_m is None else [height_m])]), abs(lon - lat))
    if apart < 2.0 * nearest:  # so near to each other that no reading is certain
        return
    np.testing.assert_allclose(corners_of(text, tmp_path_factory.mktemp("kml")), ring, atol=1e-9)


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("10.1,51.4,0,10.2 51.4,0,10.3,51.5,0 10.1,51.4,0", "no certain number of coordinates"),
        ("10.1,51.4,0,10.2,51.4,0,10.2", "no certain number of coordinates"),
        ("0,0,0,0.001,0,0,0.001,0.001,0,0,0,0", "no certain number of coordinates"),
        ("10.1 51.4 10.2 51.4 10.2 51.5", "'10.1' is no longitude and latitude"),
        ("10.1,,51.4 10.2,,51.4 10.2,,51.5", "is no longitude and latitude"),
        ("10.1,51.4,0;10.2,51.4,0;10.2,51.5,0", "is no longitude and latitude"),
        ("", "a ring of 0 corners"),
    ],
)
def test_text__that_can_be_read_in_two_ways_or_none_is_refused(text: str, why: str, tmp_path: Path) -> None:
    with pytest.raises(InputError) as raised:
        corners_of(text, tmp_path)
    assert why in raised.value.what


def test_sample__keeps_its_whole_area(shared_data: Path) -> None:
    path = shared_data / "foreign/05-kml-comma-between-tuples/L_comma.kml"
    (shape,) = read_polygons(path, unreadable).shapes
    area_m2, _ = pyproj.Geod(ellps="WGS84").geometry_area_perimeter(shape)
    assert abs(area_m2) == pytest.approx(96.06, abs=0.01)
