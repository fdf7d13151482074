"""The noise that an IMU shows: white noise is in all frequencies, so it is no more than the least of the spectrum.

A machine that shakes faster than its IMU is sampled folds that shaking into all frequencies below, where it is noise of
angular rate and specific force like any other. What a vehicle does adds to it at some frequencies; the band in which
the spectrum is least has the least of that. Lines of motors do not count: the median within a band passes them by.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.runtime.errors import Notice
from furrowmap.core.values.inertial import InertialNoise, InertialTrack

FloatArray = NDArray[np.float64]

WINDOW: Final = 256
"""Measurements of which a spectrum is taken."""
BANDS: Final = (1 / 16, 1 / 8, 1 / 4, 1 / 2, 3 / 4, 1.0)
"""Borders of the bands that are compared, as shares of half the sampling rate."""
LARGER: Final = 1.5
"""A noise that is larger than stated by less than this factor stays as stated."""


def densities(track: InertialTrack) -> tuple[float, float]:
    """Noise density of the angular rate, rad/s/√Hz, and of the specific force, m/s²/√Hz; zero of too few measurements.

    Welch's spectra (1967, IEEE Trans. Audio Electroacoustics 15, 70-73), the worst of the three axes.
    """
    count = len(track) // WINDOW
    if not count:
        return 0.0, 0.0
    step_s = float(np.median(np.diff(track.t_s)))
    taper = np.hanning(WINDOW)
    border = [int(share * WINDOW / 2) for share in BANDS]
    found = []
    for values in (track.rate_radps, track.force_mps2):
        power = np.zeros((WINDOW // 2 + 1, 3))
        for part in values[: count * WINDOW].reshape(count, WINDOW, 3):
            power += np.abs(np.fft.rfft((part - part.mean(axis=0)) * taper[:, None], axis=0)) ** 2
        bands = [np.median(power[low:high], axis=0) for low, high in pairwise(border)]
        found.append(float(np.sqrt(np.min(bands, axis=0).max() * step_s / (count * (taper**2).sum()))))
    return found[0], found[1]


def with_shown_noise(noise: InertialNoise, track: InertialTrack, notices: list[Notice]) -> InertialNoise:
    """The stated noise, or that which the measurements show if it is clearly larger; a notice tells of it."""
    shown = densities(track)
    times = shown[0] / noise.rate, shown[1] / noise.force
    if max(times) < LARGER:
        return noise
    words = [
        f"{name} {factor:.1f} times"
        for name, factor in zip(("angular rate", "specific force"), times, strict=True)
        if factor >= LARGER
    ]
    rate_hz = 1.0 / float(np.median(np.diff(track.t_s)))
    notices.append(Notice("imu-shaken", source=track.source or "The IMU", rate_hz=rate_hz, words=" and ".join(words)))
    return replace(
        noise,
        rate=shown[0] if times[0] >= LARGER else noise.rate,
        force=shown[1] if times[1] >= LARGER else noise.force,
    )
