"""LaserScan messages to scans: one sweep of a line scanner is one scan."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from furrowmap.core.readers.line_points import MAX_RANGE_M, mostly_invalid, sweep
from furrowmap.core.readers.rosbag.messages import stamp_s
from furrowmap.core.readers.rosbag.storage import BagMessage, Damage
from furrowmap.core.runtime.errors import Notice
from furrowmap.core.values.scan import Clock, Scan

MAX_SWEEP_S: Final = 10.0
"""No sweep takes longer: its time increment is damaged."""


class LineScans:
    """Decodes the LaserScan messages of one topic into scans, one scan per message.

    Angles are about the z axis of the scanner's frame, counter-clockwise from its x axis (REP-103). Ranges outside the
    limits in the message are no returns, by definition of the message.

    Args:
        source: file and topic, for messages.
    """

    clock: Final = Clock.RECORDER

    def __init__(self, source: str) -> None:
        self._source = source
        self._scans = self._firings = self._points = self._untimed = self._late = self._far = 0
        self._span_deg = self._step_deg = 0.0
        self._last_s = -np.inf

    def push(self, content: Any, message: BagMessage) -> list[Scan]:
        """The scan in a message; none if it has no return, or is not later than the one before.

        Raises:
            Damage: if its angles or times are impossible.
        """
        ranges = np.asarray(content.ranges, np.float64)
        n = len(ranges)
        first, step = float(content.angle_min), float(content.angle_increment)
        each_s = float(content.time_increment)
        if not np.isfinite((first, step, each_s)).all() or abs(step) * n > 4.0 * np.pi or n > np.iinfo(np.uint16).max:
            raise Damage(f"{n} ranges from an angle of {first:g} rad in steps of {step:g} rad are no sweep")
        if not 0.0 <= each_s * n <= MAX_SWEEP_S:
            raise Damage(f"its time increment of {each_s:g} s is not that of a sweep")
        at_s = stamp_s(content, message)
        if at_s <= self._last_s:
            self._late += 1
            return []
        self._last_s = at_s
        self._untimed += n > 1 and each_s == 0.0
        self._span_deg, self._step_deg = np.degrees(abs(step) * n), np.degrees(abs(step))
        with np.errstate(invalid="ignore"):
            returned = (ranges >= content.range_min) & (ranges <= content.range_max) & (ranges > 0.0)
        self._firings += n
        self._far += int(np.count_nonzero(returned & (ranges > MAX_RANGE_M)))
        column = np.flatnonzero(returned & (ranges <= MAX_RANGE_M))
        self._points += len(column)
        firing = column.astype(np.float64)
        if not len(column):
            return []
        intensity = np.asarray(content.intensities, np.float64)
        self._scans += 1
        return [
            sweep(
                self._scans - 1,
                np.asarray(at_s + each_s * firing, np.float64),
                np.asarray(first + step * firing, np.float64),
                ranges[column],
                intensity[column] if len(intensity) == n else np.zeros(len(column)),
                column,
            )
        ]

    def finish(self) -> list[Scan]:
        """No scans: every message is a complete scan.

        Raises:
            InputError: if most ranges are implausible.
        """
        if self._far > self._points:
            raise mostly_invalid(self._source, self._far, self._far + self._points)
        return []

    def facts(self) -> dict[str, Any]:
        """What `inspect` reports."""
        return {
            "line_scanner": True,
            "firings": self._firings,
            "angle_span_deg": round(self._span_deg, 1),
            "angle_step_deg": round(self._step_deg, 4),
        }

    def notices(self) -> list[Notice]:
        """What the messages lack, and how many were skipped."""
        source, found = self._source, []
        if self._far:
            found.append(Notice("points-invalid.far", source=source, far=self._far, farthest_m=MAX_RANGE_M))
        if self._untimed:
            found.append(Notice("no-point-times.sweeps", source=source, untimed=self._untimed, scans=self._scans))
        if self._late:
            found.append(Notice("clouds-late.sweeps", source=source, late=self._late))
        return found
