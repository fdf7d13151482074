"""Which field of a file is the field of a drive."""

from __future__ import annotations

from pathlib import Path

import geopandas
import numpy as np
import pytest
import shapely

from furrowmap.core.coverage.field_boundary import field_boundary, held_against_boundary
from furrowmap.core.geodesy.projection import map_frame
from furrowmap.core.runtime.errors import InputError
from furrowmap.core.values.session import Crs

FRAME = map_frame(Crs(map="EPSG:6677"), None, None)
FIELDS = [shapely.box(x, 96_000.0, x + 90.0, 96_050.0) for x in (16_000.0, 16_100.0, 16_200.0)]
NAMES = ["West", "Middle", "East"]


@pytest.fixture
def file(tmp_path: Path) -> Path:
    table = geopandas.GeoDataFrame({"name": NAMES, "no": [1, 2, 3]}, geometry=FIELDS, crs="EPSG:6677")
    table.to_file(tmp_path / "farm.gpkg", engine="pyogrio")
    return tmp_path / "farm.gpkg"


def drive(*shares: float) -> np.ndarray:
    """Places of which so many hundredths lie in each field, the others on the road beside them."""
    places = [shapely.box(16_000.0, 95_000.0, 16_300.0, 95_010.0), *FIELDS]
    counts = [100 - round(100 * sum(shares)), *(round(100 * share) for share in shares)]
    rng = np.random.default_rng(1)
    rows = [rng.uniform(place.bounds[:2], place.bounds[2:], (n, 2)) for place, n in zip(places, counts, strict=True)]
    return np.concatenate(rows)


@pytest.mark.parametrize(
    ("shares", "chosen"),
    [
        ((0.9, 0.0, 0.0), [0]),
        ((0.0, 0.5, 0.3), [1, 2]),
        ((0.3, 0.3, 0.4), [0, 1, 2]),
        ((0.0, 0.0, 0.0), [0, 1, 2]),
    ],
)
def test_fields__in_which_the_vehicle_was_are_the_field(
    file: Path, shares: tuple[float, ...], chosen: list[int]
) -> None:
    found, notices = field_boundary(file, FRAME, None, drive(*shares))
    wanted = shapely.union_all([FIELDS[k] for k in chosen])
    assert found.symmetric_difference(wanted).area < 0.01
    assert [notice.code for notice in notices] == (["field-chosen"] if len(chosen) < 3 else [])
    for k in range(3):
        assert all((NAMES[k] in notice.text) == (k in chosen) for notice in notices)


@pytest.mark.parametrize("name", ["East", " east ", "3"])
def test_name__chooses_a_field_wherever_the_vehicle_was(file: Path, name: str) -> None:
    found, notices = field_boundary(file, FRAME, name, drive(0.9, 0.0, 0.0))
    assert found.symmetric_difference(FIELDS[2]).area < 0.01
    assert notices == []


def test_name__of_no_field_is_refused_with_those_there_are(file: Path) -> None:
    with pytest.raises(InputError) as error:
        field_boundary(file, FRAME, "North", drive(0.9, 0.0, 0.0))
    assert error.value.code == "field-unknown"
    assert "West / 1, Middle / 2, East / 3" in error.value.lines[2]


def test_fields_without_names__say_so(tmp_path: Path) -> None:
    table = geopandas.GeoDataFrame(geometry=FIELDS, crs="EPSG:6677")
    table.to_file(tmp_path / "farm.geojson", engine="pyogrio", driver="GeoJSON")
    with pytest.raises(InputError, match="have no names"):
        field_boundary(tmp_path / "farm.geojson", FRAME, "North", drive(0.9, 0.0, 0.0))
    _, (notice,) = field_boundary(tmp_path / "farm.geojson", FRAME, None, drive(0.9, 0.0, 0.0))
    assert "without a name" in notice.text


FIELD = FIELDS[1]
PASSES = shapely.box(16_110.0, 96_000.0, 16_180.0, 96_040.0)


@pytest.mark.parametrize(
    ("east_m", "north_m", "key"),
    [
        (0.0, 0.0, None),
        (0.0, -0.9, None),
        (5.0, 5.0, None),
        (0.0, 12.0, None),
        (0.0, 18.0, "boundary-apart"),
        (-40.0, 0.0, "boundary-apart"),
        (100.0, 0.0, "boundary-apart.wholly"),
        (0.0, 500.0, "boundary-apart.wholly"),
    ],
)
def test_boundary__of_another_field_is_told_by_the_ground_worked(
    east_m: float, north_m: float, key: str | None
) -> None:
    """Up to a metre beside the boundary is a strip along it, and a tenth of the ground a headland."""
    worked = shapely.transform(PASSES, lambda xy: xy + np.array([east_m, north_m]))
    notices = held_against_boundary(FIELD, worked, drive(0.0, 1.0, 0.0))
    assert [notice.key for notice in notices] == ([key] if key else [])
    share = 1.0 - worked.intersection(FIELD).area / worked.area
    if key == "boundary-apart":
        assert f"{share:.0%} of the worked ground" in notices[0].text
    elif key:
        assert f"{shapely.distance(worked, FIELD):,.1f} m away" in notices[0].text


def test_drive_without_known_work__is_in_its_field_where_it_was_there_at_all() -> None:
    assert held_against_boundary(FIELD, None, drive(0.0, 0.02, 0.0)) == []
    (notice,) = held_against_boundary(FIELD, None, drive(0.9, 0.0, 0.0))
    assert notice.key == "boundary-apart.wholly"
    assert held_against_boundary(None, None, drive(0.9, 0.0, 0.0)) == []
