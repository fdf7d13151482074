"""The surveyed points that a user chooses for a comparison, from files that may hold points or a product."""

from dataclasses import dataclass
from pathlib import Path

import pyproj

from furrowmap.core.readers.agopengps import elevation_file
from furrowmap.core.readers.areas.area import nothing_within, read_area
from furrowmap.core.readers.surveyed_points import SurveyedPoints, read_points
from furrowmap.core.readers.text_table import column_names, is_spreadsheet
from furrowmap.core.readers.vector_file import is_vector
from furrowmap.core.runtime.errors import FurrowmapError
from furrowmap.core.runtime.languages.texts import Text
from furrowmap.core.runtime.plain_reads import open_plain


@dataclass(frozen=True)
class SurveyOptions:
    """What a user states about a file of surveyed points.

    Attributes:
        crs: of a file without one, and of a cloud without one.
        sigma_m: standard deviation along each axis, where the file states none.
        within: vector file, or CSV of corners, in whose polygons the points lie; None for all.
    """

    crs: pyproj.CRS | None = None
    sigma_m: float | None = None
    within: Path | None = None


def survey_of(path: Path, target: pyproj.CRS, options: SurveyOptions) -> SurveyedPoints:
    """The points of a file in the CRS of a product, without those outside the polygons.

    Errors as :func:`~furrowmap.core.readers.surveyed_points.read_points`; InputError if the polygons cannot be read, or
    hold none of the points.
    """
    survey = read_points(path, target, options.crs)
    if options.within is None:
        return survey
    area = read_area(options.within, target)
    kept = area.contains(survey.xyz_m)
    if not kept.any():
        east, north, _ = survey.xyz_m[0].tolist()
        raise nothing_within(area, Text("{points} points in {name}", points=len(survey), name=path.name), (east, north))
    names = tuple(name for name, inside in zip(survey.name, kept, strict=True) if inside)
    notices = (*survey.notices, *area.notices)
    role = tuple(role for role, inside in zip(survey.role, kept, strict=False) if inside)
    lying = tuple(lying for lying, inside in zip(survey.target, kept, strict=False) if inside)
    return SurveyedPoints(names, survey.xyz_m[kept], survey.sigma_m[kept], role, lying, notices)


def may_hold_points(path: Path) -> bool:
    """Whether a file may hold points with heights, and is neither a cloud nor a raster; false if it is not there."""
    try:
        if elevation_file(path) is not None:
            return True
        with open_plain(path) as file:
            head = file.read(4096)
        return is_vector(head) or is_spreadsheet(path) or len(column_names(path)) > 1
    except (FurrowmapError, OSError):
        return False
