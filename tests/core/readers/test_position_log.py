"""Epochs that a log of positions has lost, and where a byte of several files is."""

from __future__ import annotations

from functools import reduce
from operator import xor
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from furrowmap.core.readers.nmea.log import NmeaLog
from furrowmap.core.readers.position_log import byte_place, file_at
from furrowmap.core.readers.reader import ReadOptions, recording_name


def log_at(folder: Path, t_s: list[float]) -> NmeaLog:
    """A log of positions 0.1 m apart at seconds after 10 h."""
    lines = []
    for k, at in enumerate(t_s):
        minute, second = divmod(at, 60.0)
        body = f"GPGGA,10{minute:02.0f}{second:05.2f},3530.{k + 100:05d},N,13900.000000,E,4,12,0.8,100.0,M,40.0,M,,"
        lines.append(f"${body}*{reduce(xor, body.encode()):02X}\r\n")
    (folder / "log.nmea").write_text("".join(lines), encoding="ascii", newline="")
    return NmeaLog([folder / "log.nmea"], ReadOptions(date="2026-06-11"))


@pytest.mark.parametrize(
    ("t_s", "words"),
    [
        (np.delete(np.arange(12.0), 6), "1 epoch is missing (gaps: 1), at a rate of 1 Hz; the longest gap has 2 s"),
        (np.delete(np.arange(11.0), 6), ""),
        (np.delete(np.arange(40.0) / 5.0, [10, 11, 20]), "3 epochs are missing (gaps: 2), at a rate of 5 Hz"),
        (np.delete(np.arange(60.0), [*range(5, 50, 5)]), "9 epochs are missing (gaps: 9)"),
        (np.delete(np.arange(60.0), [*range(2, 50, 3)]), ""),
        (np.arange(30.0), ""),
        (np.cumsum([1.0, 1.3, 0.7] * 10), ""),
        (np.delete(np.cumsum([1.0, 1.04, 0.96] * 10), 15), "1 epoch is missing"),
    ],
)
def test_epochs__missing_from_a_regular_log_are_counted(t_s: NDArray[np.float64], words: str, tmp_path: Path) -> None:
    """Of ten steps at least, of which four in five are within a tenth of the usual one."""
    reader = log_at(tmp_path, t_s.tolist())
    assert len(reader.track()) == len(t_s)
    texts = [notice.text for notice in reader.notices if notice.code == "epochs-missing"]
    assert len(texts) == bool(words)
    assert all(words in text for text in texts)


@pytest.mark.parametrize(
    ("at", "name", "byte"), [(0, "a", 0), (99, "a", 99), (100, "b", 0), (149, "b", 49), (150, "c", 0), (151, "c", 1)]
)
def test_place__is_the_file_and_the_byte_in_it(at: int, name: str, byte: int) -> None:
    paths, ends = [Path("a"), Path("b"), Path("c")], [100, 150, 160]
    assert file_at(paths, ends, at) == (Path(name), byte)
    assert byte_place(paths, ends)(at) == f"{name}, byte {byte}"


def test_name__is_the_first_file_and_the_number_of_others() -> None:
    assert recording_name([Path("a")]) == "a"
    assert recording_name([Path("a"), Path("b"), Path("c")]) == "a and 2 more"
