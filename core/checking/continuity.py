"""Continuity of a receiver log: availability, gaps, fix types, age of corrections."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from furrowmap.core.readers.facts import GAP_INTERVALS
from furrowmap.core.values.gnss import Fix, GnssTrack

MAX_GAPS_LISTED: Final = 50


@dataclass(frozen=True)
class LogGap:
    """A gap between two positions, from the UTC of the last one before it."""

    begin_s: float
    length_s: float


@dataclass(frozen=True)
class Age:
    """Age of the corrections over the epochs that state one."""

    epochs: int
    median_s: float
    p95_s: float
    greatest_s: float


@dataclass(frozen=True)
class Continuity:
    """Continuity of one log.

    Attributes:
        first_s, last_s: UTC of the first and last.
        interval_s: median of the steps between them.
        availability: positions over the number expected at that interval.
        share_by_fix: of the epochs.
        first_by_fix_s: seconds from the first position to the first of each fix type; the log does not state when the
            receiver was switched on.
        gaps: number of steps longer than 1.5 intervals; below, the longest and the sum of all.
        gap_list: the longest ones, in order of time.
        age: of the corrections; None where none is stated.
    """

    epochs: int
    first_s: float
    last_s: float
    interval_s: float
    availability: float
    share_by_fix: dict[str, float]
    first_by_fix_s: dict[str, float]
    gaps: int
    longest_gap_s: float
    all_gaps_s: float
    gap_list: tuple[LogGap, ...]
    age: Age | None

    @classmethod
    def from_track(cls, track: GnssTrack) -> Continuity:
        """Of a track with at least one position."""
        steps = np.diff(track.t_s)
        interval = float(np.median(steps)) if len(steps) else 0.0
        wide = np.flatnonzero(steps > GAP_INTERVALS * interval)
        span = float(track.t_s[-1] - track.t_s[0])
        kinds = [Fix(int(code)) for code in np.unique(track.fix)]
        listed = np.sort(wide[np.argsort(-steps[wide], kind="stable")[:MAX_GAPS_LISTED]])
        age = track.age_s[np.isfinite(track.age_s) & (track.fix != Fix.SINGLE)]
        return cls(
            epochs=len(track),
            first_s=float(track.t_s[0]),
            last_s=float(track.t_s[-1]),
            interval_s=interval,
            availability=min(1.0, len(track) / (round(span / interval) + 1)) if interval > 0.0 else 1.0,
            share_by_fix={kind.label: float(np.mean(track.fix == kind)) for kind in kinds},
            first_by_fix_s={
                kind.label: float(track.t_s[int(np.argmax(track.fix == kind))] - track.t_s[0]) for kind in kinds
            },
            gaps=len(wide),
            longest_gap_s=float(steps[wide].max()) if len(wide) else 0.0,
            all_gaps_s=float(steps[wide].sum()),
            gap_list=tuple(LogGap(float(track.t_s[k]), float(steps[k])) for k in listed.tolist()),
            age=Age(len(age), *(float(v) for v in (*np.quantile(age, (0.5, 0.95)), age.max()))) if len(age) else None,
        )
