"""Archives and folders: what leads out of them, lies or is not whole is refused."""

from __future__ import annotations

import random
import stat
import zipfile
from pathlib import Path

import pytest

from furrowmap.core.readers.isoxml.content import MAIN, is_task_data, open_task_sets, read_content
from furrowmap.core.readers.isoxml.log import TaskDataLog
from furrowmap.core.readers.reader import ReadOptions
from furrowmap.core.runtime.errors import InputError, RefusedError

EMPTY = '<ISO11783_TaskData VersionMajor="4" VersionMinor="3"/>'


def archive(path: Path, names: list[str], *, link: bool = False, text: str = EMPTY) -> Path:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as out:
        for name in names:
            entry = zipfile.ZipInfo(name)
            if link:
                entry.external_attr = (stat.S_IFLNK | 0o777) << 16
            out.writestr(entry, text)
    return path


def refused(path: Path) -> InputError:
    with pytest.raises(InputError) as error:
        read_content(open_task_sets(path)[0])
    assert all(error.value.lines)
    return error.value


@pytest.mark.parametrize("name", ["../TASKDATA.XML", "/etc/TASKDATA.XML", "a/../../TASKDATA.XML", "C:/TASKDATA.XML"])
def test_a_name_that_leads_out__is_refused(tmp_path: Path, name: str) -> None:
    assert refused(archive(tmp_path / "a.zip", [name])).code == "archive-hostile"


def test_a_link__is_refused(tmp_path: Path) -> None:
    assert "is a link" in refused(archive(tmp_path / "a.zip", [MAIN], link=True)).what


def test_a_promise_that_no_archive_keeps__is_refused(tmp_path: Path) -> None:
    path = archive(tmp_path / "a.zip", [MAIN, "TLG00001.BIN"])
    data = path.read_bytes()
    place = data.rindex(b"PK\x01\x02") + 24  # the last entry's size in the directory
    path.write_bytes(data[:place] + (1 << 31).to_bytes(4, "little") + data[place + 4 :])
    with pytest.raises(RefusedError, match=r"330 bytes unpack to 2\.15 GB or more"):
        open_task_sets(path)[0]


def test_an_entry_shorter_than_the_archive_states__is_damaged(tmp_path: Path) -> None:
    """Its checksum is right: only the size shows that something is missing."""
    path = archive(tmp_path / "a.zip", [MAIN])
    data = path.read_bytes()
    place = data.rindex(b"PK\x01\x02") + 24
    path.write_bytes(data[:place] + (len(EMPTY) + 9).to_bytes(4, "little") + data[place + 4 :])
    assert f"{len(EMPTY)} bytes instead of the {len(EMPTY) + 9}" in refused(path).what


def test_entities__are_refused(tmp_path: Path) -> None:
    (tmp_path / MAIN).write_text(f'<!DOCTYPE a [<!ENTITY b SYSTEM "file:///etc/passwd">]>{EMPTY}')
    assert refused(tmp_path).code == "xml-hostile"


def test_damage__of_an_entry_is_reported(tmp_path: Path) -> None:
    path = archive(tmp_path / "a.zip", [MAIN], text=EMPTY + " " * 500)
    data = bytearray(path.read_bytes())
    data[len(MAIN) + 34] ^= 0xFF
    path.write_bytes(data)
    assert refused(path).code in ("task-data-unreadable", "xml-damaged")


def test_names__are_found_in_any_case_and_one_folder_down(tmp_path: Path) -> None:
    inside = tmp_path / "TaskData"
    inside.mkdir()
    (inside / "taskdata.xml").write_text(EMPTY)
    assert is_task_data(tmp_path)
    assert read_content(open_task_sets(tmp_path)[0]).version == "4.3"
    assert open_task_sets(inside / "taskdata.xml")[0].read("TASKDATA.XML") == EMPTY.encode()


def test_an_external_file_that_is_not_there__is_reported(tmp_path: Path) -> None:
    (tmp_path / MAIN).write_text(EMPTY.replace("/>", '><XFR A="PFD00001" B="1"/></ISO11783_TaskData>'))
    (notice,) = read_content(open_task_sets(tmp_path)[0]).notices
    assert notice.code == "external-file-lost"
    assert "PFD00001.XML" in notice.text


def test_another_root__is_no_task_data(tmp_path: Path) -> None:
    (tmp_path / MAIN).write_text("<gpx/>")
    assert "<gpx>" in refused(tmp_path).what


def mutated(data: bytes, rng: random.Random) -> bytes:
    """Some bytes changed, lost, doubled or added."""
    out = bytearray(data)
    for _ in range(rng.randint(1, 5)):
        at, length = rng.randrange(len(out)), rng.randint(1, 30)
        piece = [rng.randbytes(1), b"", rng.randbytes(length), bytes(out[at : at + length]) * 2][rng.randrange(4)]
        out[at : at + (1 if len(piece) == 1 else length)] = piece
    return bytes(out)


def test_damage__anywhere_ends_in_an_answer_or_three_lines(shared_data: Path, tmp_path: Path) -> None:
    with zipfile.ZipFile(shared_data / "isoxml/other/external_files_linklist_2021.zip") as source:
        whole = {Path(name).name: source.read(name) for name in source.namelist() if not name.endswith("/")}
    rng = random.Random(7)
    answers = []
    for _ in range(60):
        for name, data in whole.items():
            (tmp_path / name).write_bytes(data)
        name = rng.choice(["TASKDATA.XML", "PFD00001.XML", "TSK00000.XML", "TLG00001.XML", "TLG00001.BIN"])
        (tmp_path / name).write_bytes(mutated(whole[name], rng))
        try:
            answers.append(bool(TaskDataLog([tmp_path], ReadOptions()).inspect().facts))
        except InputError as error:
            answers.append(all(error.lines))
    assert all(answers)


def test_an_unknown_encoding__is_reported(tmp_path: Path) -> None:
    (tmp_path / MAIN).write_text(f'<?xml version="1.0" encoding="UTF-4"?>{EMPTY}')
    assert "UTF-4" in refused(tmp_path).what


def test_promise_24__an_entry_without_a_name_is_refused(tmp_path: Path) -> None:
    assert refused(archive(tmp_path / "a.zip", [MAIN, ""])).code == "archive-hostile"


def test_promise_24__xml_nested_a_hundred_thousand_deep_is_refused(tmp_path: Path) -> None:
    (tmp_path / MAIN).write_text("<a>" * 100_000 + "</a>" * 100_000)
    error = refused(tmp_path)
    assert error.code == "xml-hostile"
    assert "more than 64 levels" in error.what


def test_promise_24__numbers_of_five_thousand_digits_are_none(tmp_path: Path) -> None:
    huge = "9" * 5000
    body = f'<PFD A="PFD1" C="x" D="{"9" * 400}"/><TSK A="T"><TIM><DLV A="0074" B="{huge}" C="D"/></TIM></TSK>'
    (tmp_path / MAIN).write_text(EMPTY.replace("/>", f">{body}</ISO11783_TaskData>"))
    content = read_content(open_task_sets(tmp_path)[0])
    assert (content.partfields["PFD1"].name, content.tasks[0].id) == ("x", "T")
