"""How much of the positions' errors is taken for noise from epoch to epoch, against noise that was added."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from furrowmap.core.trajectory.positions import WHITE_SHARE, offsets, positions_of, white_noise_m, without_jumps
from furrowmap.core.values.errors import Notice
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
    found = positions_of(track, en, np.full(N, 0.006), np.full(N, np.nan), offsets(track, en, []))
    np.testing.assert_allclose(found.white_m[:, 2], 0.04, rtol=0.07)
    np.testing.assert_allclose(np.hypot(found.white_m[:, 2], found.drift_m[:, 2]), 0.06, rtol=1e-9)


def test_positions__of_smooth_heights_keep_the_usual_share_of_their_sigma() -> None:
    track, en = noisy_track(0.006, 0.002, 0.06)
    found = positions_of(track, en, np.full(N, 0.006), np.full(N, np.nan), offsets(track, en, []))
    np.testing.assert_allclose(found.white_m[:, 2], WHITE_SHARE * 0.06)


def test_steps__of_a_drive_that_turns_and_stops_there_are_none() -> None:
    track, en = noisy_track(0.006, 0.01, 0.05)
    s = TIMES_S - TIMES_S[0]
    speed = np.clip(1.5 * np.sin(0.2 * s), -1.0, 1.5)
    course = 1.2 * np.sin(0.3 * s)
    driven = np.cumsum(0.1 * speed[:, None] * np.column_stack([np.cos(course), np.sin(course)]), axis=0)
    notices: list[Notice] = []
    found = offsets(track, driven + en - [1.2, 0.1] * s[:, None], notices)
    assert notices == []
    assert not found.off_m.any()
    assert not found.run.any()


@pytest.mark.parametrize("gap_s", [0.0, 4.0])
def test_promise_12__float_positions_that_are_off_lose_their_place_and_keep_their_shape(gap_s: float) -> None:
    track, en = noisy_track(0.006, 0.01, 0.05)
    s, off = TIMES_S - TIMES_S[0], np.array([1.2, -0.9])
    floats = (s >= 40.0) & (s < 60.0)
    kept = ~((s >= 40.0) & (s < 40.0 + gap_s))
    sigma = np.where(floats, 0.11, 0.015)
    track = replace(track, fix=np.where(floats, Fix.FLOAT, Fix.FIXED).astype(np.int8), sigma_e_m=sigma, sigma_n_m=sigma)
    notices: list[Notice] = []
    found = offsets(track[kept], (en + off * floats[:, None])[kept], notices)
    assert [notice.code for notice in notices] == ["gnss-steps"]
    np.testing.assert_array_equal(found.off_m > 0.0, floats[kept])
    assert found.off_m.max() == pytest.approx(1.5, abs=0.05)
    used = positions_of(track[kept], en[kept], np.full(kept.sum(), 0.006), np.full(kept.sum(), np.nan), found)
    begin = int(np.argmax(floats[kept]))
    assert used.drift_m[begin, 0] > 1.4
    assert used.drift_m[begin + 1, 0] < 0.12


def test_promise_12__fixed_positions_that_jump_for_seconds_are_the_fewer_ones() -> None:
    track, en = noisy_track(0.006, 0.01, 0.05)
    s = TIMES_S - TIMES_S[0]
    jumped = (s >= 100.0) & (s < 103.0)
    track, en = without_jumps(track, en + jumped[:, None] * [0.0, 1.0], {}, [])
    found = offsets(track, en, [])
    np.testing.assert_array_equal(found.off_m > 0.0, jumped[np.isin(TIMES_S, track.t_s)])
    assert len(np.unique(found.run)) == 3
