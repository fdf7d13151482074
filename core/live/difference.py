"""By how much a live session differed from the run of its recording."""

import json
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from furrowmap.core.runtime.file_names import found_beside
from furrowmap.core.runtime.plain_reads import read_plain_text
from furrowmap.core.values.rotation import wrap_deg
from furrowmap.core.values.trajectory import ScanPoses

LIVE_LOG: Final = "live.jsonl"
"""In the folder of the recording: what the last live session showed, a line of JSON a second, with the CRS first."""
COMPARED: Final = ("t_s", "e_m", "n_m", "heading_deg", "worked_m2")
LOGGED: Final = (*COMPARED, "not_seen_m2", "dropped", "lost_packets")
MAX_STEP_S: Final = 0.5
"""Poses of a run further apart are not interpolated."""
WHOLE_SHARE: Final = 0.95
"""Areas are compared if the live session saw so much of the time of the run."""


@dataclass(frozen=True)
class LiveDifference:
    """Live minus run.

    Attributes:
        seconds: compared, of which there is one pose each.
        place_m: horizontal distance: root mean square, largest.
        heading_deg: root mean square, largest.
        worked_m2: ground worked as it was shown at the end, and as the run found it; None if live saw only a part.
    """

    seconds: int
    place_m: tuple[float, float]
    heading_deg: tuple[float, float]
    worked_m2: tuple[float, float] | None


def live_difference(folder: Path, crs: str, poses: ScanPoses, run_m2: float | None) -> LiveDifference | None:
    """The difference to the live session in a folder; None if there was none, or in another CRS.

    Args:
        crs: name of the map's CRS.
        poses: of the run.
        run_m2: ground worked by the run; None if that is unknown.
    """
    try:
        (log,) = found_beside(folder, LIVE_LOG)
        head, *lines = read_plain_text(log).splitlines()
        if json.loads(head)["crs"] != crs:
            return None
    except (OSError, ValueError, KeyError, TypeError):
        return None
    rows = []
    for line in lines:
        with suppress(ValueError, KeyError, TypeError):  # cut where the power was
            said = json.loads(line)
            rows.append([float(said[name]) for name in COMPARED])
    if not rows or len(poses.t_s) < 2:
        return None
    t_s, e_m, n_m, heading_deg, worked_m2 = np.array(rows).T
    after = np.clip(np.searchsorted(poses.t_s, t_s), 1, len(poses.t_s) - 1)
    near = (t_s >= poses.t_s[after - 1]) & (t_s <= poses.t_s[after])
    near &= poses.t_s[after] - poses.t_s[after - 1] < MAX_STEP_S
    if not near.any():
        return None
    east, north = (np.interp(t_s, poses.t_s, poses.xyz_m[:, axis]) for axis in (0, 1))
    turned_deg = np.interp(t_s, poses.t_s, np.degrees(np.unwrap(np.radians(poses.attitude_deg()[2]))))
    off_m = np.hypot(e_m - east, n_m - north)[near]
    off_deg = np.abs(wrap_deg(heading_deg - turned_deg))[near]
    whole = near.sum() > WHOLE_SHARE * (poses.t_s[-1] - poses.t_s[0])
    areas = (float(worked_m2[-1]), run_m2) if whole and run_m2 is not None else None
    place_m, heading = (
        (round(float(np.sqrt((off**2).mean())), 4), round(float(off.max()), 4)) for off in (off_m, off_deg)
    )
    return LiveDifference(int(near.sum()), place_m, heading, areas)
