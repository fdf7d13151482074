"""Random sequences that several parts of the simulation need."""

import zlib
from itertools import accumulate
from typing import TypeAlias

import numpy as np
import scipy.fft
from numpy.typing import NDArray

FloatArray: TypeAlias = NDArray[np.float64]
Float32Array: TypeAlias = NDArray[np.float32]


def random_for(seed: int, purpose: str) -> np.random.Generator:
    """A separate generator for every purpose, so that changes in one part do not affect the others."""
    return np.random.default_rng([seed, zlib.crc32(purpose.encode())])


def band_noise(rng: np.random.Generator, n: int, rate_hz: float, low_hz: float, high_hz: float) -> FloatArray:
    """(n,) noise of unit variance whose power lies evenly between two frequencies."""
    size = scipy.fft.next_fast_len(max(n, int(4 * rate_hz / low_hz)), real=True)
    frequency = np.fft.rfftfreq(size, 1.0 / rate_hz)
    spectrum = scipy.fft.rfft(rng.standard_normal(size)) * ((frequency >= low_hz) & (frequency <= high_hz))
    noise: FloatArray = np.asarray(scipy.fft.irfft(spectrum, size), np.float64)
    return noise[:n] / max(float(noise.std()), 1e-12)


def gauss_markov(rng: np.random.Generator, n: int, step_s: float, sigma: float, tau_s: float) -> FloatArray:
    """(n,) stationary Gauss-Markov process of first order (Gelb 1974, Applied Optimal Estimation, section 2.4)."""
    keep = float(np.exp(-step_s / tau_s))
    drive = rng.standard_normal(n) * sigma * np.sqrt(1.0 - keep * keep)
    if n:
        drive[0] = rng.standard_normal() * sigma
    # As scipy.signal.lfilter does, whose import would take a third of a second of each start.
    return np.fromiter(accumulate(drive.tolist(), lambda before, new: keep * before + new), np.float64, n)
