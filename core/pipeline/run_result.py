"""What a run, a preview or a run without scans results in."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Final
from zoneinfo import ZoneInfo

import numpy as np

from furrowmap.core.coverage.field_work import FieldWork
from furrowmap.core.geodesy.local_time import zone_at
from furrowmap.core.geodesy.projection import MapFrame
from furrowmap.core.pointclouds.placed_scans import Placement
from furrowmap.core.runtime.errors import Notice
from furrowmap.core.strips.boresight import Boresight
from furrowmap.core.strips.strip_adjustment import StripAdjustment
from furrowmap.core.strips.strip_differences import StripDifferences
from furrowmap.core.trajectory.located import Located
from furrowmap.core.trajectory.straight_passes import Strip
from furrowmap.core.values.scan import ClockReading
from furrowmap.core.values.session import Session
from furrowmap.core.values.trajectory import Trajectory

if TYPE_CHECKING:
    from furrowmap.core.images.image_aiding import ImageAid
    from furrowmap.core.matching.matched import Matched
    from furrowmap.core.matching.relative_mounting import RelativeMounting
    from furrowmap.core.pipeline.control.control_points import ControlResult

MIN_LEVER_TURN_DEG: Final = 45.0
"""A vehicle that turns by less takes a wrong lever arm with it: all it does is to shift the map."""


@dataclass(frozen=True)
class RunResult:
    """The result of a run, besides the points that went to its sink.

    Attributes:
        placement: counts of scans and points, and the scans' poses.
        work: states of the implement and the ground worked.
        clocks: readings of the clocks in the scanner's recording, the clock in use first.
        notices: warnings, in the order of the work.
        matched: the result of scan matching; None where the scans were not matched.
        boresight: of a scanner on a vehicle with an IMU; None where the scans do not show it.
        strips: of a flight, in the order of time.
        strip_differences: between them; None where no ground was seen by two.
        strip_adjustment: of the poses by the strips; None where these were not adjusted.
        image_aid: of the poses by images; None where these took no part.
        control: what control points showed; None without any.
        further_scanners: mounting of each scanner but the first, by the name of the scanner.
        live: by how much a live session of the recording differed; None without one.
    """

    session: Session
    inputs: tuple[Path, ...]
    frame: MapFrame
    located: Located
    placement: Placement
    work: FieldWork
    clocks: tuple[ClockReading, ...]
    notices: tuple[Notice, ...]
    timings_s: dict[str, float]
    matched: Matched | None = None
    boresight: Boresight | None = None
    strips: tuple[Strip, ...] = ()
    strip_differences: StripDifferences | None = None
    strip_adjustment: StripAdjustment | None = None
    image_aid: ImageAid | None = None
    control: ControlResult | None = None
    further_scanners: Mapping[str, RelativeMounting] = field(default_factory=dict)

    @cached_property
    def unconfirmed(self) -> tuple[str, ...]:
        """See :func:`unconfirmed_places`."""
        return unconfirmed_places(self.session, self.located, self.matched, self.boresight)

    @cached_property
    def zone(self) -> ZoneInfo:
        """Time zone of the times that people read: the session's, else that of the place."""
        if self.session.field.time_zone is not None:
            return ZoneInfo(self.session.field.time_zone)
        east, north = np.median(self.placement.poses.xyz_m[:, :2], axis=0)
        lon_deg, lat_deg = self.frame.to_lon_lat(np.array([east]), np.array([north]))
        return zone_at(float(lon_deg[0]), float(lat_deg[0]))


def unconfirmed_places(
    session: Session, located: Located, matched: Matched | None, boresight: Boresight | None
) -> tuple[str, ...]:
    """Keys of stated places that the recording does not show: standard deviations hold if these are right.

    Args:
        matched: the result of scan matching; None without.
        boresight: of a scanner on a vehicle with an IMU; None where the scans do not show it.
    """
    if not session.recording.lidar:
        return ()
    angles = boresight is not None and boresight.certain
    height = False
    lever = located.source == "file"
    if matched is not None:
        angles = matched.facing_shown
        height = bool(np.isfinite(matched.calibration.sigma_height_m))
        lever = all(notice.code != "lever-assumed" for notice in located.notices) and _turns(located.trajectory)
    shown = {"antenna.xyz_m": lever, "lidar.xyz_m": height, "lidar.rpy_deg": angles}
    return tuple(key for key, known in shown.items() if not known and key not in session.unstated)


def _turns(trajectory: Trajectory) -> bool:
    """Whether headings differ from their mean by MIN_LEVER_TURN_DEG."""
    heading = np.radians(trajectory.attitude_deg()[2])
    mean = np.angle(np.mean(np.exp(1j * heading)))
    return bool(np.degrees(np.abs(np.angle(np.exp(1j * (heading - mean))))).max(initial=0.0) > MIN_LEVER_TURN_DEG)
