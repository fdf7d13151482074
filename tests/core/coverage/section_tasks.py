"""Simulated tasks with section control, and the ground that each section works as exact polygons.

Written straight from ISO 11783-10 and -11 and plain kinematics; it shares nothing with what it tests.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import combinations
from pathlib import Path

import numpy as np
import pyproj
import shapely
from numpy.typing import NDArray

from tests.core.readers.isoxml.time_logs import Record, header, task_data

Floats = NDArray[np.float64]
CRS = "EPSG:25832"
CORNER_M = (640_000.0, 5_540_000.0)
STEP_S = 0.04
SPEED_MPS = 2.5
DAY = 15_000
TO_DEGREES = pyproj.Transformer.from_crs(CRS, "EPSG:4326", always_xy=True)


@dataclass(frozen=True)
class Path2d:
    """Places (n, 2) of an axle that does not slip and its direction (n,), every STEP_S."""

    place_m: Floats
    yaw: Floats

    def at(self, ahead_m: Floats | float, left_m: Floats | float) -> Floats:
        """A place (n, 2) of the body."""
        cos, sin = np.cos(self.yaw), np.sin(self.yaw)
        return self.place_m + np.column_stack([ahead_m * cos - left_m * sin, ahead_m * sin + left_m * cos])


def drive(begin_m: tuple[float, float], heading: float, *moves: tuple[float, float]) -> Path2d:
    """A drive along pieces of (length, curvature), left positive: the closed form of each arc."""
    places, yaws = [np.array([begin_m])], [np.array([heading])]
    place, yaw = np.array(begin_m), heading
    for length_m, curvature in moves:
        s = np.arange(1, round(length_m / SPEED_MPS / STEP_S) + 1) * SPEED_MPS * STEP_S
        turned = yaw + curvature * s
        if curvature:
            steps = np.column_stack([np.sin(turned) - np.sin(yaw), np.cos(yaw) - np.cos(turned)]) / curvature
        else:
            steps = np.outer(s, [np.cos(yaw), np.sin(yaw)])
        places.append(place + steps)
        yaws.append(turned)
        place, yaw = places[-1][-1], float(turned[-1])
    return Path2d(np.concatenate(places), np.concatenate(yaws))


def drawn(joint_m: Floats, yaw: float, drawbar_m: float) -> Path2d:
    """The axle of a body that is drawn at a joint: its direction turns with the joint's speed across it (RK4)."""
    velocity = np.gradient(joint_m, STEP_S, axis=0)
    out = [yaw]

    def rate(v: Floats, direction: float) -> float:
        return float((-v[0] * np.sin(direction) + v[1] * np.cos(direction)) / drawbar_m)

    for k in range(len(joint_m) - 1):
        v0, v2 = velocity[k], velocity[k + 1]
        v1 = 0.5 * (v0 + v2)
        a = rate(v0, out[-1])
        b = rate(v1, out[-1] + 0.5 * STEP_S * a)
        c = rate(v1, out[-1] + 0.5 * STEP_S * b)
        d = rate(v2, out[-1] + STEP_S * c)
        out.append(out[-1] + STEP_S / 6.0 * (a + 2.0 * b + 2.0 * c + d))
    direction = np.array(out)
    return Path2d(joint_m - drawbar_m * np.column_stack([np.cos(direction), np.sin(direction)]), direction)


@dataclass(frozen=True)
class Boom:
    """Sections from left to right: the left end of the first, widths, and how far the line is ahead of its body."""

    widths_m: Sequence[float]
    ahead_m: float
    left_m: float

    @property
    def ends_m(self) -> Floats:
        return self.left_m - np.concatenate([[0.0], np.cumsum(self.widths_m)])

    @property
    def middles_m(self) -> Floats:
        return 0.5 * (self.ends_m[1:] + self.ends_m[:-1])


def strip(body: Path2d, boom: Boom, section: int, on: NDArray[np.bool_]) -> shapely.Geometry:
    """The ground that a section sweeps while it is on (n,), from each place to the next."""
    left = body.at(boom.ahead_m, float(boom.ends_m[section]))
    right = body.at(boom.ahead_m, float(boom.ends_m[section + 1]))
    pieces = []
    rows = np.flatnonzero(on[:-1])
    for run in np.split(rows, np.flatnonzero((np.diff(rows) > 1) | (np.diff(rows // 50) > 0)) + 1):
        if len(run):
            way = np.append(run, run[-1] + 1)
            pieces.append(shapely.Polygon(np.concatenate([left[way], right[way][::-1]])))
    return shapely.union_all(shapely.make_valid(np.array(pieces, object))) if pieces else shapely.Polygon()


@dataclass
class Worked:
    """The ground of each pass: from when any section works to when none does."""

    passes: list[shapely.Geometry] = field(default_factory=list)

    def add(self, body: Path2d, boom: Boom, on: NDArray[np.bool_]) -> None:
        any_on = on.any(axis=1)
        edges = np.flatnonzero(np.diff(np.concatenate([[False], any_on, [False]]).astype(int)))
        for first, behind in edges.reshape(-1, 2):
            chosen = np.zeros(len(on), bool)
            chosen[first:behind] = True
            ground = [strip(body, boom, k, on[:, k] & chosen) for k in range(on.shape[1])]
            self.passes.append(shapely.union_all(ground))

    @property
    def area_m2(self) -> float:
        return float(shapely.union_all(self.passes).area)

    @property
    def overlap_m2(self) -> float:
        return float(sum(shapely.intersection(a, b).area for a, b in combinations(self.passes, 2)))


def controlled(
    body: Path2d, boom: Boom, field_m: shapely.Polygon, worked: shapely.Geometry, on: NDArray[np.bool_]
) -> NDArray[np.bool_]:
    """Which sections (n, k) are on, while `on` (n,): those of which any of three places is on ground not yet worked."""
    wanted = field_m.difference(worked)
    shapely.prepare(wanted)

    def inside(left_m: Floats) -> NDArray[np.bool_]:
        return np.column_stack([shapely.contains_xy(wanted, *body.at(boom.ahead_m, float(y)).T) for y in left_m])

    ends = boom.ends_m
    near = 0.45 * (ends[1:] - ends[:-1])
    any_inside = inside(boom.middles_m) | inside(boom.middles_m - near) | inside(boom.middles_m + near)
    return np.asarray(any_inside & on[:, None], bool)


def passes_of(body: Path2d, boom: Boom, field_m: shapely.Polygon, worked: Worked, spans: Floats) -> NDArray[np.bool_]:
    """Which sections (n, k) are on in each of the spans (m, 2) of a drive, one pass after the other."""
    out = np.zeros((len(body.yaw), len(boom.widths_m)), bool)
    for first, behind in spans:
        chosen = np.zeros(len(body.yaw), bool)
        chosen[first:behind] = True
        now = controlled(body, boom, field_m, shapely.union_all(worked.passes), chosen)
        worked.add(body, boom, now)
        out |= now
    return out


def spans_of(moves: Sequence[tuple[float, float]], pieces: int = 1) -> NDArray[np.int64]:
    """First step and that behind the last of each pass of so many pieces, with a turn after it."""
    ends = np.cumsum([0, *(round(length_m / SPEED_MPS / STEP_S) for length_m, _ in moves)])
    first = np.arange(0, len(moves), pieces + 1)
    return np.column_stack([ends[first], ends[first + pieces]])


def condensed(on: NDArray[np.bool_], block: int) -> NDArray[np.int64]:
    """The condensed work states (n,) of 16 sections, the leftmost in the lowest bits; 3 is not installed."""
    raw = np.zeros(len(on), np.int64)
    for k in range(16):
        section = 16 * block + k
        raw |= (on[:, section].astype(np.int64) if section < on.shape[1] else 3) << (2 * k)
    return np.where(raw >= 1 << 31, raw - (1 << 32), raw)


def log_records(
    antenna_m: Floats, begin_ms: int, columns: Sequence[NDArray[np.int64]], every_s: float = 0.2
) -> list[Record]:
    """Records every 0.2 s, and where a value changes, with what changed."""
    lon, lat = TO_DEGREES.transform(*antenna_m.T)
    records = []
    last: list[int | None] = [None] * len(columns)
    regular = round(every_s / STEP_S)
    for k in range(len(antenna_m)):
        now = [int(column[k]) for column in columns]
        changed = {c: value for c, value in enumerate(now) if value != last[c]}
        if changed or k % regular == 0:
            place = {"A": round(lat[k] * 1e7), "B": round(lon[k] * 1e7), "D": 4}
            records.append(Record(begin_ms + round(1000 * STEP_S * k), DAY, place, changed))
            last = list(now)
    return records


def elements_xml(device: str, parts: Sequence[tuple[str, int, int, dict[int, int]]], *, name: str) -> str:
    """A device of elements (kind, object, parent object, properties), whose ids are `device-object`."""
    dets, dpts = [], []
    number = 1000
    for order, (kind, own, parent, properties) in enumerate(parts):
        refs = ""
        for ddi, value in properties.items():
            number += 1
            dpts.append(f'<DPT A="{number}" B="{ddi:04X}" C="{value}"/>')
            refs += f'<DOR A="{number}"/>'
        label = f"{name} {own}"
        dets.append(f'<DET A="{device}-{own}" B="{own}" C="{kind}" D="{label}" E="{order}" F="{parent}">{refs}</DET>')
    return f'<DVC A="{device}" B="{name}">{"".join(dets)}{"".join(dpts)}</DVC>'


def millimetres(metres: float) -> int:
    return round(1000.0 * metres)


@dataclass(frozen=True)
class Simulated:
    """Task data, what was worked in each of its tasks, the field, and the whole width."""

    folder: Path
    worked: tuple[Worked, ...]
    field_m: shapely.Polygon
    width_m: float


def turn(radius_m: float, *, left: bool) -> tuple[float, float]:
    """Half a circle."""
    return np.pi * radius_m, (1.0 if left else -1.0) / radius_m


def packed(records: Sequence[Record]) -> bytes:
    return b"".join(record.pack() for record in records)


def straight_boom(folder: Path) -> Simulated:
    """A sprayer of its own with eight sections: two headlands first, then passes that switch off where it was before.

    The positions are those of its reference point, the sections have properties, their states are condensed. The
    passes are 22 m apart, the boom is 24 m: sections of 3 m cannot avoid all of the overlap.
    """
    east, north = CORNER_M
    field_m = shapely.box(east, north, east + 130.0, north + 180.0)
    boom = Boom([3.0] * 8, -2.0, 12.0)
    worked = Worked()
    sections = [("4", 10 + k, 2, {135: millimetres(-y), 67: 3000}) for k, y in enumerate(boom.middles_m.tolist())]
    parts = [("1", 1, 0, {}), ("2", 2, 1, {134: -2000, 135: 0, 70: 24_000}), *sections]
    inner = [move for k in range(6) for move in ((200.0, 0.0), turn(11.0, left=k % 2 == 1))][:-1]
    drives = [
        ((east - 20.0, north + 12.0), 0.0, [(170.0, 0.0)]),
        ((east + 150.0, north + 168.0), np.pi, [(170.0, 0.0)]),
        ((east + 10.0, north - 10.0), 0.5 * np.pi, inner),
    ]
    logs = {}
    for number, (begin_m, heading, moves) in enumerate(drives, start=1):
        body = drive(begin_m, heading, *moves)
        on = passes_of(body, boom, field_m, worked, spans_of(moves))
        records = log_records(body.place_m, 36_000_000 + 1_000_000 * number, [condensed(on, 0)])
        logs[f"TLG0000{number}"] = (header([(161, "DVC-1-2")]), packed(records))
    refs = "".join(f'<TLG A="{name}"/>' for name in logs)
    xml = f'{elements_xml("DVC-1", parts, name="sprayer")}<TSK A="TSK1" B="spray" G="4">{refs}</TSK>'
    return Simulated(task_data(folder, xml, logs), (worked,), field_m, 24.0)


def curved_passes(folder: Path) -> Simulated:
    """Arcs about one centre in a field with a slanting edge, by a self-propelled sprayer with its antenna ahead.

    Each section has a state of its own; their places and widths are logged once; the antenna is 1.6 m before the axle
    and 0.2 m to its right, the boom 4 m behind the axle. The arcs are 16.5 m apart, the boom is 18 m.
    """
    east, north = CORNER_M
    boom = Boom([2.0, 3.0, 4.0, 4.0, 3.0, 2.0], -4.0, 9.0)
    corners = [(0.0, 0.0), (140.0, 0.0), (140.0, 40.0), (60.0, 130.0), (0.0, 130.0)]
    field_m = shapely.Polygon([(east + x, north + y) for x, y in corners])
    moves = []
    for k, radius_m in enumerate((50.0, 66.5, 83.0, 99.5)):
        left = k % 2 == 0
        moves += [(0.5 * np.pi * radius_m + 24.0, (1.0 if left else -1.0) / radius_m), turn(8.25, left=not left)]
    moves.pop()
    begin_m = (east + 50.0 * np.cos(-0.24), north + 50.0 * np.sin(-0.24))
    body = drive(begin_m, 0.5 * np.pi - 0.24, *moves)
    worked = Worked()
    on = passes_of(body, boom, field_m, worked, spans_of(moves))
    parts: list[tuple[str, int, int, dict[int, int]]] = [("1", 1, 0, {}), ("7", 2, 1, {134: 1600, 135: 200})]
    parts += [("2", 3, 1, {134: -4000}), *(("4", 10 + k, 3, {}) for k in range(6))]
    names = [f"DVC-1-{10 + k}" for k in range(6)]
    columns = [on[:, k].astype(np.int64) for k in range(6)]
    columns += [np.full(len(on), millimetres(-left_m)) for left_m in boom.middles_m]
    columns += [np.full(len(on), millimetres(width_m)) for width_m in boom.widths_m]
    records = log_records(body.at(1.6, -0.2), 36_000_000, columns)
    log = header([(ddi, name) for ddi in (141, 135, 67) for name in names]), packed(records)
    xml = elements_xml("DVC-1", parts, name="sprayer") + '<TSK A="TSK1" B="spray" G="4"><TLG A="TLG00001"/></TSK>'
    return Simulated(task_data(folder, xml, {"TLG00001": log}), (worked,), field_m, 18.0)


def drawn_drill(folder: Path, *, is_connected: bool = True) -> Simulated:
    """A drawn drill with 24 sections behind a tractor, on winding passes, in two sets of task data.

    Widths and the state of the machine stand in the header for all records; the states of the sections are in two
    condensed values. The antenna is 0.9 m before the tractor's axle, the hitch 1.1 m behind it, the drill's axle 4.5 m
    behind the hitch and its coulters another 1.2 m; it sits 0.15 m to the left of the axle's middle.
    """
    east, north = CORNER_M
    boom = Boom([0.25] * 24, -1.2, 3.15)
    field_m = shapely.box(east, north, east + 40.0, north + 160.0)
    tractor = [("1", 1, 0, {}), ("7", 2, 1, {134: 900, 135: 0}), ("6", 3, 1, {134: -1100, 157: 1})]
    sections = [("4", 10 + k, 3, {135: millimetres(-y)}) for k, y in enumerate(boom.middles_m.tolist())]
    drill = [("1", 1, 0, {}), ("6", 2, 1, {134: 4500, 135: 0, 157: 1}), ("2", 3, 1, {134: -1200}), *sections]
    machines = elements_xml("DVC-1", tractor, name="tractor") + elements_xml("DVC-2", drill, name="drill")
    connection = '<CNN A="DVC-1" B="DVC-1-3" C="DVC-2" D="DVC-2-2"/>' if is_connected else ""
    channels = [(161, "DVC-2-3"), (162, "DVC-2-3"), (141, "DVC-2-1"), *((67, f"DVC-2-{10 + k}") for k in range(24))]
    constants = {2: 1, **{3 + k: 250 for k in range(24)}}
    winding = [(20.0, 1.0 / 60.0), (40.0, -1.0 / 60.0), (20.0, 1.0 / 60.0)]
    passes: list[tuple[float, float]] = []
    for k in range(2):
        side = 1.0 if k % 2 == 0 else -1.0
        passes += [(20.0, 0.0), *((length_m, side * c) for length_m, c in (*winding, *winding)), (25.0, 0.0)]
        passes.append(turn(5.6, left=k % 2 == 1))
    passes.pop()
    worked = []
    for part in range(2):
        drives = [
            ((east - 15.0, north + 5.0 + 150.0 * part), 0.0, [(70.0, 0.0)], 1),
            ((east + 8.0 + 5.6 * part, north - 20.0), 0.5 * np.pi, passes, 8),
        ]
        worked.append(Worked())
        logs = {}
        for number, (begin_m, heading, moves, pieces) in enumerate(drives, start=1):
            vehicle = drive(begin_m, heading, *moves)
            body = drawn(vehicle.at(-1.1, 0.0), heading, 4.5)
            on = passes_of(body, boom, field_m, worked[-1], spans_of(moves, pieces))
            begin_ms = 30_000_000 + 10_000_000 * part + 1_000_000 * number
            records = log_records(vehicle.at(0.9, 0.0), begin_ms, [condensed(on, 0), condensed(on, 1)])
            logs[f"TLG0000{number}"] = (header(channels, constants=constants), packed(records))
        refs = "".join(f'<TLG A="{name}"/>' for name in logs)
        xml = f'{machines}<TSK A="TSK1" B="day {part + 1}" G="4">{connection}{refs}</TSK>'
        task_data(folder / f"day{part + 1}", xml, logs)
    return Simulated(folder, tuple(worked), field_m, 6.0)


TASKS: dict[str, Callable[[Path], Simulated]] = {
    "straight boom": straight_boom, "curved passes": curved_passes, "drawn drill": drawn_drill,
}  # fmt: skip
