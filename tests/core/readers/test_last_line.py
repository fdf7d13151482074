"""A file cut at any byte never gives a number that is not in the whole file."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from furrowmap.core.readers.csv_file import is_whole
from furrowmap.core.readers.nmea.log import NmeaLog
from furrowmap.core.readers.poses.csv import PoseCsv
from furrowmap.core.readers.reader import ReadOptions
from furrowmap.core.readers.rtklib.pos import RtklibPos
from furrowmap.core.readers.states_csv import StatesCsv
from furrowmap.core.runtime.errors import InputError

ROWS = 12


def first_lines(path: Path, keep: int) -> bytes:
    return b"".join(path.read_bytes().splitlines(keepends=True)[:keep])


def test_promise_11__a_trajectory_cut_at_any_byte_of_its_last_row_states_no_other_number(
    shared_data: Path, tmp_path: Path
) -> None:
    data = first_lines(shared_data / "tractor_loop/truth/trajectory.csv", ROWS + 1)
    path = tmp_path / "trajectory.csv"
    path.write_bytes(data)
    whole = PoseCsv([path], ReadOptions()).poses()
    row = data.rindex(b"\n", 0, -1) + 1
    for end in range(row + 1, len(data) + 1):
        path.write_bytes(data[:end])
        reader = PoseCsv([path], ReadOptions())
        found = reader.poses()
        np.testing.assert_array_equal(found.position, whole.position[: len(found)])
        np.testing.assert_array_equal(found.heading_deg, whole.heading_deg[: len(found)])
        assert len(found) >= ROWS - 1
        if len(found) < ROWS:
            assert [notice.code for notice in reader.notices] == ["last-line-cut"]
        else:
            assert end >= len(data) - 1


@pytest.mark.parametrize("name", ["gnss/pos/static_rtk.pos", "gnss/pos/car_f9p_rtklibpy_weektow.pos"])
def test_promise_11__a_solution_cut_at_any_byte_of_its_last_row_states_no_other_number(
    name: str, shared_data: Path, tmp_path: Path
) -> None:
    data = first_lines(shared_data / name, 60)
    path = tmp_path / "solution.pos"
    path.write_bytes(data)
    whole = RtklibPos([path], ReadOptions()).track()
    row = data.rindex(b"\n", 0, -1) + 1
    for end in range(row + 1, len(data) + 1):
        path.write_bytes(data[:end])
        reader = RtklibPos([path], ReadOptions())
        found = reader.track()
        for column in ("t_s", "lon_deg", "lat_deg", "height_m", "sigma_e_m", "age_s", "speed_mps"):
            np.testing.assert_array_equal(getattr(found, column), getattr(whole, column)[: len(found)])
        if len(found) < len(whole):
            assert "lines-damaged" in {notice.code for notice in reader.notices}


def test_promise_11__a_log_of_nmea_cut_at_any_byte_states_no_other_number(shared_data: Path, tmp_path: Path) -> None:
    data = first_lines(shared_data / "tractor_loop/gnss.nmea", 36)
    path = tmp_path / "gnss.nmea"
    path.write_bytes(data)
    whole = NmeaLog([path], ReadOptions()).track()
    for end in range(len(data) - 200, len(data)):
        path.write_bytes(data[:end])
        found = NmeaLog([path], ReadOptions()).track()
        np.testing.assert_array_equal(found.height_m, whole.height_m[: len(found)])
        np.testing.assert_array_equal(found.lon_deg, whole.lon_deg[: len(found)])


@pytest.mark.parametrize(
    ("header", "rows"),
    [
        ("time,state", ["2026-06-11T01:00:00Z,down", "2026-06-11T01:05:00Z,up"]),
        ("state,t_s", ["down,1781141000.00", "up,1781141300.00", "down,1781141600.00"]),
        ("t_s,state,confidence", ["1781141000,down,0.95", "1781141300,up,0.95"]),
    ],
)
def test_promise_11__states_cut_at_any_byte_of_their_last_row(header: str, rows: list[str], tmp_path: Path) -> None:
    data = "\n".join([header, *rows, ""]).encode()
    path = tmp_path / "states.csv"
    path.write_bytes(data)
    whole = StatesCsv([path], ReadOptions()).states()
    for end in range(data.rindex(b"\n", 0, -1) + 2, len(data) + 1):
        path.write_bytes(data[:end])
        reader = StatesCsv([path], ReadOptions())
        try:
            found = reader.states()
        except InputError as error:
            assert error.code == "states-unreadable"  # noqa: PT017 (not every cut is refused)
            continue
        np.testing.assert_array_equal(found.begin_s, whole.begin_s[: len(found)])
        np.testing.assert_array_equal(found.confidence, whole.confidence[: len(found)])
        assert len(found) == len(whole) or [notice.code for notice in reader.notices] == ["last-line-cut"]


@given(values=st.lists(st.floats(-1e6, 1e6), min_size=2, max_size=12), decimals=st.integers(1, 6), data=st.data())
def test_is_whole__only_uncut_lines_of_fixed_decimals(values: list[float], decimals: int, data: st.DataObject) -> None:
    lines = [b"1,%.*f" % (decimals, value) for value in values]
    cut = data.draw(st.integers(0, len(lines[-1])))
    assert is_whole(lines[-1][:cut], lines[:-1]) == (cut == len(lines[-1]))
