"""What is counted over the packets of a laser scanner, of any maker."""

import math
from dataclasses import dataclass, field, replace

import numpy as np

from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import Notice
from furrowmap.core.values.clock import iso_utc
from furrowmap.core.values.scan import Scan


@dataclass
class ScannerCounts:
    """Counts over the packets of a decoder; times in seconds.

    Attributes:
        whole, cut: scans that are whole turns, and others.
        lost: packets missing in gaps, which are shorter than pauses; `lost_s` is their total duration.
        paused_s: total duration of the pauses.
        foreign: packets skipped because they are no data packets of the model.
        repeated: packets skipped because they repeat the one before.
        late: packets with a stamp earlier than the one before.
        revolutions: turned without gaps, in `turning_s`.
        host_first_s, host_last_s: recorder's time minus the stamps' time, medians of the first and the last batch.
        host_least_s, host_most_s: its limits over all packets.
        jumps: when and by how much the scanner's clock was set.
    """

    packets: int = 0
    points: int = 0
    whole: int = 0
    cut: int = 0
    first_s: float = math.nan
    last_s: float = math.nan
    lost: int = 0
    gaps: int = 0
    lost_s: float = 0.0
    pauses_s: list[float] = field(default_factory=list)
    paused_s: float = 0.0
    foreign: int = 0
    repeated: int = 0
    late: int = 0
    revolutions: float = 0.0
    turning_s: float = 0.0
    host_first_s: float = math.nan
    host_last_s: float = math.nan
    host_least_s: float = math.inf
    host_most_s: float = -math.inf
    jumps: list[tuple[float, float]] = field(default_factory=list)

    @property
    def rpm(self) -> float:
        """Revolutions per minute; nan without rotation."""
        return 60.0 * self.revolutions / self.turning_s if self.turning_s > 0.0 else math.nan

    @property
    def host_words(self) -> str:
        """How the recorder's times differ from the stamps."""
        return f"packet times; {self.host_least_s:+.4f} to {self.host_most_s:+.4f} s relative to the "

    def note_times(self, t_s: FloatArray, host_s: FloatArray) -> None:
        """Count packets by their UTC (m,) and the recorder's times (m,)."""
        if not self.packets:
            self.first_s = float(t_s[0])
        self.packets += len(t_s)
        self.last_s = float(t_s[-1])
        ahead_s = host_s - t_s
        self.host_last_s = float(np.median(ahead_s))
        if math.isnan(self.host_first_s):
            self.host_first_s = self.host_last_s
        self.host_least_s = min(self.host_least_s, float(ahead_s.min()))
        self.host_most_s = max(self.host_most_s, float(ahead_s.max()))

    def numbered(self, scan: Scan, *, whole: bool) -> Scan:
        """The next scan with its number; it is counted."""
        scan = replace(scan, number=self.whole + self.cut, whole=whole)
        self.points += len(scan)
        self.whole += whole
        self.cut += not whole
        return scan

    def flow_notices(self) -> list[Notice]:
        """What is missing, double or out of order."""
        notices = []
        if self.gaps:
            share = 100 * self.lost / (self.lost + self.packets)
            notices.append(
                Notice("lost-packets", lost=self.lost, gaps=self.gaps, lost_s=self.lost_s, lost_percent=share)
            )
        if self.pauses_s:
            ends = dict.fromkeys(f"{end_s:,.3f}" for end_s in (min(self.pauses_s), max(self.pauses_s)))
            count = len(self.pauses_s)
            words = " to ".join(ends)
            notices.append(Notice("pauses", pauses=count, shortest_pause_s=words, paused_s=self.paused_s))
        if self.foreign:
            notices.append(Notice("packets-damaged", foreign=self.foreign))
        if self.repeated:
            notices.append(Notice("repeated-packets", repeated=self.repeated))
        if self.late:
            notices.append(Notice("late-packets", late=self.late))
        return notices

    def clock_notices(self) -> list[Notice]:
        """Whether the scanner's clock was set."""
        if not self.jumps:
            return []
        at_s, size_s = self.jumps[0]
        return [Notice("clock-jumps", jumps=len(self.jumps), size_s=size_s, first_at=iso_utc(at_s))]
