"""Whether positions, scans and wheels agree within their standard deviations, and the likely cause where not."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum
from typing import Any, Final

import numpy as np

from furrowmap.core.adjustment.knots import GNSS_DRIFT, KNOT_STEP_S
from furrowmap.core.adjustment.vehicle import SLIP, SLIP_EVERY_S, AxleSteps
from furrowmap.core.matching.antenna_sway import LEVER_CERTAIN_SIGMAS, AntennaSway
from furrowmap.core.matching.clock_offset import CAUSE_CLEAR_RATIO, MIN_OFFSET_GAIN, AntennaConstants
from furrowmap.core.matching.laser_elevations import OtherModel
from furrowmap.core.matching.problem import Adjusted
from furrowmap.core.matching.yaw_ambiguity import Facing
from furrowmap.core.runtime import arrays
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import Notice
from furrowmap.core.runtime.languages.texts import Text, figure_text
from furrowmap.core.values.margins import margin, with_margin
from furrowmap.core.values.rotation import Mounting
from furrowmap.core.values.scan import Scan, named_offset
from furrowmap.core.values.trajectory import Trajectory

SLIP_OVER_S: Final = 0.5
SLIP_FLOOR_M: Final = 0.003
"""Poses half a second apart are not known better."""
MAX_SLIP: Final = 1.4
MAX_DRIFT: Final = 3.0
"""Ratios of what is seen to what is stated from which results contradict each other."""
TILT_RANGES_M: Final = (2.0, 15.0)
"""Distances from the scanner of the returns that are looked at: beyond the vehicle, before the field's end."""
MAX_TILT_RETURNS: Final = 4_000
MIN_TILT_RETURNS: Final = 200
TRIED_PLANES: Final = 400
ON_PLANE_M: Final = 0.12
MAX_LEVEL_DEG: Final = 20.0
"""A field and the vehicle on it are never steeper together."""
WALL_TILTS_DEG: Final = (65.0, 115.0)
"""A plane of such a tilt may be a wall."""
TILT_CLEAR_RATIO: Final = 2.0
"""Returns on another plane must be so many times those on a level one below the scanner."""


@dataclass(frozen=True)
class GroundTilt:
    """How the ground lies in the vehicle frame.

    Attributes:
        tilt_deg: angle between the vehicle's z axis and the upward normal of the ground; 0 where it is as it should be.
        upside_down: whether it would be as it should be with the scanner turned over.
        facing: which way the scanner faces by what stands, where scans see too little ground to be matched.
        model: that the scanner is likely of, rather than the one that it is read as; None where that one fits.
    """

    tilt_deg: float = 0.0
    upside_down: bool = False
    facing: Facing = field(default_factory=Facing)
    model: OtherModel | None = None


LEVEL_GROUND: Final = GroundTilt()
"""As it should be."""


def ground_tilt(scans: Sequence[Scan], mounting: Mounting) -> GroundTilt:
    """How the ground lies in the vehicle frame.

    The ground is the plane with most returns (RANSAC; Fischler and Bolles 1981). It is as it should be if a plane below
    the scanner, level to MAX_LEVEL_DEG, has nearly as many. With an upright plane it may be a wall, unless turning the
    scanner over, or its pitch, makes it level.

    Args:
        scans: some at the begin of the recording.
        mounting: of the scanner, as stated.
    """
    places = np.concatenate([np.zeros((0, 3)), *(np.asarray(scan.xyz_m, np.float64) for scan in scans)])
    distance = np.linalg.norm(places, axis=1)
    places = places[(distance > TILT_RANGES_M[0]) & (distance < TILT_RANGES_M[1])]
    places = places[:: max(1, len(places) // MAX_TILT_RETURNS)]
    if len(places) < MIN_TILT_RETURNS:
        return LEVEL_GROUND
    corners = places[np.random.default_rng(0).integers(0, len(places), (TRIED_PLANES, 3))]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.maximum(np.linalg.norm(normal, axis=1), 1e-9)[:, None]
    away = np.einsum("ij,ij->i", normal, corners[:, 0])
    # The scanner, at the origin, is above the ground: the normal points to it.
    normal, away = normal * -np.sign(away)[:, None], -np.abs(away)
    on_plane = (np.abs(places @ normal.T - away) < ON_PLANE_M).sum(axis=0)

    def tilts(roll_deg: float, pitch_sign: float) -> FloatArray:
        roll, pitch, yaw = mounting.rpy_deg
        up = Mounting(mounting.xyz_m, (roll + roll_deg, pitch_sign * pitch, yaw)).rotation[2]
        return np.asarray(np.degrees(np.arccos(np.clip(normal @ up, -1.0, 1.0))), np.float64)

    tilt = tilts(0.0, 1.0)
    least = TILT_CLEAR_RATIO * np.where(tilt < MAX_LEVEL_DEG, on_plane, 0).max()
    turned = {
        (roll_deg, sign): np.where((tilts(roll_deg, sign) < MAX_LEVEL_DEG) & (tilt > MAX_LEVEL_DEG), on_plane, 0)
        for roll_deg, sign in ((180.0, 1.0), (180.0, -1.0), (0.0, -1.0))
    }
    (roll_deg, _), most = max(turned.items(), key=lambda item: int(item[1].max()))
    if most.max() > least:
        return GroundTilt(float(tilt[np.argmax(most)]), upside_down=roll_deg > 0.0)
    wall = (tilt > WALL_TILTS_DEG[0]) & (tilt < WALL_TILTS_DEG[1])
    other = np.where(wall | (tilt < MAX_LEVEL_DEG), 0, on_plane)
    return GroundTilt(float(tilt[np.argmax(other)])) if other.max() > least else LEVEL_GROUND


class Cause(StrEnum):
    """Likely cause of a contradiction."""

    CLOCK = "clock"
    LEVER_ARM = "lever-arm"
    CLOCK_OR_LEVER_ARM = "clock-or-lever-arm"
    UPSIDE_DOWN = "upside-down"
    MOUNTING = "mounting"
    MODEL = "model"
    POSITIONS = "positions"
    UNKNOWN = "unknown"


@dataclass(frozen=True)
class Seen:
    """What the adjustment shows, over what is stated.

    Attributes:
        slip: sideways movement of the rear axle over half a second, over that of the wheels' slip (RMS).
        drift: drift of the positions, over what the receiver states (RMS).
        constants: between antenna and scanner.
        ground: how it lies in the vehicle frame.
        sway: what the sway shows of the antenna.
        lever_m: lever arm with which the scans agree better; None where no other was found.
        slow_times: slow errors of the positions, over what the receiver states, as scans show them; 1 where as stated.
        slow_gain: by how much larger slow errors would make −2 log likelihood fall.
        creep_mps: rate at which heights creep; 0 where they do not.
    """

    slip: float = 0.0
    drift: float = 0.0
    constants: AntennaConstants = field(default_factory=AntennaConstants)
    ground: GroundTilt = field(default_factory=GroundTilt)
    sway: AntennaSway = field(default_factory=AntennaSway)
    lever_m: tuple[float, float, float] | None = None
    slow_times: float = 1.0
    slow_gain: float = 0.0
    creep_mps: float = 0.0

    @property
    def factor(self) -> float:
        """The largest ratio of what is seen to what is stated."""
        c = self.constants
        gain = max(c.clock_gain, c.lever_gain)
        by_constants = np.sqrt(gain / MIN_OFFSET_GAIN) if c.off else 0.0
        ratios = self.slip / MAX_SLIP, self.drift / MAX_DRIFT, self.ground.tilt_deg / MAX_LEVEL_DEG
        return float(max(*ratios, by_constants, self.sway.certainty / LEVER_CERTAIN_SIGMAS))

    def plain(self) -> dict[str, Any]:
        """For `report.json`."""
        return {
            "consistent": self.cause is None,
            "cause": self.cause,
            "factor": round(self.factor, 2),
            "slip": round(self.slip, 2),
            "drift": round(self.drift, 2),
            "slow_errors": round(self.slow_times, 1),
            "ground_tilt_deg": round(self.ground.tilt_deg, 1),
            "clock_gain": round(self.constants.clock_gain, 1),
            "lever_arm_gain": round(self.constants.lever_gain, 1),
            "lever_arm_by_sway_m": self.sway.plain(),
        }

    @property
    def cause(self) -> Cause | None:
        """The likely cause of a contradiction; None where there is none."""
        c = self.constants
        if self.ground.model is not None:
            return Cause.MODEL
        if self.ground.tilt_deg or self.ground.facing.offset_deg:
            return Cause.UPSIDE_DOWN if self.ground.upside_down else Cause.MOUNTING
        if self.factor <= 1.0 and self.slow_times == 1.0:
            return None
        if self.sway.off:
            apart = Cause.CLOCK if self.sway.clock_s else Cause.LEVER_ARM
            return Cause.CLOCK_OR_LEVER_ARM if self.sway.unrelated and not self.sway.clock_s else apart
        if self.lever_m is not None:
            return Cause.LEVER_ARM
        if self.slow_times > 1.0:
            return Cause.POSITIONS
        if c.off and self.slow_gain < CAUSE_CLEAR_RATIO * max(c.clock_gain, c.lever_gain):
            return Cause.CLOCK if c.clock_off else Cause.LEVER_ARM if c.lever_off else Cause.CLOCK_OR_LEVER_ARM
        return Cause.UNKNOWN


_LIKELY: Final = {
    Cause.CLOCK: Text("The likely cause is the offset of the clocks, [recording] lidar_minus_gnss_s."),
    Cause.LEVER_ARM: Text("The likely cause is the lever arm of the antenna, [antenna] xyz_m."),
    Cause.CLOCK_OR_LEVER_ARM: Text(
        "The likely cause is the lever arm of the antenna, [antenna] xyz_m, or the "
        "offset of the clocks, [recording] lidar_minus_gnss_s: the drive does not "
        "separate the two."
    ),
    Cause.UPSIDE_DOWN: Text("The likely cause is a scanner mounted upside down, or the roll in [lidar] rpy_deg."),
    Cause.MOUNTING: Text("The likely cause is the mounting of the scanner, [lidar] rpy_deg."),
    Cause.MODEL: Text(
        "The likely cause is the model of the scanner: [lidar] model, the product byte of its packets, or the metadata "
        "beside them."
    ),
    Cause.POSITIONS: Text(
        "The likely cause is the positions: PPP, DGNSS or float solutions, smoothed "
        "logs, or standard deviations that are too small."
    ),
    Cause.UNKNOWN: Text(
        "Lever arm ([antenna] xyz_m), mounting ([lidar] xyz_m, rpy_deg), clocks "
        "(lidar_minus_gnss_s) or the positions themselves may be wrong."
    ),
}


_SWAY_DIRECTIONS: Final = (Text("forward"), Text("left"), Text("up"))


def contradiction_notice(seen: Seen) -> Notice | None:
    """The notice of a contradiction, with its figures and likely cause; None where there is none."""
    cause = seen.cause
    c = seen.constants
    if cause is None:
        return None
    shown: list[Text] = []
    if seen.ground.model is not None:
        other = seen.ground.model
        plane = seen.ground.model.ground
        shown.append(
            Text(
                "with the elevations of a {read_as} the ground is tilted by {tilt_deg:.0f}° in the vehicle frame and "
                "{above_m:+.2f} m above its origin, with those of a {other} it is level and in place",
                read_as=other.read_as,
                tilt_deg=plane.tilt_deg,
                above_m=plane.above_m,
                other=other.name,
            )
        )
    elif seen.ground.tilt_deg:
        shown.append(
            Text("the ground is tilted by {tilt_deg:.0f}° in the vehicle frame", tilt_deg=seen.ground.tilt_deg)
        )
    if turn_deg := seen.ground.facing.offset_deg:
        shown.append(
            Text(
                "plants stay in one place with the scanner turned by {turn_deg:+.0f}° about the vertical",
                turn_deg=turn_deg,
            )
        )
    if seen.slip > MAX_SLIP:
        shown.append(Text("the rear axle slips sideways {slip:.1f} times as much as wheels do", slip=seen.slip))
    if seen.drift > MAX_DRIFT:
        shown.append(Text("positions drift {drift:.1f} times as much as the receiver states", drift=seen.drift))
    if seen.slow_times > 1.0:
        shown.append(
            Text(
                "positions err slowly together, {slow_times:.0f} times as much as the receiver states",
                slow_times=seen.slow_times,
            )
        )
    if seen.creep_mps and seen.slow_times > 1.0:
        shown.append(
            Text(
                "heights creep by {a_minute_m:+.2f} m a minute against ground that is seen again",
                a_minute_m=60.0 * seen.creep_mps,
            )
        )
    if c.off:
        x, y = c.lever_m
        shown.append(
            Text(
                "positions and scans agree better with clocks {clock_s:+.3f} s apart, or with "
                "an antenna {x:+.2f} m further forward and {y:+.2f} m further left",
                clock_s=c.clock_s,
                x=x,
                y=y,
            )
        )
    if seen.sway.off:
        shown.append(_sway_in_words(seen.sway))
    if seen.lever_m is not None:
        x, y, z = seen.lever_m
        shown.append(Text("scans agree better with the antenna at {place}", place=f"[{x:g}, {y:g}, {z:g}]"))
    return Notice("contradiction.scans-and-positions", shown=shown, likely=_LIKELY[cause])


def _sway_in_words(sway: AntennaSway) -> Text:
    if sway.clock_s:
        return Text(
            "the antenna sways as the vehicle does {clock_s:+.2f} s apart from it by the scanner's clock",
            clock_s=sway.clock_s,
        )
    off = tuple(
        Text(
            "further {where} by {far} (95 %)", where=where, far=figure_text(with_margin(value, sigma, " m", sign=True))
        )
        for value, sigma, where in zip(sway.lever_m, sway.sigma_m, _SWAY_DIRECTIONS, strict=True)
        if abs(value) > LEVER_CERTAIN_SIGMAS * sigma
    )
    return Text("the antenna sways with the vehicle's roll and pitch as one that is {off}", off=off)


def clock_notice(stated_s: float, used_s: float, sigma_s: float) -> Notice:
    """The notice of an offset of the clocks that the scans show, and which is used.

    Args:
        stated_s: offset in the session.
        used_s: beyond it.
    """
    return Notice(
        "clock-offset",
        used_s=abs(used_s),
        is_used_s=used_s > 0,
        cause=named_offset(used_s),
        stated_s=stated_s + used_s,
        margin=margin(sigma_s, " s"),
    )


def enlarge_sigmas(
    trajectory: Trajectory, seen: Seen, lever_m: FloatArray, sensor_m: FloatArray, turned_deg: float = 0.0
) -> Trajectory:
    """The trajectory with standard deviations enlarged to what is seen, where results contradict each other.

    Args:
        lever_m: (3,) of the antenna, as stated.
        sensor_m: (3,) of the scanner, as stated.
        turned_deg: by how much headings change with the lever arm that fits better.
    """
    if seen.cause is None:
        return trajectory
    sigma = trajectory.sigma * max(seen.factor, 1.0)
    c = seen.constants
    other = seen.ground.model
    if other is not None:
        # Poses fitted to it are off by as much.
        sigma[:, 2] = np.hypot(sigma[:, 2], other.ground.above_m)
        sigma[:, 3:5] = np.hypot(sigma[:, 3:5], other.ground.tilt_deg)
    turn_deg = seen.ground.tilt_deg
    turned_deg = max(turned_deg, abs(seen.ground.facing.offset_deg))
    place_m = 2.0 * float(np.linalg.norm(sensor_m)) if turn_deg else 0.0
    if seen.lever_m is not None:
        place_m = max(place_m, float(np.linalg.norm(np.subtract(seen.lever_m, lever_m))))
    if seen.sway.off and not seen.sway.clock_s:
        place_m = max(place_m, float(np.linalg.norm(seen.sway.lever_m)))
    if c.off:
        speed = float(np.sqrt(np.nanmean(trajectory.speed_mps**2)))
        place_m = max(place_m, abs(c.clock_s) * speed, float(np.hypot(*c.lever_m)))
    if seen.cause is Cause.UNKNOWN or (c.off and not c.clock_off and not seen.sway.off):
        # It may be the lever arm, as far as the sway leaves that open: poses take most of it, so that residuals show
        # little. And the nose may point aside as the axle slips.
        left_open = np.hypot(seen.sway.lever_m, seen.sway.sigma_m)
        place_m = max(place_m, float(np.linalg.norm(left_open[np.isfinite(left_open)])))
        turned_deg = max(turned_deg, float(np.degrees(SLIP * seen.slip)) if seen.slip > MAX_SLIP else 0.0)
    sigma[:, :3] = np.hypot(sigma[:, :3], place_m)
    sigma[:, 3:5] = np.hypot(sigma[:, 3:5], turn_deg)
    sigma[:, 5] = np.hypot(sigma[:, 5], turned_deg)
    return replace(trajectory, sigma=sigma)


def check_consistency(adjusted: Adjusted, ground: GroundTilt) -> Seen:
    """What an adjusted trajectory shows; `ground` says how the ground lies in the vehicle frame."""
    knots = adjusted.problem.knots
    state = adjusted.state
    positions = adjusted.problem.positions
    linked = knots.linked
    steps = [
        (s.sideways_m, s.sigma_m) for s in (AxleSteps.from_knots(linked[p], state) for p in arrays.parts(len(linked)))
    ]
    sideways_m, sigma_m = (np.concatenate(values) for values in zip(*steps, strict=True))
    many = round(SLIP_OVER_S / KNOT_STEP_S)
    whole = len(sideways_m) // many * many
    # Slip is the same within SLIP_EVERY_S, and its sigma that of one step's share of it.
    sideways = sideways_m[:whole].reshape(-1, many).sum(axis=1)
    stated = np.sqrt((sigma_m[:whole] ** 2).reshape(-1, many).sum(axis=1) * KNOT_STEP_S / SLIP_EVERY_S)
    stated = np.hypot(stated, SLIP_FLOOR_M)
    knot, _, inside = knots.at(positions.t_s)
    begin_m = positions.drift_m[np.searchsorted(positions.run, positions.run)]
    drift = state[GNSS_DRIFT][knot[inside]] / np.maximum(positions.drift_m, begin_m)[inside]
    slip = _rms(sideways / stated)
    slow = adjusted.slow_errors
    return Seen(
        slip,
        _rms(drift),
        adjusted.constants,
        ground,
        adjusted.sway,
        slow_times=max(slow.times),
        slow_gain=slow.gain,
        creep_mps=slow.trend.rate_mps if slow.trend.shown else 0.0,
    )


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2))) if values.size else 0.0
