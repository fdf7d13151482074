"""Changes of CRS: exact where only the projection changes, refused where PROJ would only guess."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pyproj import CRS, Proj

from furrowmap.core.geodesy.crs_change import crs_change
from furrowmap.core.runtime.errors import RefusedError

ZONE_IX, ZONE_X, JGD2011 = CRS("EPSG:6677"), CRS("EPSG:6678"), CRS("EPSG:6668")
FIELD = (16_000.0, 96_000.0, 17_000.0, 97_000.0)


@given(e=st.floats(16_000, 17_000), n=st.floats(96_000, 97_000))
def test_change__of_projection_alone_is_that_of_proj(e: float, n: float) -> None:
    change = crs_change(ZONE_IX, ZONE_X, FIELD)
    lon, lat = Proj(ZONE_IX)(e, n, inverse=True)
    np.testing.assert_allclose(np.ravel(change(np.array([e]), np.array([n]))), Proj(ZONE_X)(lon, lat), atol=1e-6)
    assert change.accuracy_m == 0
    assert change.notices == ()


def test_change__to_the_same_crs_moves_nothing() -> None:
    xy = np.array([[16_650.0, 96_560.0], [16_700.25, 96_500.5]])
    np.testing.assert_array_equal(crs_change(ZONE_IX, ZONE_IX, FIELD).points(xy), xy)


def test_change__of_datum_says_how_well_it_is_known() -> None:
    change = crs_change(ZONE_IX, CRS("EPSG:4326"), FIELD)
    assert change.accuracy_m == 1.0
    assert [notice.code for notice in change.notices] == ["crs-change-loose"]


@pytest.mark.parametrize(
    ("source", "target", "place"),
    [
        ("EPSG:4612", "EPSG:6668", (141.3, 38.3, 141.4, 38.4)),  # moved by metres in 2011
        ("EPSG:4301", "EPSG:6668", (140.0, 36.0, 140.1, 36.1)),
    ],
)
def test_promise_18__a_change_that_needs_a_grid_is_refused(source: str, target: str, place: tuple[float, ...]) -> None:
    with pytest.raises(RefusedError, match=r"\.gsb") as refused:
        crs_change(CRS(source), CRS(target), place)  # type: ignore[arg-type]
    assert refused.value.code == "crs-change-grid"


def test_change__of_jgd2000_far_from_the_earthquake_needs_none() -> None:
    assert crs_change(CRS("EPSG:4612"), JGD2011, (143.3, 43.3, 143.4, 43.4)).accuracy_m == 1.0


def test_change__of_coordinates_without_a_place_is_refused() -> None:
    change = crs_change(CRS("EPSG:4326"), CRS("EPSG:32654"), (139.0, 36.0, 140.0, 37.0))
    with pytest.raises(RefusedError, match="EPSG:32654"):
        change(np.array([139.0]), np.array([95.0]))
