"""Heights that jump between two levels are put on one; those of a vehicle that climbs are left as they are."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from furrowmap.core.trajectory.height_steps import without_height_steps
from furrowmap.core.trajectory.used_positions import UsedPositions
from furrowmap.core.values.gnss import Fix, GnssTrack

RATE_HZ = 10.0


def track(height_m: np.ndarray) -> GnssTrack:
    n = len(height_m)
    unknown = np.full(len(height_m), np.nan)
    return GnssTrack(
        t_s=1_779_529_272.0 + np.arange(n) / RATE_HZ,
        lon_deg=np.full(n, 11.0),
        lat_deg=np.full(n, 55.0),
        height_m=height_m,
        fix=np.full(n, Fix.FIXED, np.int8),
        sigma_e_m=np.full(n, 0.01),
        sigma_n_m=np.full(n, 0.01),
        sigma_h_m=np.full(n, 0.02),
        speed_mps=unknown,
        course_deg=unknown,
        heading_deg=unknown,
        satellites=np.full(n, 12, np.int16),
        hdop=unknown,
        age_s=unknown,
    )


def flown() -> np.ndarray:
    t_s = np.arange(300) / RATE_HZ
    climb_m = 40.0 + 3.0 * np.sin(0.8 * t_s) + 2.0 * np.minimum(t_s, 10.0)
    return np.asarray(climb_m + np.random.default_rng(0).normal(0.0, 0.02, 300))


@pytest.mark.parametrize(
    ("first", "end", "off_m"), [(200, 300, 36.6), (0, 80, -36.6), (100, 180, 2.0), (150, 151, 9.0)]
)
def test_heights_on_another_level__are_put_on_that_of_most(first: int, end: int, off_m: float) -> None:
    mixed = flown()
    mixed[first:end] += off_m
    found = without_height_steps(UsedPositions(track(mixed)))
    assert found.track.height_m == pytest.approx(flown(), abs=0.25)
    assert found.levels_m == pytest.approx(abs(off_m), abs=0.2)
    assert [notice.code for notice in found.notices] == ["gnss-height-steps"]


def test_a_vehicle_that_climbs__has_one_level() -> None:
    stated = UsedPositions(track(flown()))
    assert without_height_steps(stated) is stated


@pytest.mark.parametrize("seed", range(5))
def test_heights_that_scatter_more_than_stated__have_one_level(seed: int) -> None:
    """As those of a receiver without corrections, stated as good to centimetres."""
    noise_m = np.random.default_rng(seed).normal(0.0, 1.0, 3000)
    assert without_height_steps(UsedPositions(track(noise_m))).levels_m == 0.0


@pytest.mark.parametrize(("first", "end", "off_m"), [(200, 300, -40.0), (100, 180, 2.0)])
def test_levels_of_a_drive__last_and_have_one_quality(first: int, end: int, off_m: float) -> None:
    mixed = flown()
    mixed[first:end] += off_m
    found = without_height_steps(UsedPositions(track(mixed)), lasting=True)
    assert found.track.height_m == pytest.approx(flown(), abs=0.25)
    assert found.levels_m == pytest.approx(abs(off_m), abs=0.2)
    assert [notice.code for notice in found.notices] == ["gnss-height-steps"]
    fix = np.full(len(mixed), Fix.FIXED, np.int8)
    fix[first:end] = Fix.FLOAT
    for left in (replace(track(mixed), fix=fix), with_outliers()):
        positions = UsedPositions(left)
        assert without_height_steps(positions, lasting=True) is positions


def with_outliers() -> GnssTrack:
    height_m = flown()
    height_m[[50, 120, 121, 260]] += 9.0
    return track(height_m)


def test_heights_that_are_not_known__have_no_level() -> None:
    unknown = UsedPositions(track(np.full(300, np.nan)))
    assert without_height_steps(unknown) is unknown
