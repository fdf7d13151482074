"""E57 files written by the standard, and what damage does to them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from furrowmap.core.readers.las.cloud import open_cloud
from furrowmap.core.readers.reader import Recognised
from furrowmap.core.runtime.errors import InputError
from tests.core.readers.las.e57_files import POSE, e57, some_rows


@pytest.mark.parametrize("packets", [1, 7])
def test_points__are_those_of_the_packed_fields(packets: int, tmp_path: Path) -> None:
    rows = some_rows(2000)
    path = tmp_path / "scan.e57"
    path.write_bytes(e57(rows, packets=packets))
    cloud = open_cloud(path)
    (batch,) = cloud.batches()
    kept = rows["invalid"] == 0
    np.testing.assert_allclose(batch.xyz_m, np.column_stack([rows[axis] for axis in "xyz"])[kept], rtol=0, atol=1e-9)
    assert batch.intensity.tolist() == np.rint((rows["intensity"][kept] + 5) * (65535 / 4095)).astype(int).tolist()
    assert batch.rgb is None
    assert [notice.code for notice in cloud.notices] == ["points-without-place"]
    assert Recognised.by_content(path).inspect().facts["points"] == kept.sum()


def test_pose__turns_and_moves_the_scan(tmp_path: Path) -> None:
    rows = some_rows(50) | {"invalid": np.zeros(50, int)}
    path = tmp_path / "scan.e57"
    path.write_bytes(e57(rows, pose=POSE))
    (batch,) = open_cloud(path).batches()
    angle = 2.0 * np.arctan2(0.8, 0.6)
    x, y, z = rows["x"], rows["y"].astype(float), rows["z"]
    expected = [np.cos(angle) * x - np.sin(angle) * y + 10.0, np.sin(angle) * x + np.cos(angle) * y, z - 3.0]
    np.testing.assert_allclose(batch.xyz_m, np.column_stack(expected), atol=1e-6)


def test_damage__is_an_error_that_says_where(tmp_path: Path) -> None:
    data = e57(some_rows(3000))
    path = tmp_path / "scan.e57"
    middle = bytearray(data)
    middle[5000] ^= 4
    for content, code, words in (
        (bytes(middle), "points-damaged", "the page at byte 4,096 has a wrong checksum"),
        (data[:-1024], "bad-table-header", "it ends before byte"),
        (data[:30], "bad-table-header", "48 bytes"),
        (data.replace(b"ScaledInteger", b"ScaledTnteger"), "bad-table-header", "has a wrong checksum"),
    ):
        path.write_bytes(content)
        with pytest.raises(InputError, match=words) as caught:
            open_cloud(path)
        assert caught.value.code == code
