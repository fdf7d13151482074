"""Several sets of task data in one folder or archive, and values that a header states for all records."""

from __future__ import annotations

import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from furrowmap.core.coverage.task_work import task_works
from furrowmap.core.readers.boundary_file import read_fields
from furrowmap.core.readers.isoxml.content import MAIN
from furrowmap.core.readers.isoxml.log import TaskDataLog, read_tasks
from furrowmap.core.readers.isoxml.time_log import read_time_log
from furrowmap.core.readers.reader import ReadOptions
from furrowmap.core.runtime.errors import InputError
from furrowmap.core.values.tool_states import ToolState
from tests.core.readers.isoxml.time_logs import Record, header, task_data

CHANNELS = [(141, "DET-1"), (67, "DET-1")]


def records(begin_s: int, values: dict[int, int], north: int = 0) -> bytes:
    """A minute northwards at 2 m/s, a record a second; the first has the values."""
    return b"".join(
        Record(
            1000 * (begin_s + k),
            15_000,
            {"A": 500_000_000 + north + 180 * k, "B": 100_000_000, "D": 4},
            values if k == 0 else {},
        ).pack()
        for k in range(61)
    )


def one_set(folder: Path, begin_s: int, field: str = "PFD1", lat: float = 50.0, log: bytes | None = None) -> Path:
    """A set of one task with a field."""
    ring = "".join(f'<PNT A="2" C="{lat + y}" D="{10.0 + x}"/>' for x, y in [(-0.001, 0), (0.001, 0), (0, 0.002)])
    body = (
        f'<PFD A="{field}" C="field of {folder.name}"><PLN A="1"><LSG A="1">{ring}</LSG></PLN></PFD>'
        f'<TSK A="TSK1" B="run" E="{field}" G="4"><TLG A="TLG00001"/></TSK>'
    )
    north = round((lat - 50.0) * 1e7)
    return task_data(folder, body, {"TLG00001": (header(CHANNELS), log or records(begin_s, {0: 1, 1: 6000}, north))})


def in_folder(folder: Path) -> Path:
    return folder


def in_archive(folder: Path) -> Path:
    path = folder.with_suffix(".zip")
    with zipfile.ZipFile(path, "w") as out:
        for file in sorted(folder.rglob("*")):
            if file.is_file():
                out.write(file, file.relative_to(folder))
    return path


@pytest.fixture(params=[in_folder, in_archive])
def packed(request: pytest.FixtureRequest) -> Callable[[Path], Path]:
    form: Callable[[Path], Path] = request.param
    return form


def test_sets__are_read_as_one_recording(tmp_path: Path, packed: Callable[[Path], Path]) -> None:
    """Two sets with the same ids: each task keeps its own field, and ids are told apart by the folder."""
    season = tmp_path / "season"
    one_set(season / "monday", 36_000)
    one_set(season / "tuesday", 40_000, lat=50.01)
    path = packed(season)
    content, tasks = read_tasks(path)
    assert [task.id for task in tasks] == ["monday/TSK1", "tuesday/TSK1"]
    assert [task.field.name for task in tasks if task.field] == ["field of monday", "field of tuesday"]
    assert list(content.partfields) == ["monday/PFD1", "tuesday/PFD1"]
    reader = TaskDataLog([path], ReadOptions())
    assert len(reader.track()) == 122
    assert (reader.states().state == ToolState.DOWN).sum() == 2
    assert list(reader.inspect().facts["tasks"]) == ["monday/TSK1", "tuesday/TSK1"]
    assert [work.task.id for work in task_works(path).works] == ["monday/TSK1", "tuesday/TSK1"]
    assert len(read_fields(path)[0]) == 2


def test_sets__a_log_that_a_later_set_has_again_is_read_once(tmp_path: Path, packed: Callable[[Path], Path]) -> None:
    season = tmp_path / "season"
    log = records(36_000, {0: 1, 1: 6000})
    one_set(season / "a", 36_000, log=log)
    one_set(season / "b", 36_000, field="PFD2", log=log)
    _, tasks = read_tasks(packed(season))
    assert [len(task.track) for task in tasks] == [61, 0]
    assert "time-log-copy" in {notice.code for notice in tasks[1].notices}


def test_sets__of_the_same_main_file_are_read_once(tmp_path: Path, packed: Callable[[Path], Path]) -> None:
    season = tmp_path / "season"
    text = (one_set(season / "a", 36_000) / MAIN).read_text(encoding="utf-8")
    (one_set(season / "copy of a", 36_000) / MAIN).write_text(text, encoding="utf-8")
    content, tasks = read_tasks(packed(season))
    assert [task.id for task in tasks] == ["a/TSK1"]
    assert [notice.code for notice in content.notices] == ["task-data-copies"]


def test_sets__one_that_cannot_be_read_is_left_out(tmp_path: Path, packed: Callable[[Path], Path]) -> None:
    season = tmp_path / "season"
    one_set(season / "a", 36_000)
    (one_set(season / "b", 40_000) / MAIN).write_text("<broken", encoding="utf-8")
    content, tasks = read_tasks(packed(season))
    assert [task.id for task in tasks] == ["a/TSK1"]
    assert [notice.code for notice in content.notices] == ["task-data-left-out"]
    (season / "a" / MAIN).write_text("<also broken", encoding="utf-8")
    with pytest.raises(InputError) as error:
        read_tasks(packed(season))
    assert error.value.code == "task-data-missing"
    assert "none of its 2 sets" in error.value.what


def test_sets__a_task_is_chosen_in_all_of_them(tmp_path: Path) -> None:
    one_set(tmp_path / "a", 36_000)
    one_set(tmp_path / "b", 40_000, lat=50.01)
    assert [task.id for task in read_tasks(tmp_path, "TSK1")[1]] == ["a/TSK1", "b/TSK1"]
    with pytest.raises(InputError) as error:
        read_tasks(tmp_path, "TSK9")
    assert error.value.code == "no-such-task"


def test_two_main_files__in_one_folder_are_ambiguous(tmp_path: Path) -> None:
    one_set(tmp_path, 36_000)
    (tmp_path / "taskdata.xml").write_text((tmp_path / MAIN).read_text(encoding="utf-8"), encoding="utf-8")
    if len(list(tmp_path.glob("*.[xX][mM][lL]"))) < 3:
        pytest.skip("names differ in case only, which this file system does not keep apart")
    with pytest.raises(InputError) as error:
        read_tasks(tmp_path)
    assert error.value.code == "task-data-ambiguous"


@pytest.mark.parametrize("in_header", [(0,), (1,), (0, 1)])
def test_constants__of_the_header_give_what_the_records_would(tmp_path: Path, in_header: tuple[int, ...]) -> None:
    """Work state and width in the header, in the records, or one in each."""
    stated = {0: 1, 1: 6000}
    constants = {k: stated[k] for k in in_header}
    logged = {k: value for k, value in stated.items() if k not in in_header}
    folder = one_set(tmp_path, 36_000, log=records(36_000, logged))
    (folder / "TLG00001.xml").write_bytes(header(CHANNELS, constants=constants))
    (work,) = task_works(folder).works
    assert work.implement.width_m == 6.0
    assert work.work.ground is not None
    assert work.work.ground.figures.worked.ellipsoid_m2 == pytest.approx(60 * 2.0 * 6.0, rel=0.01)


def test_constant__counts_until_a_record_has_another_value() -> None:
    data = b"".join(Record(1000 * k, 15_000, {"A": 1, "B": 1}, {1: 3000} if k == 2 else {}).pack() for k in range(4))
    log = read_time_log(header(CHANNELS, "AB", constants={1: 6000}), data, "TLG00001")
    ((element, width_mm),) = log.values_of(67)
    assert element == "DET-1"
    np.testing.assert_array_equal(width_mm, [6000, 6000, 3000, 3000])
    assert list(log.values_of(141)) == []


@pytest.mark.parametrize("text", ["wide", "6.0", "9" * 5000, "2147483648", "-2147483649"])
def test_constant__that_is_no_number_of_the_records_is_refused(text: str) -> None:
    with pytest.raises(InputError) as error:
        read_time_log(header(CHANNELS, "AB", constants={1: text}), b"", "TLG00001")
    assert error.value.code == "time-log-header"
    assert text[:40] in error.value.what
