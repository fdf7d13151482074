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
from furrowmap.core.trajectory.climbs import climb_notices
from furrowmap.core.values.errors import Notice
from furrowmap.core.values.gnss import Fix, GnssTrack
from furrowmap.core.values.session import Crs

FloatArray = NDArray[np.float64]
T_S = 1_779_529_272.0 + 0.2 * np.arange(600)


def told(
    height_m: FloatArray, way_m: FloatArray, sigma_m: float = 0.02, t_s: FloatArray = T_S, seed: int = 0
) -> list[Notice]:
    """For a straight way, with noise of the standard deviation that is stated."""
    n = len(t_s)
    noise = sigma_m * np.random.default_rng(seed).normal(size=(n, 3))
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
