"""Arrays that grow with the recording lie in files: they hold what others do, and a full disk is an error."""

from __future__ import annotations

import platform
import resource
import sys
from pathlib import Path

import numpy as np
import pytest

from furrowmap.core.runtime import arrays
from furrowmap.core.runtime.settings import using
from furrowmap.core.runtime.write_errors import WriteError


def memory(kind: str) -> int:
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith(kind)) << 10


@pytest.mark.parametrize("order", ["C", "F"])
@pytest.mark.parametrize("least", [1, 1 << 40])
def test_scratch_arrays_are_arrays(order: str, least: int, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(arrays, "LARGE", least)
    with using(scratch_folder=tmp_path):
        made = arrays.zeros((300, 7), np.float32, order)
        assert not made.any()
        made += np.arange(7)
        copy = arrays.copied(made)
        assert list(tmp_path.iterdir()) == []  # no name, so nothing is left after a kill
    made[:] = 0.0
    assert copy.flags.f_contiguous == (order == "F")
    assert copy.dtype == np.float32
    assert np.array_equal(copy, np.tile(np.arange(7), (300, 1)))
    assert np.array_equal(arrays.full(9, np.inf), np.full(9, np.inf))


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="reads /proc")
def test_large_arrays_take_no_memory_of_the_process() -> None:
    before = memory("RssAnon")
    made = arrays.zeros(4 * arrays.LARGE // 8)
    made += 1.0
    assert memory("RssAnon") - before < arrays.LARGE
    mapped = memory("VmRSS")
    arrays.release_files()
    assert mapped - memory("VmRSS") > made.nbytes // 2
    assert made.sum() == len(made)


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="reads /proc")
def test_keeping_files_out__lets_their_pages_go_by_itself(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(arrays, "RESIDENT_FILES", 0)
    monkeypatch.setattr(arrays, "RELEASE_S", 0.01)
    made = arrays.full(4 * arrays.LARGE // 8, 1.0)
    mapped = memory("RssFile")
    with arrays.keeping_files_out():
        while mapped - memory("RssFile") < made.nbytes // 2:
            pass
    assert made.sum() == len(made)


def test_no_room_is_an_error_when_the_array_is_made() -> None:
    """Else the process would end by a signal when it writes to the array."""
    had = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (arrays.LARGE, had[1]))
    try:
        with pytest.raises(WriteError, match=r"Temporary files cannot be written to .* too large"):
            arrays.zeros(2 * arrays.LARGE, np.uint8)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, had)


def test_no_room_is_an_error_where_the_system_reserves_none(monkeypatch: pytest.MonkeyPatch) -> None:
    """macOS and Windows have no posix_fallocate: the zeros are written."""
    monkeypatch.delattr(arrays.os, "posix_fallocate")
    made = arrays.zeros(2 * arrays.LARGE + 5, np.uint8)
    assert not made.any()
    made += 1
    assert made.sum() == 2 * arrays.LARGE + 5
    test_no_room_is_an_error_when_the_array_is_made()


def test_parts_cover_all_rows_in_order(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(arrays, "ROWS_AT_ONCE", 4)
    assert [np.arange(10)[part].tolist() for part in arrays.parts(10)] == [[0, 1, 2, 3], [4, 5, 6, 7], [8, 9]]
    assert list(arrays.parts(0)) == []


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="other C libraries have no such function")
def test_release__gives_back_what_lies_between_blocks_in_use() -> None:
    blocks = [np.ones(8_000) for _ in range(1_500)]
    held = blocks[::50]
    before = memory("RssAnon")
    del blocks
    arrays.release()
    assert memory("RssAnon") < before - 80_000_000
    assert all(block.all() for block in held)
