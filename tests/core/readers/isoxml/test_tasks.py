"""Tasks of small task data: their fixes, clocks, states and widths."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from furrowmap.core.readers.isoxml.log import LoggedTask, TaskDataLog, read_tasks, whole_width_m
from furrowmap.core.readers.reader import ReadOptions
from furrowmap.core.values.gnss import Fix
from furrowmap.core.values.tool_states import ToolState
from tests.core.readers.isoxml.time_logs import Record, header, task_data

STATE, WIDTH, CONDENSED, AREA = 141, 67, 161, 116
"""Numbers of ISO 11783-11's data dictionary."""
DAY = 15_000
NOON_S = 315_532_800 + 86_400 * DAY + 43_200


def task_of(
    folder: Path, records: list[Record], channels: list[tuple[int, str]], letters: str = "ABD", **xml: str
) -> LoggedTask:
    body = f'<TSK A="TSK1" B="run" G="4">{xml.get("times", "")}<TLG A="TLG00001"/></TSK>{xml.get("device", "")}'
    log = (header(channels, letters), b"".join(record.pack() for record in records))
    (task,) = read_tasks(task_data(folder, body, {"TLG00001": log}))[1]
    return task


def at(second: float, values: dict[int, int] | None = None, **position: int) -> Record:
    place = {"A": 500_000_000 + round(10 * second), "B": 100_000_000, "D": 4} | position
    return Record(round(1000 * (43_200 + second)), DAY, place, values or {})


def codes(task: LoggedTask) -> list[str]:
    return [notice.code for notice in task.notices]


@pytest.mark.parametrize(
    ("status", "fix", "is_stated"),
    [
        (1, Fix.SINGLE, True),
        (2, Fix.DGPS, True),
        (3, Fix.PPS, True),
        (4, Fix.FIXED, True),
        (5, Fix.FLOAT, True),
        (6, Fix.ESTIMATED, True),
        (7, Fix.MANUAL, True),
        (8, Fix.SIMULATED, True),
        (9, Fix.SINGLE, False),
        (14, Fix.SINGLE, False),
        (15, Fix.SINGLE, False),
    ],
)
def test_status__is_the_method_of_nmea_2000(status: int, fix: Fix, is_stated: bool, tmp_path: Path) -> None:
    task = task_of(tmp_path, [at(k, D=status if k == 1 else 4) for k in range(3)], [(STATE, "DET-1")])
    assert task.track.fix.tolist() == [Fix.FIXED, fix, Fix.FIXED]
    assert codes(task) == ["local-time", *([] if is_stated else ["quality-unknown"])]


@pytest.mark.parametrize(
    ("ahead_s", "used_s", "code"),
    [
        (0.0, 0.0, None),
        (1.9, 1.9, None),
        (-1.9, -1.9, None),
        (2.1, 2.1, "clock-by-gps"),
        (-2.1, -2.1, "clock-by-gps"),
        (53_999.0, 53_999.0, "clock-by-gps"),
        (-53_999.0, -53_999.0, "clock-by-gps"),
        (54_001.0, 0.0, "gps-time-unused"),
        (-54_001.0, 0.0, "gps-time-unused"),
    ],
)
def test_clock__is_corrected_by_gps_times_up_to_fifteen_hours_off(
    ahead_s: float, used_s: float, code: str | None, tmp_path: Path
) -> None:
    """No time zone is further from UTC than 14 hours."""
    records = []
    for k in range(5):
        day, second = divmod(43_200 + k - ahead_s, 86_400)
        records.append(at(k, H=round(1000 * second), I=DAY + int(day)))
    task = task_of(tmp_path, records, [(STATE, "DET-1")], "ABDHI")
    assert task.track.t_s - NOON_S == pytest.approx(np.arange(5) - used_s, abs=1e-6)
    assert (codes(task) == []) if code is None else (code in codes(task))
    assert ("local-time" in codes(task)) is (code == "gps-time-unused")


@pytest.mark.parametrize(
    ("begin", "local_s"),
    [
        ("2021-01-25T12:00:00+02:00", 7200.0),
        ("2021-01-25T12:14:00+02:00", 7200.0),
        ("2021-01-25T11:46:00-09:30", -34_200.0),
        ("2021-01-25T10:05:00Z", 7200.0),
        ("2021-01-25T12:25:00+00:00", -1800.0),
        ("2021-01-25T12:00:00", None),
        ("noon", None),
    ],
)
def test_clock__is_corrected_by_the_zone_of_the_task(begin: str, local_s: float | None, tmp_path: Path) -> None:
    """Where the face of the clock fits within a quarter of an hour; else by the nearest quarter."""
    task = task_of(tmp_path, [at(k) for k in range(5)], [(STATE, "DET-1")], times=f'<TIM A="{begin}" D="4"/>')
    assert task.track.t_s[0] == NOON_S - (local_s or 0.0)
    assert codes(task) == (["local-time"] if local_s is None else [])
    np.testing.assert_equal(task.local_minus_utc_s, np.nan if local_s is None else local_s)


@pytest.mark.parametrize(
    ("raw", "state"),
    [(0, ToolState.UP), (1, ToolState.DOWN), (2, ToolState.UNKNOWN), (3, ToolState.UNKNOWN), (-1, ToolState.UNKNOWN)],
)
def test_states__of_work_are_on_and_off(raw: int, state: ToolState, tmp_path: Path) -> None:
    records = [at(k, {0: raw}) for k in range(4)]
    task = task_of(tmp_path, records, [(STATE, "DET-1")])
    assert set(task.state.tolist()) == {state}
    assert task.states.state.tolist() == ([] if state is ToolState.UNKNOWN else [state])


@pytest.mark.parametrize("section", [0, 1, 15])
@pytest.mark.parametrize(
    ("bits", "state"), [(0, ToolState.UP), (1, ToolState.DOWN), (2, ToolState.UP), (3, ToolState.UP)]
)
def test_states__of_sixteen_sections_have_two_bits_each(
    bits: int, state: ToolState, section: int, tmp_path: Path
) -> None:
    """Off, on, error, not installed; the value is a signed number of 32 bits."""
    raw = bits << (2 * section)
    records = [at(k, {0: raw - (1 << 32) if raw >= 1 << 31 else raw}) for k in range(4)]
    assert set(task_of(tmp_path, records, [(CONDENSED, "DET-1")]).state.tolist()) == {state}


@pytest.mark.parametrize(
    ("width_mm", "width_m", "is_told"),
    [(100_000, 100.0, False), (100_001, np.nan, True), (1, 0.001, False), (-1, np.nan, True)],
)
def test_widths__from_0_to_100_metres(width_mm: int, width_m: float, is_told: bool, tmp_path: Path) -> None:
    task = task_of(tmp_path, [at(k, {0: 1, 1: width_mm}) for k in range(3)], [(STATE, "DET-1"), (WIDTH, "DET-1")])
    np.testing.assert_array_equal(task.width_m, [width_m] * 3)
    assert ("width-implausible" in codes(task)) is is_told
    np.testing.assert_equal(whole_width_m([task]), width_m)


def test_widths__of_working_sections_are_added_and_of_functions_the_largest_counts(tmp_path: Path) -> None:
    device = '<DVC A="DVC1"><DET A="DET1" B="1" C="{0}"/><DET A="DET2" B="2" C="{0}"/></DVC>'
    channels = [(STATE, "DET1"), (STATE, "DET2"), (WIDTH, "DET1"), (WIDTH, "DET2")]
    records = [at(0, {0: 1, 1: 1, 2: 3000, 3: 4500}), at(1, {1: 0}), at(2, {0: 0, 1: 1}), at(3, {0: 0, 1: 0})]
    sections = task_of(tmp_path / "1", records, channels, device=device.format("4"))
    assert sections.width_m.tolist() == [7.5, 3.0, 4.5, 0.0]
    functions = task_of(tmp_path / "2", records, channels, device=device.format("3"))
    assert functions.width_m.tolist() == [4.5] * 4
    assert whole_width_m([sections, functions]) == 7.5


def test_states__of_the_machine_are_off_where_its_width_is_0(tmp_path: Path) -> None:
    records = [at(0, {0: 1, 1: 3000}), at(1, {1: 0}), at(2, {1: 3000})]
    task = task_of(tmp_path, records, [(STATE, "DET-1"), (WIDTH, "DET-1")])
    assert task.state.tolist() == [ToolState.DOWN, ToolState.UP, ToolState.DOWN]


def test_counter__is_the_increase_of_the_whole_machine(tmp_path: Path) -> None:
    device = '<DVC A="DVC1"><DET A="DET1" B="1" C="1"/><DET A="DET2" B="2" C="3" F="1"/></DVC>'
    records = [at(0, {0: 100, 1: 500}), at(1, {0: 130, 1: 590}), at(2, {0: 180})]
    channels = [(AREA, "DET1"), (AREA, "DET2")]
    assert task_of(tmp_path / "1", records, channels, device=device).counted_m2 == 80.0
    assert task_of(tmp_path / "2", records, channels).counted_m2 == 90.0
    assert np.isnan(task_of(tmp_path / "3", [at(0), at(1)], channels).counted_m2)


@pytest.mark.parametrize("varies_s", [0.0, 0.3])
def test_positions__are_those_of_last_resort(varies_s: float, tmp_path: Path) -> None:
    """A straight drive at 2 m/s whose stamps vary: the standard deviations are those of its times."""
    chance = np.random.default_rng(4)
    late_s = varies_s * chance.standard_normal(600)
    metre = 90  # units of 1e-7 degrees of latitude
    records = [at(k + late_s[k], A=500_000_000 + 2 * metre * k) for k in range(600)]
    task_of(tmp_path, records, [(STATE, "DET-1")])
    reader = TaskDataLog([tmp_path], ReadOptions())
    track = reader.track()
    time_s = np.hypot(0.1, varies_s)
    assert np.median(track.sigma_e_m) == pytest.approx(np.hypot(0.015, 2.0 * time_s), rel=0.1)
    np.testing.assert_array_equal(track.sigma_e_m, track.sigma_n_m)
    (notice,) = [notice for notice in reader.notices if notice.code == "positions-of-terminal"]
    assert f"off by {time_s:.1f}" in notice.text
