"""The layers of `field.gpkg`."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray

from furrowmap.core.coverage.field_work import FieldWork
from furrowmap.core.coverage.strip_outlines import StripGround
from furrowmap.core.coverage.worked_ground import AreaFigure, FieldPlace
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.strips.strip_differences import StripDifferences
from furrowmap.core.values.clock import iso_utc
from furrowmap.core.values.gnss import Fix
from furrowmap.core.values.tool_states import ToolState, ToolStates
from furrowmap.core.values.trajectory import SIGMA_NAMES, SOURCE_NAMES, Motion, ScanPoses
from furrowmap.exporters.files.csv_cells import write_csv

HEADER: Final = ("time", "t_s", "state", "sigma_s", "confidence", "common_share")


def write_states(path: Path, states: ToolStates) -> None:
    """Write a row for each change of state, with all digits of `t_s`."""
    rows: list[tuple[Any, ...]] = []
    for k in range(len(states)):
        word = ToolState(int(states.state[k])).label
        rows.append((states.begin_s[k], word, states.begin_sigma_s[k], states.confidence[k]))
        if k + 1 == len(states) or states.begin_s[k + 1] > states.end_s[k]:
            rows.append((states.end_s[k], ToolState.UNKNOWN.label, states.end_sigma_s[k], 0.0))
    write_csv(path, HEADER, ((iso_utc(float(row[0])), *row, states.common_share) for row in rows))


ObjectArray = NDArray[np.object_]
Columns = dict[str, NDArray[Any]]

_TOOL_COLUMNS: Final = {
    "implement": "implement_{}",
    "implement_confidence": "implement_{}_confidence",
    "tool_height_m": "tool_{}_height_m",
    "pass": "pass_{}",
}
"""Names of the columns of a further tool in `trajectory`, by those of the first."""
_SAME_SCAN_S: Final = 0.25
"""Largest distance in time between a pose and the scan that shows the tool, which may be of another scanner."""
_MAX_GAP_S: Final = 1.0
"""A track is interrupted where positions are missing for longer."""
_TOOL_EVENTS: Final = ("down", "up")
"""Events of the tool; the others are of the vehicle."""


@dataclass(frozen=True)
class Layer:
    """A vector layer.

    Attributes:
        kind: geometry type, as OGR calls it; empty for a table.
        shapes: (n,) geometries or None.
        columns: (n,) values of each field; times as datetime64[ms] in UTC; masked values and nan become NULL.
    """

    name: str
    kind: str
    description: str
    shapes: ObjectArray
    columns: Columns

    @property
    def fields(self) -> tuple[tuple[str, str], ...]:
        """Name and numpy type of each field."""
        return tuple((name, values.dtype.str) for name, values in self.columns.items())

    def rows(self) -> list[dict[str, Any]]:
        """The values of each feature by field, as Python has them; None for masked ones."""
        cells = [np.ma.asarray(values).tolist() for values in self.columns.values()]
        return [dict(zip(self.columns, row, strict=True)) for row in zip(*cells, strict=True)]


def concatenate_layers(layers: Sequence[Layer]) -> Layer:
    """One layer with the features of several that have the same fields."""
    columns: Columns = {}
    for name in layers[0].columns:
        parts = [layer.columns[name] for layer in layers]
        columns[name] = (np.ma.concatenate if any(map(np.ma.isMA, parts)) else np.concatenate)(parts)
    return replace(layers[0], shapes=np.concatenate([layer.shapes for layer in layers]), columns=columns)


def geometry_array(shapes: Any) -> ObjectArray:
    """Geometries or None (n,) as an array of objects."""
    out = np.empty(len(shapes), object)
    out[:] = shapes
    return out


def track_lines(xyz_m: FloatArray, t_s: FloatArray, tolerance_m: float) -> shapely.MultiLineString:
    """Positions (n, 2 or 3) as lines, simplified by `tolerance_m` at most, and interrupted where some are missing."""
    parts = np.split(xyz_m, np.flatnonzero(np.diff(t_s) > _MAX_GAP_S) + 1)
    lines = [shapely.LineString(part) for part in parts if len(part) > 1]
    return shapely.MultiLineString(list(shapely.simplify(lines, tolerance_m)))


def hull(shapes: Sequence[shapely.Geometry]) -> shapely.Geometry:
    """The convex hull of shapes in two dimensions; that of a point or a line with a metre around it."""
    found = shapely.convex_hull(shapely.force_2d(shapely.GeometryCollection(shapes)))
    return found if isinstance(found, shapely.Polygon) else found.buffer(1.0, quad_segs=2)


def field_layers(poses: ScanPoses, work: FieldWork) -> list[Layer]:
    """All layers, the topmost of a map first: `trajectory` always, the others where the worked ground is known."""
    text = "The vehicle frame's origin (on the ground below the rear axle) in the middle of each scan"
    points = geometry_array(shapely.points(poses.xyz_m))
    trajectory = Layer("trajectory", "2.5D Point", text, points, _trajectory_columns(poses, work))
    known = [one for one in work.each if one.ground is not None]
    if not known:
        return [trajectory]
    # Events of the vehicle are in the layer once.
    tools = [[_event_layer(one, drive=one is known[0]), *_ground_layers(one)] for one in known]
    if work.others:
        tools = [
            [replace(a, columns={"tool": np.full(len(a.shapes), one.tool, object), **a.columns}) for a in tool]
            for one, tool in zip(known, tools, strict=True)
        ]
    events, *others = (concatenate_layers(layers) for layers in zip(*tools, strict=True))
    return [events, trajectory, *others]


def strip_layers(grounds: Sequence[StripGround], differences: StripDifferences | None) -> list[Layer]:
    """The layers of a flight's strips: differences where two see the same ground, outlines; none without strips."""
    layers = []
    if differences is not None:
        columns: Columns = {
            "strip_a": differences.strip_a,
            "strip_b": differences.strip_b,
            "before_m": differences.before_m,
            "after_m": differences.after_m,
            "sigma_m": differences.sigma_m,
            "cell_m": np.full(len(differences), differences.cell_m),
        }
        text = "Height in a strip less that in an earlier one, with the stated mounting and with the one used"
        points = geometry_array(shapely.points(differences.centre_m))
        layers.append(Layer("strip_differences", "Point", text, points, columns))
    if grounds:
        strips = [ground.strip for ground in grounds]
        columns = {
            "strip": np.array([strip.number for strip in strips], np.int64),
            "start": times([strip.begin_s for strip in strips]),
            "end": times([strip.end_s for strip in strips]),
            "heading_deg": numbers(strip.heading_deg for strip in strips),
            "length_m": numbers(strip.length_m for strip in strips),
            "speed_mps": numbers(strip.speed_mps for strip in strips),
            "points": np.array([ground.points for ground in grounds], np.int64),
            "area_m2": numbers(ground.area_m2 for ground in grounds),
            "points_m2": numbers(ground.points_m2 for ground in grounds),
        }
        shapes = geometry_array([ground.outline for ground in grounds])
        layers.append(
            Layer("strips", "MultiPolygon", "The ground that a straight pass of the flight covers", shapes, columns)
        )
    return layers


def _trajectory_columns(poses: ScanPoses, work: FieldWork) -> Columns:
    roll_deg, pitch_deg, heading_deg = poses.attitude_deg()
    columns: Columns = {
        "scan": poses.scan,
        "time": times(poses.t_s),
        "t_s": poses.t_s,
        "roll_deg": roll_deg,
        "pitch_deg": pitch_deg,
        "heading_deg": heading_deg,
        "speed_mps": poses.speed_mps,
        "motion": _labels(poses.motion, {int(motion): motion.label for motion in Motion}),
        "fix": _labels(poses.fix, {int(fix): fix.label for fix in Fix}),
        **{f"sigma_{name}": poses.sigma[:, i] for i, name in enumerate(SIGMA_NAMES)},
        **{name: getattr(poses, name).astype(object) for name in SOURCE_NAMES},
    }
    columns |= _tool_columns(poses, work)
    for number, other in enumerate(work.others, start=2):
        columns |= {f"tool_{number}": np.full(len(poses), other.tool, object)}
        columns |= {_TOOL_COLUMNS[name].format(number): values for name, values in _tool_columns(poses, other).items()}
    return columns


def _tool_columns(poses: ScanPoses, work: FieldWork) -> Columns:
    """A tool over the scans."""
    n = len(poses)
    state = np.full(n, ToolState.UNKNOWN, np.int8)
    confidence = np.zeros(n)
    height = np.full(n, np.nan)
    history = work.history
    if history is not None:
        row = np.searchsorted(0.5 * (history.t_s[1:] + history.t_s[:-1]), poses.t_s)
        at = np.abs(history.t_s[row] - poses.t_s) < _SAME_SCAN_S
        for into, of in ((state, history.state), (confidence, history.confidence), (height, history.tool_height_m)):
            into[at] = of[row[at]]
    if work.external is not None:
        state, confidence = work.external.at(poses.t_s)
    return {
        "implement": _labels(state, {int(state): state.label for state in ToolState}),
        "implement_confidence": confidence,
        "tool_height_m": height,
        "pass": _pass_numbers(work.pass_at(poses.t_s)),
    }


def _ground_layers(work: FieldWork) -> list[Layer]:
    """The paths of a tool and its ground, and the field where its boundary is known."""
    ground = work.ground
    assert ground is not None
    spans = {p.number: (p.times.begin_s, p.times.end_s) for p in ground.passes}
    paths = Layer(
        "tool_path",
        "2.5D LineString",
        "The path of the middle of the tool's line, a line for each state of the tool",
        geometry_array([path.line for path in work.paths]),
        {
            "implement": texts(path.state.label for path in work.paths),
            "pass": _pass_numbers([path.pass_number or 0 for path in work.paths]),
            "start": times([path.begin_s for path in work.paths]),
            "end": times([path.end_s for path in work.paths]),
            "length_m": numbers(path.length_m for path in work.paths),
        },
    )
    overlaps = Layer(
        "overlaps",
        "Polygon",
        "Ground that two passes worked, or one pass twice",
        geometry_array([overlap.ground for overlap in ground.overlaps]),
        {
            "pass_a": np.array([overlap.pass_a for overlap in ground.overlaps], np.int64),
            "pass_b": np.array([overlap.pass_b for overlap in ground.overlaps], np.int64),
            "start": times([spans[overlap.pass_b][0] for overlap in ground.overlaps]),
            "end": times([spans[overlap.pass_b][1] for overlap in ground.overlaps]),
            **_areas([overlap.area for overlap in ground.overlaps]),
        },
    )
    coverage = Layer(
        "coverage",
        "MultiPolygon",
        "All ground worked, once however often",
        geometry_array([] if ground.coverage.is_empty else [ground.coverage]),
        _areas([] if ground.coverage.is_empty else [ground.figures.worked]),
    )
    passes = Layer(
        "passes",
        "MultiPolygon",
        "The ground worked from one lowering of the tool to its lifting",
        geometry_array([p.ground for p in ground.passes]),
        {
            "pass": np.array([p.number for p in ground.passes], np.int64),
            "start": times([p.times.begin_s for p in ground.passes]),
            "end": times([p.times.end_s for p in ground.passes]),
            "length_m": numbers(p.length_m for p in ground.passes),
            "width_m": numbers(p.width_m for p in ground.passes),
            **_areas([p.area for p in ground.passes]),
            "speed_mps": numbers(p.speed_mps for p in ground.passes),
            "depth_m": numbers(depth.depth_m for depth in work.depths),
            "depth_sigma_m": numbers(depth.sigma_m for depth in work.depths),
            "depth_spread_m": numbers(depth.spread_m for depth in work.depths),
        },
    )
    field = []
    if ground.figures.field is not None and ground.boundary is not None:
        not_worked = "Ground of the field that was neither worked nor missed: where no pass has been yet"
        outline = geometry_array([shapely.MultiPolygon(shapely.get_parts(ground.boundary).tolist())])
        shares = {"worked_share": numbers([ground.figures.field.worked_share]), **_areas([ground.figures.field.area])}
        field = [
            _place_layer("unworked", not_worked, ground.unworked),
            Layer("boundary", "MultiPolygon", "The field", outline, shares),
        ]
    missed = "Strips narrower than the tool that were not worked"
    zones = "Headland, where turns take place, and the field's body"
    return [
        paths,
        _place_layer("misses", missed, ground.misses, "kind"),
        *field,
        overlaps,
        coverage,
        passes,
        _place_layer("zones", zones, ground.zones, "zone"),
    ]


def _place_layer(name: str, text: str, places: Sequence[FieldPlace], kind_column: str = "") -> Layer:
    kinds = {kind_column: texts(place.kind for place in places)} if kind_column else {}
    shapes = geometry_array([place.ground for place in places])
    return Layer(name, "Polygon", text, shapes, kinds | _areas([place.area for place in places]))


def _event_layer(work: FieldWork, *, drive: bool) -> Layer:
    found = work.events if drive else [event for event in work.events if event.kind in _TOOL_EVENTS]
    return Layer(
        "events",
        "2.5D Point",
        "Where the tool went down or up, where the vehicle stopped, started or reversed, where positions end",
        geometry_array([shapely.Point(e.xyz_m) if np.isfinite(e.xyz_m).all() else None for e in found]),
        {
            "kind": texts(event.kind for event in found),
            "time": times([event.t_s for event in found]),
            "t_s": numbers(event.t_s for event in found),
            "pass": _pass_numbers([event.pass_number or 0 for event in found]),
            "sigma_s": numbers(event.sigma_s for event in found),
        },
    )


def _areas(areas: Sequence[AreaFigure]) -> Columns:
    return {
        "area_m2": numbers(area.grid_m2 for area in areas),
        "area_ellipsoid_m2": numbers(area.ellipsoid_m2 for area in areas),
        "area_sigma_m2": numbers(area.sigma_m2 for area in areas),
    }


def _labels(codes: NDArray[np.int8], words: Mapping[int, str]) -> ObjectArray:
    """The word of each code; None (NULL in the file) for unknown codes."""
    known, index = np.unique(codes, return_inverse=True)
    return np.array([words.get(int(code)) for code in known], dtype=object)[index]


def _pass_numbers(passes: ArrayLike) -> NDArray[Any]:
    """Numbers of passes; 0 (between passes) is masked."""
    return np.ma.masked_equal(np.asarray(passes, np.int64), 0)


def texts(values: Iterable[str | None]) -> ObjectArray:
    """A column of texts; None becomes NULL."""
    return np.array(list(values), dtype=object)


def numbers(values: Iterable[float]) -> NDArray[np.float64]:
    """A column of numbers; nan becomes NULL."""
    return np.array(list(values), np.float64)


def times(t_s: ArrayLike) -> NDArray[np.datetime64]:
    """A column of times in UTC to the millisecond."""
    return np.round(np.asarray(t_s, np.float64) * 1000.0).astype(np.int64).view("datetime64[ms]")
