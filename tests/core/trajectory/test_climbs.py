"""Heights that no vehicle on the ground has, against ways of a known slope and real logs."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from furrowmap.core.geodesy.projection import map_frame
from furrowmap.core.readers.reader import ReadOptions, open_recording
from furrowmap.core.runtime.errors import Notice
from furrowmap.core.trajectory.used_positions import climb_notices
from furrowmap.core.values.gnss import Fix, GnssTrack
from furrowmap.core.values.session import Crs

FloatArray = NDArray[np.float64]
T_S = 1_779_529_272.0 + 0.2 * np.arange(600)


def told(
    height_m: FloatArray, way_m: FloatArray, sigma_m: float = 0.02, t_s: FloatArray = T_S, seed: int | None = 0
) -> list[Notice]:
    """For a straight way, with noise of the standard deviation that is stated; without, where there is no seed."""
    n = len(t_s)
    noise = np.zeros((n, 3)) if seed is None else sigma_m * np.random.default_rng(seed).normal(size=(n, 3))
    nan, sigma = np.full(n, np.nan), np.full(n, sigma_m)
    fix, satellites = np.full(n, Fix.FIXED, np.int8), np.full(n, 12, np.int16)
    track = GnssTrack(
        t_s, nan, nan, height_m + noise[:, 2], fix, sigma, sigma, sigma, nan, nan, nan, satellites, nan, nan, "log.nmea"
    )
    return climb_notices(track, np.column_stack([way_m, np.zeros(n)]) + noise[:, :2])


@settings(max_examples=25, deadline=None)
@given(st.floats(-0.42, 0.42), st.floats(0.0, 8.0), st.sampled_from([0.01, 0.1, 0.4]), st.integers(0, 99))
def test_no_slope_that_is_driven__is_told(slope: float, speed_mps: float, sigma_m: float, seed: int) -> None:
    way = speed_mps * (T_S - T_S[0])
    assert told(slope * way, way, sigma_m, seed=seed) == []


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_jump_of_heights__is_told_with_its_time_and_size(sign: float) -> None:
    way = 1.5 * (T_S - T_S[0])
    (notice,) = told(sign * 6.0 * (T_S[300] < T_S), way)
    assert notice.code == "gnss-heights"
    assert f"heights change by {sign * 6.0:+.0f}"[:-1] in notice.text
    assert "log.nmea" in notice.text
    assert told(0.9 * (T_S[300] < T_S), way) == []


def test_heights_that_drift_at_a_stand__are_told() -> None:
    drift = 0.1 * (T_S - T_S[0])
    assert told(drift, np.zeros(600), 0.01)
    assert told(0.1 * drift, np.zeros(600), 1.0) == []


@pytest.mark.parametrize("sigma_m", [0.01, 0.5])
def test_a_jump_at_a_stand__is_told_beyond_a_metre_and_three_standard_deviations(sigma_m: float) -> None:
    most_m = 1.0 + 3.0 * np.hypot(sigma_m, sigma_m)
    jump, still = (T_S[300] < T_S).astype(float), np.zeros(600)
    assert told(0.99 * most_m * jump, still, sigma_m, seed=None) == []
    (notice,) = told(1.01 * most_m * jump, still, sigma_m, seed=None)
    assert f"heights change by {1.01 * most_m:+.1f} m within 0.0 m of way" in notice.text
    assert f"beyond their standard deviations ({sigma_m:.2f} m)" in notice.text
    # From each position of the 30 s before it.
    assert "This begins at 150 of 600 positions" in notice.text or "This begins at 149 of 600" in notice.text


@pytest.mark.parametrize("speed_mps", [0.5, 2.0, 8.0])
def test_a_slope__is_told_beyond_45_percent_and_a_metre_in_half_a_minute(speed_mps: float) -> None:
    way = speed_mps * (T_S - T_S[0])
    sigma_m = 0.02
    steepest = 0.45 + (1.0 + 3.0 * np.hypot(sigma_m, sigma_m)) / (30.0 * speed_mps)
    assert told(0.98 * steepest * way, way, sigma_m, seed=None) == []
    assert told(1.02 * steepest * way, way, sigma_m, seed=None)


@pytest.mark.parametrize("lasts_s", [0.2, 10.0])
def test_a_short_rise_on_the_way__is_told_beyond_what_is_climbed_in_3_or_10_seconds(lasts_s: float) -> None:
    """Half a minute of way would hide it."""
    speed_mps = 2.0
    t = T_S - T_S[0]
    most_m = 1.0 + 0.45 * speed_mps * max(lasts_s, 3.0)
    rise = np.clip((t - 60.0) / lasts_s, 0.0, 1.0)
    assert told(0.9 * most_m * rise, speed_mps * t, 0.01, seed=None) == []
    assert told(1.1 * most_m * rise, speed_mps * t, 0.01, seed=None)


@pytest.mark.parametrize(("interval_s", "longest_s"), [(0.2, 2.0), (1.0, 5.0)])
def test_a_pause__hides_the_way_from_2_seconds_and_5_intervals_on(interval_s: float, longest_s: float) -> None:
    n = 200
    t, still = T_S[0] + interval_s * np.arange(n), np.zeros(n)
    jump = (np.arange(n) >= n // 2).astype(float)
    for pause_s, hidden in ((0.95 * longest_s, False), (1.05 * longest_s, True)):
        paused = t + (pause_s - interval_s) * jump
        assert (told(9.0 * jump, still, t_s=paused, seed=None) == []) == hidden


def test_a_pause__hides_the_way() -> None:
    t_s = np.append(T_S[:300], T_S[300:] + 20.0)
    way = 1.5 * (T_S - T_S[0])
    assert told(30.0 * (T_S[299] < T_S), way, t_s=t_s) == []
    assert told(30.0 * (T_S[299] < T_S), way)


def test_unknown_heights__take_no_part() -> None:
    way = 1.5 * (T_S - T_S[0])
    assert told(np.full(600, np.nan), way) == []
    assert told(np.where(np.arange(600) % 7 == 0, np.nan, 0.1 * way), way) == []


@pytest.mark.parametrize(
    ("name", "wrong"),
    [
        ("gnss/car_reference/rover_1Hz_spp.pos", True),
        ("gnss/car_reference/reference_1Hz.pos", False),
        ("gnss/walk_f9p/walk.nmea", False),
        ("rover_real/gnss.nmea", False),
        ("tractor_loop/gnss.nmea", False),
        ("tractor_fishtail/gnss.nmea", False),
        ("gnss/nmea/car_10hz.nmea", False),
    ],
)
def test_real_logs__are_told_of_where_their_heights_are_wrong(name: str, wrong: bool, shared_data: Path) -> None:
    """A car in a town by code alone, and beside it carrier-phase positions of the same drive, and others."""
    reader = open_recording([shared_data / name], ReadOptions(date="2026-05-23"))
    track = reader.track()  # type: ignore[attr-defined]
    track = track[track.fix > 0]
    zone = int(np.median(track.lon_deg) // 6.0) + 31
    frame = map_frame(Crs(map=f"EPSG:{32600 + zone}"))
    en = np.column_stack(frame.project(track.lon_deg, track.lat_deg))
    assert [notice.code for notice in climb_notices(track, en)] == ["gnss-heights"] * wrong
