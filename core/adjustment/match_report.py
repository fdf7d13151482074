"""Figures and notices of scan matching for the report."""

from collections.abc import Sequence
from typing import Any, Final

import numpy as np

from furrowmap.core.adjustment.mounting_calibration import MountingCalibration
from furrowmap.core.adjustment.problem import Adjusted
from furrowmap.core.adjustment.yaw_ambiguity import Facing
from furrowmap.core.estimation.aiding import AIDED, GYRO_SCALE, MISALIGNMENT
from furrowmap.core.estimation.inertial import RATE_BIAS
from furrowmap.core.estimation.knots import StateBlock
from furrowmap.core.matching.returns import PIXEL_M
from furrowmap.core.runtime.errors import Notice
from furrowmap.core.values.clock import iso_utc
from furrowmap.core.values.gnss import Positions
from furrowmap.core.values.margins import margin
from furrowmap.core.values.rotation import Mounting
from furrowmap.core.values.time_span import Span

HEIGHT_REPORTED_M: Final = 0.05
FACING_ASSUMED: Final = Notice("facing-assumed")
LEVER_ASSUMED: Final = Notice("lever-assumed")


def match_notices(adjusted: Adjusted, used: Mounting, unheld: Sequence[Span] = ()) -> tuple[Notice, ...]:
    """Scans left out, unbridged gaps, a mounting that is off, and what is assumed.

    Args:
        adjusted: the result.
        used: the mounting in use.
        unheld: times whose scans no positions hold.
    """
    assumed = adjusted.problem.lever_m.any() and not adjusted.facing.shown and not adjusted.sway.known
    stated = adjusted.problem.mounting
    mounting = mounting_notices(adjusted.calibration, adjusted.facing, stated, used)
    gaps = [
        Notice("gap-not-bridged", begin_s=iso_utc(gap.begin_s), end_s=gap.end_s - gap.begin_s)
        for gap in adjusted.unbridged
    ]
    found = adjusted.slow_errors
    unchecked = not (found.checked or adjusted.sway.off) and found.times == (1.0, 1.0)
    slow = [slow_errors_unchecked(adjusted.problem.positions)] if unchecked else []
    return (*unheld_notices(unheld), *gaps, *mounting, *([LEVER_ASSUMED] if assumed else []), *slow)


def slow_errors_unchecked(positions: Positions) -> Notice:
    """The notice that nothing shows slow errors of the positions, and which are assumed."""
    return Notice("slow-errors-assumed", margin=margin(float(np.median(positions.drift_m[:, 0])), " m"))


def unheld_notices(unheld: Sequence[Span]) -> list[Notice]:
    """Scans that no positions hold, at times in order; none where there are no such."""
    if not unheld:
        return []
    total_s = sum(end_s - begin_s for begin_s, end_s in unheld)
    return [Notice("scans-not-held", total_s=total_s, unheld=iso_utc(unheld[0][0]))]


def mounting_notices(found: MountingCalibration, facing: Facing, stated: Mounting, used: Mounting) -> list[Notice]:
    """A mounting that is off, as the scans show it; `used` is the one in use."""
    notices = []
    was, now = (", ".join(f"{angle:.2f}" for angle in m.rpy_deg) for m in (stated, used))
    if facing.offset_deg:
        notices.append(Notice("mounting-off", was=was, now=now))
    elif used is not stated:
        notices.append(Notice("mounting-off.mounting-notices", was=was, now=now))
    if not facing.shown:
        notices.append(FACING_ASSUMED)
    if height_is_off(found):
        notices.append(Notice("mounting-height", height_m=found.height_m))
    return notices


def height_is_off(found: MountingCalibration) -> bool:
    """Whether the vehicle's origin certainly is not on the ground under its wheels."""
    return abs(found.height_m) > HEIGHT_REPORTED_M + 3.0 * found.sigma_height_m


def match_figures(adjusted: Adjusted, used: Mounting) -> dict[str, Any]:
    """The figures of matching in the report, with the mounting in use."""
    returns, walls, ranges = adjusted.problem.returns, adjusted.walls.scatter, adjusted.sensor.ranges
    constants = adjusted.constants
    matched, squares = adjusted.ground.tally[4:]
    return {
        "residual_rms_m": round(float(np.sqrt(squares / max(matched, 1.0))), 4),
        "returns": len(returns),
        "returns_matched": int(matched),
        "walls": {
            "returns": len(returns.upright),
            "returns_matched": int(walls.matched),
            "residual_rms_m": round(float(np.sqrt(walls.squares / walls.matched)), 4) if walls.matched else None,
            "correlated": round(walls.correlated, 1) if walls.matched else None,
        },
        "relief_slope_rms": round(float(np.sqrt(adjusted.relief.variance)), 4),
        "body_footprint_m2": round(float(returns.body.sum()) * PIXEL_M**2, 2),
        "facing_shown": adjusted.facing.shown,
        "mounting_rpy_deg": [round(angle, 3) for angle in used.rpy_deg],
        # By how much each laser's ranges are too long, by its number from the lowest.
        "laser_ranges_m": None
        if ranges is None
        else {
            str(k): [round(float(ranges.offset_m[k]), 5), round(float(ranges.sigma_m[k]), 5)]
            for k in np.flatnonzero(np.isfinite(ranges.sigma_m)).tolist()
        },
        "stance": _stance_figures(adjusted.calibration),
        "positions_doubted": int((adjusted.antenna.weight < 1.0).sum()),
        # What is to be added to the lever arm, forward and to the left.
        "lever_arm_m": {
            axis: [round(value, 4), round(sigma, 4)]
            for axis, value, sigma in zip("xy", constants.lever_m, constants.lever_sigma_m, strict=True)
        }
        if np.isfinite(constants.lever_sigma_m).all()
        else None,
        "imu": _imu_figures(adjusted),
    }


def _imu_figures(adjusted: Adjusted) -> dict[str, Any] | None:
    """Of the IMU, each with its standard deviation against fixed ground; null without one."""
    state = adjusted.state
    if state.layout != AIDED:
        return None
    sigma = adjusted.last.held.solve().sigma().reshape(len(state.xyz_m), -1).min(axis=0)

    def of(block: StateBlock, factor: float) -> list[list[float]]:
        first = state.layout.column(block)
        spread = factor * sigma[first : first + block.size]
        pairs: list[list[float]] = np.column_stack([factor * state[block].mean(axis=0), spread]).round(5).tolist()
        return pairs

    return {
        "rate_bias_dps": of(RATE_BIAS, np.degrees(1.0)),
        "misalignment_deg": of(MISALIGNMENT, np.degrees(1.0)),
        "gyro_scale": of(GYRO_SCALE, 1.0)[0],
    }


def _stance_figures(found: MountingCalibration) -> dict[str, Any] | None:
    """How the vehicle stands on its ground; null where the scans do not show it."""
    if not np.isfinite(found.sigma_deg[0]):
        return None
    roll, pitch, yaw = found.sigma_deg
    return {
        "roll_deg": [round(found.roll_deg, 3), round(roll, 3)],
        "pitch_deg": [round(found.pitch_deg, 3), round(pitch, 3)],
        "yaw_deg": [round(found.yaw_deg, 3), round(yaw, 3) if np.isfinite(yaw) else None],
        "height_m": [round(found.height_m, 3), round(found.sigma_height_m, 3)],
    }
