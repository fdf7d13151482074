"""A walk with a scanner in the hands, and its IMU behind a low-pass filter, worked out in earth-centred coordinates."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.signal import butter, lfilter

from furrowmap.core.values.inertial import InertialTrack
from tests.core.trajectory.flights import SITE, Flight, FloatArray

STEPS_HZ = 1.9
"""Steps of a person."""


class Walk(Flight):
    """Loops at walking speed: the body rises with each step, sways with every second, and jerks as a foot is set."""

    def attitude_deg(self, t_s: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        stride = np.pi * STEPS_HZ * t_s
        roll = 3.0 * np.sin(stride + 0.4) + self._sines(t_s, 1, 4.0, 0.05, 0.3)
        pitch = 2.0 * np.sin(2.0 * stride + 1.0) + self._sines(t_s, 2, 5.0, 0.05, 0.3)
        heading = 12.0 * t_s + 8.0 * np.sin(stride + 2.0) + self._sines(t_s, 3, 60.0, 0.02, 0.08)
        return roll, pitch, heading

    @cached_property
    def _way(self) -> CubicSpline:
        dense = np.arange(-1.0, self.length_s + 1.0, 0.01)
        course = np.radians(12.0 * dense + self._sines(dense, 3, 60.0, 0.02, 0.08))
        steps = 0.01 * self.speed_mps * np.column_stack([np.sin(course), np.cos(course)])
        return CubicSpline(dense, np.column_stack([np.cumsum(steps, axis=0), 0.4 * np.sin(0.15 * dense)]))

    def xyz_m(self, t_s: FloatArray) -> FloatArray:
        stride = np.pi * STEPS_HZ * t_s
        bounce = 0.03 * np.sin(2.0 * stride) + 0.006 * np.sin(4.0 * stride + 0.7) + 0.003 * np.sin(8.0 * stride + 0.2)
        sway = 0.02 * np.sin(stride)
        body = np.column_stack([sway, -sway, bounce])
        return np.asarray(np.asarray(SITE) + self._way(t_s) + body)


def filtered(
    exact: InertialTrack, cut_off_hz: float, *, seed: int, bias: tuple[float, float], scale_off: float = 0.0
) -> InertialTrack:
    """Measurements behind a causal filter of second order, which delays them, with noise before it.

    Args:
        bias: standard deviations of the constant biases, rad/s and m/s².
        scale_off: standard deviation of the scale of each axis of the specific force, a share.
    """
    random = np.random.default_rng([seed, 97])
    rate_hz = 1.0 / float(np.median(np.diff(exact.t_s)))
    numerator, denominator = butter(2, cut_off_hz, fs=rate_hz)
    n = len(exact)
    rate = exact.rate_radps + random.normal(0.0, bias[0], 3) + random.normal(0.0, 2e-3, (n, 3))
    scale = 1.0 + random.normal(0.0, scale_off, 3)
    force = scale * exact.force_mps2 + random.normal(0.0, bias[1], 3) + random.normal(0.0, 0.03, (n, 3))

    def behind(values: FloatArray) -> FloatArray:
        return np.asarray(lfilter(numerator, denominator, values - values[0], axis=0) + values[0])

    return replace(exact, rate_radps=behind(rate), force_mps2=behind(force))
