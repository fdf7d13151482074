"""A cloud or a surface against surveyed points."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from furrowmap.core.accuracy.cloud_at_points import TargetSearch
from furrowmap.core.accuracy.paired_points import PAIR_COLUMNS, PairedPoints, pairs_of_files, pairs_of_product
from furrowmap.core.accuracy.point_check import CHECK_COLUMNS
from furrowmap.core.accuracy.product_check import Check, check_product
from furrowmap.core.geodesy.crs_change import optional_with_heights
from furrowmap.core.readers.chosen_survey import SurveyOptions, may_hold_points
from furrowmap.core.runtime.progress import Progress, silent
from furrowmap.exporters.files.atomic import refuse_existing
from furrowmap.exporters.files.csv_cells import write_csv_table
from furrowmap.settings import CheckSettings

if TYPE_CHECKING:
    import pyproj


def check(
    product: str | Path,
    points: str | Path,
    settings: CheckSettings = CheckSettings(),
    *,
    crs: str | pyproj.CRS | None = None,
    table: str | Path | None = None,
    overwrite: bool = False,
    progress: Progress = silent,
) -> Check:
    """Compare a cloud (LAS, LAZ, COPC) or a surface (GeoTIFF) with surveyed points.

    RMSE after ASPRS Positional Accuracy Standards, Edition 2 (2023), with the accuracy of the points included.

    Args:
        points: table, vector file or Elevation.txt (AgOpenGPS) of surveyed points, in the product's height system.
        crs: CRS of the points, and of a cloud, where their files state none; the product's by default.
        table: CSV to write, one point a row.

    Raises:
        InputError: if a file cannot be read, or no point lies in the product.
        RefusedError: if the CRS cannot be changed safely, or the CSV exists.
    """
    if table is not None:
        refuse_existing(Path(table), overwrite=overwrite)
    found = check_product(
        Path(product),
        Path(points),
        SurveyOptions(optional_with_heights(crs), settings.points_sigma_m, settings.area_file),
        search=TargetSearch(settings.targets, settings.diameter_m, settings.target_shape, settings.checkerboard_m),
        class_m=settings.class_m,
        progress=progress,
    )
    if table is not None:
        write_csv_table(Path(table), CHECK_COLUMNS, [point.row() for point in found.points])
    return found


def check_pairs(
    measured: str | Path,
    surveyed: str | Path,
    settings: CheckSettings = CheckSettings(),
    *,
    crs: str | pyproj.CRS | None = None,
    table: str | Path | None = None,
    overwrite: bool = False,
    progress: Progress = silent,
) -> PairedPoints:
    """Compare points that are named alike: differences and their RMS in easting, northing and height.

    Args:
        measured: table or vector file of points measured in a product, or a cloud or surface to measure them in.
        surveyed: table or vector file of the survey.
        crs: of the plane for points in degrees; for a product as in :func:`check`.
        table: CSV to write, one point a row.

    Raises:
        InputError: if a file cannot be read, or no points belong together.
        RefusedError: if the CRS cannot be changed safely, or the CSV exists.
    """
    if table is not None:
        refuse_existing(Path(table), overwrite=overwrite)
    if may_hold_points(Path(measured)):
        pairs = pairs_of_files(Path(measured), Path(surveyed), optional_with_heights(crs), settings.area_file)
    else:
        found = check(measured, surveyed, settings, crs=crs, progress=progress)
        pairs = pairs_of_product(found.points, found.notices)
    if table is not None:
        write_csv_table(Path(table), PAIR_COLUMNS, pairs.rows())
    return pairs
