"""Outages and float solutions of a drive whose positions are known are told; none is made up."""

from __future__ import annotations

import datetime as dt
from dataclasses import replace
from zoneinfo import ZoneInfo

import numpy as np
import pytest

from furrowmap.core.geodesy.local_time import in_local_time
from furrowmap.core.pipeline.notices import fix_shares, quality_notices
from furrowmap.core.values.clock import iso_utc
from furrowmap.core.values.gnss import Fix
from furrowmap.core.values.trajectory import ScanPoses
from tests.exporters.vectors.worked_field import worked_field

STEP_S = 0.1


def drive(*spans: tuple[Fix, int, int]) -> ScanPoses:
    """A drive with fixed solutions, and others from one scan to another."""
    poses = worked_field()[0]
    fix = np.full(len(poses), Fix.FIXED, np.int8)
    for kind, begin, end in spans:
        fix[begin:end] = kind
    return replace(poses, fix=fix, t_s=poses.t_s[0] + STEP_S * np.arange(len(poses)))


@pytest.mark.parametrize(
    ("spans", "codes"),
    [
        ((), []),
        (((Fix.NONE, 100, 150),), ["gnss-outage"]),  # five seconds
        (((Fix.NONE, 100, 110),), []),  # one second
        (((Fix.FLOAT, 0, 80),), ["gnss-not-fixed"]),  # a tenth of the time
        (((Fix.FLOAT, 0, 10),), []),
        (((Fix.NONE, 100, 150), (Fix.SINGLE, 300, 380)), ["gnss-outage", "gnss-not-fixed"]),
        (((Fix.FLOAT, 0, 10_000),), []),  # without any fixed solution another warning says so
    ],
)
def test_what_stands_out__is_told(spans: tuple[tuple[Fix, int, int], ...], codes: list[str]) -> None:
    assert [notice.code for notice in quality_notices(drive(*spans))] == codes


@pytest.mark.parametrize(("missing", "told"), [(18, False), (20, True)])
def test_outage__is_told_from_two_seconds_between_positions_on(missing: int, told: bool) -> None:
    spans = (Fix.NONE, 100, 100 + missing), (Fix.NONE, 300, 310)
    assert [notice.code for notice in quality_notices(drive(*spans))] == ["gnss-outage"] * told


@pytest.mark.parametrize(("share", "told"), [(0.049, False), (0.051, True)])
def test_not_fixed__is_told_from_a_twentieth_on(share: float, told: bool) -> None:
    count = round(share * len(drive()))
    notices = quality_notices(drive((Fix.FLOAT, 200, 200 + count)))
    assert [notice.code for notice in notices] == ["gnss-not-fixed"] * told
    for notice in notices:
        assert notice.text.startswith("For 5% of the time")


@pytest.mark.parametrize(("pause_s", "counted_s"), [(0.28, 0.28), (0.32, 0.1), (60.0, 0.1)])
def test_not_fixed__counts_a_pause_beyond_three_steps_as_a_usual_one(pause_s: float, counted_s: float) -> None:
    poses = drive((Fix.FLOAT, 100, 201))
    t_s = poses.t_s + np.where(np.arange(len(poses)) > 150, pause_s - STEP_S, 0.0)
    (notice,) = quality_notices(replace(poses, t_s=t_s))
    assert f"(float {10.0 + counted_s:.1f} s)" in notice.text


def test_outage__has_its_length_and_its_time_in_words() -> None:
    poses = drive((Fix.NONE, 100, 150))
    (notice,) = quality_notices(poses)
    assert f"for 5.1 s in all (outages: 1, the longest of 5.1 s from {iso_utc(float(poses.t_s[99]))})" in notice.text
    japanese = notice.text_in("ja")
    assert "計 5.1 秒" in japanese
    assert "position" not in japanese


def test_shares__count_every_quality_and_none_as_its_own() -> None:
    poses = drive((Fix.NONE, 0, 200), (Fix.FLOAT, 200, 300))
    n = len(poses)
    assert fix_shares(poses) == pytest.approx({"fixed": (n - 300) / n, "none": 200 / n, "float": 100 / n}, abs=1e-4)
    assert fix_shares(replace(poses, fix=np.full(n, -1, np.int8))) == {"file": 1.0}


def test_not_fixed__has_its_seconds_by_quality() -> None:
    (notice,) = quality_notices(drive((Fix.FLOAT, 0, 60), (Fix.SINGLE, 400, 440)))
    assert "(single 4.0 s, float 6.0 s)" in notice.text
    assert "FIX" in notice.text_in("ja")


@pytest.mark.parametrize("zone", ["Asia/Tokyo", "America/St_Johns", "UTC"])
def test_times_in_texts__become_those_of_the_place(zone: str) -> None:
    """Across midnight, and with the zone named once."""
    begin = dt.datetime(2026, 6, 11, 14, 59, 59, 500_000, dt.UTC)
    stamps = [iso_utc(begin.timestamp()), iso_utc(begin.timestamp() + 1.0)]
    there = [(begin + dt.timedelta(seconds=k)).astimezone(ZoneInfo(zone)) for k in (0, 1)]
    told = in_local_time(f"From {stamps[0]} to {stamps[1]}: nothing.", ZoneInfo(zone))
    assert told == f"From {there[0]:%Y-%m-%d %H:%M:%S}.5 to {there[1]:%Y-%m-%d %H:%M:%S}.5 ({zone}): nothing."
