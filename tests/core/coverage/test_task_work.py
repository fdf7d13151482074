"""The ground worked by a machine's own log, against another decoder, the machine's counter and the boundaries."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import shapely

from furrowmap.core.coverage.task_work import TaskWorks, task_works
from furrowmap.core.runtime.errors import InputError
from tests.core.readers.isoxml.time_logs import Record, header, task_data

UNION_M2 = {
    "TSK1": 43145, "TSK2": 36437, "TSK3": 17454, "TSK4": 26690, "TSK5": 15860, "TSK6": 2132 + 40158, "TSK7": 57386,
    "TSK8": 42497, "TSK10": 44990, "TSK11": 43058, "TSK12": 69342, "TSK13": 10557, "TSK14": 26093 + 13759,
    "TSK15": 14834, "TSK16": 52575, "TSK17": 12059, "TSK18": 23290, "TSK19": 19683, "TSK20": 6178,
}  # fmt: skip
"""Swaths with square ends while working, united for each log: the two of TSK6 and of TSK14 are added up."""


@pytest.fixture(scope="module")
def harvest(shared_data: Path) -> TaskWorks:
    return task_works(shared_data / "isoxml/field_days/harvest_21_fields")


def test_harvest__the_union_is_within_a_percent(harvest: TaskWorks) -> None:
    worked = {w.task.id: w.work.ground.figures.worked.ellipsoid_m2 for w in harvest.works if w.work.ground is not None}
    assert worked.keys() == UNION_M2.keys()
    assert sum(worked.values()) == pytest.approx(618_176, rel=0.01)
    for task, expected in UNION_M2.items():
        assert worked[task] == pytest.approx(expected, rel=0.02), task


def test_harvest__the_counter_is_way_times_width(harvest: TaskWorks) -> None:
    """The machine's counter counts overlap twice, and only as much of the header as had a crop to cut."""
    assert sum(work.task.counted_m2 for work in harvest.works) == 710_800
    assert sum(work.logged_swept_m2 for work in harvest.works) == pytest.approx(710_800, rel=0.002)
    for work in harvest.works:
        assert work.work.ground is not None
        figures = work.work.ground.figures
        assert work.logged_swept_m2 <= figures.swept_m2
        twice = figures.swept_m2 - figures.worked.grid_m2
        assert twice == pytest.approx(figures.overlap.grid_m2, rel=0.35)


def test_harvest__lies_in_its_fields(harvest: TaskWorks) -> None:
    assert sum(work.boundary_area_m2 for work in harvest.works) == pytest.approx(637_495, rel=0.0005)
    for work in harvest.works:
        assert work.work.ground is not None
        assert work.work.boundary is not None
        inside = work.work.ground.coverage.intersection(work.work.boundary).area
        assert inside > 0.85 * work.work.ground.coverage.area
    assert harvest.frame.name == "EPSG:25832"


def test_tillage__gives_the_working_way_of_the_readme(shared_data: Path) -> None:
    works = task_works(shared_data / "isoxml/field_days/tillage_two_fields_holes.zip").works
    figures = [work.work.ground.figures for work in works if work.work.ground is not None]
    assert [f.length_m / 1000.0 for f in figures] == pytest.approx([8.26, 6.51], abs=0.02)
    assert [f.worked.ellipsoid_m2 for f in figures] == pytest.approx([82_901, 65_279], rel=0.01)  # its boundaries


def test_transport__worked_nothing(shared_data: Path) -> None:
    (work,) = task_works(shared_data / "isoxml/other/transport_totals_2022.zip").works
    assert work.work.ground is not None
    assert work.work.ground.figures.worked.grid_m2 == 0.0
    assert work.work.ground.figures.passes == 0


def test_unknown_state__is_not_told_as_nothing_worked(shared_data: Path) -> None:
    (work,) = task_works(shared_data / "isoxml/other/external_files_linklist_2021.zip", width_m=3.0).works
    assert work.work.ground is None
    assert "state-unknown" in {notice.code for notice in work.notices}


def test_unknown_width__is_asked_for(shared_data: Path) -> None:
    with pytest.raises(InputError) as error:
        task_works(shared_data / "isoxml/hostile/corrupt_zip_and_bad_positions.zip")
    assert error.value.code == "width-unknown"
    works = task_works(shared_data / "isoxml/hostile/corrupt_zip_and_bad_positions.zip", width_m=2.0, only="TSK3").works
    assert works[0].work.ground is not None
    assert works[0].work.ground.figures.worked.grid_m2 < 2.0 * 50_000.0


def test_jumps__to_another_continent_make_no_way(shared_data: Path) -> None:
    found = task_works(shared_data / "isoxml/other/no_status_position_jumps.zip")
    left_out = [notice for notice in found.notices if notice.code == "task-left-out"]
    assert left_out
    for work in found.works:
        steps_m = np.hypot(*np.diff(work.course.trajectory.xyz_m[:, :2], axis=0).T)
        assert steps_m.max(initial=0.0) < 1000.0, work.task.id


@pytest.mark.parametrize("width_mm", [3000, 9000])
def test_a_straight_run__is_its_length_times_its_width(tmp_path: Path, width_mm: int) -> None:
    """600 m due north at 2 m/s, down for the middle 400 m: the degree of latitude is 111.2 km at 50°."""
    step = round(2.0 / 111_229.0 * 1e7)
    records = [
        Record(
            36_000_000 + 1000 * k,
            15_000,
            {"A": 500_000_000 + step * k, "B": 100_000_000, "D": 4},
            {0: int(50 <= k < 250)} | ({1: width_mm} if k == 0 else {}),
        )
        for k in range(301)
    ]
    body = '<TSK A="TSK1" B="run" G="4"><TLG A="TLG00001" C="1"/></TSK>'
    log = (header([(141, "DET-1"), (67, "DET-1")]), b"".join(record.pack() for record in records))
    (work,) = task_works(task_data(tmp_path / "TASKDATA", body, {"TLG00001": log})).works
    assert work.work.ground is not None
    worked = work.work.ground.figures.worked
    assert worked.ellipsoid_m2 == pytest.approx(400.0 * width_mm / 1000.0, rel=0.002)
    assert worked.sigma_m2 > 0.0
    assert shapely.get_num_geometries(work.work.ground.coverage) == 1
    assert work.logged_swept_m2 == pytest.approx(worked.ellipsoid_m2, rel=0.002)


def passes(folder: Path, *, width_mm: int = 1700, corner: str = "141.341", jump_s: int = 0) -> Path:
    """Task data of three passes at one record a second; one record has another width, the second half comes later."""
    rows, lat, lon = [], 43.05, 141.34
    for k in range(120):
        lat, lon = lat + 1e-5 * (1 - 2 * (k // 40 % 2)), lon + 2e-5 * (k % 40 == 39)
        place = {"A": int(lat * 1e7), "B": int(lon * 1e7), "D": 4}
        day, since_s = divmod(29_000 + k + jump_s * (k >= 50), 86_400)
        width = width_mm if k == 60 else 1700
        rows.append(Record(1000 * since_s, 16967 + day, place, {0: int(k % 40 < 30), 1: width}))
    corners = [("43.049", "141.339"), ("43.049", corner), ("43.051", "141.341")]
    ring = "".join(f'<PNT A="2" C="{lat}" D="{lon}"/>' for lat, lon in corners)
    body = (
        '<TSK A="TSK1" G="4" E="PFD1"><TLG A="TLG00001"/></TSK><DVC A="DVC1"><DET A="DET-1" B="1" C="1"/></DVC>'
        f'<PFD A="PFD1" C="north"><PLN A="1"><LSG A="1">{ring}</LSG></PLN></PFD>'
    )
    head = header([(141, "DET-1"), (67, "DET-1")])
    return task_data(folder / "TASKDATA", body, {"TLG00001": (head, b"".join(row.pack() for row in rows))})


@pytest.mark.parametrize("width_mm", [2**31 - 1, 100_001, -1])
def test_promise_14__a_width_of_no_machine_is_unknown(tmp_path: Path, width_mm: int) -> None:
    right = task_works(passes(tmp_path / "right")).works[0]
    (work,) = task_works(passes(tmp_path, width_mm=width_mm)).works
    assert work.implement.width_m == right.implement.width_m == 1.7
    assert work.work.ground is not None
    assert right.work.ground is not None
    assert work.work.ground.figures.worked == right.work.ground.figures.worked
    assert {n.code for n in work.notices} - {n.code for n in right.notices} == {"width-implausible"}
    with pytest.raises(InputError) as refused:
        task_works(tmp_path / "TASKDATA", width_m=2000.0)
    assert refused.value.code == "width-implausible"


def test_promise_24__a_boundary_with_a_corner_far_away_is_dropped(tmp_path: Path) -> None:
    (work,) = task_works(passes(tmp_path, corner="0.0")).works
    assert work.work.boundary is None
    assert "boundary-ring" in {notice.code for notice in work.notices} | {n.code for n in task_works(tmp_path).notices}


@pytest.mark.parametrize("jump_s", [4 * 86_400, 300 * 86_400])
def test_promise_13__a_jump_of_the_clock_is_a_gap_that_is_not_filled(tmp_path: Path, jump_s: int) -> None:
    (work,) = task_works(passes(tmp_path, jump_s=jump_s)).works
    assert len(work.course.trajectory.t_s) == 120
    assert work.work.ground is not None
    assert work.work.ground.figures.worked.grid_m2 < 2.0 * 1.7 * 120
    np.testing.assert_allclose(np.diff(work.course.trajectory.gaps_s), jump_s + 1.0)
