"""Real task data: what an independent decoder found in them, and what is unusual in each."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
import shapely
from isoxml.converter.shapely_geom import ShapelyConverterV4
from isoxml.util.isoxml_io import isoxml_from_path
from pyproj import Geod

from furrowmap.core.readers.isoxml.log import LoggedTask, read_tasks, whole_width_m
from furrowmap.core.readers.reader import Recognised
from furrowmap.core.runtime.errors import InputError
from furrowmap.core.values.tool_states import ToolState

HARVEST = "isoxml/field_days/harvest_21_fields"
RECORDS = (4716, 4135, 1599, 2496, 1785, 187 + 3883, 4952, 4497, 3433, 2956, 6359, 1877, 2484 + 1053, 2416, 5092, 1525,
           2797, 2088, 984)  # fmt: skip
COUNTED_M2 = (48300, 40500, 19500, 30100, 17900, 52000, 65000, 48200, 50800, 49000, 80000, 13900, 45900, 17900, 61600,
              13400, 27300, 22000, 7500)  # fmt: skip


def tasks_of(path: Path) -> list[LoggedTask]:
    return read_tasks(path)[1]


def codes(task: LoggedTask) -> set[str]:
    return {notice.code for notice in task.notices}


def test_harvest__is_what_the_independent_decoder_found(shared_data: Path) -> None:
    tasks = tasks_of(shared_data / HARVEST)
    assert tuple(len(task.track) for task in tasks) == RECORDS
    assert sum(RECORDS) == 61_314
    assert tuple(task.counted_m2 for task in tasks) == COUNTED_M2
    assert whole_width_m(tasks) == 9.0
    assert all(codes(task) == {"local-time", "quality-unknown"} for task in tasks)
    for task in tasks:
        lasts_s = task.states.end_s - task.states.begin_s
        step_s = np.diff(task.track.t_s, append=np.nan)
        down = (task.state == ToolState.DOWN) & (step_s <= 15.0)
        assert lasts_s[task.states.state == ToolState.DOWN].sum() == pytest.approx(step_s[down].sum())


def test_harvest__has_the_fields_that_another_reader_sees(shared_data: Path) -> None:
    content, _ = read_tasks(shared_data / HARVEST, "TSK1")
    theirs, _ = isoxml_from_path(shared_data / HARVEST, read_bin_files=False)
    converter = ShapelyConverterV4()
    assert list(content.partfields) == [field.id for field in theirs.partfields]
    for field in theirs.partfields:
        ours = content.partfields[field.id]
        assert ours.boundary is not None
        (polygon,) = (converter.to_shapely_polygon(polygon) for polygon in field.polygons)
        assert shapely.equals(ours.boundary, polygon)
    assert sum(map(area_m2, (f.boundary for f in content.partfields.values()))) == pytest.approx(694_000, rel=0.02)


def area_m2(shape: shapely.Geometry | None) -> float:
    assert shape is not None
    return float(abs(Geod(ellps="WGS84").geometry_area_perimeter(shapely.orient_polygons(shape))[0]))


def test_tillage__two_fields_with_holes(shared_data: Path) -> None:
    tasks = tasks_of(shared_data / "isoxml/field_days/tillage_two_fields_holes.zip")
    assert [len(task.track) for task in tasks] == [8599, 3863]
    assert [task.counted_m2 for task in tasks] == [80_652, 63_466]
    areas = [area_m2(task.field.boundary) for task in tasks if task.field is not None]
    assert areas == pytest.approx([82_901, 65_279], abs=1.0)
    holes = [
        shapely.get_num_interior_rings(part) for t in tasks if t.field for part in shapely.get_parts(t.field.boundary)
    ]
    assert sum(holes) == 2
    assert whole_width_m(tasks) == 10.0
    assert all("sections-contradicted" in codes(task) for task in tasks)


def test_sprayer__states_and_widths_of_its_sections(shared_data: Path) -> None:
    (task,) = tasks_of(shared_data / "isoxml/field_days/sprayer_and_sections/agco_jd_sprayer900_2014.zip")
    assert whole_width_m([task]) == 30.0  # seven sections of 3 m and two of 4.5 m
    assert set(task.width_m[task.state == ToolState.DOWN].tolist()) >= {6.0, 13.5, 30.0}
    assert np.all(task.width_m[task.state == ToolState.UP] == 0.0)
    assert task.counted_m2 == 10_811
    assert set(task.track.fix.tolist()) == {4}
    assert task.local_minus_utc_s == pytest.approx(7058.5, abs=0.1)
    assert "clock-by-gps" in codes(task)
    assert task.track.lat_deg[0] == pytest.approx(41.850, abs=0.002)


def test_sprayer__simulated_positions_and_a_gps_time_that_cannot_be(shared_data: Path) -> None:
    (task,) = tasks_of(shared_data / "isoxml/field_days/sprayer_and_sections/agco_microtrak_2016.zip")
    assert codes(task) >= {"gps-time-unused", "local-time", "positions-missing"}
    assert np.isnan(task.local_minus_utc_s)
    assert task.counted_m2 == pytest.approx(8966, abs=10)


def test_zone__of_a_clock_that_comes_from_the_tasks_times(shared_data: Path) -> None:
    local_s = {t.id: t.local_minus_utc_s for t in tasks_of(shared_data / "isoxml/other/no_status_position_jumps.zip")}
    assert {local_s[name] for name in ("TSK-6", "TSK-8", "TSK-9", "TSK-14", "TSK-22")} == {-18_000.0}
    (transport,) = tasks_of(shared_data / "isoxml/other/transport_totals_2022.zip")
    assert transport.local_minus_utc_s == 7200.0


def test_transport__never_works(shared_data: Path) -> None:
    (task,) = tasks_of(shared_data / "isoxml/other/transport_totals_2022.zip")
    assert len(task.track) == 314 + 27 + 4336
    assert not (task.states.state == ToolState.DOWN).any()
    assert whole_width_m([task]) == 12.0


def test_external_files__are_read_in_their_places(shared_data: Path) -> None:
    content, (task,) = read_tasks(shared_data / "isoxml/other/external_files_linklist_2021.zip")
    assert len(content.partfields) == 15
    assert task.field is not None
    assert (task.field.id, len(task.track)) == ("PFD9", 207)
    assert content.notices == ()


def test_mac__its_own_files_are_passed_over(shared_data: Path) -> None:
    (mac,) = tasks_of(shared_data / "isoxml/other/mac_resource_forks.zip")
    (plain,) = tasks_of(shared_data / "isoxml/other/single_dpd.zip")
    assert np.array_equal(mac.track.lon_deg, plain.track.lon_deg)


def test_damaged_archive__is_read_and_its_damage_reported(shared_data: Path) -> None:
    content, tasks = read_tasks(shared_data / "isoxml/hostile/corrupt_zip_and_bad_positions.zip")
    assert ["500,000 foreign bytes" in notice.text for notice in content.notices] == [True]
    by_log = {log: task for task in tasks for log in task.logs}
    assert "time-log-damaged" in codes(by_log["TLG0006"])
    assert "time-log-damaged" in codes(by_log["TLG0007"])
    for task in tasks:
        place = np.column_stack([task.track.lat_deg, task.track.lon_deg])
        assert np.all(np.abs(place - np.median(place, axis=0)) < 0.2), task.id  # none of 206,637 km
    missing = next(notice for notice in by_log["TLG0008"].notices if notice.code == "positions-missing")
    assert "4700 of 14218" in missing.text


@pytest.mark.parametrize(
    ("name", "code", "word"),
    [
        ("hostile/not_a_zip.zip", "task-data-missing", "LINKLIST.xml"),
        ("hostile/broken_headers", "task-data-missing", "TLG00001.xml"),
    ],
)
def test_hostile__is_refused_by_name(shared_data: Path, name: str, code: str, word: str) -> None:
    with pytest.raises(InputError) as error:
        Recognised.by_content(shared_data / "isoxml" / name).inspect()
    assert error.value.code == code
    assert word in error.value.what


def test_two_sets__of_the_same_main_file_are_one(shared_data: Path) -> None:
    answer = Recognised.by_content(shared_data / "isoxml/hostile/two_taskdata.zip").inspect()
    assert [notice.code for notice in answer.notices] == ["task-data-copies"]
    assert "task2" in answer.notices[0].text


def test_every_sample__is_inspected_or_refused(shared_data: Path) -> None:
    refused, read = [], 0
    for path in [shared_data / HARVEST, *sorted((shared_data / "isoxml").rglob("*.zip"))]:
        try:
            answer = Recognised.by_content(path).inspect()
        except InputError as error:
            refused.append((path.stem, error.lines))
            continue
        read += 1
        assert answer.facts["tasks"] or path.stem == "two_taskdata"
        assert all(clock.first_s <= clock.last_s for clock in answer.clocks)
    assert read == 11
    assert {name for name, _ in refused} == {"not_a_zip"}
    assert all(all(lines) for _, lines in refused)


def test_a_lost_time_log__is_reported_and_the_others_read(shared_data: Path, tmp_path: Path) -> None:
    folder = tmp_path / "TASKDATA"
    folder.mkdir()
    for name in ("TASKDATA.XML", "TLG00006.xml", "TLG00006.bin", "TLG00007.bin"):
        shutil.copyfile(shared_data / HARVEST / name, folder / name)
    broken = (shared_data / "isoxml/hostile/broken_headers/TLG00003.xml").read_bytes()
    (folder / "TLG00007.xml").write_bytes(broken)
    _, (task,) = read_tasks(folder, "TSK6")
    assert len(task.track) == 187
    lost = next(notice for notice in task.notices if notice.code == "time-log-lost")
    assert "TLG00007.xml, line 30" in lost.text
