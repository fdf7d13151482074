"""Whether recordings belong together in time, and what a clock's disagreement is probably due to."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from furrowmap.core.session.examination import Examined, likely_offset, time_matches
from furrowmap.core.values.scan import Clock, ClockReading

T0_S = 1_781_141_020.0


def reading(first_s: float, last_s: float) -> ClockReading:
    return ClockReading(Clock.GNSS, first_s, last_s)


@pytest.mark.parametrize(
    ("offset_s", "cause"),
    [
        (9 * 3600.0, "local time"),
        (-7 * 3600.0, "local time"),
        (5.5 * 3600.0, "local time"),
        (86_400.0, "date"),
        (1024 * 604_800.0, "rollover"),
    ],
)
def test_offset__known_causes_are_recognised(offset_s: float, cause: str) -> None:
    found = likely_offset(reading(T0_S + offset_s + 3, T0_S + offset_s + 63), reading(T0_S, T0_S + 60))
    assert found is not None
    assert found[0] == offset_s
    assert cause in str(found[1])


def test_offset__leap_seconds_show_in_short_recordings() -> None:
    found = likely_offset(reading(T0_S + 18, T0_S + 28), reading(T0_S, T0_S + 10))
    assert found is not None
    assert (found[0], str(found[1])) == (18.0, "leap seconds: GPS time taken for UTC")


def test_offset__none_where_nothing_usual_fits() -> None:
    assert likely_offset(reading(T0_S + 5000, T0_S + 5060), reading(T0_S, T0_S + 60)) is None


@given(st.integers(-14, 14).filter(bool), st.floats(60, 1500), st.floats(0, 0.4))
def test_offset__whole_hours_are_found_whatever_the_lengths(hours: int, length_s: float, late: float) -> None:
    shift_s = 3600.0 * hours + late * length_s
    found = likely_offset(reading(T0_S + shift_s, T0_S + shift_s + length_s), reading(T0_S, T0_S + length_s))
    assert found is not None
    assert found[0] == 3600.0 * hours


@pytest.mark.parametrize("hours", [-9, 9])
def test_offset__of_recordings_of_hours_is_the_one_with_the_largest_overlap(hours: int) -> None:
    """Five hours overlap in part with eight other whole hours too."""
    found = likely_offset(reading(T0_S + 3600.0 * hours, T0_S + 3600.0 * (hours + 5)), reading(T0_S, T0_S + 18_000.0))
    assert found is not None
    assert found[0] == 3600.0 * hours


def pose_csv(path: Path, first_s: float, last_s: float) -> Path:
    rows = "".join(
        f"{first_s + i * 0.1:.1f},16650,96560,271,0,0,90\n" for i in range(round((last_s - first_s) * 10) + 1)
    )
    path.write_text("time_unix_s,e_m,n_m,h_m,roll_deg,pitch_deg,heading_deg\n" + rows)
    return path


def test_matches__scans_and_positions_are_set_against_each_other(shared_data: Path, tmp_path: Path) -> None:
    """The capture's GPS time is 2016-01-21T08:18:02.341Z to .728Z, as its README has it."""
    scans_s = 1_453_364_282.341
    capture = Examined.read(shared_data / "velodyne" / "vlp16_single_gps.pcap")
    together = Examined.read(pose_csv(tmp_path / "together.csv", scans_s - 10, scans_s + 10))
    local = Examined.read(pose_csv(tmp_path / "local.csv", scans_s - 10 + 32_400, scans_s + 10 + 32_400))
    fits, apart = time_matches([capture, together, local])
    assert (fits.scans, fits.positions) == (capture.path, together.path)
    assert fits.shared_s == pytest.approx(0.3875, abs=0.002)
    assert fits.offset_s is None
    assert "100%" in str(fits.text)
    assert apart.shared_s == pytest.approx(-(32_400 - 10 - 0.3875), abs=0.2)
    assert apart.offset_s == -32_400
    assert "lidar_minus_gnss_s = -32400.0" in str(apart.text)
