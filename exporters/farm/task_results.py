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
from numpy.typing import NDArray
from pyproj import CRS

from furrowmap.core.runtime.errors import InputError
from furrowmap.exporters.farm.results import (
    OWN,
    PROVENANCE,
    SESSIONS,
    TRACKS,
    SessionResult,
    drawing_order,
    footprint,
    local_date,
    one_row,
    short_hash,
    track_of,
    with_columns,
    zone_of,
)
from furrowmap.exporters.files.ogr import pyogrio
from furrowmap.exporters.files.result_folder import TRAJECTORY, reading_result
from furrowmap.exporters.vectors.field_layers import Layer, geometry_array
from furrowmap.exporters.vectors.geopackage import read_layer
from furrowmap.exporters.vectors.task_fields import FIELDS

HEIGHTS = "not measured"
"""Height system of positions that task data log."""


def read_tasks(path: Path, zone: ZoneInfo | None = None) -> list[SessionResult]:
    """Read the GeoPackage that `furrowmap fields` wrote: a result for each task.

    A task is identified by its id, its name and the time at which it began.

    Args:
        path: of the GeoPackage.
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
            told = {name: _plain(values, row) for name, values in figures.columns.items()}
            own = {name: _of_task(layer, str(told["task"])) for name, layer in layers.items()}
            results.append(_task_result(path.resolve(), told, own, crs, digest, zone))
        return results


def _task_result(
    path: Path,
    told: Mapping[str, Any],
    layers: dict[str, Layer],
    crs: CRS,
    digest: str,
    zone: ZoneInfo | None,
) -> SessionResult:
    driven = layers.pop(TRAJECTORY)
    start, end = driven.columns["time"][[0, -1]]
    recordings = short_hash(["task data", told["task"], told["task_name"], str(start)])
    identity = {"session": recordings, "recordings": recordings, "digest": digest}
    name = str(told["task_name"] or told["task"])
    zone = zone or zone_of({}, driven.shapes[0], crs)
    date = local_date(start, zone)
    key, span = {"session": recordings, "date": np.datetime64(date)}, {"start": start, "end": end}
    if "coverage" in layers:
        layers["coverage"] = with_columns(layers["coverage"], {"name": name, **span})
    covered = layers.get("coverage")
    hull = geometry_array([footprint(driven, covered if covered is not None and len(covered.shapes) else None)])
    facts = _facts(told, layers, driven, path, crs)
    text = "Where each session took place: the hull of its trajectory and worked ground"
    provenance = {
        **identity,
        "furrowmap": version("furrowmap"),
        "base_by": version("furrowmap"),
        "added": np.datetime64("now", "ms"),
        "report": json.dumps({"task_data": {k: v for k, v in told.items() if v == v}}, ensure_ascii=False),
        "session_toml": None,
    }
    own = (
        Layer(SESSIONS, "Polygon", text, hull, one_row({**key, "name": name, **span, "time_zone": zone.key, **facts})),
        Layer(PROVENANCE, "", "Where sessions came from", geometry_array([None]), one_row(provenance)),
        Layer(
            TRACKS,
            "2.5D MultiLineString",
            "The path of the vehicle",
            geometry_array([track_of(driven)]),
            one_row({**key, **span}),
        ),
    )
    taken = [with_columns(layers[n], key) for n in drawing_order(list(layers)) if n not in OWN]
    return SessionResult(**identity, name=name, date=date, crs=crs, heights=HEIGHTS, folder=path, layers=(*own, *taken))


def _facts(told: Mapping[str, Any], layers: Mapping[str, Layer], driven: Layer, path: Path, crs: CRS) -> dict[str, Any]:
    """The row of `sessions`, as far as task data know it; areas in the plane of the map where layers have them."""
    rate, area_m2 = float(told["work_rate_ha_h"]), float(told["worked_area_m2"])
    lengths = np.hypot(*np.diff(_places(driven), axis=0).T)
    passes = layers.get("passes")
    widths = passes.columns["width_m"] if passes is not None and len(passes.shapes) else np.array([np.nan])
    return {
        "worked_area_m2": _area(layers, "coverage", area_m2),
        "worked_area_ellipsoid_m2": area_m2,
        "worked_area_sigma_m2": float(told["worked_area_sigma_m2"]),
        "overlap_area_m2": _area(layers, "overlaps", float(told["overlap_area_m2"])),
        "missed_area_m2": _area(layers, "misses", float(told["missed_area_m2"])),
        "swept_area_m2": float(told["swept_area_m2"]),
        "worked_length_m": float(told["worked_length_m"]),
        "work_rate_ha_h": rate,
        "distance_m": float(lengths.sum()),
        "duration_s": float(driven.columns["t_s"][-1] - driven.columns["t_s"][0]),
        "hours": area_m2 / 10_000.0 / rate if rate > 0 else float("nan"),
        "field_name": told["field"] or None,
        "passes": np.int64(len(passes.shapes) if passes is not None else 0),
        "width_m": float(np.nanmax(widths)),
        "crs": crs.to_string(),
        "heights": HEIGHTS,
        "coordinates": "as-recorded",
        "folder": path.as_posix(),
    }


def _area(layers: Mapping[str, Layer], name: str, otherwise: float) -> float:
    """Area of a layer in the plane of the map, as a run states it; nan where the task's is unknown."""
    layer = layers.get(name)
    return float(np.sum(layer.columns["area_m2"])) if layer is not None and np.isfinite(otherwise) else otherwise


def _places(driven: Layer) -> NDArray[np.float64]:
    return np.array([(point.x, point.y) for point in driven.shapes], np.float64)


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
