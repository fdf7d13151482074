"""A chunk table of LAZ that does not account for every byte before it."""

from __future__ import annotations

import struct
from pathlib import Path

import laspy
import numpy as np
import pytest

from furrowmap.core.readers.las.cloud import open_cloud
from furrowmap.core.values.errors import InputError


@pytest.mark.parametrize("extra", [-4, 4])
def test_promise_08__chunks_are_as_long_as_the_table_states(extra: int, tmp_path: Path) -> None:
    header = laspy.LasHeader(version="1.4", point_format=6)
    header.scales = np.full(3, 0.001)
    las = laspy.LasData(header)
    las.x = las.y = las.z = np.arange(60_000) % 977 * 0.01
    path = tmp_path / "points.laz"
    las.write(path)
    data = bytearray(path.read_bytes())
    points = struct.unpack_from("<I", data, 96)[0]
    (table,) = struct.unpack_from("<q", data, points)
    open_cloud(path)
    cut = data[:table] + bytes(extra) if extra > 0 else data[: table + extra]
    struct.pack_into("<q", cut, points, table + extra)
    path.write_bytes(cut + data[table:])
    with pytest.raises(InputError, match=r"the chunk table states [\d,]+ bytes of chunks, but there are") as error:
        open_cloud(path)
    assert error.value.code == "laz-chunk-table"
