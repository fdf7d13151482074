"""How much of the positions' errors is taken for noise from epoch to epoch, against noise that was added."""

from __future__ import annotations

import numpy as np
import pytest

from furrowmap.core.trajectory.positions import WHITE_SHARE, positions_of, white_noise_m
from furrowmap.core.values.gnss import Fix, GnssTrack

N = 2000
TIMES_S = 1.75e9 + 0.1 * np.arange(N, dtype=np.float64)


def noisy_track(white_m: float, white_h_m: float, sigma_h_m: float) -> tuple[GnssTrack, np.ndarray]:
    """A straight drive over rolling ground, with noise added; and its easting and northing."""
    random = np.random.default_rng(7)
    s = TIMES_S - TIMES_S[0]
    en = np.column_stack([1.2 * s, 0.1 * s]) + white_m * random.normal(size=(N, 2))
    height = 30.0 + 0.5 * np.sin(0.1 * s) + white_h_m * random.normal(size=N)
    unknown, sigma = np.full(N, np.nan), np.full(N, 0.03)
    track = GnssTrack(
        t_s=TIMES_S, lon_deg=unknown, lat_deg=unknown, height_m=height, fix=np.full(N, Fix.FIXED, np.int8),
        sigma_e_m=sigma, sigma_n_m=sigma, sigma_h_m=np.full(N, sigma_h_m), speed_mps=unknown, course_deg=unknown,
        heading_deg=unknown, satellites=np.full(N, -1, np.int16), hdop=unknown, age_s=unknown,
    )  # fmt: skip
    return track, en


@pytest.mark.parametrize("sigma", [0.006, 0.02])
def test_white_noise__is_what_was_added_to_either_kind_of_axes(sigma: float) -> None:
    track, en = noisy_track(sigma, sigma, 0.05)
    for axes in (en, track.height_m[:, None]):
        found = white_noise_m(track, axes, np.full(N, 0.05))
        np.testing.assert_allclose(found, sigma, rtol=0.07)


def test_positions__of_coarse_heights_have_the_noise_that_the_heights_show() -> None:
    track, en = noisy_track(0.006, 0.04, 0.06)
    found = positions_of(track, en, np.full(N, 0.006), np.full(N, np.nan))
    np.testing.assert_allclose(found.white_m[:, 2], 0.04, rtol=0.07)
    np.testing.assert_allclose(np.hypot(found.white_m[:, 2], found.drift_m[:, 2]), 0.06, rtol=1e-9)


def test_positions__of_smooth_heights_keep_the_usual_share_of_their_sigma() -> None:
    track, en = noisy_track(0.006, 0.002, 0.06)
    found = positions_of(track, en, np.full(N, 0.006), np.full(N, np.nan))
    np.testing.assert_allclose(found.white_m[:, 2], WHITE_SHARE * 0.06)
