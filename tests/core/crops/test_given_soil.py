"""Soil of another survey under parcels: its offset and standard deviation against closed forms."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
import rasterio
import shapely
from pyproj import CRS, Transformer
from rasterio.transform import from_origin

from furrowmap.core.crops.bare_soil import SoilCells, soil_cells
from furrowmap.core.crops.site_soil import SiteSoil, SurveyedSoil, align_survey, open_soil_raster, soil_around
from furrowmap.core.runtime.errors import InputError
from furrowmap.core.values.parcel import Parcel

MAP = CRS.from_epsg(25832)
EAST, NORTH = 651_000.0, 6_132_600.0
BOX = (EAST - 5.0, NORTH - 5.0, EAST + 15.0, NORTH + 8.0)


def on_map(*box: float) -> shapely.Polygon:
    return shapely.transform(shapely.box(*box), lambda xy: np.add(xy, (EAST, NORTH)))


PARCEL = Parcel("1", on_map(0.0, 0.0, 10.0, 2.5), on_map(1.0, 0.1, 9.0, 2.4))
CELLS = np.array([(EAST + x, NORTH + y) for x in np.arange(-2.9, 13.0, 0.5) for y in np.arange(-2.9, 5.5, 0.5)])
AROUND = CELLS[~shapely.contains_xy(PARCEL.gross.buffer(0.2), *CELLS.T)]
INSIDE = shapely.get_coordinates([shapely.Point(EAST + x, NORTH + y) for x in (1.2, 4.0, 8.7) for y in (0.3, 2.2)])


def mound(xy: np.ndarray) -> np.ndarray:
    """A mound of 20 cm under the parcel, which the soil around it does not show, on a slope."""
    e, n = xy[..., 0] - EAST, xy[..., 1] - NORTH
    return 70.0 + 0.01 * e + 0.2 * np.exp(-(((e - 5.0) / 2.0) ** 2) - ((n - 1.25) / 1.0) ** 2)


def write_soil(path: Path, heights_m: object, cell_m: float = 0.1, epsg: int = 25832) -> Path:
    """The heights of cells around the parcel, 6 m beyond it."""
    to_map = Transformer.from_crs(epsg, MAP, always_xy=True)
    west, north = Transformer.from_crs(MAP, epsg, always_xy=True).transform(EAST - 6.0, NORTH + 9.0)
    rows, columns = round(15.0 / cell_m), round(22.0 / cell_m)
    x, y = np.meshgrid(west + cell_m * (np.arange(columns) + 0.5), north - cell_m * (np.arange(rows) + 0.5))
    values = heights_m(np.stack(to_map.transform(x, y), axis=-1)).astype(np.float32)  # type: ignore[operator]
    profile = {"driver": "GTiff", "width": columns, "height": rows, "count": 1, "dtype": "float32", "nodata": np.nan}
    with rasterio.open(
        path, "w", crs=f"EPSG:{epsg}", transform=from_origin(west, north, cell_m, cell_m), **profile
    ) as f:
        f.write(values, 1)
    return path


def soil_from(path: Path, cells: SoilCells) -> SurveyedSoil:
    with open_soil_raster(path, MAP, BOX) as raster:
        return align_survey(raster, [PARCEL], {"1": cells})


def cells_of(height_m: np.ndarray, sigma_m: float) -> SoilCells:
    return SoilCells(AROUND, height_m, np.full(len(AROUND), sigma_m))


@pytest.mark.parametrize(("cell_m", "epsg"), [(0.05, 25832), (0.25, 25832), (0.1, 25833)])
def test_given_soil__is_that_of_the_survey_at_the_height_of_the_points(
    tmp_path: Path, cell_m: float, epsg: int
) -> None:
    """The survey is 13.7 cm too low; the mound is in it alone. Means of half a metre flatten its top by 6 mm."""
    path = write_soil(tmp_path / "dtm.tif", lambda xy: mound(xy) - 0.137, cell_m, epsg)
    noise = 0.003 * np.random.default_rng(1).standard_normal(len(AROUND))
    cells = cells_of(mound(AROUND) + noise, 0.003)
    soil = soil_from(path, cells)
    patch = soil.under(PARCEL)
    assert patch is not None
    assert patch.at(INSIDE) == pytest.approx(mound(INSIDE), abs=0.012)
    assert soil.offset_m == pytest.approx(0.137, abs=1.5e-3)
    assert 1e-4 < patch.sigma_m < 2e-3
    around = soil_around({"1": cells}).under(PARCEL)
    assert around is not None
    middle = np.array([[EAST + 5.0, NORTH + 1.25]])
    assert abs(around.at(middle) - mound(middle)) > 0.05
    assert SiteSoil(soil, 0.01, 0).notices == []


def test_given_soil__errors_are_as_large_as_stated(tmp_path: Path) -> None:
    """Between the surveys: an offset, a smooth change with a range of 3 m, and noise of the cells of both."""
    rng, ratios = np.random.default_rng(2), []
    places = np.concatenate([AROUND, INSIDE])
    apart = np.linalg.norm(places[:, None] - places[None, :], axis=2) / 3.0
    root = np.linalg.cholesky((1.0 + apart) * np.exp(-apart) + 1e-9 * np.eye(len(places)))
    for _ in range(24):
        path = write_soil(tmp_path / "dtm.tif", lambda xy: 70.0 + 0.004 * rng.standard_normal(xy.shape[:-1]), 0.25)
        change = 0.05 + 0.01 * root @ rng.standard_normal(len(places))
        seen = 70.0 + change[: len(AROUND)] + 0.004 * rng.standard_normal(len(AROUND))
        patch = soil_from(path, cells_of(seen, 0.002)).under(PARCEL)
        assert patch is not None
        ratios.append(float((patch.at(INSIDE) - 70.0 - change[len(AROUND) :]).mean()) / patch.sigma_m)
    assert np.sqrt(np.mean(np.square(ratios))) == pytest.approx(1.0, abs=0.4)


def test_given_soil__without_bare_soil_in_common_is_used_as_it_is(tmp_path: Path) -> None:
    soil = soil_from(write_soil(tmp_path / "dtm.tif", mound), soil_cells(np.zeros((0, 3))))
    patch = soil.under(PARCEL)
    assert patch is not None
    assert patch.at(INSIDE) == pytest.approx(mound(INSIDE), abs=0.012)
    assert math.isnan(patch.sigma_m)
    assert [notice.code for notice in SiteSoil(soil, 0.01, 0).notices] == ["soil-not-aligned"]
    assert soil.plain()["offset_sigma_m"] is None


def test_given_soil__of_a_parcel_without_bare_soil_has_the_offset_of_the_others(tmp_path: Path) -> None:
    path = write_soil(tmp_path / "dtm.tif", mound)
    lonely = Parcel("2", on_map(3.0, 5.0, 6.0, 7.0), on_map(3.0, 5.0, 6.0, 7.0))
    with open_soil_raster(path, MAP, BOX) as raster:
        soil = align_survey(raster, [PARCEL, lonely], {"1": cells_of(mound(AROUND) + 0.05, 0.002), "2": cells_of(
            mound(AROUND), 0.002).at(np.arange(2))})  # fmt: skip
    patch = soil.under(lonely)
    assert patch is not None
    place = np.array([[EAST + 4.5, NORTH + 6.0]])
    assert patch.at(place) == pytest.approx(mound(place) + 0.05, abs=2e-3)
    assert patch.sigma_m == pytest.approx(soil.offset_sigma_m, abs=1e-3)


def test_given_soil__is_unknown_where_the_survey_does_not_cover_the_parcel(tmp_path: Path) -> None:
    path = write_soil(tmp_path / "dtm.tif", lambda xy: np.where(xy[..., 0] < EAST + 5.0, mound(xy), np.nan))
    assert soil_from(path, cells_of(mound(AROUND), 0.002)).under(PARCEL) is None
    far = Parcel("1", *(shapely.transform(shape, lambda xy: xy + 500.0) for shape in (PARCEL.gross, PARCEL.net)))
    with open_soil_raster(path, MAP, BOX) as raster:
        assert align_survey(raster, [far], {"1": soil_cells(np.zeros((0, 3)))}).under(far) is None


def test_soil_raster__without_heights_is_refused(tmp_path: Path) -> None:
    path = write_soil(tmp_path / "dtm.tif", mound)
    with rasterio.open(path, "r+") as raster:
        raster.update_tags(TIFFTAG_SOFTWARE="furrowmap 0.1")
        raster.set_band_description(1, "slope")
    with pytest.raises(InputError, match="'slope' and no heights") as refused, open_soil_raster(path, MAP, BOX):
        pass
    assert refused.value.code == "soil-unusable"
