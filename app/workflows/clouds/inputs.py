"""What workflows of clouds share: the clouds and the box that settings state, and the report of the products."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path
from typing import Any

from pyproj import CRS

from furrowmap.core.geodesy.crs_change import horizontal_part, optional_crs, optional_with_heights
from furrowmap.core.pointclouds.joined_clouds import Clouds, box_in, near_box, open_clouds
from furrowmap.core.readers.areas.area import read_area
from furrowmap.core.readers.las.cloud import Box
from furrowmap.core.runtime.errors import Notice
from furrowmap.core.runtime.json_text import json_text, plain
from furrowmap.core.runtime.progress import Progress
from furrowmap.core.values.crs import name_of
from furrowmap.exporters.files.file_records import FileRecord, file_records, rooted_records
from furrowmap.settings import (
    CanopySettings,
    CleanSettings,
    FeatureSettings,
    GrowthSettings,
    ParcelSettings,
    SurfaceSettings,
)

CloudSettings = CanopySettings | CleanSettings | FeatureSettings | GrowthSettings | ParcelSettings | SurfaceSettings


def open_inputs(clouds: Sequence[str | Path], settings: CloudSettings) -> Clouds:
    """The clouds in the CRS that settings state, without the points outside their polygons."""
    stated = optional_with_heights(settings.crs)
    opened = open_clouds([Path(path) for path in clouds], stated, optional_with_heights(settings.dst_crs))
    opened = replace(opened, notices=(*opened.notices, *_unused_notices(opened, stated)))
    within = getattr(settings, "within", None)
    if within is None:
        return opened
    area = read_area(Path(within), opened.crs)
    return replace(opened, area=area, notices=(*opened.notices, *area.notices))


def _unused_notices(clouds: Clouds, stated: CRS | None) -> Iterator[Notice]:
    """Warnings about files that state another CRS than the user."""
    for file in clouds.files:
        own = clouds.sources[file.path]
        if stated is None or file.crs is None or own.crs is stated:
            continue
        if not own.flat.equals(horizontal_part(stated), ignore_axis_order=True):
            yield Notice("crs-not-used", path=file.path.name, own=name_of(own.flat), stated=name_of(stated))


def box_to_use(
    clouds: Clouds, box: Box | None, box_crs: CRS | str | None, progress: Progress
) -> tuple[Box | None, tuple[Notice, ...]]:
    """The box as stated, else that of all points but far ones, and a warning about these."""
    stated = box_in(clouds, box, optional_crs(box_crs))
    return (stated, ()) if stated is not None else near_box(clouds, progress)


def write_account(
    staging: Path,
    report: str,
    clouds: Clouds,
    records: Sequence[FileRecord],
    content: Mapping[str, Any],
    warnings: Sequence[Notice],
) -> dict[str, Any]:
    """Write the report of the products in a staging folder; its content. The records begin with those of the clouds."""
    account = {
        "furrowmap": version("furrowmap"),
        "inputs": input_rows(clouds, records[: len(clouds.files)]),
        **content,
        "warnings": warnings,
        "products": sorted([*(path.name for path in staging.iterdir()), report]),
    }
    (staging / report).write_text(json_text(account), encoding="utf-8")
    return dict(plain(account))


def input_records(clouds: Clouds, progress: Progress) -> list[FileRecord]:
    """Name, size and SHA-256 of each file."""
    return rooted_records([(file.path, file.path.parent) for file in clouds.files], progress)


def area_records(clouds: Clouds) -> list[FileRecord]:
    """Name, size and SHA-256 of the file of the area that the clouds are clipped to; none without one."""
    return file_records([clouds.area.path], clouds.area.path.parent) if clouds.area is not None else []


def input_rows(clouds: Clouds, records: Sequence[FileRecord]) -> list[dict[str, Any]]:
    """Name, format, points and SHA-256 of each file."""
    return [
        {"name": record.name, "format": file.format, "points": file.points, "sha256": record.sha256}
        for record, file in zip(records, clouds.files, strict=True)
    ]
