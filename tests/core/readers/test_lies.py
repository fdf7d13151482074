"""Memory and time by what was read, not by what a file states, repeats or unpacks to."""

from __future__ import annotations

import json
import struct
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from furrowmap.core.readers.line_csv import LineCsv
from furrowmap.core.readers.reader import GivesTrack, ReadOptions, Recognised
from furrowmap.core.readers.rosbag.bag_storage import McapStorage
from furrowmap.core.runtime.errors import InputError, RefusedError
from tests.core.readers.lies import FIXES, LIES, MB, mcap_head, mcap_record, packed, task_data

ADDRESS_SPACE = 6 << 30
PEAK_KB = 700_000
SECONDS = 30.0
SIZE = 25 << 20
ROOT = Path(__file__).parents[3]


@pytest.fixture(scope="module")
def program() -> Iterator[subprocess.Popen[str]]:
    """Reads each file in a process of its own."""
    command = [sys.executable, "-m", "tests.core.readers.read_lies"]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, cwd=ROOT) as program:
        yield program


@pytest.mark.skipif(sys.platform != "linux", reason="/proc is that of Linux")
@pytest.mark.parametrize("name", LIES)
def test_promise_10__memory_and_time_are_bounded_by_what_was_read(
    name: str, tmp_path: Path, program: subprocess.Popen[str]
) -> None:
    way, make = LIES[name]
    path = make(tmp_path)
    assert path.stat().st_size <= SIZE
    assert program.stdin is not None
    assert program.stdout is not None
    program.stdin.write(json.dumps([ADDRESS_SPACE, way, str(path)]) + "\n")
    program.stdin.flush()
    found = json.loads(program.stdout.readline())
    assert found["came"] == "read" or found["came"].islower() or found["came"].startswith("not read"), found
    assert found["peak_kb"] < PEAK_KB, found
    assert found["spent_s"] < SECONDS, found


def test_rows__that_take_far_more_memory_than_their_file_are_refused(tmp_path: Path) -> None:
    path = packed(tmp_path / "a.nmea.gz", FIXES, FIXES, 90 * MB)
    reader = Recognised.by_content(path).open()
    assert isinstance(reader, GivesTrack)
    with pytest.raises(RefusedError, match="of memory or more") as caught:
        reader.track()
    assert caught.value.code == "too-large"
    assert "--allow-large" in caught.value.remedy


def test_tables__with_a_line_without_an_end_are_refused(tmp_path: Path) -> None:
    path = packed(tmp_path / "a.csv.gz", b"time_unix_s,angle_deg,range_m\n", b"1.5,2.5,3.5,", 40 * MB)
    with pytest.raises(InputError, match="a line has more than 17 MB"):
        LineCsv([path], ReadOptions()).inspect()


def test_damage__in_many_places_is_counted(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    message = mcap_record(5, struct.pack("<HIQQ", 1, 0, 10**18, 10**18) + bytes(100))
    path.write_bytes(mcap_head() + message + mcap_record(6, b"\xff" * 12) * 1020)
    storage = McapStorage(path)
    assert len(list(storage.messages())) == 1
    assert [notice.code for notice in storage.notices].count("bag-chunk-damaged") == 20
    assert "1,000 further places are damaged" in storage.notices[-1].text


def test_task_data__name_a_file_once(tmp_path: Path) -> None:
    external = b'<XFC><CTR A="CTR1" B="x"/></XFC>'
    path = task_data(tmp_path, '<XFR A="PFD00001" B="1"/>' * 3 + '<XFR A="PFD00002" B="1"/>', PFD00001_XML=external)
    notices = Recognised.by_content(path).inspect().notices
    assert [notice.text for notice in notices if notice.code == "file-named-again"] == [
        "Files that the task data name more than once are read once: PFD00001.XML."
    ]
