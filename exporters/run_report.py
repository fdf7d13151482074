"""What a run found out, as `report.json` tells it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Any

import msgspec
import numpy as np

from furrowmap.core.pipeline import Run
from furrowmap.core.values.clock import iso_utc
from furrowmap.core.values.scan_poses import ScanPoses
from furrowmap.core.values.trajectory import SIGMAS, Motion
from furrowmap.exporters.report import FileRecord, Report


def report_of(found: Run, inputs: Sequence[FileRecord], timings_s: dict[str, float], products: Sequence[str]) -> Report:
    """The report of a run.

    Args:
        found: by the run.
        inputs: the records of the files that it read.
        timings_s: seconds of each stage.
        products: names of the files written.
    """
    return Report(
        session=msgspec.to_builtins(found.session),
        inputs=inputs,
        figures=_figures(found),
        accuracy=_accuracy(found.tally.poses),
        observability=_observability(found),
        clocks=_clocks(found),
        warnings=found.notices,
        timings=timings_s,
        products=products,
    )


def _figures(found: Run) -> dict[str, Any]:
    """Counts, times and lengths."""
    tally, poses = found.tally, found.tally.poses
    step_m = np.hypot(*np.diff(poses.xyz_m[:, :2], axis=0).T)
    step_s = np.diff(poses.t_s)
    together = step_s <= found.located.trajectory.max_gap_s
    moving = (poses.motion[1:] != Motion.STANDING) | (poses.motion[:-1] != Motion.STANDING)
    return {
        "points": tally.points,
        "points_read": tally.points_read,
        "points_without_pose": tally.points_without_pose,
        "points_standing_left_out": tally.points_standing,
        "scans": tally.scans,
        "scans_whole": tally.scans_whole,
        "scans_without_pose": tally.scans_without_pose,
        "start": iso_utc(tally.first_s),
        "end": iso_utc(tally.last_s),
        "duration_s": round(tally.last_s - tally.first_s, 3),
        "distance_m": round(float(step_m[together & moving].sum()), 2),
        "standing_s": round(float(step_s[together & ~moving].sum()), 1),
        "crs": found.frame.name,
        "heights": found.session.crs.heights,
        "bounds_m": [[round(v, 3) for v in f(poses.xyz_m, axis=0).tolist()] for f in (np.min, np.max)],
    }


def _accuracy(poses: ScanPoses) -> dict[str, Any]:
    """The sigmas of the scans' poses: median and 95th percentile of each, null where unknown."""
    out = {}
    for i, name in enumerate(SIGMAS):
        known = poses.sigma[:, i][np.isfinite(poses.sigma[:, i])]
        quantiles = np.quantile(known, (0.5, 0.95)).tolist() if len(known) else (None, None)
        out[f"sigma_{name}"] = dict(zip(("median", "p95"), quantiles, strict=True))
    return out


def _observability(found: Run) -> dict[str, Any]:
    """What held each unknown of the poses."""
    words = Counter(found.tally.poses.heading_from.tolist())
    level = "assumed level" if found.located.source == "gnss" else "file"
    return {
        "position": found.located.source,
        "height": found.located.source,
        "roll": level,
        "pitch": level,
        "heading": {word: round(count / len(found.tally.poses), 4) for word, count in words.most_common()},
        "positions": found.located.positions,
        "gaps": [[iso_utc(a), iso_utc(b)] for a, b in found.located.trajectory.gaps_s.tolist()],
    }


def _clocks(found: Run) -> dict[str, Any]:
    """What each clock said."""
    track = found.located.trajectory.t_s
    return {
        "lidar": [
            {"clock": c.clock, "first": iso_utc(c.first_s), "last": iso_utc(c.last_s), "note": c.note}
            for c in found.clocks
        ],
        "positions": {"first": iso_utc(float(track[0])), "last": iso_utc(float(track[-1]))},
        "lidar_minus_gnss_s": found.session.recording.lidar_minus_gnss_s,
    }
