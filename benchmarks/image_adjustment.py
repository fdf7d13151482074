"""Adjustment of a flight's images alone: its time, and the errors of the trajectory against the truth.

    python benchmarks/image_adjustment.py SESSION

The truth is looked for beside the session: truth/trajectory.csv.
"""

from __future__ import annotations

import resource
import sys
from pathlib import Path
from time import perf_counter

import numpy as np

from furrowmap.core.pipeline.session_aid import aid_session
from furrowmap.core.pipeline.solution import companions, ground_scale
from furrowmap.core.runtime.progress import silent
from furrowmap.core.session.opened import open_session
from furrowmap.core.trajectory.located import locate
from furrowmap.core.values.trajectory import Trajectory


def errors(trajectory: Trajectory, truth: Path) -> str:
    """Errors of a trajectory in words."""
    table = np.genfromtxt(truth, delimiter=",", names=True)
    inside = (table["time_unix_s"] > trajectory.span_s[0]) & (table["time_unix_s"] < trajectory.span_s[1])
    table = table[inside]
    poses = trajectory.at(table["time_unix_s"])
    off = poses.xyz_m - np.column_stack([table[name] for name in ("e_m", "n_m", "h_m")])
    turned = np.column_stack(poses.attitude_deg()) - np.column_stack(
        [table[f"{name}_deg"] for name in ("roll", "pitch", "heading")]
    )
    turned = (turned + 180.0) % 360.0 - 180.0
    shape = off - off.mean(axis=0)
    return (
        f"position {1000 * np.sqrt((off**2).sum(axis=1).mean()):.1f} mm, shape "
        f"{1000 * np.sqrt((shape**2).sum(axis=1).mean()):.1f} mm, roll, pitch, heading "
        f"{np.round(np.sqrt((turned**2).mean(axis=0)), 4).tolist()} deg"
    )


def main(session: Path) -> None:
    """Adjust and print."""
    opened = open_session(session)
    located = locate(opened.positions(), opened.session, opened.frame, companions(opened))
    truth = session.parent / "truth" / "trajectory.csv"
    print("without images:", errors(located.trajectory, truth))
    begin, used = perf_counter(), resource.getrusage(resource.RUSAGE_SELF).ru_utime
    scale = ground_scale(opened.frame, located.trajectory)
    aided = aid_session(opened, located, scale, silent)
    used = resource.getrusage(resource.RUSAGE_SELF).ru_utime - used
    for notice in aided.notices:
        print(notice.text)
    aid = aided.aid
    if aid is None:
        return
    print("with images:   ", errors(aided.located.trajectory, truth))
    print(f"{aid.images} images in {perf_counter() - begin:.0f} s, {used:.0f} s of the processor")
    print(aid.calibration())


if __name__ == "__main__":
    main(Path(sys.argv[1]))
