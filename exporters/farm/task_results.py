"""The result of `furrowmap fields` as a farm map takes it: each task of the task data is a session."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path
from typing import Any
from zoneinfo import ZoneInfo

import numpy as np
import shapely
from numpy.typing import NDArray
from pyproj import CRS

from furrowmap.core.runtime.errors import InputError
from furrowmap.exporters.farm.results import SessionResult, session_result, short_hash, zone_of
from furrowmap.exporters.files.ogr import pyogrio
from furrowmap.exporters.files.result_folder import TRAJECTORY, reading_result
from furrowmap.exporters.vectors.field_layers import Layer
from furrowmap.exporters.vectors.geopackage import read_layer
from furrowmap.exporters.vectors.task_fields import FIELDS

TASK_HEIGHTS = "not measured"
"""Height system of positions that task data log."""


def read_tasks(path: Path, zone: ZoneInfo | None = None) -> list[SessionResult]:
    """Read the GeoPackage that `furrowmap fields` wrote: a result for each task.

    A task is identified by its id, its name and the time at which it began.

    Args:
        zone: time zone of the dates; None for that of the place.

    Raises:
        InputError: if it is no such file, or is damaged.
    """
    if not path.is_file():
        raise _no_tasks(path, "does not exist")
    with reading_result(path):
        names = [str(name) for name in pyogrio.list_layers(path)[:, 0]]
        if FIELDS not in names or TRAJECTORY not in names:
            raise _no_tasks(path, "was not written by `furrowmap fields`")
        layers = {name: read_layer(path, name) for name in names if name != "layer_styles"}
        if not all("task" in layer.columns for layer in layers.values()):
            raise _no_tasks(path, "was not written by `furrowmap fields`")
        crs = CRS.from_user_input(pyogrio.read_info(path, layer=TRAJECTORY)["crs"])
        figures, digest = layers.pop(FIELDS), hashlib.sha256(path.read_bytes()).hexdigest()
        results = []
        for row in range(len(figures.shapes)):
            task = {name: _plain(values, row) for name, values in figures.columns.items()}
            own = {name: _of_task(layer, str(task["task"])) for name, layer in layers.items()}
            results.append(_task_result(path.resolve(), task, own, crs, digest, zone))
        return results


def _task_result(
    path: Path, task: Mapping[str, Any], layers: dict[str, Layer], crs: CRS, digest: str, zone: ZoneInfo | None
) -> SessionResult:
    driven = layers[TRAJECTORY]
    recordings = short_hash(["task data", task["task"], task["task_name"], str(driven.columns["time"][0])])
    rate, area_m2 = float(task["work_rate_ha_h"]), float(task["worked_area_m2"])
    passes = layers.get("passes")
    widths = passes.columns["width_m"] if passes is not None and len(passes.shapes) else np.array([np.nan])
    facts = {
        "worked_area_m2": _area(layers, "coverage", area_m2),
        "worked_area_ellipsoid_m2": area_m2,
        "worked_area_sigma_m2": float(task["worked_area_sigma_m2"]),
        "overlap_area_m2": _area(layers, "overlaps", float(task["overlap_area_m2"])),
        "missed_area_m2": _area(layers, "misses", float(task["missed_area_m2"])),
        "swept_area_m2": float(task["swept_area_m2"]),
        "worked_length_m": float(task["worked_length_m"]),
        "work_rate_ha_h": rate,
        "distance_m": float(np.hypot(*np.diff(shapely.get_coordinates(driven.shapes), axis=0).T).sum()),
        "duration_s": float(driven.columns["t_s"][-1] - driven.columns["t_s"][0]),
        "hours": area_m2 / 10_000.0 / rate if rate > 0 else float("nan"),
        "field_name": task["field"] or None,
        "passes": np.int64(len(passes.shapes) if passes is not None else 0),
        "width_m": float(np.nanmax(widths)),
        "crs": crs.to_string(),
        "heights": TASK_HEIGHTS,
        "coordinates": "as-recorded",
        "folder": path.as_posix(),
    }
    report = json.dumps({"task_data": {k: v for k, v in task.items() if v == v}}, ensure_ascii=False)
    return session_result(
        layers,
        {"session": recordings, "recordings": recordings, "digest": digest},
        str(task["task_name"] or task["task"]),
        crs,
        path,
        zone or zone_of({}, driven.shapes[0], crs),
        facts,
        {"furrowmap": version("furrowmap"), "report": report, "session_toml": None},
    )


def _area(layers: Mapping[str, Layer], name: str, otherwise: float) -> float:
    """Area of a layer in the plane of the map, as in a run's figures; nan where the task's is unknown."""
    layer = layers.get(name)
    return float(np.sum(layer.columns["area_m2"])) if layer is not None and np.isfinite(otherwise) else otherwise


def _of_task(layer: Layer, task: str) -> Layer:
    """The features of a task, without the columns that name it."""
    mine = layer.columns["task"] == task
    columns = {name: values[mine] for name, values in layer.columns.items() if name not in ("task", "field")}
    return replace(layer, shapes=layer.shapes[mine], columns=columns)


def _plain(values: NDArray[Any], row: int) -> Any:
    if np.ma.getmaskarray(values)[row]:
        return None
    value = np.ma.getdata(values)[row]
    return value.item() if isinstance(value, np.generic) else value


def _no_tasks(path: Path, why: str) -> InputError:
    return InputError("no-task-result", path=path, why=why)
