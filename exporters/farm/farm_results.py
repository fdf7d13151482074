"""The results of `furrowmap run` and of `furrowmap fields` as a farm map takes them: sessions with their layers."""

import datetime as dt
import hashlib
import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from importlib.metadata import version
from pathlib import Path
from typing import Any, Final
from zoneinfo import ZoneInfo

import numpy as np
import shapely
from numpy.typing import NDArray
from pyproj import CRS, Transformer

from furrowmap.core.geodesy.crs_change import crs_change
from furrowmap.core.geodesy.local_time import local_time, zone_at
from furrowmap.core.readers.ogr_layers import layer_info, list_layers
from furrowmap.core.runtime.errors import InputError, Notice
from furrowmap.core.runtime.file_names import leads_out, own_file, read_own, resolved
from furrowmap.core.runtime.plain_reads import expect_plain_file, read_plain_bytes
from furrowmap.core.values.crs import crs_of_file
from furrowmap.exporters.farm.farm_memory_tables import DERIVED, FIELDS_LAYER, MACHINES, SEASONS, VISITS
from furrowmap.exporters.files.result_folder import (
    FIELD,
    REPORT,
    SESSION_FILE,
    TRAJECTORY,
    ResultFolder,
    open_result,
    reading_result,
)
from furrowmap.exporters.vectors.field_layers import Columns, Layer, geometry_array, hull, track_lines
from furrowmap.exporters.vectors.geopackage import read_layer

SESSIONS: Final = "sessions"
PROVENANCE: Final = "provenance"
TRACKS: Final = "tracks"
OWN: Final = frozenset({SESSIONS, PROVENANCE, TRACKS, *DERIVED})
"""Tables that only a farm map has; all others are a run's layers with two more columns."""
_LAYER_NAME: Final = re.compile(r"[a-z][a-z0-9_]{0,40}")
"""Layers with other names are not a run's."""
_DRAWING_ORDER: Final = (
    "events", "tool_path", TRACKS, "misses", "unworked", "boundary", "overlaps", "passes", "coverage", "plants",
    "lines", "planes", "zones", FIELDS_LAYER, VISITS, SEASONS, SESSIONS, MACHINES,
)  # fmt: skip
_TRACK_TOLERANCE_M: Final = 0.02
"""Maximum distance of a simplified track from the positions."""
_FIGURES: Final = (
    "worked_area_m2", "worked_area_ellipsoid_m2", "worked_area_sigma_m2", "overlap_area_m2", "missed_area_m2",
    "swept_area_m2", "worked_length_m", "working_speed_mps", "work_rate_ha_h", "distance_m", "duration_s",
)  # fmt: skip


@dataclass(frozen=True)
class SessionResult:
    """The result of a session.

    Attributes:
        session: its identity, 16 hexadecimal digits of a hash of its name and the content of its recordings: the
            session that `furrowmap run` would replace.
        digest: of the products that were read, to detect an unchanged result.
        date: the day at the place where it began.
        folder: of the products, absolute.
        layers: `sessions` and `provenance` first (a row each), then all others.
    """

    session: str
    recordings: str
    digest: str
    name: str
    date: dt.date
    crs: CRS
    heights: str
    folder: Path
    layers: tuple[Layer, ...]

    def in_crs(self, target: CRS) -> "tuple[SessionResult, tuple[Notice, ...]]":
        """The session with its horizontal coordinates in another CRS; heights and figures are unchanged."""
        if self.crs.equals(target, ignore_axis_order=True):
            return self, ()
        (footprint,) = self.layers[0].shapes
        change = crs_change(self.crs, target, footprint.bounds)

        def moved(xyz: NDArray[np.float64]) -> NDArray[np.float64]:
            return np.column_stack([change.points(xyz[:, :2]), xyz[:, 2:]])

        layers = [
            replace(layer, shapes=shapely.transform(layer.shapes, moved, include_z=layer.kind.startswith("2.5D")))
            for layer in self.layers
        ]
        return replace(self, crs=target, layers=tuple(layers)), change.notices


def read_result(folder: Path, zone: ZoneInfo | None = None) -> SessionResult:
    """Read the result of a run, without its cloud; `zone` None for that of the run, else of the place."""
    result = open_result(folder)
    with reading_result(folder / FIELD):
        folder = result.folder
        path = result.folder / FIELD
        session = result.folder / SESSION_FILE
        names = (name for name in result.layer_names if _LAYER_NAME.fullmatch(name))
        tool = (result.report["session"].get("implement") or {}).get("name")
        layers = {name: read_layer(path, name) for name in names}
        # The figures are those of the tool that moves the soil.
        several = {name: layer for name, layer in layers.items() if "tool" in layer.columns}
        layers |= {name: _features_of(layer, "tool", tool) for name, layer in several.items()}
        crs = crs_of_file(layer_info(path, TRAJECTORY)["crs"])
        name = str(result.report["session"]["name"])
        recordings = sorted([record["name"], record["sha256"]] for record in result.report["inputs"])
        return session_result(
            layers,
            {
                "session": short_hash([name, recordings]),
                "recordings": short_hash(recordings),
                "digest": products_digest(folder),
            },
            name,
            crs,
            resolved(folder),
            zone or zone_of(result.report, layers[TRAJECTORY].shapes[0], crs),
            _facts(result),
            {
                "furrowmap": str(result.report["furrowmap"]),
                "report": read_own(folder, REPORT).decode("utf-8"),
                "session_toml": session.read_text("utf-8", errors="replace")
                if session.is_file() and not leads_out(session, folder)
                else None,
            },
        )


def products_digest(place: Path) -> str:
    """The hash of what a farm map was made from: a result folder, or the file of `furrowmap fields`. Raises OSError."""
    if not place.is_dir():
        return hashlib.sha256(read_plain_bytes(place)).hexdigest()
    digest = hashlib.sha256(read_own(place, REPORT))
    field = own_file(place, FIELD)
    expect_plain_file(field)
    with field.open("rb") as file:
        digest.update(hashlib.file_digest(file, "sha256").digest())
    return digest.hexdigest()


def session_result(
    layers: dict[str, Layer],
    identity: Mapping[str, str],
    name: str,
    crs: CRS,
    folder: Path,
    zone: ZoneInfo,
    facts: Mapping[str, Any],
    provenance: Mapping[str, Any],
) -> SessionResult:
    """A session with the layers of a run, and those that only a farm map has.

    `identity`: session, recordings and digest; `facts`: further columns of `sessions`; `provenance`: `furrowmap`,
    `report` and `session_toml` of the table of that name.
    """
    driven = layers[TRAJECTORY]
    start, end = driven.columns["time"][[0, -1]]
    date = local_date(start, zone)
    key = {"session": identity["session"], "date": np.datetime64(date)}
    span = {"start": start, "end": end}
    shapes = [*driven.shapes]
    covered = layers.get("coverage")
    if covered is not None:
        layers["coverage"] = with_columns(covered, {"name": name, **span})
        shapes += covered.shapes.tolist()
    row = {**key, "name": name, **span, "time_zone": zone.key, **facts}
    where = "Where each session took place: the hull of its trajectory and worked ground"
    versions = {"furrowmap": provenance["furrowmap"], "base_by": version("furrowmap")}
    added = {**identity, **versions, "added": np.datetime64("now", "ms"), **provenance}
    what = "The report of each session, and its session file with all defaults"
    xyz_m = shapely.get_coordinates(driven.shapes, include_z=True)
    track = geometry_array([track_lines(xyz_m, driven.columns["t_s"], _TRACK_TOLERANCE_M)])
    own = (
        Layer(SESSIONS, "Polygon", where, geometry_array([hull(shapes)]), one_row(row)),
        Layer(PROVENANCE, "", what, geometry_array([None]), one_row(added)),
        Layer(TRACKS, "2.5D MultiLineString", "The path of the vehicle", track, one_row({**key, **span})),
    )
    taken = [with_columns(layers[n], key) for n in drawing_order(list(layers)) if n not in {TRAJECTORY, *OWN}]
    heights = str(facts["heights"])
    return SessionResult(
        **identity, name=name, date=date, crs=crs, heights=heights, folder=folder, layers=(*own, *taken)
    )


def drawing_order(names: Sequence[str]) -> list[str]:
    """Layers with the topmost of a map first; unknown ones come last but for the footprints."""
    last = len(_DRAWING_ORDER) - 1.5
    return sorted(names, key=lambda name: (_DRAWING_ORDER.index(name) if name in _DRAWING_ORDER else last, name))


def with_columns(layer: Layer, more: Mapping[str, Any]) -> Layer:
    """The layer with additional columns of one value each, before its own."""
    n = len(layer.shapes)
    first: Columns = {name: np.repeat(column, n) for name, column in one_row(more).items()}
    return replace(layer, columns=first | {name: v for name, v in layer.columns.items() if name not in first})


def one_row(values: Mapping[str, Any]) -> Columns:
    """Columns of one row; None becomes NULL."""
    plain = (np.generic, float, int)
    return {name: np.array([value], None if isinstance(value, plain) else object) for name, value in values.items()}


def _facts(result: ResultFolder) -> dict[str, Any]:
    """What of a report has a column of its own; the rest is in its text."""
    report = result.report
    figures = result.report["figures"]
    session = report["session"]
    implement = session.get("implement") or {}
    return {
        **{name: _number(figures.get(name)) for name in _FIGURES},
        "hours": _number((figures.get("hours") or {}).get("field_s")) / 3600.0,
        "soil_moved_m3": _number((figures.get("soil_moved") or {}).get("volume_m3")),
        "machine": session.get("machine") or None,
        "field_name": None,
        "passes": np.int64(_number(figures.get("passes"), 0.0)),
        "warnings": np.int64(len(report.get("warnings") or ())),
        "implement": implement.get("kind"),
        "width_m": _number(implement.get("width_m")),
        "working_depth_m": _number(implement.get("working_depth_m")),
        "crs": session["crs"]["map"] or figures.get("crs"),
        "heights": session["crs"]["heights"],
        "coordinates": session["crs"]["coordinates"],
        "folder": resolved(result.folder).as_posix(),
    }


def _number(value: Any, otherwise: float = np.nan) -> float:
    return float(value) if isinstance(value, int | float) else otherwise


def zone_of(report: Mapping[str, Any], place: shapely.Point, crs: CRS) -> ZoneInfo:
    """The time zone of a run, as its report has it; that of the place where a report has none."""
    try:
        return ZoneInfo(report["figures"]["time_zone"])
    except (KeyError, OSError, TypeError, ValueError):
        geodetic = crs.geodetic_crs
        assert geodetic is not None
        to_lon_lat = Transformer.from_crs(crs.to_2d(), geodetic.to_2d(), always_xy=True)
        return zone_at(*to_lon_lat.transform(place.x, place.y))


def local_date(start: np.datetime64, zone: ZoneInfo) -> dt.date:
    """The day of a time (UTC) in a time zone."""
    return local_time(float(start.astype("datetime64[ms]").astype(np.int64)) / 1000.0, zone).date()


def short_hash(value: object) -> str:
    """16 hexadecimal digits of a hash of a value that JSON can express."""
    return hashlib.sha256(json.dumps(value, ensure_ascii=False).encode("utf-8", "surrogatepass")).hexdigest()[:16]


TASK_HEIGHTS: Final = "not measured"
"""Height system of positions that task data log."""


def read_tasks(path: Path, zone: ZoneInfo | None = None) -> list[SessionResult]:
    """Read the GeoPackage that `furrowmap fields` wrote: a result for each task; `zone` None for that of the place.

    A task is identified by its id, its name and the time at which it began.
    """
    if not path.is_file():
        raise _no_tasks(path, "does not exist")
    with reading_result(path):
        names = [name for name, _ in list_layers(path)]
        if FIELDS_LAYER not in names or TRAJECTORY not in names:
            raise _no_tasks(path, "was not written by `furrowmap fields`")
        layers = {name: read_layer(path, name) for name in names if name != "layer_styles"}
        if not all("task" in layer.columns for layer in layers.values()):
            raise _no_tasks(path, "was not written by `furrowmap fields`")
        crs = crs_of_file(layer_info(path, TRAJECTORY)["crs"])
        figures = layers.pop(FIELDS_LAYER)
        digest = products_digest(path)
        results = []
        for task in figures.rows():
            own = {name: _features_of(layer, "task", str(task["task"]), "field") for name, layer in layers.items()}
            results.append(_task_result(resolved(path), task, own, crs, digest, zone))
        return results


def _task_result(
    path: Path, task: Mapping[str, Any], layers: dict[str, Layer], crs: CRS, digest: str, zone: ZoneInfo | None
) -> SessionResult:
    driven = layers[TRAJECTORY]
    recordings = short_hash(["task data", task["task"], task["task_name"], str(driven.columns["time"][0])])
    rate = float(task["work_rate_ha_h"])
    area_m2 = float(task["worked_area_m2"])
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
        "passes": np.int64(np.count_nonzero(~shapely.is_empty(passes.shapes)) if passes is not None else 0),
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


def _features_of(layer: Layer, column: str, value: str | None, *left_out: str) -> Layer:
    """The features with a value in a column, without that column and others."""
    mine = layer.columns[column] == value
    columns = {name: values[mine] for name, values in layer.columns.items() if name not in (column, *left_out)}
    return replace(layer, shapes=layer.shapes[mine], columns=columns)


def _no_tasks(path: Path, why: str) -> InputError:
    return InputError("no-task-result", path=path, why=why)
