"""The parcels of a run, held against the crop on its own surface."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rasterio
import shapely
from rasterio.features import rasterize
from rasterio.transform import from_origin
from shapely.affinity import translate

from furrowmap.core.crops.measure import MeasuredParcel, ParcelFigures
from furrowmap.core.geodesy.projection import map_frame
from furrowmap.core.values.parcel import Parcel
from furrowmap.core.values.session import Crs
from furrowmap.exporters.files.result_folder import DSM, PARCEL_TABLE
from furrowmap.workflows.crops.parcels import WrittenParcels, held_against_surface

WEST, SOUTH, CROP_M, SIGMA_M = 651_500.0, 6_133_880.0, 0.5, 0.005
SURE_M = (0.005, 0.006)
FRAME = map_frame(Crs("EPSG:25832"))
SOWN = [
    shapely.box(WEST + 10 + 6 * i, SOUTH + 10 + 3 * j, WEST + 15 + 6 * i, SOUTH + 12.4 + 3 * j)
    for i in range(3)
    for j in range(3)
]


@pytest.fixture
def result(tmp_path: Path) -> Path:
    transform = from_origin(WEST, SOUTH + 30.0, 0.1, 0.1)
    soil = np.random.default_rng(4).normal(70.0, 0.01, (300, 400))
    surface = soil + rasterize(SOWN, soil.shape, transform=transform) * CROP_M
    with rasterio.open(
        tmp_path / DSM, "w", "GTiff", 400, 300, 1, "EPSG:25832", transform, "float32", nodata=-9999.0
    ) as raster:
        raster.write(surface.astype(np.float32), 1)
    return tmp_path


def written(east_m: float) -> WrittenParcels:
    found = []
    for k, shape in enumerate(translate(shape, east_m) for shape in SOWN):
        values: dict[str, Any] = {field.name: 0.4 for field in fields(ParcelFigures)}
        values |= {"id": str(k), "points": 900, "lodging": False, "area_m2": 8.0, "height_sigma_m": SIGMA_M}
        found.append(MeasuredParcel(Parcel(str(k), shape, shape.buffer(-0.3)), ParcelFigures(**values)))
    return WrittenParcels(found, None, {"parcels": []}, ())


def test_parcels_beside_the_crop__are_told_with_the_shift_and_state_what_it_costs(result: Path) -> None:
    held = held_against_surface(written(1.0), result, FRAME, SURE_M)
    (notice,) = held.notices
    assert notice.code == "parcels-beside-crop"
    assert held.shift is not None
    assert (held.shift.east_m, held.shift.north_m) == pytest.approx((-1.0, 0.0), abs=0.11)
    stated = np.genfromtxt(result / PARCEL_TABLE, delimiter=",", names=True, encoding="utf-8")["height_sigma_m"]
    assert (stated > 0.2 * CROP_M).all()
    assert held.account["parcels"][0]["height_sigma_m"] == pytest.approx(stated[0], abs=1e-4)


def test_parcels_on_the_crop__stay_as_they_are(result: Path) -> None:
    right = written(0.0)
    assert held_against_surface(right, result, FRAME, SURE_M) == right
    assert not (result / PARCEL_TABLE).exists()


def test_crop_whose_place_is_unsure__has_larger_sigmas(result: Path) -> None:
    """Parcels 1.8 m wide, 0.3 m within their crop, miss half of it where they are 1.2 m off to the north."""
    held = held_against_surface(written(0.0), result, FRAME, (0.006, 0.85))
    assert (held.notices, held.shift) == ((), None)
    sigmas = [row.figures.height_sigma_m for row in held.found]
    assert 0.2 * CROP_M < min(sigmas) < max(sigmas) < CROP_M


def test_parcels_of_a_neighbour__are_told_and_leave_the_positions_alone(result: Path) -> None:
    held = held_against_surface(written(-40.0), result, FRAME, SURE_M)
    (notice,) = held.notices
    assert notice.key == "parcels-beside-crop.elsewhere"
    assert held.shift is not None
    assert (held.shift.east_m, held.shift.north_m) == pytest.approx((40.0, 0.0), abs=0.11)
    assert not held.shift.of_positions
    assert "moved by +40.0 m east" in notice.text
    assert "mirrored east" not in notice.text
