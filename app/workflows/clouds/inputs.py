"""The files of clouds as the JSON accounts of surfaces and cleaned clouds list them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from furrowmap.core.pointclouds.clouds import Clouds
from furrowmap.core.runtime.progress import Progress
from furrowmap.exporters.files.file_records import FileRecord, file_records, rooted_records


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
