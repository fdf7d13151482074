"""The further scanners of a session: calibrated against the first one, and their scans beside its own."""

from __future__ import annotations

import heapq
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import msgspec
import numpy as np
from numpy.typing import NDArray

from furrowmap.core.coverage.field_work import ImplementTracker
from furrowmap.core.implement.machine_voxels import MachineVoxels, classifier
from furrowmap.core.runtime.background import SCANS_AHEAD, ahead
from furrowmap.core.runtime.errors import Notice
from furrowmap.core.runtime.progress import Progress
from furrowmap.core.session.opened import LidarRecording, OpenSession, watched
from furrowmap.core.values.rotation import Mounting
from furrowmap.core.values.scan import Scan
from furrowmap.core.values.trajectory import Trajectory

if TYPE_CHECKING:
    from furrowmap.core.matching.matched import Matched
    from furrowmap.core.matching.relative_mounting import RelativeMounting


@dataclass(frozen=True)
class FurtherRecording:
    """The recording of a further scanner with the clock that is used, and the machine as it sees it.

    Attributes:
        implement: follows the implement if no scanner before this one shows it; else None.
    """

    lidar: LidarRecording
    found: RelativeMounting
    machine: MachineVoxels | None
    implement: ImplementTracker | None

    def scans(self, number: int) -> Iterator[Scan]:
        """Its scans, as those of that number in the session, without the errors of its lasers."""
        scans = self.lidar.scans()
        if self.found.ranges is not None:
            scans = map(self.found.ranges.corrected, scans)
        if self.implement is not None:
            scans = self.implement.following(scans)
        return ahead((replace(scan, scanner=number) for scan in scans), SCANS_AHEAD)


def further_recordings(
    opened: OpenSession,
    first: LidarRecording,
    mounting: Mounting,
    matched: Matched | None,
    trajectory: Trajectory,
    implement: ImplementTracker,
    progress: Progress,
) -> list[FurtherRecording]:
    """The further scanners, calibrated by the ground and the walls that the first one sees; none for a session of one.

    Args:
        first: the first scanner's recording, with the clock that is used.
        mounting: of the first scanner, which is used.
        matched: the result of scan matching; None without.
        implement: has looked for it in the first scanner's scans.
    """
    session = opened.session
    shown = implement.shown
    if not session.further_lidars:
        return []
    from furrowmap.core.matching.relative_mounting import FirstScanner, relative_mounting

    scans = watched(ahead(first.scans(), SCANS_AHEAD), first, progress, "reading scans")
    corrected = map(matched.ranges.corrected, scans) if matched is not None and matched.ranges is not None else scans
    reference = FirstScanner.of_scans(corrected, mounting, trajectory, session)
    out = []
    for number, lidar in enumerate(session.further_lidars, start=1):
        recording = opened.lidar(float(np.mean(trajectory.span_s)), number=number)
        if lidar.minus_gnss_s is None and matched is not None:
            recording = recording.ahead_by(matched.clock_used_s)
        tracker = ImplementTracker(msgspec.structs.replace(session, lidar=lidar), flying=implement.flying)
        scans = watched(ahead(recording.scans(), SCANS_AHEAD), recording, progress, "reading scans")
        found = relative_mounting(reference, scans, lidar.mounting, tracker.add_scan)
        machine = tracker.learn(trajectory)
        machine = replace(machine, mounting=found.mounting) if machine is not None else None
        follows = tracker if tracker.shown and not shown else None
        shown = shown or tracker.shown
        out.append(FurtherRecording(recording.ahead_by(found.clock_used_s), found, machine, follows))
    return out


def together(first: Iterator[Scan], further: Sequence[FurtherRecording]) -> Iterator[Scan]:
    """The scans of all scanners in the order of their begin."""
    if not further:
        return first
    streams = [first, *(one.scans(number) for number, one in enumerate(further, start=1))]
    return heapq.merge(*streams, key=lambda scan: float(scan.t_s[0]) if len(scan) else -np.inf)


def classifiers(
    machine: MachineVoxels | None, further: Sequence[FurtherRecording]
) -> list[Callable[[Scan], NDArray[np.uint8]]]:
    """What classifies the points of each scanner: by the machine as the first one sees it, and as each itself does."""
    out = [classifier(machine)]
    for one in further:
        # The voxels are of the vehicle frame.
        as_first = replace(machine, mounting=one.found.mounting) if machine is not None else None
        out.append(classifier(one.machine, as_first))
    return out


def further_notices(opened: OpenSession, further: Sequence[FurtherRecording]) -> Iterator[Notice]:
    """Warnings about the further scanners; complete once their scans have been read."""
    for lidar, one in zip(opened.session.lidars[1:], further, strict=True):
        for notice in (*one.lidar.notices, *one.found.notices(lidar.minus_gnss_s or 0.0)):
            yield notice.about(lidar.name)
