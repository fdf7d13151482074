"""Warnings of a run about its positions: gaps, outages that were bridged, and time without a fixed solution."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.pointclouds.placed import Placement
from furrowmap.core.runtime.errors import Notice
from furrowmap.core.trajectory.located import Located
from furrowmap.core.values.clock import iso_utc
from furrowmap.core.values.gnss import Fix
from furrowmap.core.values.trajectory import ScanPoses

OUTAGE_S: Final = 2.0
"""Time without positions that is told."""
NOT_FIXED: Final = 0.05
"""Share of the time without a fixed solution that is told."""
_GOOD: Final = (Fix.FIXED, Fix.SIMULATED, -1)
"""Quality of fixed solutions; poses from a file have none."""


def position_notices(placement: Placement, located: Located) -> list[Notice]:
    """What stands out in the positions: gaps in which scans have no pose, outages, and float or worse solutions.

    Args:
        placement: the scans and their poses.
        located: the trajectory.
    """
    return [*_gaps(placement, located), *quality_notices(placement.poses)]


def quality_notices(poses: ScanPoses) -> list[Notice]:
    """Outages that poses bridge, and the time without a fixed solution where there are fixed ones as well.

    Args:
        poses: in the order of time.
    """
    return [*_outages(poses), *_not_fixed(poses)]


def fix_shares(poses: ScanPoses) -> dict[str, float]:
    """Share of the poses by the quality of the position behind each, the most frequent first.

    Poses without a position near are "none", those from a file "file".
    """
    codes, counts = np.unique(poses.fix, return_counts=True)
    order = np.argsort(-counts, kind="stable")
    names = [Fix(code).label if code >= 0 else "file" for code in codes.tolist()]
    return {names[i]: round(float(counts[i]) / len(poses), 4) for i in order.tolist()}


def _gaps(placement: Placement, located: Located) -> list[Notice]:
    """Gaps of the trajectory during the scans."""
    gaps = located.trajectory.gaps_s
    inside = gaps[(gaps[:, 0] < placement.last_s) & (gaps[:, 1] > placement.first_s)]
    if not len(inside):
        return []
    length = inside[:, 1] - inside[:, 0]
    longest = int(np.argmax(length))
    return [
        Notice(
            "gaps",
            length=length.sum(),
            inside=len(inside),
            length_2=length[longest],
            inside_2=iso_utc(float(inside[longest, 0])),
        )
    ]


def _outages(poses: ScanPoses) -> list[Notice]:
    """Times with poses, but without positions."""
    without = poses.fix == Fix.NONE
    edges = np.flatnonzero(np.diff(without, prepend=False, append=False)).reshape(-1, 2)
    begin, end = poses.t_s[np.maximum(edges[:, 0] - 1, 0)], poses.t_s[np.minimum(edges[:, 1], len(poses) - 1)]
    length = end - begin
    told = length >= OUTAGE_S
    if not told.any():
        return []
    longest = int(np.argmax(length))
    return [
        Notice(
            "gnss-outage",
            length=length[told].sum(),
            told=int(told.sum()),
            length_2=length[longest],
            begin=iso_utc(float(begin[longest])),
        )
    ]


def _not_fixed(poses: ScanPoses) -> list[Notice]:
    """Time with positions that are no fixed solutions, where others are."""
    fixed = np.isin(poses.fix, _GOOD)
    others = ~fixed & (poses.fix != Fix.NONE)
    if not fixed.any() or others.mean() < NOT_FIXED:
        return []
    seconds = _duration_s(poses.t_s)
    kinds = [Fix(code) for code in np.unique(poses.fix[others]).tolist()]
    words = ", ".join(f"{kind.label} {seconds[poses.fix == kind].sum():.1f} s" for kind in kinds)
    first = iso_utc(float(poses.t_s[np.argmax(others)]))
    return [Notice("gnss-not-fixed", others=others.mean(), words=words, first=first)]


def _duration_s(t_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """Time (n,) that each of the times stands for; a pause counts as a usual step."""
    if len(t_s) < 2:
        return np.zeros(len(t_s))
    step = np.diff(t_s)
    usual = float(np.median(step))
    return np.append(np.where(step > 3.0 * usual, usual, step), usual)
