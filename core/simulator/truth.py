"""The ground truth of a recording: trajectory, implement, ground, worked ground."""

from pathlib import Path
from typing import Any, Final

import numpy as np
import shapely
from numpy.typing import NDArray

from furrowmap.core.simulator.drive import DRIVE_RATE_HZ, SimulatedTrack
from furrowmap.core.simulator.machine_motion import SimulatedMotion
from furrowmap.core.simulator.noise import FloatArray
from furrowmap.core.simulator.scenario import Scenario
from furrowmap.core.simulator.site import CELL_M, SimulatedSite
from furrowmap.core.simulator.soil_over_time import Ground, ToolSweep

TRUTH_CELL_M: Final = 2.0 * CELL_M
TRUTH_HZ: Final = 100
_HEIGHT_STEP_M: Final = 2.0**-13
_TIME_STEP_S: Final = 2.0**-7
"""Rounding that makes the surface compress well."""
_VERTEX_M: Final = 0.12


def write_trajectory(file: Path, motion: SimulatedMotion, site: SimulatedSite, rate_hz: int, place_digits: int) -> None:
    """The vehicle frame at so many of its times a second, in map coordinates and in the angles of files."""
    i = slice(None, None, DRIVE_RATE_HZ // rate_hz)
    heading = (90.0 - np.degrees(motion.yaw_rad[i])) % 360.0
    columns = [
        site.t0_s + motion.t_s[i],
        *(motion.xyz_m[i] + np.array([site.e0_m, site.n0_m, site.h0_m])).T,
        np.degrees(motion.roll_rad[i]),
        np.degrees(motion.pitch_rad[i]),
        np.where(heading >= 359.999995, 0.0, heading),
    ]
    names = "time_unix_s,e_m,n_m,h_m,roll_deg,pitch_deg,heading_deg"
    numbers = f"%.4f{f',%.{place_digits}f' * 3}{',%.5f' * 3}"
    np.savetxt(file, np.column_stack(columns), fmt=numbers, header=names, comments="")


def write_implement(file: Path, track: SimulatedTrack, site: SimulatedSite) -> None:
    """Height and state of the tool at 100 Hz."""
    i = slice(None, None, DRIVE_RATE_HZ // TRUTH_HZ)
    rows = zip(site.t0_s + track.t_s[i], track.tool_m[i], track.down[i], strict=True)
    lines = [f"{t:.4f},{tool:.4f},{'down' if down else 'up'}\n" for t, tool, down in rows]
    file.write_text("time_unix_s,tool_height_m,state\n" + "".join(lines), encoding="utf-8")


def quarters(fine: NDArray[Any], rows: int, cols: int) -> NDArray[Any]:
    """(rows, cols, 4) the fine cells of each cell of twice their size."""
    return fine[: 2 * rows, : 2 * cols].reshape(rows, 2, cols, 2).swapaxes(1, 2).reshape(rows, cols, 4)


def coarse_surface(scenario: Scenario, ground: Ground) -> dict[str, FloatArray]:
    """The ground on the truth's cells: before, after (means), worked_time, reworked_time (nan: never)."""
    rows, cols = (round(m / TRUTH_CELL_M) for m in (scenario.field.size_n_m, scenario.field.size_e_m))
    e, n = ((np.arange(k) + 0.5) * TRUTH_CELL_M for k in (cols, rows))
    plane = ground.slope_e * e[None, :] + ground.slope_n * n[:, None]
    first = quarters(ground.first_s, rows, cols)
    last = quarters(ground.last_s, rows, cols)
    worked = np.isfinite(first)
    count = worked.sum(axis=2)
    whole = (count > 2) | ((count == 2) & worked[..., 0])  # a cell is worked if the larger part of it is
    again = np.where(worked & (first < last), last, -np.inf).max(axis=2)
    return {
        "before": quarters(ground.before, rows, cols).mean(axis=2, dtype=np.float64) + plane,
        "after": quarters(ground.after, rows, cols).mean(axis=2, dtype=np.float64) + plane,
        "worked_time": np.where(whole, np.where(worked, first, np.inf).min(axis=2), np.nan),
        "reworked_time": np.where(whole & np.isfinite(again), again, np.nan),
    }


class SeenAfter:
    """Counts, cell by cell of the truth, the returns from worked ground after its last working."""

    def __init__(self, scenario: Scenario, ground: Ground) -> None:
        self._ground = ground
        self._rows, self._cols = (round(m / TRUTH_CELL_M) for m in (scenario.field.size_n_m, scenario.field.size_e_m))
        self.counts = np.zeros(self._rows * self._cols, np.int64)

    def add(self, cell: NDArray[np.int32], t_s: FloatArray) -> None:
        """Take note of returns from cells of the ground (row * cols + col, -1 elsewhere) at their times."""
        on = cell >= 0
        cell = cell[on]
        cell = cell[t_s[on] >= self._ground.last_s.ravel()[cell]]
        row, col = np.divmod(cell, self._ground.before.shape[1])
        row_ = row // 2
        col_ = col // 2
        inside = (row_ < self._rows) & (col_ < self._cols)
        np.add.at(self.counts, row_[inside] * self._cols + col_[inside], 1)

    @property
    def image(self) -> NDArray[np.uint8]:
        """(rows, cols), at most 255."""
        return np.minimum(self.counts, 255).astype(np.uint8).reshape(self._rows, self._cols)


def write_surface(
    file: Path, surface: dict[str, FloatArray], seen_after: NDArray[np.uint8], site: SimulatedSite
) -> None:
    """The truth's ground as a compressed archive of arrays."""
    np.savez_compressed(
        file,
        before=(np.round(surface["before"] / _HEIGHT_STEP_M) * _HEIGHT_STEP_M).astype(np.float32),
        after=(np.round(surface["after"] / _HEIGHT_STEP_M) * _HEIGHT_STEP_M).astype(np.float32),
        worked_time=(np.round(surface["worked_time"] / _TIME_STEP_S) * _TIME_STEP_S).astype(np.float32),
        reworked_time=(np.round(surface["reworked_time"] / _TIME_STEP_S) * _TIME_STEP_S).astype(np.float32),
        seen_after=seen_after,
        e0=site.e0_m,
        n0=site.n0_m,
        cell_m=TRUTH_CELL_M,
        h0_m=site.h0_m,
        t0_unix_s=site.t0_s,
    )


def swept(sweep: ToolSweep, width_m: float) -> shapely.Polygon | shapely.MultiPolygon:
    """The ground, in local coordinates, that a tool's line passes over."""
    way = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(sweep.e_m), np.diff(sweep.n_m)))])
    _, kept = np.unique(np.floor(way / _VERTEX_M), return_index=True)
    i = np.unique(np.append(kept, len(way) - 1))
    middle = np.column_stack([sweep.e_m[i], sweep.n_m[i]])
    left = 0.5 * width_m * np.column_stack([-np.sin(sweep.yaw_rad[i]), np.cos(sweep.yaw_rad[i])])
    outline = shapely.Polygon(np.concatenate([middle + left, (middle - left)[::-1]]))
    if outline.is_valid:
        return outline
    corners = np.stack([(middle + left)[:-1], (middle + left)[1:], (middle - left)[1:], (middle - left)[:-1]], axis=1)
    joined = shapely.union_all(shapely.make_valid(shapely.polygons(corners)))
    assert isinstance(joined, (shapely.Polygon, shapely.MultiPolygon))
    return joined


def write_worked(file: Path, sweeps: list[ToolSweep], width_m: float, site: SimulatedSite) -> dict[str, Any]:
    """The layers passes, coverage and overlaps; their figures."""
    import pyogrio.raw

    corner = np.array([site.e0_m, site.n0_m])
    found = [shapely.transform(swept(sweep, width_m), lambda xy: xy + corner) for sweep in sweeps]
    shapes = np.array(found, object)  # of no shapes, too, which shapely would take for numbers
    lengths = [float(np.hypot(np.diff(sweep.e_m), np.diff(sweep.n_m)).sum()) for sweep in sweeps]
    passes = {
        "pass": np.arange(1, len(sweeps) + 1),
        "start": np.array([_iso(site, sweep.begin_s) for sweep in sweeps], object),
        "end": np.array([_iso(site, sweep.end_s) for sweep in sweeps], object),
        "t_start_s": np.array([site.t0_s + sweep.begin_s for sweep in sweeps], np.float64),
        "t_end_s": np.array([site.t0_s + sweep.end_s for sweep in sweeps], np.float64),
        "length_m": np.array(lengths, np.float64),
        "width_m": np.full(len(sweeps), width_m),
        "area_m2": np.array([shape.area for shape in shapes], np.float64),
    }
    coverage = shapely.union_all(shapes)
    overlaps = _overlaps(shapes)
    layers = {
        "passes": (passes, [_multi(shape) for shape in shapes], "MultiPolygon"),
        "coverage": (
            {"area_m2": np.array([coverage.area] * (len(shapes) > 0), np.float64)},
            [_multi(coverage)] * (len(shapes) > 0),
            "MultiPolygon",
        ),
        "overlaps": (
            {
                "pass_a": np.array([a for a, _, _ in overlaps], np.int64),
                "pass_b": np.array([b for _, b, _ in overlaps], np.int64),
                "area_m2": np.array([float(shape.area) for _, _, shape in overlaps], np.float64),
            },
            [shape for _, _, shape in overlaps],
            "Polygon",
        ),
    }
    # GDAL stamps the file with the time of writing; the same scenario shall give the same bytes
    pyogrio.set_gdal_config_options({"OGR_CURRENT_DATE": _iso(site, 0.0)})
    try:
        for layer, (columns, geometry, kind) in layers.items():
            pyogrio.raw.write(
                file,
                shapely.to_wkb(np.array(geometry, object)),
                list(columns.values()),
                list(columns),
                layer=layer,
                driver="GPKG",
                geometry_type=kind,
                crs=site.crs,
            )
    finally:
        pyogrio.set_gdal_config_options({"OGR_CURRENT_DATE": None})
    total = float(sum(shape.area for shape in shapes))
    return {
        "passes": len(sweeps),
        "worked_area_m2": round(float(coverage.area), 4),
        "swept_area_sum_m2": round(total, 4),
        "overlap_area_m2": round(float(sum(shape.area for _, _, shape in overlaps)), 4),
        "pass_lengths_m": [round(length, 3) for length in lengths],
    }


def ground_figures(surface: dict[str, FloatArray], seen_after: NDArray[np.uint8]) -> dict[str, Any]:
    """Volume, swelling, and how much of the worked ground the sensor saw afterwards."""
    change = surface["after"] - surface["before"]
    worked = np.isfinite(surface["worked_time"])
    return {
        "soil_volume_difference_m3": round(float(change.sum()) * TRUTH_CELL_M**2, 4),
        "worked_cells_seen_after_share": round(float((seen_after[worked] > 0).mean()), 4) if worked.any() else 0.0,
        "mean_swelling_m": round(float(change[worked].mean()), 5) if worked.any() else 0.0,
    }


def drive_figures(track: SimulatedTrack, motion: SimulatedMotion) -> dict[str, Any]:
    """How far and how long the machine drove, how often the tool changed its state, how much the ground tilted it."""
    return {
        "distance_driven_m": round(float(np.hypot(np.diff(track.e_m), np.diff(track.n_m)).sum()), 2),
        "standing_s": round(float((np.abs(track.speed_mps) < 0.01).sum()) / DRIVE_RATE_HZ, 2),
        "transitions": transitions(track),
        "rms_deg": {
            "roll": round(float(np.sqrt(np.mean(np.degrees(motion.roll_rad) ** 2))), 3),
            "pitch": round(float(np.sqrt(np.mean(np.degrees(motion.pitch_rad) ** 2))), 3),
        },
    }


def transitions(track: SimulatedTrack) -> int:
    """How often the tool changed its state."""
    return int(np.count_nonzero(np.diff(track.down.astype(np.int8))))


def _overlaps(shapes: NDArray[np.object_]) -> list[tuple[int, int, shapely.Polygon]]:
    """(pass, later pass, ground worked by both), a polygon a place."""
    found = []
    tree = shapely.STRtree(shapes)
    for a, b in sorted(zip(*(i.tolist() for i in tree.query(shapes, predicate="intersects")), strict=True)):
        if a < b:
            both = shapely.intersection(shapes[a], shapes[b])
            parts = [p for p in shapely.get_parts(both) if isinstance(p, shapely.Polygon) and p.area > 1e-4]
            found += [(a + 1, b + 1, part) for part in parts]
    return found


def _multi(shape: shapely.Geometry) -> shapely.MultiPolygon:
    return shapely.MultiPolygon([p for p in shapely.get_parts(shape) if isinstance(p, shapely.Polygon)])


def _iso(site: SimulatedSite, t_s: float) -> str:
    return site.utc(t_s).isoformat(timespec="milliseconds").replace("+00:00", "Z")
