"""The spool of records against arrays in memory."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from furrowmap.core.runtime.record_spool import RecordSpool, square_keys, square_of

LAYOUT = np.dtype([("key", "<i8"), ("number", "<u2"), ("height_m", "<f4")])


def blocks(rng: np.random.Generator) -> list[NDArray[np.void]]:
    found = []
    for n in (500, 1, 0, 700):
        records = np.zeros(n, LAYOUT)
        records["key"] = rng.integers(-20, 20, n)
        records["number"] = rng.integers(0, 65_000, n)
        found.append(records)
    return found


@pytest.fixture(name="written")
def _written() -> NDArray[np.void]:
    return np.concatenate(blocks(np.random.default_rng(5)))


def filled(folder: Path) -> RecordSpool:
    spool = RecordSpool(LAYOUT, folder)
    for records in blocks(np.random.default_rng(5)):
        spool.add(records, records["key"])
    return spool


def test_read__returns_the_records_of_each_key_in_the_order_in_which_they_came(
    tmp_path: Path, written: NDArray[np.void]
) -> None:
    wanted = [3, -20, 99, 7]
    with filled(tmp_path) as spool:
        there, counts = np.unique(written["key"], return_counts=True)
        assert spool.counts == dict(zip(there.tolist(), counts.tolist(), strict=True))
        expected = np.concatenate([written[written["key"] == key] for key in wanted])
        assert np.array_equal(spool.read(wanted), expected)
        assert len(spool.read([])) == 0


def test_overwrite__replaces_what_was_read(tmp_path: Path, written: NDArray[np.void]) -> None:
    with filled(tmp_path) as spool:
        some = spool.read([4, 5])
        some["height_m"] = 2.5
        spool.overwrite([4, 5], some)
        assert np.array_equal(spool.read([4, 5]), some)
        assert np.array_equal(spool.read([6]), written[written["key"] == 6])


def test_parts__are_ranges_of_keys_that_fit_into_the_room_given(tmp_path: Path, written: NDArray[np.void]) -> None:
    with filled(tmp_path) as spool:
        parts = [part.copy() for part in spool.parts(-5, 6, lambda: np.empty(200, LAYOUT))]
    inside = written[(written["key"] >= -5) & (written["key"] < 6)]
    assert len(parts) > 1
    assert np.array_equal(np.sort(np.concatenate(parts)), np.sort(inside))


def test_shift_keys__merges_keys(tmp_path: Path, written: NDArray[np.void]) -> None:
    with filled(tmp_path) as spool:
        spool.shift_keys(2, 100)
        assert np.array_equal(np.sort(spool.read([101])), np.sort(written[written["key"] >> 2 == 1]))


def test_squares__have_one_key_each_on_both_sides_of_zero() -> None:
    places = [(column, row) for column in (-(2**30), -1, 0, 1, 2**30 - 1) for row in (-(2**30), -1, 0, 1, 2**30 - 1)]
    keys = square_keys(*np.transpose(places)).tolist()
    assert [square_of(key) for key in keys] == places
    assert keys == sorted(keys)


def test_read__a_file_that_lost_its_end_is_an_error_and_nothing_made_up(tmp_path: Path) -> None:
    with filled(tmp_path) as spool:
        keys = list(spool.counts)
        spool._file.truncate(1000 * LAYOUT.itemsize)
        with pytest.raises(OSError, match="1,201 records is shorter than was written"):
            spool.read(keys)
