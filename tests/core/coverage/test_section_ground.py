"""The ground that sections work, against exact polygons of simulated tasks and a plain sum over a real log."""

from __future__ import annotations

import struct
import zipfile
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import pytest
import shapely

from furrowmap.core.coverage.task_work import TaskWorks, task_works
from tests.core.coverage.section_tasks import CRS, TASKS, Simulated, drawn_drill

AREA_SHARE = 0.005
OVERLAP_SHARE_OF_FIELD = 0.002


@pytest.fixture(scope="module", params=list(TASKS))
def task(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[Simulated, TaskWorks]:
    simulated = TASKS[request.param](tmp_path_factory.mktemp("sections") / "TASKDATA")
    return simulated, task_works(simulated.folder, crs=CRS)


def test_ground__of_each_task_is_that_of_the_exact_polygons(task: tuple[Simulated, TaskWorks]) -> None:
    simulated, found = task
    assert len(found.works) == len(simulated.worked)
    for work, truth in zip(found.works, simulated.worked, strict=True):
        ground = work.work.ground
        assert ground is not None
        assert ground.figures.passes == len(truth.passes)
        assert ground.figures.worked.grid_m2 == pytest.approx(truth.area_m2, rel=AREA_SHARE)
        assert ground.coverage.symmetric_difference(shapely.union_all(truth.passes)).area < AREA_SHARE * truth.area_m2
        missing_m2 = ground.figures.overlap.grid_m2 - truth.overlap_m2
        assert abs(missing_m2) < OVERLAP_SHARE_OF_FIELD * simulated.field_m.area
        swept_m2 = sum(one.swept_m2 for one in ground.passes)
        assert swept_m2 == pytest.approx(truth.area_m2 + truth.overlap_m2, rel=AREA_SHARE)
        assert work.logged_swept_m2 == pytest.approx(swept_m2, rel=AREA_SHARE)
        assert work.implement.width_m == pytest.approx(simulated.width_m)


def test_ground__of_the_whole_width_is_another(task: tuple[Simulated, TaskWorks]) -> None:
    """What the test above shows: without their sections these tasks are wrong by more than is allowed."""
    simulated, _ = task
    found = task_works(simulated.folder, crs=CRS, width_m=simulated.width_m)
    for work, truth in zip(found.works, simulated.worked, strict=True):
        assert work.work.ground is not None
        figures = work.work.ground.figures
        off = abs(figures.worked.grid_m2 / truth.area_m2 - 1.0) / AREA_SHARE
        allowed_m2 = OVERLAP_SHARE_OF_FIELD * simulated.field_m.area
        assert max(off, abs(figures.overlap.grid_m2 - truth.overlap_m2) / allowed_m2) > 1.0
        assert "sections-unused" in {notice.code for notice in work.notices}


def test_machines__that_no_connection_names_are_joined_where_that_must_be(tmp_path: Path) -> None:
    simulated = drawn_drill(tmp_path / "TASKDATA", is_connected=False)
    for work, truth in zip(task_works(simulated.folder, crs=CRS).works, simulated.worked, strict=True):
        assert work.work.ground is not None
        assert work.work.ground.figures.worked.grid_m2 == pytest.approx(truth.area_m2, rel=AREA_SHARE)
        assert "connection-assumed" in {notice.code for notice in work.notices}


def decoded(path: Path) -> dict[str, tuple[float, float]]:
    """Of each section of a sprayer's log its width, and the way on which it was on: a decoder of its own.

    Between two records no more than 15 s apart the vehicle goes straight, and the states are those of the first. In the
    last minute but one the log's positions jump 230 m within a second: it ends there.
    """
    sections: dict[str, tuple[float, float]] = {}
    with zipfile.ZipFile(path) as archive:
        names = sorted(name for name in archive.namelist() if name.upper().endswith(".BIN") and "TLG" in name.upper())
        for name in names:
            channels = [
                (int(item.get("A", ""), 16), item.get("C", ""))
                for item in ET.fromstring(archive.read(name[:-4] + ".xml")).iter("DLV")
            ]
            data, at = archive.read(name), 0
            before: tuple[float, float, float] | None = None
            on: dict[str, int] = {}
            width_m: dict[str, float] = {}
            while at + 33 <= len(data):
                millis, day, north, east, _, status, _, _, _, _, _ = struct.unpack_from("<IHiiiBHHBIH", data, at)
                at += struct.calcsize("<IHiiiBHHBIH")
                t_s, here = millis / 1000 + 86_400 * day, status not in (0, 14) and (north, east) != (0, 0)
                if here:
                    lat, lon = 1e-7 * north, 1e-7 * east
                    if before is not None and t_s - before[0] <= 15.0:
                        metres = 111_132.0 * (lat - before[1]), 111_320.0 * np.cos(np.radians(lat)) * (lon - before[2])
                        if np.hypot(*metres) > 10.0:
                            return sections
                        for element, state in on.items():
                            width, way = sections.get(element, (0.0, 0.0))
                            sections[element] = (width_m.get(element, width), way + state * float(np.hypot(*metres)))
                    before = t_s, lat, lon
                count, at = data[at], at + 1
                for k in range(at, at + 5 * count, 5):
                    channel, value = struct.unpack_from("<Bi", data, k)
                    ddi, element = channels[channel]
                    if ddi == 141:
                        on[element] = int(value == 1)
                    elif ddi == 67:
                        width_m[element] = value / 1000
                at += 5 * count
    return sections


def test_real_sprayer__works_as_its_log_adds_up(shared_data: Path) -> None:
    """Nine sections, 30 m: width times way of each while it is on, summed by another decoder."""
    path = shared_data / "isoxml/field_days/sprayer_and_sections/agco_jd_sprayer900_2014.zip"
    sections = decoded(path)
    assert len(sections) == 9
    swept_m2 = sum(width_m * way_m for width_m, way_m in sections.values())
    (work,) = task_works(path).works
    assert work.work.ground is not None
    figures = work.work.ground.figures
    assert work.implement.width_m == 30.0
    assert figures.swept_m2 == pytest.approx(swept_m2, rel=0.01)
    assert work.logged_swept_m2 == pytest.approx(swept_m2, rel=0.01)
    assert figures.swept_m2 - figures.overlap.grid_m2 == pytest.approx(figures.worked.grid_m2, rel=0.01)
    at_full_width_m2 = task_works(path, width_m=30.0).works[0].work.ground
    assert at_full_width_m2 is not None
    assert at_full_width_m2.figures.swept_m2 > 1.2 * swept_m2
