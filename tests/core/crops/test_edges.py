"""Parcels, soil and doses at the edge of what can be computed: nothing, too little, or all alike."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import rasterio
import shapely
from pyproj import CRS

from furrowmap.core.crops.bare_soil import (
    MIN_SOIL_CELLS,
    HeightCovariance,
    SoilCells,
    interpolate_soil,
    noise_in_pixels,
    without_crop,
)
from furrowmap.core.crops.dose_columns import column_words, dose_name, dose_unit, parcel_doses
from furrowmap.core.crops.dose_response import fit_response
from furrowmap.core.crops.parcel_areas import inset_parcels
from furrowmap.core.crops.parcel_points import USUAL_NOISE_M, ParcelPoints
from furrowmap.core.crops.published import grown_region
from furrowmap.core.crops.response_values import ResponseQuestion
from furrowmap.core.crops.site_soil import open_soil_raster, soil_around
from furrowmap.core.features.classification import colour_segments
from furrowmap.core.features.neighbours import MAX_COLUMNS, sort_into_columns
from furrowmap.core.runtime.errors import InputError
from furrowmap.core.values.parcel import Parcel

MAP = CRS.from_epsg(6677)
BOX = shapely.box(0.0, 0.0, 10.0, 4.0)


def of(**attributes: object) -> Parcel:
    return Parcel("1", BOX, BOX, None, attributes)  # type: ignore[arg-type]


def test_doses__by_a_stated_name_in_any_case_or_by_what_names_say() -> None:
    parcels = [of(Variety="A", Nitrogen=120.0, n_kg_ha=1.0), of(Variety="B", Nitrogen="none")]
    assert dose_name(parcels, "NITROGEN") == "Nitrogen"
    assert dose_name(parcels) == "n_kg_ha"
    assert dose_name([of(height=1.0)]) is None
    assert dose_unit("n_kg_ha") == "kg/ha"
    assert dose_unit("Nitrogen") == dose_unit(None) == ""
    names = ("n_kg_ha", "mean_height_m", "volume_m3", "cover")
    assert [str(column_words(name)) for name in names] == [
        "nitrogen (kg/ha)",
        "mean height (m)",
        "volume (m³)",
        "cover",
    ]
    np.testing.assert_array_equal(parcel_doses(parcels, "Nitrogen"), [120.0, np.nan])
    with pytest.raises(InputError, match="No parcel has a number under 'Variety'") as refused:
        dose_name(parcels, "Variety")
    assert refused.value.code == "dose-unknown"
    assert "Nitrogen, n_kg_ha" in refused.value.remedy


def test_net_parcels__of_any_shape_lie_within_their_strips() -> None:
    assert inset_parcels([BOX], 0.0, 0.0)[0] is BOX
    assert inset_parcels([BOX], 1.0, 0.5)[0].equals(shapely.box(1.0, 0.5, 9.0, 3.5))
    holed = BOX.difference(shapely.box(4.0, 1.0, 5.0, 2.0))
    assert inset_parcels([holed], 1.0, 0.5)[0].equals(holed.intersection(shapely.box(1.0, 0.5, 9.0, 3.5)))
    hexagon = shapely.Polygon([(0, 2), (1, 0), (9, 0), (10, 2), (9, 4), (1, 4)])
    assert inset_parcels([hexagon], 1.0, 0.5)[0].equals(hexagon.intersection(shapely.box(1.0, 0.5, 9.0, 3.5)))
    assert inset_parcels([BOX], 5.0, 0.5)[0] is None
    assert inset_parcels([shapely.Polygon([(0, 0), (5, 0), (10, 0)])], 1.0, 0.5)[0] is None


def test_points__none_are_none_and_few_have_the_usual_noise() -> None:
    with ParcelPoints([of()], None) as points:
        points.add(np.zeros((0, 3)))
        points.add(np.array([[5.0, 2.0, 1.0], [12.0, 2.0, 0.5]]))
        assert points.count == 1
        assert points.noise_m(0.04) == USUAL_NOISE_M


def test_grown_regions__of_nothing_are_empty() -> None:
    assert not grown_region(np.full((4, 5), np.nan)).any()
    one = np.full((4, 5), np.nan)
    one[2, 3] = 0.4
    assert np.argwhere(grown_region(one)).tolist() == [[2, 3]]


def test_responses__that_do_not_level_off_say_so() -> None:
    dose = np.tile(np.array([0.0, 50.0, 100.0, 150.0, 200.0]), 6)
    rising = 0.3 + 0.4 / (1.0 + np.exp(-0.02 * (dose - 210.0)))
    value = rising + np.random.default_rng(2).normal(0.0, 0.002, len(dose))
    found = fit_response(dose, value, question=ResponseQuestion(unit="kg/ha"))
    assert found.words.startswith("The response does not level off up to the highest dose, 200 kg/ha.")
    assert found.agronomic is not None
    assert found.agronomic.low == 200.0
    assert found.agronomic.high_open


def test_soil__of_no_or_too_few_cells_or_of_a_row_of_them_is_not_known() -> None:
    def cells(xy_m: np.ndarray) -> SoilCells:
        return SoilCells(xy_m, np.zeros(len(xy_m)), np.full(len(xy_m), 0.01))

    relief = HeightCovariance(0.01, 2.0, 0.004)
    row = np.column_stack([np.linspace(-2.0, 12.0, 4 * MIN_SOIL_CELLS), np.full(4 * MIN_SOIL_CELLS, -1.0)])
    assert interpolate_soil(of(), cells(row[: MIN_SOIL_CELLS - 1]), relief) is None
    assert interpolate_soil(of(), cells(row), relief) is None
    assert soil_around({"1": cells(row)}).under(of()) is None
    around = np.concatenate([row, row + np.array([0.0, 6.0])])
    patch = interpolate_soil(of(), cells(around), relief)
    assert patch is not None
    assert np.abs(patch.height_m).max() < 1e-9
    assert len(without_crop(cells(np.zeros((0, 2))))) == 0
    assert len(without_crop(cells(row[:2]))) == 2
    assert len(noise_in_pixels(np.zeros((0, 3)), 0.04)) == 0


def test_soil_rasters__have_no_heights_beside_or_without_them(tmp_path: Path) -> None:
    path = tmp_path / "soil.tif"
    profile = {"driver": "GTiff", "width": 8, "height": 8, "count": 1, "dtype": "float32", "nodata": -9999.0}
    with rasterio.open(path, "w", crs=MAP, transform=rasterio.Affine(1, 0, 0, 0, -1, 8), **profile) as raster:
        heights = np.full((8, 8), 3.0, np.float32)
        heights[:, 4:] = -9999.0
        raster.write(heights, 1)
    with open_soil_raster(path, MAP, (0.0, 0.0, 8.0, 8.0)) as soil:
        assert len(soil.heights_m(np.zeros((0, 2)), 1.0)) == 0
        assert np.isnan(soil.heights_m(np.array([[100.0, 100.0], [101.0, 100.0]]), 1.0)).all()
        assert np.isnan(soil.heights_m(np.array([[7.5, 4.5]]), 1.0)).all()
        np.testing.assert_allclose(soil.heights_m(np.array([[1.5, 4.5]]), 1.0), [3.0])


def test_columns__are_refused_where_points_are_spread_too_far() -> None:
    side_m = 1.0
    with pytest.raises(ValueError, match=r"columns of 1\.0 m"):
        sort_into_columns(np.array([[0.0, 0.0, 0.0], [MAX_COLUMNS * 1.0, 2.0, 0.0]]), side_m)
    near = sort_into_columns(np.array([[3.0, 0.5, 2.0], [0.0, 0.0, 1.0], [0.2, 0.1, 0.0]]), side_m)
    assert near.order.tolist() == [2, 1, 0]


def test_colour_segments__of_nothing_are_none() -> None:
    assert len(colour_segments(np.zeros((0, 3)), np.zeros((0, 3)), 0.3)) == 0
    one = colour_segments(np.arange(30.0).reshape(10, 3) * 0.01, np.full((10, 3), np.nan), 0.3)
    assert set(one.tolist()) == {0}
