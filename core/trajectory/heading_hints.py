"""What shows the heading beside accelerations: the course of a vehicle on wheels, or a heading that was recorded.

Both are linear in the attitude at the begin of a chunk and in the biases, as the second differences of alignment are.
"""

from dataclasses import dataclass
from typing import Final, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from furrowmap.core.adjustment.knots import KNOT_STEP_S
from furrowmap.core.adjustment.preintegration import Increments
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.values.gnss import CREEP_M_RTS, DRIFT_CORRELATION_S

LENGTHS_S: Final = (2.0, 3.0, 5.0, 8.0, 12.0, 20.0)
"""Times over which a course is taken; the shortest over which the way exceeds the noise of positions."""
ABOVE_NOISE: Final = 5.0
COURSE_SIDEWAYS_SHARE: Final = 0.05
"""Sideways way as a share of the way: slip, and the yaw of an IMU mounted by hand."""
OF_TURN: Final = 0.3
"""Error of a way's direction as a share of the turn within it: speed changes in turns."""
DIRECTED: Final = 0.3
"""The way forward less that in reverse, as a share of both: with less it is not certain where the nose is."""
HEADING_CHANGE_CORRELATION_S: Final = 10.0
"""Time over which what changes of a recorded heading's error, as large as what stays, is the same."""
DECISIVE: Final = 25.0
"""A difference of weighted squares that decides between two opposite headings."""


@dataclass(frozen=True)
class ChunkMotion:
    """Motion by the IMU in the axes of the vehicle at the begin of a chunk.

    Attributes:
        turned: (m, 3, 3) rotation of each knot's axes to the first one's.
        swept_s: (m, 3, 3) integral of it over time: the turn by a constant rate, per rad/s.
        way_m: (m, 3) of the antenna, but for gravity and the velocity at the begin.
    """

    begin: int
    turned: FloatArray
    swept_s: FloatArray
    way_m: FloatArray

    @classmethod
    def integrate(cls, steps: Increments, whole: FloatArray, begin: int, end: int, arm_m: FloatArray) -> "ChunkMotion":
        """Of the knots from `begin` to before `end`."""
        turned = whole[begin].T @ whole[begin:end]
        swept = np.cumsum(turned, axis=0) * KNOT_STEP_S
        inner = slice(begin, end - 1)
        pushed = np.einsum("kij,kj->ki", turned[:-1], steps.velocity_mps[inner])
        velocity = np.cumsum(pushed, axis=0) - pushed
        way = np.cumsum(velocity * KNOT_STEP_S + np.einsum("kij,kj->ki", turned[:-1], steps.way_m[inner]), axis=0)
        return cls(begin, turned, swept, np.concatenate([np.zeros((1, 3)), way]) + turned @ arm_m)


@dataclass(frozen=True)
class HintRows:
    """Observations of a chunk's rotation vector in the map's axes and biases (k, 9), and inverse variances (k,)."""

    design: FloatArray
    residual: FloatArray
    weight: FloatArray


class HeadingHint(Protocol):
    """What shows the heading of a chunk."""

    def starts(self, rotation: FloatArray, motion: ChunkMotion) -> list[FloatArray]:
        """Attitudes (3, 3) at the begin of a chunk to start from, the likelier first; empty where nothing shows it.

        Args:
            rotation: (3, 3) an attitude whose roll and pitch are about right.
        """
        ...

    def rows(self, rotation: FloatArray, bias: FloatArray, motion: ChunkMotion) -> HintRows:
        """Observations at an attitude (3, 3) at the begin of a chunk and biases (6,)."""
        ...


@dataclass(frozen=True)
class Course(HeadingHint):
    """The vehicle's origin moves along its nose, forward or in reverse.

    Attributes:
        way_m: (n, 3) of the antenna over `knots` steps from each knot on, in the map's axes; nan where unknown.
        knots: steps that a way lasts.
        sigma_m: of a way, by the noise of the positions.
    """

    way_m: FloatArray
    knots: int
    sigma_m: float
    lever_m: FloatArray

    @classmethod
    def from_antenna(cls, antenna_m: FloatArray, white_m: float, drift_m: float, lever_m: FloatArray) -> "Course":
        """The course of an antenna (n, 3) at consecutive knots.

        Args:
            antenna_m: metres on the ground; nan where unknown.
            white_m: noise of positions from one to the next.
            drift_m: standard deviation of their slowly varying error.
        """
        for length_s in LENGTHS_S:
            knots = round(length_s / KNOT_STEP_S)
            drifted = 2.0 * (1.0 - np.exp(-length_s / DRIFT_CORRELATION_S))
            sigma = float(np.sqrt(2.0 * white_m**2 + max(drifted * drift_m**2, CREEP_M_RTS**2 * length_s)))
            way = np.full_like(antenna_m, np.nan)
            way[:-knots] = antenna_m[knots:] - antenna_m[:-knots]
            size = np.hypot(way[:, 0], way[:, 1])
            if np.isfinite(size).any() and np.nanpercentile(size, 75) > ABOVE_NOISE * sigma:
                break
        way[:, 2] = 0.0 * way[:, 2]  # roll and pitch are small, heights are noisier than positions
        return cls(way, knots, sigma, lever_m)

    def _ways(self, motion: ChunkMotion) -> tuple[NDArray[np.int64], FloatArray, FloatArray, FloatArray]:
        """Ways within a chunk: first knots (k,), ways (k, 3), mean axes of the vehicle (k, 3, 3), turns (k,)."""
        first = np.arange(0, max(0, len(motion.turned) - self.knots), self.knots, dtype=np.int64)
        way = self.way_m[motion.begin + first]
        known = np.isfinite(way).all(axis=1)
        first = first[known]
        way = way[known]
        axes = np.array([motion.turned[k : k + self.knots].mean(axis=0) for k in first]).reshape(-1, 3, 3)
        turned = np.einsum("kji,kjl->kil", motion.turned[first], motion.turned[first + self.knots])
        turn = np.arccos(np.clip(0.5 * (np.trace(turned, axis1=1, axis2=2) - 1.0), -1.0, 1.0))
        return first, way, axes, turn

    def _sigma_m(self, way: FloatArray, turn: FloatArray) -> FloatArray:
        out: FloatArray = np.hypot(
            self.sigma_m, np.hypot(COURSE_SIDEWAYS_SHARE, OF_TURN * turn) * np.linalg.norm(way, axis=1)
        )
        return out

    def starts(self, rotation: FloatArray, motion: ChunkMotion) -> list[FloatArray]:
        """The two opposite attitudes whose noses lie along the ways; first that of the longer way forward."""
        _, way, axes, turn = self._ways(motion)
        nose = axes[:, :, 0] @ rotation.T
        seen = way[:, 0] + 1j * way[:, 1]
        own = nose[:, 0] + 1j * nose[:, 1]
        weight = self._sigma_m(way, turn) ** -2
        doubled = complex((weight * (seen * np.conj(own)) ** 2).sum())
        along = (np.exp(-0.5j * np.angle(doubled)) * seen * np.conj(own)).real
        if not np.abs(along).sum() or abs(along.sum()) < DIRECTED * np.abs(along).sum():
            return []
        yaw = 0.5 * np.angle(doubled) + (np.pi if along.sum() < 0 else 0.0)
        return [Rotation.from_euler("z", yaw + turned).as_matrix() @ rotation for turned in (0.0, np.pi)]

    def rows(self, rotation: FloatArray, bias: FloatArray, motion: ChunkMotion) -> HintRows:
        """No way of the vehicle's origin to the left."""
        first, way, axes, turn = self._ways(motion)
        swept = motion.swept_s[np.minimum(first + self.knots // 2, len(motion.swept_s) - 1)]
        left = axes[:, :, 1] - np.cross(swept @ bias[:3], axes[:, :, 1])
        arm = (motion.turned[first + self.knots] - motion.turned[first]) @ self.lever_m
        own = way @ rotation  # in the axes at the begin
        # The way of the arm turns with the axes, so its part to the left has no derivatives.
        of_arm = (axes[:, :, 1] * arm).sum(axis=1)
        design = np.zeros((len(first), 9))
        design[:, :3] = np.cross(left, own) @ rotation.T
        design[:, 3:6] = np.einsum("ki,kij->kj", -np.cross(axes[:, :, 1], own), swept)
        return HintRows(design, of_arm - (left * own).sum(axis=1), self._sigma_m(way, turn) ** -2)


@dataclass(frozen=True)
class RecordedHeading(HeadingHint):
    """Yaw of the vehicle at the knots, by another device or by the IMU's own filter.

    Attributes:
        yaw_rad: (n,) of the vehicle's x axis, counterclockwise from the map's x axis; nan where unknown.
        sigma_rad: standard deviation, of an error that stays the same.
    """

    yaw_rad: FloatArray
    sigma_rad: float

    def _off(self, rotation: FloatArray, motion: ChunkMotion, bias: FloatArray) -> tuple[NDArray[np.intp], FloatArray]:
        """Knots in the chunk with a heading (k,), and what is missing to it there (k,)."""
        at = np.flatnonzero(np.isfinite(self.yaw_rad[motion.begin : motion.begin + len(motion.turned)]))
        nose = motion.turned[at, :, 0] - np.cross(motion.swept_s[at] @ bias[:3], motion.turned[at, :, 0])
        nose = nose @ rotation.T
        off = self.yaw_rad[motion.begin + at] - np.arctan2(nose[:, 1], nose[:, 0])
        return at, np.asarray((off + np.pi) % (2.0 * np.pi) - np.pi)

    def starts(self, rotation: FloatArray, motion: ChunkMotion) -> list[FloatArray]:
        """The attitude turned to the mean heading."""
        _, off = self._off(rotation, motion, np.zeros(6))
        if not len(off):
            return []
        return [Rotation.from_euler("z", np.angle(np.exp(1j * off).mean())).as_matrix() @ rotation]

    def rows(self, rotation: FloatArray, bias: FloatArray, motion: ChunkMotion) -> HintRows:
        """The mean heading, whose error stays, and how headings change, which shows the bias of the gyroscopes."""
        at, off = self._off(rotation, motion, bias)
        if not len(at):
            return HintRows(np.zeros((0, 9)), off, off)
        design = np.zeros((len(at), 9))
        design[:, 2] = 1.0
        design[:, 3:6] = -(rotation @ motion.swept_s[at])[:, 2]
        mean = design.mean(axis=0)
        weight = np.full(len(at) + 1, KNOT_STEP_S / HEADING_CHANGE_CORRELATION_S)
        weight[0] = 1.0
        changes = np.concatenate([mean[None], design - mean])
        return HintRows(changes, np.concatenate([[off.mean()], off - off.mean()]), weight / self.sigma_rad**2)
