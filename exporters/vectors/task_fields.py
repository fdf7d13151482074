"""The worked ground of the tasks of task data: a table of figures, and a GeoPackage of all fields."""

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np
import shapely

from furrowmap.core.coverage.task_work import TaskWork, TaskWorks
from furrowmap.core.values.clock import iso_utc
from furrowmap.core.values.trajectory import ScanPoses
from furrowmap.exporters.files.atomic import atomic_output
from furrowmap.exporters.vectors.field_layers import (
    Columns,
    Layer,
    concatenate_layers,
    field_layers,
    geometry_array,
    numbers,
    texts,
)
from furrowmap.exporters.vectors.geopackage import write_styled_layers

FIELDS_LAYER: Final = "fields"
TASK_FIGURES: Final = (
    "worked_area_m2", "worked_area_sigma_m2", "overlap_area_m2", "missed_area_m2", "swept_area_m2",
    "logged_swept_area_m2", "counted_area_m2", "boundary_area_m2", "worked_length_m", "work_rate_ha_h",
)  # fmt: skip
"""The figures of a field; areas are on the ellipsoid, except `swept_area_m2` in the map's plane."""


def task_figures(work: TaskWork) -> dict[str, Any]:
    """The figures of a task; None where unknown."""
    task = work.task
    ground = work.work.ground
    figures = ground.figures if ground is not None else None
    row: dict[str, Any] = {
        "task": task.id,
        "task_name": task.name,
        "field": task.field.name if task.field is not None else None,
        "start": iso_utc(float(task.track.t_s[0])),
        "end": iso_utc(float(task.track.t_s[-1])),
        "positions": len(work.course.trajectory),
        "passes": figures.passes if figures is not None else None,
        "width_m": work.implement.width_m,
        "logged_swept_area_m2": work.logged_swept_m2,
        "counted_area_m2": task.counted_m2,
        "boundary_area_m2": work.boundary_area_m2,
    }
    if figures is not None:
        row |= {
            "worked_area_m2": figures.worked.ellipsoid_m2,
            "worked_area_sigma_m2": figures.worked.sigma_m2,
            "overlap_area_m2": figures.overlap.ellipsoid_m2,
            "missed_area_m2": figures.missed.ellipsoid_m2,
            "swept_area_m2": figures.swept_m2,
            "worked_length_m": figures.length_m,
            "work_rate_ha_h": figures.work_rate_ha_h,
        }
    return {
        name: (round(value, 4) if math.isfinite(value) else None) if isinstance(value, float) else value
        for name, value in ({"task": task.id} | dict.fromkeys(TASK_FIGURES) | row).items()
    }


def write_fields(path: Path, works: TaskWorks) -> None:
    """Write the layers of `field.gpkg` for all tasks, and a layer of the fields."""
    by_name: dict[str, list[Layer]] = {}
    for work in works.works:
        for layer in field_layers(ScanPoses.at_knots(work.course.trajectory), work.work):
            n = len(layer.shapes)
            field = work.task.field.name if work.task.field is not None else ""
            own = {"task": np.full(n, work.task.id, object), "field": np.full(n, field, object)}
            by_name.setdefault(layer.name, []).append(replace(layer, columns=own | layer.columns))
    order = sorted(by_name, key=lambda name: name == "trajectory")  # which comes first where nothing was worked
    layers = [*(concatenate_layers(by_name[name]) for name in order), _fields(works.works)]
    with atomic_output(path) as unfinished:
        write_styled_layers(unfinished, layers, works.frame.crs)


def _fields(works: Sequence[TaskWork]) -> Layer:
    rows = [task_figures(work) for work in works]
    passes = [-1 if row["passes"] is None else row["passes"] for row in rows]
    columns: Columns = {
        **{name: texts(row[name] for row in rows) for name in ("task", "task_name", "field")},
        "passes": np.ma.masked_equal(np.array(passes, np.int64), -1),
        **{name: numbers(math.nan if row[name] is None else row[name] for row in rows) for name in TASK_FIGURES},
    }
    outlines: list[shapely.MultiPolygon | None] = []
    for work in works:
        polygons = [part for part in shapely.get_parts(work.work.boundary) if isinstance(part, shapely.Polygon)]
        outlines.append(shapely.MultiPolygon(polygons) if polygons else None)
    text = "The fields, with the figures of their tasks"
    return Layer(FIELDS_LAYER, "MultiPolygon", text, geometry_array(outlines), columns)
