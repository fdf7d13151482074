"""Checks of an adjustment with an IMU: its mounting, its noise, and whether the residuals of positions are white.

The first guess of the attitude assumes neither an upright vehicle nor forward motion, so an IMU that is turned by 90°
or 180° against its stated mounting turns the whole vehicle: on its side, upside down, or across its course.

White noise is in all frequencies, so it is no more than the least of the spectrum. A machine that shakes faster than
its IMU is sampled folds that shaking into all frequencies below, where it is noise like any other. The band in which
the spectrum is least has the least of what the vehicle does; the median within a band ignores lines of motors.

Residuals that follow from those before carry less than the noise stated for them says: as many of them as are alike
count as one. A first-order process of correlation r from one to the next has, for anything slower, the information of
white noise that is √((1 + r) / (1 − r)) times as large (Bartlett 1946, J. Royal Statistical Society B 8, 27-41).
"""

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import InputError, Notice
from furrowmap.core.runtime.languages.texts import Text
from furrowmap.core.values.inertial import InertialNoise, InertialTrack
from furrowmap.core.values.rotation import Mounting, quaternion_to_matrix
from furrowmap.core.values.trajectory import Trajectory

MOUNTING_MOVING_MPS: Final = 0.5
MIN_MOVING_S: Final = 5.0
STEADY: Final = 0.9
"""Length of the mean course, a vector of length 1: beyond it the course hardly turns, less than 25° to both sides."""
NEAR_DEG: Final = 25.0
"""A mean attitude so near to a quarter turn is one."""
_QUARTERS: Final = Rotation.create_group("O")
"""The 24 turns by quarters about the axes."""
SPECTRUM_SAMPLES: Final = 256
"""Measurements of which a spectrum is taken."""
NOISE_BANDS: Final = (1 / 16, 1 / 8, 1 / 4, 1 / 2, 3 / 4, 1.0)
"""Borders of the bands that are compared, as shares of half the sampling rate."""
MIN_NOISE_FACTOR: Final = 1.5
"""A noise that is larger than stated by less than this factor stays as stated."""
SIGNIFICANT_SIGMAS: Final = 3.0
"""Correlations below so many of their standard deviations, 1/√n, show nothing."""
MIN_RESIDUAL_PAIRS: Final = 20


@dataclass(frozen=True)
class TurnedMounting:
    """A mounting of an IMU that is likely stated with another yaw than it has: a quarter turn or half a turn off."""

    yaw_deg: float
    right: Mounting

    def notice(self, name: str) -> Notice:
        """The warning, with the name of the measurements."""
        return Notice("imu-turned", name=name, yaw_deg=self.yaw_deg, right=_words(self.right))


def turned_mounting(trajectory: Trajectory, mounting: Mounting, name: str, *, on_wheels: bool) -> TurnedMounting | None:
    """What the attitude of the vehicle, against upright and its course, says of the mounting; None if it fits.

    A drone may fly sideways or backwards. That its nose belongs along its course shows only where the course turns
    and the nose turns with it; that a vehicle on wheels moves along its nose needs no showing.

    Raises:
        InputError: if the vehicle would be on its side or upside down.
    """
    turned = quaternion_to_matrix(trajectory.quaternion)
    step_s = np.diff(trajectory.t_s, append=trajectory.t_s[-1])
    velocity = np.gradient(trajectory.xyz_m[:, :2], trajectory.t_s, axis=0) if len(trajectory) > 2 else turned[:, :2, 0]
    speed = np.hypot(*velocity.T)
    moving = (speed > MOUNTING_MOVING_MPS) & (step_s < trajectory.max_gap_s)
    if step_s[moving].sum() < MIN_MOVING_S:
        _expect_upright(turned, mounting, name)
        return None
    along = np.zeros((int(moving.sum()), 3))
    along[:, :2] = velocity[moving] / speed[moving, None]
    course = np.stack(
        [along, np.column_stack([-along[:, 1], along[:, 0], 0 * along[:, 0]]), 0 * along + (0, 0, 1)], axis=2
    )
    relative = np.einsum("kji,kjl->kil", course, turned[moving])
    weight = step_s[moving]
    left, size, right = np.linalg.svd(np.einsum("k,kij->ij", weight, relative) / weight.sum())
    if size[1] < 0.7:  # the rotations differ too much to have a mean
        _expect_upright(turned, mounting, name)
        return None
    mean = Rotation.from_matrix(left @ np.diag([1.0, 1.0, np.linalg.det(left @ right)]) @ right)
    nearest = _QUARTERS[int(np.argmin((_QUARTERS.inv() * mean).magnitude()))]
    off_deg = float(np.degrees((nearest.inv() * mean).magnitude()))
    if off_deg > NEAR_DEG or nearest.magnitude() < 0.1:
        _expect_upright(turned, mounting, name)
        return None
    mended = Mounting.from_rotation(mounting.xyz_m, nearest.as_matrix() @ mounting.rotation)
    if nearest.as_matrix()[2, 2] < 0.5:
        raise InputError("imu-turned.likely-forward", name=name, right=_words(mended))
    if not on_wheels and not _follows_course(along[:, :2], turned[moving, :2, 0], weight):
        return None
    yaw_deg = float(np.degrees(np.arctan2(*nearest.as_matrix()[[1, 0], 0])))
    return TurnedMounting(abs(yaw_deg), mended)


def _follows_course(along: FloatArray, nose: FloatArray, weight: FloatArray) -> bool:
    """Whether a nose (n, 2) turns with a course (n, 2), rather than keeping a direction of its own.

    A nose that has nothing to do with the course is steadier in the map than against the course: lengths of mean
    directions multiply.
    """
    course, own = (way @ [1.0, 1.0j] for way in (along, nose))
    own = own / np.maximum(np.abs(own), 1e-9)
    if abs(np.average(course, weights=weight)) > STEADY:
        return False
    return bool(abs(np.average(own * course.conj(), weights=weight)) > abs(np.average(own, weights=weight)))


def _expect_upright(turned: FloatArray, mounting: Mounting, name: str) -> None:
    """The check of the tilt alone, for a vehicle that shows no course."""
    up = turned[:, 2, :].mean(axis=0)  # the map's up in the vehicle frame
    axis = int(np.argmax(np.abs(up)))
    if np.linalg.norm(up) < 0.7 or (axis == 2 and up[2] > 0):
        return
    from_up = np.eye(3)[axis] * np.sign(up[axis])
    to_up = np.array([0.0, 0.0, 1.0])
    across = np.cross(from_up, to_up)
    turn = Rotation.from_rotvec(across * 0.5 * np.pi if axis != 2 else [np.pi, 0.0, 0.0])
    right = Mounting.from_rotation(mounting.xyz_m, turn.as_matrix() @ mounting.rotation)
    raise InputError("imu-turned.likely-upright", name=name, right=_words(right))


def _words(mounting: Mounting) -> str:
    angles = (180.0 - (180.0 - angle) % 360.0 + 0.0 for angle in np.round(mounting.rpy_deg, 1).tolist())
    return f"[{', '.join(f'{angle:.1f}' for angle in angles)}]"


def densities(track: InertialTrack) -> tuple[float, float]:
    """Noise density of the angular rate, rad/s/√Hz, and of the specific force, m/s²/√Hz; zero of too few measurements.

    Welch's spectra (1967, IEEE Trans. Audio Electroacoustics 15, 70-73), the worst of the three axes.
    """
    count = len(track) // SPECTRUM_SAMPLES
    if not count:
        return 0.0, 0.0
    step_s = float(np.median(np.diff(track.t_s)))
    taper = np.hanning(SPECTRUM_SAMPLES)
    border = [int(share * SPECTRUM_SAMPLES / 2) for share in NOISE_BANDS]
    found = []
    for values in (track.rate_radps, track.force_mps2):
        power = np.zeros((SPECTRUM_SAMPLES // 2 + 1, 3))
        for part in values[: count * SPECTRUM_SAMPLES].reshape(count, SPECTRUM_SAMPLES, 3):
            power += np.abs(np.fft.rfft((part - part.mean(axis=0)) * taper[:, None], axis=0)) ** 2
        bands = [np.median(power[low:high], axis=0) for low, high in pairwise(border)]
        found.append(float(np.sqrt(np.min(bands, axis=0).max() * step_s / (count * (taper**2).sum()))))
    return found[0], found[1]


def with_shown_noise(noise: InertialNoise, track: InertialTrack) -> tuple[InertialNoise, tuple[Notice, ...]]:
    """The stated noise, or that which the measurements show if it is clearly larger, and a notice about it."""
    shown = densities(track)
    times = shown[0] / noise.rate, shown[1] / noise.force
    if max(times) < MIN_NOISE_FACTOR:
        return noise, ()
    words = [
        Text("{name} {factor:.1f} times", name=name, factor=factor)
        for name, factor in zip((Text("angular rate"), Text("specific force")), times, strict=True)
        if factor >= MIN_NOISE_FACTOR
    ]
    rate_hz = 1.0 / float(np.median(np.diff(track.t_s)))
    notice = Notice("imu-shaken", source=track.source or "The IMU", rate_hz=rate_hz, words=words)
    larger = replace(
        noise,
        rate=shown[0] if times[0] >= MIN_NOISE_FACTOR else noise.rate,
        force=shown[1] if times[1] >= MIN_NOISE_FACTOR else noise.force,
    )
    return larger, (notice,)


@dataclass(frozen=True)
class Whiteness:
    """Residuals of positions, by axis: easting, northing, height.

    Attributes:
        correlation: (3,) from one position to the next; nan where there are too few.
        noise_m: (3,) white noise with the same information.
        assumed_m: (3,) white noise that was assumed (median).
    """

    correlation: tuple[float, ...]
    noise_m: tuple[float, ...]
    assumed_m: tuple[float, ...]

    @classmethod
    def of_residuals(cls, residual_m: FloatArray, assumed_m: FloatArray) -> "Whiteness":
        """Of residuals (n, 3) in the order of time, nan where one takes no part, and the noise assumed (n, 3)."""
        part = np.asarray(np.isfinite(residual_m).all(axis=1))
        pairs = part[1:] & part[:-1]
        count = int(pairs.sum())
        if count < MIN_RESIDUAL_PAIRS:
            unknown = (np.nan, np.nan, np.nan)
            return cls(unknown, unknown, unknown)
        before = residual_m[:-1][pairs]
        after = residual_m[1:][pairs]
        square = (residual_m[part] ** 2).mean(axis=0)
        share = np.clip((before * after).mean(axis=0) / np.maximum(square, 1e-12), -0.99, 0.99)
        share = np.where(np.abs(share) < SIGNIFICANT_SIGMAS / np.sqrt(count), 0.0, share)
        # Negative correlations come from the trajectory's own freedom to follow, and are no noise.
        noise = np.sqrt(square * (1.0 + np.maximum(share, 0.0)) / (1.0 - np.maximum(share, 0.0)))
        values = (share, noise, np.median(assumed_m[part], axis=0))
        return cls(*(tuple(np.round(value, 4).tolist()) for value in values))
