"""Heights and places that a log repeats, interpolates or rounds, against drives of known heights."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from furrowmap.core.runtime.errors import Notice
from furrowmap.core.trajectory.held_positions import held_against_motion, measured_heights, without_held
from furrowmap.core.trajectory.used_positions import UsedPositions, positions_without_steps
from furrowmap.core.values.gnss import Fix, GnssTrack

FloatArray = NDArray[np.float64]
N = 300
T_S = 1_779_529_272.0 + 0.1 * np.arange(N)
SIGMA_M = 0.03


def way(speed_mps: float = 1.0) -> FloatArray:
    return np.column_stack([speed_mps * (T_S - T_S[0]), np.zeros(N)])


def log(
    height_m: FloatArray, en_m: FloatArray | None = None, fix: Fix = Fix.FIXED, speed_mps: float = np.nan
) -> GnssTrack:
    """At 36.9° N, with a millimetre as the last digit."""
    en_m = way() if en_m is None else en_m
    nan = np.full(N, np.nan)
    sigma = np.full(N, SIGMA_M)
    lat = 36.9 + en_m[:, 1] / 111_200.0
    lon = 140.0 + en_m[:, 0] / 89_000.0
    fixes = np.full(N, fix, np.int8)
    satellites = np.full(N, 12, np.int16)
    speed = np.full(N, speed_mps)
    return GnssTrack(
        T_S,
        lon,
        lat,
        np.round(height_m, 3),
        fixes,
        sigma,
        sigma,
        sigma,
        speed,
        nan,
        nan,
        satellites,
        nan,
        nan,
        "a.nmea",
    )


def measured(seed: int = 0, noise_m: float = 0.005) -> FloatArray:
    return 300.0 + 0.02 * (T_S - T_S[0]) + np.random.default_rng(seed).normal(0.0, noise_m, N)


def judged(track: GnssTrack, en_m: FloatArray | None = None) -> tuple[GnssTrack, list[Notice]]:
    found = held_against_motion(UsedPositions(track), way() if en_m is None else en_m)
    return found.track, list(found.notices)


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 999), st.floats(0.001, 0.5), st.sampled_from([0.0, 0.3, 1.0, 4.0]))
def test_measured_heights__are_left_as_they_are(seed: int, noise_m: float, speed_mps: float) -> None:
    en_m = way(speed_mps)
    track, notices = judged(log(measured(seed, noise_m), en_m), en_m)
    assert notices == []
    assert np.array_equal(track.sigma_h_m, np.full(N, SIGMA_M))


@pytest.mark.parametrize("rate_mps", [0.0, 0.01, -0.05])
@pytest.mark.parametrize("part", [slice(None), slice(100, 220)])
def test_kept_and_interpolated_heights__get_large_standard_deviations_and_no_others(
    rate_mps: float, part: slice
) -> None:
    height = measured()
    height[part] = 300.0 + rate_mps * (T_S[part] - T_S[0])
    track, (notice,) = judged(log(height))
    assert notice.key == "gnss-heights.held-values"
    assert "a.nmea: " in notice.text
    inside = np.zeros(N, np.bool_)
    inside[part] = True
    assert track.sigma_h_m[inside].min() >= 0.5
    assert np.count_nonzero(track.sigma_h_m[~inside] != SIGMA_M) < 10
    seen = measured_heights(positions_without_steps(track, way()))
    assert not seen[inside].any()


def sway(seed: int, noise_m: float) -> FloatArray:
    """Heights of an antenna that sways by a centimetre at 1 to 3 Hz, with the receiver's noise."""
    rng = np.random.default_rng(seed)
    since_s = T_S - T_S[0]
    waves = [0.008 * np.sin(2.0 * np.pi * (f * since_s + rng.uniform())) for f in (1.1, 1.7, 2.6)]
    return 300.0 + 0.01 * since_s + np.sum(waves, axis=0) + rng.normal(0.0, noise_m, N)


@pytest.mark.parametrize("every", [5, 10, 20])
@pytest.mark.parametrize("phase", [0, 3])
@pytest.mark.parametrize("digits", [3, 4])
def test_heights_on_lines_between_measured_ones__do_not_show_the_sway(every: int, phase: int, digits: int) -> None:
    number = np.arange(N)
    height_m = np.round(np.interp(number, number[phase::every], sway(every, 0.006)[phase::every]), digits)
    track, _ = judged(log(height_m))
    assert not measured_heights(positions_without_steps(track, way())).any()


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 999), st.sampled_from([0.0, 0.0003, 0.002, 0.02]))
def test_heights_that_sway__are_measured(seed: int, noise_m: float) -> None:
    """Also where a filter of the receiver left no noise."""
    track, _ = judged(log(sway(seed, noise_m)))
    assert measured_heights(positions_without_steps(track, way())).all()


def test_heights_kept_at_a_stand__are_a_receivers_own() -> None:
    still = np.zeros((N, 2))
    assert judged(log(np.full(N, 300.0), still), still)[1] == []


def test_heights_of_a_simulator__are_not_doubted() -> None:
    assert judged(log(np.full(N, 300.0), fix=Fix.SIMULATED))[1] == []


@pytest.mark.parametrize(("step_m", "told"), [(0.05, False), (0.5, True), (1.0, True)])
def test_rounded_heights__have_the_standard_deviation_of_their_rounding(step_m: float, *, told: bool) -> None:
    height = 300.0 + 0.15 * (T_S - T_S[0]) + np.random.default_rng(1).normal(0.0, 0.004, N)
    track, notices = judged(log(np.round(height / step_m) * step_m))
    assert [notice.key for notice in notices] == (["gnss-heights.rounded-values"] if told else [])
    assert np.allclose(track.sigma_h_m, np.hypot(SIGMA_M, 0.3 * step_m))
    assert not measured_heights(positions_without_steps(track, way())).any()


@pytest.mark.parametrize("speed_mps", [np.nan, 1.0])
def test_places_that_repeat_while_the_vehicle_goes_on__are_not_used(speed_mps: float) -> None:
    en_m = way()
    en_m[120:150] = en_m[119]
    found = without_held(UsedPositions(log(measured(), en_m, speed_mps=speed_mps)))
    kept = found.track
    assert found.unused == {"held": 30}
    assert len(kept) == N - 30
    assert [notice.code for notice in found.notices] == ["gnss-frozen"]


@pytest.mark.parametrize("stop", [30, 150])
def test_places_that_a_receiver_holds_at_a_stand__are_used(stop: int) -> None:
    en_m = way()
    en_m[100 : 100 + stop] = en_m[100]
    en_m[100 + stop :] -= en_m[100 + stop] - en_m[100] - 0.1
    found = without_held(UsedPositions(log(measured(), en_m)))
    kept = found.track
    assert len(kept) == N
    assert found.notices == ()


def test_rounded_places__are_not_held() -> None:
    en_m = np.round(way() / 1.8) * 1.8
    found = without_held(UsedPositions(log(measured(), en_m)))
    assert len(found.track) == N
    assert found.notices == ()
