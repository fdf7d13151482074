"""A scanner with one beam that sweeps in a plane: a row for each return."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import numpy as np

from furrowmap.core.runtime.progress import Progress
from furrowmap.core.simulator.flight_scenario import ScenarioLineScanner
from furrowmap.core.simulator.motion import mount_rotation
from furrowmap.core.simulator.rays import Beams, Firings, Met, make_optics, make_scene
from furrowmap.core.simulator.recording import World, cast_in_order

_NONE: Final = np.zeros(1)
_BEAM: Final = Beams(_NONE, _NONE, _NONE, _NONE, origin_m=0.0, step_m=0.002, zero_deg=0.0)
_LINES_PER_BATCH: Final = 20_000
"""Beams cast together."""


def record_lines(
    file: Path, world: World, line: ScenarioLineScanner, duration_s: float, progress: Progress
) -> dict[str, Any]:
    """Write the scans as CSV: time, angle about the scanner's z axis from its x axis, range; its figures."""
    scenario, site = world.scenario, world.site
    optics = make_optics(scenario, _BEAM, mount_rotation(scenario.lidar.true_rpy_deg))
    scene = make_scene(scenario, world.ground, world.crop)
    sweeps = max(0, math.floor((duration_s + scenario.lidar.stop_s - scenario.lidar.start_s) * line.rate_hz))
    stamped_s = site.t0_s + scenario.clock.true_lidar_minus_gnss_s
    met, last_s = np.zeros(len(Met), np.int64), scenario.lidar.start_s
    with file.open("w", encoding="ascii", newline="") as out:
        out.write("time_unix_s,angle_deg,range_m,intensity\n")
        batches = _batches(world, line, sweeps * line.beams)
        for first, firings, returns in cast_in_order(scene, optics, batches):
            seen = returns.ticks[0, :, 0] > 0
            met += np.bincount(returns.met[0, seen, 0], minlength=len(Met))
            last_s = float(firings.t_s[-1])
            rows = np.column_stack([
                stamped_s + firings.t_s[seen], -np.degrees(firings.azimuth_rad[seen]),
                _BEAM.step_m * returns.ticks[0, seen, 0], returns.reflectivity[0, seen, 0],
            ])  # fmt: skip
            np.savetxt(out, rows, fmt="%.6f,%.4f,%.3f,%d")
            progress("lidar", (first + len(seen)) / (sweeps * line.beams))
    counts = {kind.name.lower(): int(met[kind]) for kind in Met if kind is not Met.NOTHING}
    return {
        "lidar": {
            "points": sum(counts.values()),
            **counts,
            "sweeps": sweeps,
            "first_firing_unix_s": round(site.t0_s + scenario.lidar.start_s, 6),
            "last_packet_unix_s": round(site.t0_s + last_s, 6),
        },
        "laser_bias_m": {"0": round(float(optics.lasers[0, 3]), 4)},
    }


def _batches(world: World, line: ScenarioLineScanner, beams: int) -> Iterator[tuple[int, Firings]]:
    """Beams one after another, evenly over the share of a turn in which there are any."""
    step_deg = line.field_deg / (line.beams - 1)
    still = np.zeros(_LINES_PER_BATCH)
    for first in range(0, beams, _LINES_PER_BATCH):
        sweep, beam = np.divmod(first + np.arange(min(_LINES_PER_BATCH, beams - first)), line.beams)
        angle_deg = beam * step_deg - 0.5 * line.field_deg
        t_s = world.scenario.lidar.start_s + (sweep + beam * step_deg / 360.0) / line.rate_hz
        xyz, rotation = world.motion.at(t_s)
        none = still[: len(t_s)]
        azimuth = -np.radians(angle_deg)
        yield first, Firings(first, t_s, azimuth, none, xyz, rotation, none, none, world.mounted(t_s))
