"""How much of the positions' errors is taken for noise from epoch to epoch, against noise that was added."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from furrowmap.core.runtime.errors import InputError, RefusedError
from furrowmap.core.trajectory.used_positions import (
    WHITE_SHARE,
    UsedPositions,
    jumps,
    offsets,
    positions_of,
    rate_notices,
    sigmas_m,
    usable,
    white_noise_m,
    without_jumps,
)
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
    found = positions_of(track, en, np.full(N, 0.006), np.full(N, np.nan), offsets(track, en))
    np.testing.assert_allclose(found.white_m[:, 2], 0.04, rtol=0.07)
    np.testing.assert_allclose(np.hypot(found.white_m[:, 2], found.drift_m[:, 2]), 0.06, rtol=1e-9)


def test_positions__of_smooth_heights_keep_the_usual_share_of_their_sigma() -> None:
    track, en = noisy_track(0.006, 0.002, 0.06)
    found = positions_of(track, en, np.full(N, 0.006), np.full(N, np.nan), offsets(track, en))
    np.testing.assert_allclose(found.white_m[:, 2], WHITE_SHARE * 0.06)


def test_steps__of_a_drive_that_turns_and_stops_there_are_none() -> None:
    track, en = noisy_track(0.006, 0.01, 0.05)
    s = TIMES_S - TIMES_S[0]
    speed = np.clip(1.5 * np.sin(0.2 * s), -1.0, 1.5)
    course = 1.2 * np.sin(0.3 * s)
    driven = np.cumsum(0.1 * speed[:, None] * np.column_stack([np.cos(course), np.sin(course)]), axis=0)
    found = offsets(track, driven + en - [1.2, 0.1] * s[:, None])
    assert found.notices == ()
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
    found = offsets(track[kept], (en + off * floats[:, None])[kept])
    assert [notice.code for notice in found.notices] == ["gnss-steps"]
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
    positions, en = without_jumps(UsedPositions(track), en + jumped[:, None] * [0.0, 1.0])
    track = positions.track
    found = offsets(track, en)
    np.testing.assert_array_equal(found.off_m > 0.0, jumped[np.isin(TIMES_S, track.t_s)])
    assert len(np.unique(found.run)) == 3


def some(*fixes: Fix, interval_s: float = 0.1, **columns: object) -> GnssTrack:
    """Positions of these qualities beside each other, without standard deviations."""
    t_s = 1.75e9 + interval_s * np.arange(len(fixes))
    usual = {"lon_deg": 9.0 + 0.0 * t_s, "lat_deg": 50.0 + 0.0 * t_s, "height_m": 100.0 + 0.0 * t_s}
    return GnssTrack.build(t_s, fix=np.array(fixes, np.int8), **(usual | columns))  # type: ignore[arg-type]


def test_sigmas__that_are_not_stated_are_those_of_the_quality_and_twice_that_for_heights() -> None:
    """Centimetres with the phase, decimetres with corrections, metres without."""
    expected = {
        Fix.FIXED: 0.015, Fix.FLOAT: 0.3, Fix.PPP: 0.15, Fix.DGPS: 0.6, Fix.PPS: 0.6,
        Fix.SINGLE: 2.0, Fix.ESTIMATED: 2.0, Fix.MANUAL: 2.0, Fix.SIMULATED: 0.015, Fix.NONE: 2.0,
    }  # fmt: skip
    assert set(expected) == set(Fix)
    np.testing.assert_allclose(sigmas_m(some(*expected)), [[sigma, 2.0 * sigma] for sigma in expected.values()])


@pytest.mark.parametrize(
    ("east_m", "north_m", "height_m", "found"),
    [
        (0.03, 0.04, 0.01, (0.05 / np.sqrt(2.0), 0.01)),
        (0.03, 0.03, np.nan, (0.03, 0.06)),
        (0.03, 0.03, 0.0, (0.03, 0.06)),
        (0.0, 0.0, 0.2, (0.3, 0.2)),
        (np.nan, 0.03, np.nan, (0.3, 0.6)),
    ],
)
def test_sigmas__are_the_stated_ones_where_they_are_positive(
    east_m: float, north_m: float, height_m: float, found: tuple[float, float]
) -> None:
    track = some(Fix.FLOAT, sigma_e_m=np.array([east_m]), sigma_n_m=np.array([north_m]), sigma_h_m=np.array([height_m]))
    np.testing.assert_allclose(sigmas_m(track), [found])


@pytest.mark.parametrize(
    ("interval_s", "codes"), [(0.2, []), (0.249, []), (0.26, ["gnss-rate"]), (1.99, ["gnss-rate"])]
)
def test_rate__is_told_below_four_positions_a_second(interval_s: float, codes: list[str]) -> None:
    notices = rate_notices(some(*[Fix.FIXED] * 9, interval_s=interval_s))
    assert [notice.code for notice in notices] == codes


def test_rate__of_more_than_two_seconds_is_refused() -> None:
    with pytest.raises(RefusedError, match=r"positions come every 2\.1 s") as caught:
        rate_notices(some(*[Fix.FIXED] * 9, interval_s=2.06))
    assert caught.value.code == "gnss-rate"


@pytest.mark.parametrize(
    ("fixes", "wanted", "used", "codes"),
    [
        ([Fix.FIXED, Fix.FIXED, Fix.FLOAT, Fix.SINGLE], None, 3, []),
        ([Fix.SIMULATED, Fix.FLOAT, Fix.DGPS], None, 2, []),
        ([Fix.FLOAT, Fix.FLOAT, Fix.SINGLE, Fix.NONE], None, 3, ["gnss-quality"]),
        ([Fix.FIXED, Fix.FLOAT, Fix.SINGLE, Fix.FLOAT], (Fix.FLOAT,), 2, []),
        ([Fix.SINGLE, Fix.SINGLE, Fix.FLOAT], (Fix.SINGLE,), 2, []),
    ],
)
def test_usable__are_fixed_and_float_ones_or_the_best_or_the_wanted(
    fixes: list[Fix], wanted: tuple[Fix, ...] | None, used: int, codes: list[str]
) -> None:
    found = usable(some(*fixes), wanted)
    assert (len(found.track), sum(found.unused.values())) == (used, len(fixes) - used)
    assert [notice.code for notice in found.notices] == codes
    assert not {Fix(fix).label for fix in found.track.fix.tolist()} & set(found.unused)
    if codes:
        assert "(most are float)" in found.notices[0].text


NO_HEIGHTS = "gnss-no-heights"
NO_POSITIONS = "gnss-no-positions"


@pytest.mark.parametrize(
    ("fixes", "heights", "wanted", "code", "words"),
    [
        ([Fix.FIXED] * 3, 0, None, NO_HEIGHTS, "none of its 3 positions has a height"),
        ([Fix.FIXED] * 3, 1, None, NO_HEIGHTS, "none of its 3 positions has a height"),
        ([Fix.FIXED, Fix.NONE, Fix.NONE], 3, None, NO_POSITIONS, "1 of its 3 epochs has a position"),
        ([Fix.FIXED, Fix.NONE, Fix.NONE], 0, None, NO_POSITIONS, "0 of its 3 epochs have a position"),
        ([Fix.FIXED, Fix.SINGLE, Fix.SINGLE], 3, None, NO_POSITIONS, "1 of 3 positions .* (found: 2 single, 1 fixed)"),
        ([Fix.FIXED, Fix.FIXED], 2, (Fix.FLOAT,), NO_POSITIONS, "0 of 2 positions .* (found: 2 fixed)"),
    ],
)
def test_fewer_than_two_usable_positions__are_refused_with_the_reason(
    fixes: list[Fix], heights: int, wanted: tuple[Fix, ...] | None, code: str, words: str
) -> None:
    height = np.where(np.arange(len(fixes)) < heights, 100.0, np.nan)
    with pytest.raises(InputError, match=words.replace("(", r"\(").replace(")", r"\)")) as caught:
        usable(some(*fixes, height_m=height), wanted)
    assert caught.value.code == code


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("sigma_m", [0.02, 0.5])
@pytest.mark.parametrize("interval_s", [0.1, 0.4])
def test_jump__is_beyond_what_brakes_and_standard_deviations_allow(
    axis: int, sigma_m: float, interval_s: float
) -> None:
    """Three neighbours on each side, 3 m/s² on the way to them, six standard deviations but 0.3 m or 1 m of height."""
    t_s = interval_s * np.arange(21)
    floor_m = 1.0 if axis == 2 else 0.3
    most_m = 0.5 * 3.0 * (3.0 * interval_s) ** 2 + max(floor_m, 6.0 * sigma_m)
    sigma = np.full((21, 2), sigma_m)
    for times, expected in ((0.98, []), (1.02, [10])):
        xyz_m = np.zeros((21, 3))
        xyz_m[10, axis] = times * most_m
        assert np.flatnonzero(jumps(t_s, xyz_m, sigma)).tolist() == expected


def test_jump__beside_a_pause_is_what_no_speed_explains() -> None:
    """The mean time of its neighbours is 0.45 s away, in which 15 m/s are driven."""
    t_s = np.concatenate([0.1 * np.arange(11), 2.0 + 0.1 * np.arange(10)])
    most_m = 0.5 * 3.0 * 1.2**2 + 15.0 * np.mean([-0.3, -0.2, -0.1, 1.0, 1.1, 1.2]) + 0.3
    for times, expected in ((0.99, []), (1.01, [10])):
        xyz_m = np.zeros((21, 3))
        xyz_m[10, 0] = times * most_m
        assert np.flatnonzero(jumps(t_s, xyz_m, np.full((21, 2), 0.01))).tolist() == expected


@pytest.mark.parametrize("index", [0, 1, 2, 10, 18, 19, 20])
@pytest.mark.parametrize("size_m", [2.8, 4.0, 40.0])
def test_jump__at_either_end_is_that_position_and_none_beside_it(index: int, size_m: float) -> None:
    t_s, xyz_m = 0.1 * np.arange(21), np.zeros((21, 3))
    xyz_m[:, 0] = 1.5 * t_s
    xyz_m[index, 1] = size_m
    found = np.flatnonzero(jumps(t_s, xyz_m, np.full((21, 2), 0.01))).tolist()
    # The neighbours of the first and the last are 0.2 s away on average, in which 3 m are driven.
    assert found == ([] if index in {0, 20} and size_m < 3.0 else [index])


@pytest.mark.parametrize("sigma_m", [0.02, 0.3])
@pytest.mark.parametrize("interval_s", [0.1, 0.5])
def test_step__is_beyond_what_brakes_and_standard_deviations_allow(sigma_m: float, interval_s: float) -> None:
    n = 40
    most_m = max(0.3, 6.0 * sigma_m) + 0.5 * 3.0 * interval_s**2
    for times, told in ((0.99, False), (1.01, True)):
        track = some(
            *[Fix.FIXED] * n, interval_s=interval_s, sigma_e_m=np.full(n, sigma_m), sigma_n_m=np.full(n, sigma_m)
        )
        en = np.zeros((n, 2))
        en[30:, 1] = times * most_m
        found = offsets(track, en)
        np.testing.assert_allclose(found.off_m, np.where((np.arange(n) >= 30) & told, times * most_m, 0.0), rtol=1e-6)
        assert found.run.tolist() == [*30 * [0], *10 * [int(told)]]
        assert bool(found.notices) is told


@pytest.mark.parametrize(("pause", "told"), [(5.4, True), (5.6, False)])
def test_step__after_more_than_five_and_a_half_usual_ones_shows_nothing(pause: float, told: bool) -> None:
    n = 40
    track = some(*[Fix.FIXED] * n)
    track = replace(track, t_s=track.t_s + np.where(np.arange(n) >= 30, 0.1 * (pause - 1.0), 0.0))
    en = np.zeros((n, 2))
    en[30:, 0] = 3.0
    assert offsets(track, en).off_m.any() == told


@pytest.mark.parametrize(("count", "told"), [(9, False), (10, True)])
def test_step__of_fewer_than_ten_positions_is_not_looked_for(count: int, told: bool) -> None:
    en = np.zeros((count, 2))
    en[count - 2 :, 0] = 3.0
    assert offsets(some(*[Fix.FIXED] * count), en).off_m.any() == told


@pytest.mark.parametrize(
    ("epochs", "interval_s", "shown"), [(31, 0.1, False), (33, 0.1, True), (60, 0.24, True), (60, 0.26, False)]
)
def test_white_noise__is_shown_by_thirty_differences_four_a_second(epochs: int, interval_s: float, shown: bool) -> None:
    track = some(*[Fix.FLOAT] * epochs, interval_s=interval_s)
    en = 0.02 * np.random.default_rng(2).normal(size=(epochs, 2))
    found = white_noise_m(track, en, np.full(epochs, 0.3))
    if shown:
        np.testing.assert_allclose(found, 0.02, rtol=0.5)
    else:
        np.testing.assert_allclose(found, 0.3 * 0.3)  # the usual share
    np.testing.assert_array_equal(white_noise_m(track, 0.0 * en, np.full(epochs, 0.01)), 0.004)
    # An antenna sways by some centimetres; a scatter of metres is noise, whatever is stated.
    np.testing.assert_array_equal(white_noise_m(track, 4.0 * en, np.full(epochs, 0.05)) <= 0.05, True)
    scattered = white_noise_m(track, 99.0 * en, np.full(epochs, 0.3))
    np.testing.assert_allclose(scattered, 2.0 if shown else 0.3 * 0.3, rtol=0.5)
