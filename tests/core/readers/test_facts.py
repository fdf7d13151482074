"""Times of a log as `inspect` reports them, in closed form."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from furrowmap.core.readers.epochs import timing_facts, utc_facts, utc_of
from furrowmap.core.readers.facts import jump_notices, position_facts
from furrowmap.core.readers.reader import ReadOptions
from furrowmap.core.runtime.errors import InputError
from furrowmap.core.values.gnss import Fix, GnssTrack


@given(rate_hz=st.sampled_from([1, 2, 5, 10, 20]), count=st.integers(20, 200), gap_s=st.floats(2.0, 100.0))
def test_times__of_a_regular_log_with_a_gap(rate_hz: int, count: int, gap_s: float) -> None:
    t_s = 1.75e9 + np.arange(count) / rate_hz
    t_s[count // 2 :] += gap_s - 1.0 / rate_hz
    facts = timing_facts(t_s)
    assert abs(facts["span_s"] - ((count - 2) / rate_hz + gap_s)) < 2e-3
    assert facts["rate_hz"] == rate_hz
    assert facts["gaps"]["count"] == 1
    assert abs(facts["gaps"]["longest_s"] - gap_s) < 2e-3
    assert abs(facts["gaps"]["longer_than_s"] - 1.5 / rate_hz) < 2e-3


def test_times__without_a_gap_and_of_too_few() -> None:
    facts = timing_facts(1.75e9 + 0.25 * np.arange(9))
    assert facts == {"span_s": 2.0, "rate_hz": 4.0, "gaps": {"longer_than_s": 0.375, "count": 0, "longest_s": 0.0}}
    assert timing_facts(np.array([1.75e9])) == {}
    assert utc_facts(np.zeros(0)) == {}
    found = utc_facts(np.array([1_781_143_200.0, 1_781_143_201.5]))
    assert found == {"first": "2026-06-11T02:00:00.000Z", "last": "2026-06-11T02:00:01.500Z", "gps_minus_utc_s": 18}


def track_of(t_s: Any, north_m: Any, fix: Fix = Fix.SINGLE) -> GnssTrack:
    """Positions on the meridian of 10° E."""
    lat = 50.0 + np.asarray(north_m, np.float64) / 111_229.0
    lon, kinds = np.full(len(lat), 10.0), np.full(len(lat), fix, np.int8)
    return GnssTrack.build(np.asarray(t_s, np.float64), lon_deg=lon, lat_deg=lat, fix=kinds, source="log")


@pytest.mark.parametrize(
    ("fix", "off_m", "jumps"),
    [
        (Fix.SINGLE, 1.95, 0),
        (Fix.SINGLE, 2.06, 1),
        (Fix.DGPS, 1.95, 0),
        (Fix.PPP, 1.95, 0),
        (Fix.FIXED, 0.95, 0),
        (Fix.FIXED, 1.06, 1),
        (Fix.FLOAT, 1.06, 1),
    ],
)
@pytest.mark.parametrize("speed_mps", [0.0, 2.0])
def test_jumps__are_two_metres_or_one_between_carrier_phase_solutions(
    fix: Fix, off_m: float, jumps: int, speed_mps: float
) -> None:
    """More than one and a half times the way by the speed around."""
    t_s = np.arange(20.0)
    north_m = speed_mps * t_s
    north_m[10:] += off_m + 0.5 * speed_mps
    notices = jump_notices(track_of(t_s, north_m, fix), "{:.0f} s".format)
    assert len(notices) == jumps
    if jumps:
        assert "jump 1 time " in notices[0].text
        assert f"more than {1 if fix in (Fix.FIXED, Fix.FLOAT) else 2} m" in notices[0].text
        assert f"the largest jump is {off_m + 0.5 * speed_mps:.1f} m" in notices[0].text
        assert "(0 times with a change of fix)" in notices[0].text
        assert "10 s at 50.00" in notices[0].text


@pytest.mark.parametrize(("pause_s", "jumps"), [(1.45, 1), (1.55, 0)])
def test_jumps__after_a_gap_are_none(pause_s: float, jumps: int) -> None:
    t_s = np.arange(20.0)
    t_s[10:] += pause_s - 1.0
    assert len(jump_notices(track_of(t_s, np.where(t_s < 10.0, 0.0, 30.0)))) == jumps


def test_jumps__with_a_change_of_fix_are_counted_and_fewer_than_six_positions_have_none() -> None:
    t_s = np.arange(20.0)
    track = track_of(t_s, np.where(t_s < 10.0, 0.0, 5.0))
    track.fix[10:] = Fix.FIXED
    (notice,) = jump_notices(track)
    assert "(1 time with a change of fix)" in notice.text
    assert "more than 2 m" in notice.text
    assert len(jump_notices(track[7:13])) == 1
    assert jump_notices(track[8:13]) == []


def test_positions__as_inspect_tells_them() -> None:
    track = track_of(np.arange(5.0), [0.0, 3.0, 3.0, 10.0, 10.0])
    track.fix[3:] = Fix.FIXED
    assert position_facts(track) == {
        "epochs_by_fix": {"single": 3, "fixed": 2},
        "place": {"lat_deg": pytest.approx(50.000027), "lon_deg": 10.0},
        "distance_m": 10.0,
        "stated_for_epochs": {"sigmas": 0, "speed": 0, "course": 0, "heading": 0, "height": 0},
    }
    track.height_m[1:3], track.speed_mps[2] = (55.1234, 54.0), 2.345
    track.heading_deg[:4], track.course_deg[:1], track.sigma_e_m[:] = 1.0, 1.0, 1.0
    facts = position_facts(track)
    assert (facts["height_m"], facts["speed_max_mps"]) == ([54.0, 55.123], 2.35)
    assert facts["stated_for_epochs"] == {"sigmas": 5, "speed": 1, "course": 1, "heading": 4, "height": 2}
    assert position_facts(track[:0]) == {}


WEEK_S = 604_800.0
TEN_YEARS_S = 10 * 365.25 * 86_400.0


@pytest.mark.parametrize(
    ("seconds", "scale", "expected"),
    [
        ([0.0, 1.0], "gps", 2422 * WEEK_S),
        ([2 * WEEK_S - 2.0, 2 * WEEK_S - 1.0], "gps", 2424 * WEEK_S - 2.0),
        ([0.0, 1.0], "utc", 2422 * WEEK_S + 18.0),
        ([TEN_YEARS_S, TEN_YEARS_S + 1.0], "utc", TEN_YEARS_S + 18.0),
        ([1.3e9, 1.3e9 + 1.0], "gps", 1.3e9),
        ([2 * WEEK_S, 2 * WEEK_S + 1.0], "gps", None),
        ([-1.0, 0.0], "gps", None),
        ([TEN_YEARS_S - 1.0, TEN_YEARS_S + 1.0], "gps", None),
        ([0.0, 1.3e9], "gps", None),
    ],
)
def test_times__of_a_week_or_since_1980(seconds: list[float], scale: str, expected: float | None) -> None:
    """`expected` is the first of them in GPS time since 1980 as of 2026, 18 s ahead of UTC."""
    if expected is None:
        with pytest.raises(InputError) as refused:
            utc_of(np.array(seconds), scale, "log", ReadOptions(week=2422))
        assert refused.value.code == "unknown-time-scale"
    else:
        found = utc_of(np.array(seconds), scale, "log", ReadOptions(week=2422))
        leap_s = 18.0 if expected > 1.2e9 or scale == "utc" else 0.0
        np.testing.assert_allclose(found - 315_964_800.0 + leap_s - expected, [0.0, 1.0], atol=1e-6)
    assert utc_of(np.array(seconds), "unix", "log", ReadOptions()).tolist() == seconds


@pytest.mark.parametrize("scale", ["gps", "utc"])
@pytest.mark.parametrize("days_off", [-3.4, 0.0, 3.4])
def test_times__of_a_week_by_a_time_nearby(scale: str, days_off: float) -> None:
    near_s = 315_964_800.0 + 2422 * WEEK_S + 1000.0 + 86_400.0 * days_off
    (found,) = utc_of(np.array([1000.0]), scale, "log", ReadOptions(near_s=near_s))
    assert found == 315_964_800.0 + 2422 * WEEK_S + 1000.0 - (18.0 if scale == "gps" else 0.0)
