"""The noise that an IMU shows, against noise of a known spectrum."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from furrowmap.core.trajectory.inertial_checks import densities, with_shown_noise
from furrowmap.core.trajectory.shown_errors import likeliest
from furrowmap.core.values.inertial import InertialTrack
from tests.core.trajectory.flights import INDUSTRIAL

FloatArray = NDArray[np.float64]


def white(count: int, rate_hz: float, rate: float = 1e-3, force: float = 0.02, seed: int = 1) -> InertialTrack:
    """Measurements of nothing but noise of these densities; the axes x and y have half of it."""
    random = np.random.default_rng(seed)
    axes = np.sqrt(rate_hz) * np.array([0.5, 0.5, 1.0])
    noise = [density * axes * random.normal(size=(count, 3)) for density in (rate, force)]
    return InertialTrack(1e9 + np.arange(count) / rate_hz, noise[0], noise[1], "imu.csv")


@pytest.mark.parametrize("rate_hz", [50.0, 400.0])
def test_density__of_white_noise_does_not_depend_on_the_rate(rate_hz: float) -> None:
    assert densities(white(30_000, rate_hz)) == pytest.approx((1e-3, 0.02), rel=0.1)


@pytest.mark.parametrize(
    ("low", "high"), [(1 / 16, 1 / 8), (1 / 8, 1 / 4), (1 / 4, 1 / 2), (1 / 2, 3 / 4), (3 / 4, 1.0)]
)
def test_density__is_that_of_the_quietest_band(low: float, high: float) -> None:
    """A hundred times as much in all other frequencies changes little, but for those that a taper spreads."""
    track = white(30_000, 100.0)
    share = np.linspace(0.0, 1.0, 15_001)[:, None]
    loud = np.where((share < low - 2 / 128) | (share > high + 2 / 128), 100.0, 1.0)

    def coloured(values: FloatArray, factor: FloatArray) -> FloatArray:
        out: FloatArray = np.fft.irfft(factor * np.fft.rfft(values, axis=0), len(values), axis=0)
        return out

    alone = replace(track, rate_radps=coloured(track.rate_radps, loud), force_mps2=coloured(track.force_mps2, loud))
    assert densities(alone) == pytest.approx((1e-3, 0.02), rel=0.25)


@pytest.mark.parametrize(("count", "known"), [(255, False), (256, True)])
def test_density__needs_256_measurements(count: int, known: bool) -> None:
    track = white(count, 100.0)
    assert (min(densities(track)) > 0.0) is known
    tiny = replace(INDUSTRIAL, rate=1e-9, force=1e-9)
    found, notices = with_shown_noise(tiny, track)
    assert (found is tiny) is not known
    assert bool(notices) is known


@pytest.mark.parametrize(
    ("rate_times", "force_times", "words"),
    [
        (1.48, 1.48, None),
        (1.52, 1.48, "(angular rate 1.5 times)"),
        (0.5, 1.52, "(specific force 1.5 times)"),
        (4.0, 2.5, "(angular rate 4.0 times and specific force 2.5 times)"),
    ],
)
def test_noise__is_what_is_shown_from_one_and_a_half_times_on(
    rate_times: float, force_times: float, words: str | None
) -> None:
    track = white(3_000, 50.0)
    shown = densities(track)
    stated = replace(INDUSTRIAL, rate=shown[0] / rate_times, force=shown[1] / force_times)
    found, notices = with_shown_noise(stated, track)
    expected = (shown[0] if rate_times > 1.5 else stated.rate, shown[1] if force_times > 1.5 else stated.force)
    assert (found.rate, found.force) == expected
    assert replace(found, rate=stated.rate, force=stated.force) == stated
    assert [notice.code for notice in notices] == ["imu-shaken"] * (words is not None)
    for notice in notices:
        assert notice.text.startswith("imu.csv: at 50 Hz")
        assert str(words) in notice.text


@pytest.mark.parametrize("times", [0.25, 0.9, 1.0, 3.0, 10.0])
@pytest.mark.parametrize("min_gain", [0.0, 1.0])
def test_times_of_a_standard_deviation__are_those_of_the_least_deviance_but_none_below_one(
    times: float, min_gain: float
) -> None:
    """The deviance is a parabola over the logarithm, which three of its points determine."""
    found = likeliest(lambda tried: float(np.log2(tried / times) ** 2), min_gain)
    assert found == pytest.approx(max(1.0, times), rel=1e-9)
