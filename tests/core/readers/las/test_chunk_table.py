"""A chunk table of LAZ that does not account for every byte before it."""

from __future__ import annotations

import struct
from pathlib import Path

import laspy
import lazrs
import numpy as np
import pytest

from furrowmap.core.readers.las.cloud import open_cloud
from furrowmap.core.readers.las.header import HEADER_BYTES, read_header
from furrowmap.core.runtime.errors import InputError
from tests.fuzz.recordings import las


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
    assert error.value.code == "laz-damaged"


@pytest.mark.parametrize("stop", [KeyboardInterrupt, SystemExit])
def test_an_interruption__while_the_table_is_read_is_no_damage(
    stop: type[BaseException], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "points.laz"
    path.write_bytes(las(1, 50, compressed=True))

    def interrupted(*_: object) -> None:
        raise stop

    monkeypatch.setattr(lazrs, "read_chunk_table_only", interrupted)
    with pytest.raises(stop):
        open_cloud(path)


@pytest.mark.parametrize("version", range(5))
def test_headers__that_end_early_are_told_at_every_length(version: int) -> None:
    whole = HEADER_BYTES[version]
    data = b"LASF" + bytes(20) + bytes([1, version]) + bytes(400)
    for size in (4, 24, 25, 26, 100, 226, whole - 1):
        with pytest.raises(InputError, match="ends inside its header") as error:
            read_header(Path("cut.las"), data[:size], size)
        assert error.value.code == "las-header"
