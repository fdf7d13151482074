"""A surface at surveyed points."""

from pathlib import Path

import numpy as np
import pyproj

from furrowmap.core.checking.point_check import PointCheck, ProductAtPoints
from furrowmap.core.readers.geotiff import expect_heights, open_geotiff
from furrowmap.core.readers.surveyed_points import SurveyOptions, survey_of
from furrowmap.core.runtime.arrays import three
from furrowmap.core.runtime.errors import InputError


def surface_at_points(path: Path, points_file: Path, options: SurveyOptions = SurveyOptions()) -> ProductAtPoints:
    """Height of a surface at each point, bilinear between cell centres.

    InputError if it is no such raster, or the points cannot be read; RefusedError if PROJ has no exact transformation
    between their CRS.
    """
    from rasterio.windows import Window

    with open_geotiff(path, _no_surface) as raster:
        expect_heights(raster, path, _no_surface)
        box = tuple(raster.bounds)
        crs = pyproj.CRS.from_wkt(raster.crs.to_wkt())
        survey = survey_of(points_file, crs, options)
        checks, to_cells = [], ~raster.transform
        for name, xyz in zip(survey.name, survey.xyz_m, strict=True):
            column, row = (a * xyz[0] + b * xyz[1] + c for a, b, c in (to_cells[:3], to_cells[3:6]))
            left, top = int(np.floor(column - 0.5)), int(np.floor(row - 0.5))
            four = raster.read(1, window=Window(left, top, 2, 2), boundless=True, masked=True)
            cells = np.ma.filled(four.astype(np.float64), np.nan)
            right, down = column - 0.5 - left, row - 0.5 - top
            share = np.outer([1.0 - down, down], [1.0 - right, right])
            height = float(np.sum(np.where(share > 0.0, cells * share, 0.0)))
            why = "" if np.isfinite(height) else "lies where the surface has no heights"
            found = (np.nan, np.nan, height)
            checks.append(PointCheck(name, three(xyz), found, why_not=why))
    return ProductAtPoints(crs, tuple(checks), survey, box, "nothing", tuple(survey.notices))


def _no_surface(path: Path, why: str) -> InputError:
    return InputError("check-product", path=path, why=why)
