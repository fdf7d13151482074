"""Mounting calibration: roll, pitch, yaw and height of the scanner on the vehicle, by the ground under the wheels.

A vehicle stands on the ground with its wheels, so over a session the ground under them is level in its own frame, at
height zero; and it travels along its x axis. Where the ground is tilted in that frame, or there is a crab angle, the
stated mounting is off by that much. The session does not state the wheels' places: they are where the ground's heights
follow the vehicle's roll and pitch best.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.special import ndtr, softmax, stdtrit

from furrowmap.core.adjustment.knots import KNOT_STEP_S, Knots, State
from furrowmap.core.matching.height_grid import HeightGrid, TilePassage, heights, layers
from furrowmap.core.runtime.arrays import FloatArray, three

HALF_TRACKS_M: Final = np.arange(0.3, 1.15, 0.05)
"""Half of the distance between the rear wheels, which are beside the vehicle frame's origin."""
WHEELBASES_M: Final = np.arange(1.2, 3.3, 0.1)
TYRE_M: Final = (-0.09, 0.0, 0.09)
"""The ground under a tyre is averaged over these places, forward and aside."""
STANCE_EVERY_S: Final = 0.1
MAX_STANCE_TIMES: Final = 10_000
STANCE_BATCH_S: Final = 1.0
"""The sway, of 1 to 3 Hz, averages out over such a time."""
MIN_BATCH_TIMES: Final = 4
"""In a batch."""
MIN_BATCHES: Final = 3
MIN_STANCE_MPS: Final = 0.2
FEW_BATCHES_SIGMAS: Final = 2.5
"""Standard deviations at which Student's distribution of few batches is as wide as the normal one that is used."""
MAX_STANCE_HEIGHT_M: Final = 0.15
"""A vehicle that seems to float or sink by more has its origin elsewhere: what lies under it is then not what carries
it."""
OFF_DEG: Final = 0.15 * 2.0 ** np.arange(5)
"""Of a stated mounting that is off, about each axis: standard deviations that are as likely as each other. Before the
scans it is as likely right as off."""
MIN_TURN_DEG: Final = 0.05
"""A correction that is smaller than ruts and tyres is not made, but counts in the standard deviations."""
RUTS_SIGMA: Final = np.radians(0.05)
"""Ruts and tyres leave a vehicle this much off the ground's level, on the mean of a session."""
HEIGHT_SIGMA_M: Final = 0.01


@dataclass(frozen=True)
class MountingCalibration:
    """How the vehicle stands in its own frame, as turned about its axes: zero where the mounting is right.

    Attributes:
        roll_deg: of the vehicle against the ground that carries it, right side down.
        pitch_deg: the same, nose up.
        yaw_deg: of the vehicle's x axis against the way it goes, counter-clockwise.
        height_m: of the vehicle's origin above the ground.
        sigma_deg: (3,) standard deviations of roll, pitch, yaw; inf where the scans do not show it.
        corrected_deg: (3,) by how much the stated mounting was turned about these axes before.
        yaw_off: whether the stated yaw is known to be wrong, so that another one took its place.
    """

    roll_deg: float
    pitch_deg: float
    yaw_deg: float
    height_m: float
    sigma_deg: tuple[float, float, float]
    sigma_height_m: float
    corrected_deg: tuple[float, float, float] = (0.0, 0.0, 0.0)
    yaw_off: bool = False

    @property
    def turn_deg(self) -> FloatArray:
        """(3,) angles, roll, pitch and yaw, about which the mounting is to be turned further; see :meth:`_expected`."""
        further: FloatArray = self._expected()[0] - np.array(self.corrected_deg)
        return further

    @property
    def left_deg(self) -> FloatArray:
        """(3,) standard deviations of roll, pitch and yaw of the mounting as it is now."""
        out: FloatArray = np.hypot(self._expected()[1], self.turn_deg)
        return out

    def _expected(self) -> tuple[FloatArray, FloatArray]:
        """Mean and standard deviation (3,) of the angles by which the stated mounting is off, given the scans.

        A mounting that was measured is right, one from a drawing is off by one of OFF_DEG about each axis. How likely
        each is follows from all three axes (spike and slab; Mitchell and Beauchamp 1988, JASA 83, 1023-1032). So ruts
        do not spoil a mounting that is right, and one that is off is corrected by the weighted mean, without a limit.
        """
        shown = abs(self.height_m) < MAX_STANCE_HEIGHT_M
        sigma = np.where(shown, self.sigma_deg, np.inf)
        off = np.array([self.roll_deg, self.pitch_deg, self.yaw_deg]) + self.corrected_deg
        prior = np.repeat(np.append(0.0, OFF_DEG)[:, None], 3, axis=1)
        prior[:, 2] = OFF_DEG[-1] if self.yaw_off else prior[:, 2]
        # What the scans do not show is hardly doubted: else every short session was.
        prior = np.where(np.isfinite(sigma), prior, np.minimum(prior, OFF_DEG[0]))
        by_scans = (prior / sigma) ** 2
        share = by_scans / (1.0 + by_scans)
        logs = 0.5 * (share * (off / sigma) ** 2 - np.log1p(by_scans)).sum(axis=1)
        logs[1:] -= np.log(len(OFF_DEG))
        likely = softmax(logs)
        mean = likely @ (share * off)
        square = likely @ ((share * off) ** 2 + prior**2 * (1.0 - share))
        return mean, np.sqrt(square - mean**2)


def mounting_calibration(
    knots: Knots,
    state: State,
    surface: HeightGrid,
    passage: TilePassage | None,
    guard_s: float,
    crab_rad: tuple[float, float],
) -> MountingCalibration:
    """How the vehicle stands on the ground that the scans show.

    Args:
        passage: of the implement, which separates old soil from new.
        guard_s: see :func:`~furrowmap.core.matching.height_grid.layers`.
        crab_rad: by how much it goes to the left of where it looks, and its standard deviation.
    """
    velocity = np.zeros((len(knots), 3))
    for chain in knots.chains:
        part = slice(chain.first, chain.first + chain.count)
        velocity[part] = np.gradient(state.xyz_m[part], KNOT_STEP_S, axis=0)
    along = np.einsum("ij,ij->i", velocity, state.rotation[:, :, 0])
    step = max(1, round(STANCE_EVERY_S / KNOT_STEP_S), len(knots) // MAX_STANCE_TIMES)
    chosen = np.arange(0, len(knots), step)
    chosen = chosen[np.abs(along[chosen]) > MIN_STANCE_MPS]
    t_s = knots.t_s[chosen]

    tyre = np.stack(np.meshgrid(TYRE_M, TYRE_M), axis=-1).reshape(-1, 2)
    xyz_m = state.xyz_m[chosen]
    rotation = state.rotation[chosen]

    def under(places_m: FloatArray) -> FloatArray:
        """Heights (n, m) of the ground under tyres at places (m, 2), above the vehicles' frames; nan where not seen."""
        places = (places_m[:, None] + tyre).reshape(-1, 2)
        at = xyz_m[:, None] + np.column_stack([places, np.zeros(len(places))]) @ rotation.transpose(0, 2, 1)
        flat = np.ascontiguousarray(at.reshape(-1, 3))
        layer = layers(np.repeat(t_s, len(places)), flat, passage, guard_s)
        height = heights(surface, flat, layer).reshape(at.shape[:2])
        above = ((height - at[:, :, 2]) * rotation[:, None, 2, 2]).reshape(len(at), len(places_m), -1)
        known = np.isfinite(above)
        mean = np.where(known, above, 0.0).sum(axis=2) / np.maximum(known.sum(axis=2), 1)
        return np.where(known.mean(axis=2) > 0.6, mean, np.nan)

    half = HALF_TRACKS_M[:, None] * [0.0, 1.0]
    left = under(half)
    right = under(-half)
    by_track = (left - right) / (2.0 * HALF_TRACKS_M)
    track = _steadiest(by_track)
    rear = 0.5 * (left + right)[:, track]
    ahead = np.column_stack([WHEELBASES_M, np.full(len(WHEELBASES_M), HALF_TRACKS_M[track])])
    front = 0.5 * (under(ahead) + under(ahead * [1.0, -1.0]))
    by_base = (front - rear[:, None]) / WHEELBASES_M
    roll, sigma_roll = _mean_of_batches(t_s, by_track[:, track])
    pitch, sigma_pitch = _mean_of_batches(t_s, by_base[:, _steadiest(by_base)])
    height, sigma_height = _mean_of_batches(t_s, rear)
    yaw, sigma_yaw = crab_rad
    sigmas = np.degrees(np.hypot([sigma_roll, sigma_pitch, sigma_yaw], RUTS_SIGMA))
    return MountingCalibration(
        roll_deg=float(np.degrees(-roll)),
        pitch_deg=float(np.degrees(-pitch)),
        yaw_deg=float(np.degrees(-yaw)),
        height_m=-height,
        sigma_deg=three(sigmas),
        sigma_height_m=float(np.hypot(sigma_height, HEIGHT_SIGMA_M)),
    )


def _steadiest(slopes: FloatArray) -> int:
    """Which of several slopes (n, m) changes least, where all are known; the middle one where too few are."""
    known = slopes[np.isfinite(slopes).all(axis=1)]
    if len(known) < MIN_BATCH_TIMES * MIN_BATCHES:
        return int(slopes.shape[1] // 2)
    return int(np.argmin(np.median(np.abs(known - np.median(known, axis=0)), axis=0)))


def _mean_of_batches(t_s: FloatArray, values: FloatArray) -> tuple[float, float]:
    """Median over batches of time of the values' means, where they are known, and its standard deviation."""
    known = np.isfinite(values)
    _, batch = np.unique(np.floor(t_s[known] / STANCE_BATCH_S), return_inverse=True)
    count = np.bincount(batch)
    each = (np.bincount(batch, values[known]) / np.maximum(count, 1))[count >= MIN_BATCH_TIMES]
    if len(each) < MIN_BATCHES:
        return 0.0, np.inf
    # The scatter of few batches is uncertain itself: Student's distribution widens it.
    few = stdtrit(len(each) - 1, ndtr(FEW_BATCHES_SIGMAS)) / FEW_BATCHES_SIGMAS
    return float(np.median(each)), float(few * np.std(each, ddof=1) / np.sqrt(len(each)))
