"""A folder of products as a farm's base map takes it: one session with its layers."""

from __future__ import annotations

import datetime as dt
import hashlib
import json
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
from furrowmap.core.values.errors import Notice
from furrowmap.exporters.farm.products import TRAJECTORY, array_of, read_products
from furrowmap.exporters.vectors.field_layers import Columns, Layer

SESSIONS: Final = "sessions"
PROVENANCE: Final = "provenance"
TRACKS: Final = "tracks"
OWN: Final = frozenset({SESSIONS, PROVENANCE, TRACKS})
"""Tables that the base makes itself; all others are a run's layers with two columns more."""
_DRAWN: Final = ("events", "tool_path", TRACKS, "misses", "overlaps", "passes", "coverage", "zones", SESSIONS)
_GAP_S: Final = 1.0
"""A track is not drawn over a longer time without positions."""
_SIMPLER_M: Final = 0.02
"""By how much a track's line may leave the positions."""
_FIGURES: Final = (
    "worked_area_m2",
    "worked_area_ellipsoid_m2",
    "worked_area_sigma_m2",
    "overlap_area_m2",
    "missed_area_m2",
    "worked_length_m",
    "working_speed_mps",
    "work_rate_ha_h",
    "distance_m",
    "duration_s",
)


@dataclass(frozen=True)
class SessionResult:
    """A session as the base keeps it.

    Attributes:
        session: its identity, 16 hexadecimal digits of its name and of the content of its recordings: the session that
            `furrowmap run` would replace.
        recordings: the same of the recordings alone.
        digest: of the products that were read, so that the same need not be written twice.
        name: as the session has it.
        date: the day at the place where it began.
        crs: of all layers.
        heights: what they are heights above.
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

    def in_crs(self, target: CRS) -> tuple[SessionResult, tuple[Notice, ...]]:
        """The session with its horizontal coordinates in another CRS; heights and figures stay what they are.

        Raises:
            RefusedError: if there is no way that PROJ can vouch for.
        """
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
    """The products that `furrowmap run` left in `folder`.

    Args:
        folder: of the products; its cloud is not read.
        zone: by which the session's day is told; None for the nautical zone of the place (its longitude, in steps of
            15 degrees), which is the same on every computer.

    Raises:
        InputError: if there are none, or they cannot be read.
        RefusedError: if a run is writing them just now.
    """
    read = read_products(folder)
    session, layers = read.report["session"], dict(read.layers)
    name, driven = str(session["name"]), layers.pop(TRAJECTORY)
    recordings = sorted([str(record["name"]), str(record["sha256"])] for record in read.report["inputs"])
    identity = {
        "session": _short_hash([name, recordings]),
        "recordings": _short_hash(recordings),
        "digest": read.digest,
    }
    start, end = driven.columns["time"][[0, -1]]
    date = _day(start, driven.shapes[0], read.crs, zone)
    context = {"session": identity["session"], "date": np.datetime64(date)}
    if "coverage" in layers:
        layers["coverage"] = _with(layers["coverage"], {"name": name, "start": start, "end": end})
    own = [
        Layer(
            SESSIONS,
            "Polygon",
            "Where each session took place: the hull of the way driven and of the ground worked",
            array_of([_footprint(driven, layers.get("coverage"))]),
            _row({**context, "name": name, "start": start, "end": end, **_facts(read.report, folder)}),
        ),
        Layer(
            PROVENANCE,
            "",
            "What each session was made of and by: its report, and the session as it was understood",
            array_of([None]),
            _row(
                {
                    **identity,
                    "furrowmap": str(read.report.get("furrowmap")),
                    "base_by": version("furrowmap"),
                    "added": np.datetime64("now", "ms"),
                    "report": read.report_text,
                    "session_toml": read.session_text,
                }
            ),
        ),
        Layer(
            TRACKS,
            "2.5D MultiLineString",
            "The way of the vehicle",
            array_of([_track(driven)]),
            _row({**context, "start": start, "end": end}),
        ),
    ]
    taken = [_with(layers[name], context) for name in drawing_order(list(layers)) if name not in OWN]
    return SessionResult(
        **identity,
        name=name,
        date=date,
        crs=read.crs,
        heights=str(session["crs"]["heights"]),
        folder=folder.resolve(),
        layers=(*own, *taken),
    )


def drawing_order(names: Sequence[str]) -> list[str]:
    """Layers with those that a map shows on top first; such as nobody knows come last but the footprints."""
    return sorted(names, key=_order)


def _order(name: str) -> tuple[float, str]:
    return (_DRAWN.index(name) if name in _DRAWN else len(_DRAWN) - 1.5, name)


def _with(layer: Layer, more: Mapping[str, Any]) -> Layer:
    """The layer with columns that have the same value in every row, before its own."""
    n = len(layer.shapes)
    first: Columns = {name: np.repeat(column, n) for name, column in _row(more).items()}
    return replace(layer, columns=first | {name: v for name, v in layer.columns.items() if name not in first})


def _row(values: Mapping[str, Any]) -> Columns:
    """Columns of one row; None becomes NULL."""
    return {name: value.reshape(1) if isinstance(value, np.generic) else _cell(value) for name, value in values.items()}


def _cell(value: Any) -> NDArray[Any]:
    if isinstance(value, float | int):
        return np.array([value])
    return np.array([value], dtype=object)


def _facts(report: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """What of a report is worth a column; the rest stays in its text."""
    session, figures = report["session"], report.get("figures") or {}
    implement = session.get("implement") or {}
    return {
        **{name: _number(figures.get(name)) for name in _FIGURES},
        "passes": np.int64(_number(figures.get("passes"), 0.0)),
        "warnings": np.int64(len(report.get("warnings") or ())),
        "implement": implement.get("kind"),
        "width_m": _number(implement.get("width_m")),
        "working_depth_m": _number(implement.get("working_depth_m")),
        "crs": session["crs"].get("map") or figures.get("crs"),
        "heights": session["crs"]["heights"],
        "coordinates": session["crs"].get("coordinates"),
        "folder": folder.resolve().as_posix(),
    }


def _number(value: Any, otherwise: float = np.nan) -> float:
    return float(value) if isinstance(value, int | float) else otherwise


def _footprint(driven: Layer, coverage: Layer | None) -> shapely.Geometry:
    shapes = [*driven.shapes, *(coverage.shapes if coverage is not None else ())]
    hull = shapely.convex_hull(shapely.force_2d(shapely.GeometryCollection(shapes)))
    return hull if hull.geom_type == "Polygon" else hull.buffer(1.0, quad_segs=2)


def _track(driven: Layer) -> shapely.Geometry:
    """The positions as lines with heights, interrupted where positions are missing."""
    xyz = shapely.get_coordinates(driven.shapes, include_z=True)
    t_s = driven.columns["t_s"]
    parts = np.split(xyz, np.flatnonzero(np.diff(t_s) > _GAP_S) + 1)
    lines = [shapely.LineString(part) for part in parts if len(part) > 1]
    return shapely.MultiLineString(list(shapely.simplify(lines, _SIMPLER_M)))


def _day(start: np.datetime64, place: shapely.Point, crs: CRS, zone: ZoneInfo | None) -> dt.date:
    moment = dt.datetime.fromtimestamp(float(start.astype("datetime64[ms]").astype(np.int64)) / 1000.0, dt.UTC)
    if zone is not None:
        return moment.astimezone(zone).date()
    base = crs.geodetic_crs
    assert base is not None
    longitude, _ = Transformer.from_crs(crs.to_2d(), base.to_2d(), always_xy=True).transform(place.x, place.y)
    return (moment + dt.timedelta(hours=round(longitude / 15.0))).date()


def _short_hash(value: object) -> str:
    return hashlib.sha256(json.dumps(value, ensure_ascii=False).encode("utf-8", "surrogatepass")).hexdigest()[:16]
