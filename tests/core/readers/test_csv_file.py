"""Numbers of a CSV, whole and by the piece, against pandas."""

from __future__ import annotations

from io import StringIO
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from furrowmap.core.readers import csv_file
from furrowmap.core.readers.csv_file import Column, CsvFile
from furrowmap.core.runtime.errors import InputError

SCHEMA = [Column({name: 1.0}, sparse=True) for name in "abc"]
ROWS = {
    "plain": ["1,2,3", "4.5,-6e-3,+7", "1700000000.123456789,0.1,1e300"],
    "empty": [",2,3", "1,,3", "1,2,", ",,", "1,2,3"],
    "words": ["NA,2,3", "1,null,nan", "n/a,-1.#IND,None", "inf,-inf,3"],
    "ragged": ["1", "1,2", "1,2,3,4,5", "7,8,9"],
    "spaced": [" 1 , 2,3 ", "", "   ", "4,\t5,6"],
    "blank": ["1,2,3", *[""] * 200, "4,5,6"],  # pieces of the file without any row
    "quoted": ['"1","2.5",3', '4,"",6', '7,8,"9"'],
}


def rows_of(path: Path) -> np.ndarray:
    with CsvFile(path) as file:
        return np.concatenate(list(file.pieces(SCHEMA)))


@pytest.mark.parametrize("piece", [64, 1 << 20])
@pytest.mark.parametrize("separator", [",", ";", "\t"])
@pytest.mark.parametrize("end", ["\n", "\r\n"])
@pytest.mark.parametrize("kind", ROWS)
def test_rows__are_those_that_pandas_reads(
    kind: str, end: str, separator: str, piece: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(csv_file, "CSV_CHUNK_BYTES", piece)
    lines = [line.replace("\t", " ").replace(",", separator) for line in ("a,b,c", *ROWS[kind], *ROWS["plain"])]
    (tmp_path / "x.csv").write_text(end.join([*lines, ""]), newline="")
    names = list(range(5))
    text = StringIO("\n".join(line for line in lines[1:] if line.strip(" ")))
    expected = pd.read_csv(
        text, sep=separator, header=None, names=names, index_col=False, skipinitialspace=True, dtype=np.float64
    )
    np.testing.assert_allclose(rows_of(tmp_path / "x.csv"), expected[[0, 1, 2]].to_numpy(), rtol=1e-15)


@pytest.mark.parametrize(("row", "name"), [("1,x,3", "b"), ("1,2,1_0", "c"), ("0x1,2,3", "a"), ("1,2,3 4", "c")])
def test_a_field_that_is_no_number__is_named_with_its_line(row: str, name: str, tmp_path: Path) -> None:
    (tmp_path / "x.csv").write_text("a,b,c\n1,2,3\n\n4,,6\n" + row + "\n1,2,3\n")
    with pytest.raises(InputError, match=f"x.csv, line 5: column `{name}` holds") as refused:
        rows_of(tmp_path / "x.csv")
    assert refused.value.code == "not-a-number"


def test_a_row_without_a_field_that_must_be_there__is_dropped_with_a_notice(tmp_path: Path) -> None:
    (tmp_path / "x.csv").write_text("a,b,c\n1,2,3\n4,,6\n7\n8,9,10\n")
    with CsvFile(tmp_path / "x.csv") as file:
        rows = file.rows([Column({"a": 1.0}), Column({"b": 2.0}), Column({"c": 1.0}, sparse=True)])
    np.testing.assert_array_equal(rows, [[1.0, 4.0, 3.0], [8.0, 18.0, 10.0]])
    assert [notice.code for notice in file.notices] == ["rows-incomplete"]
