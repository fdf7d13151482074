"""Octrees that do not fit their file: all points are read all the same, and the notice says what is wrong."""

from __future__ import annotations

import struct
from collections.abc import Callable
from pathlib import Path

import laspy
import numpy as np
import pytest
from pyproj import CRS

from furrowmap.core.readers.las.cloud import ENTRY, CloudFile, open_cloud
from furrowmap.core.runtime.errors import InputError
from furrowmap.exporters.cloud.copc_file import CopcFormat
from furrowmap.exporters.cloud.point_batches import PointBatch
from furrowmap.exporters.cloud.writer import CopcWriter

N = 5000
INFO_AT = 375 + 54
"""The record with the octree's cube is the first of the file, behind the header."""
HALF, ROOT_AT, ROOT_BYTES = INFO_AT + 24, INFO_AT + 40, INFO_AT + 48
KEY, OFFSET, SIZE, POINTS = (ENTRY.fields[name][1] for name in ("key", "offset", "bytes", "points"))

PAGE = 1 << 20
"""Bytes of two pages that together are longer than the file."""


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """A small cloud with a tree of several nodes, whose root is their first entry."""
    path = tmp_path_factory.mktemp("copc") / "a.copc.laz"
    xyz = np.random.default_rng(1).uniform(0.0, 100.0, (N, 3))
    kind = CopcFormat(CRS("EPSG:6677").to_wkt("WKT1_GDAL"), (0.0, 0.0, 0.0))
    with CopcWriter(path, kind, node_points=1024) as writer:
        writer.append(PointBatch(xyz, np.full(N, 1.78e9)))
        writer.close()
    return path.read_bytes()


def changed(folder: Path, data: bytes, *changes: tuple[int, bytes]) -> CloudFile:
    whole = bytearray(data)
    for at, put in changes:
        whole[at : at + len(put)] = put
    path = folder / "changed.copc.laz"
    path.write_bytes(whole)
    return open_cloud(path)


def root_at(data: bytes) -> int:
    return int(struct.unpack_from("<Q", data, ROOT_AT)[0])


def test_index__of_a_sound_file(sound: bytes, tmp_path: Path) -> None:
    cloud = changed(tmp_path, sound)
    assert cloud.notices == ()
    assert len(np.frombuffer(sound, ENTRY, 3, root_at(sound))) == 3  # so that nodes can be changed


CHANGES: dict[str, Callable[[bytes, int], list[tuple[int, bytes]]]] = {
    "half size of the cube 0, spacing": lambda data, root: [(HALF, bytes(8))],
    "half size of the cube nan, spacing": lambda data, root: [(HALF, struct.pack("<d", np.nan))],
    "is outside the file": lambda data, root: [(ROOT_AT, struct.pack("<Q", len(data) - 8))],
    "a hierarchy page at bytes 2 to": lambda data, root: [(ROOT_AT, struct.pack("<Q", 2))],
    "points in 8 nodes, the file 5,000 points in 9": lambda data, root: [(root + ENTRY.itemsize + POINTS, bytes(4))],
    "a node is outside the cube": lambda data, root: [(root + KEY, struct.pack("<i", -1))],
    "outside the cube": lambda data, root: [(root + KEY + 4, struct.pack("<i", 1))],
    "node 0-0-0-0 is not a chunk of the file": lambda data, root: [(root + OFFSET, struct.pack("<Q", 1000))],
    "node 0-0-0-0 is not a chunk of": lambda data, root: [(root + SIZE, struct.pack("<i", 7))],
    "refers to itself": lambda data, root: [
        (root + POINTS, struct.pack("<i", -1)), (root + OFFSET, struct.pack("<Q", root)),
    ],
    "hierarchy pages overlap": lambda data, root: [
        (len(data), bytes(PAGE)),
        *(
            (root + k * ENTRY.itemsize + OFFSET, struct.pack("<Qii", len(data) + k * ENTRY.itemsize, size, -1))
            for k, size in enumerate((PAGE, PAGE - ENTRY.itemsize))
        ),
    ],
}  # fmt: skip


@pytest.mark.parametrize("words", CHANGES)
def test_index__that_does_not_fit_is_not_used(words: str, sound: bytes, tmp_path: Path) -> None:
    cloud = changed(tmp_path, sound, *CHANGES[words](sound, root_at(sound)))
    (notice,) = cloud.notices
    assert notice.code == "copc-index"
    assert words in notice.text
    assert sum(len(batch) for batch in cloud.batches()) == N


def test_chunk_table__of_a_file_that_was_written_to_a_stream_is_at_its_end(tmp_path: Path) -> None:
    """Its offset could not be filled in where it belongs: that is -1, and the last 8 bytes have it (LASzip)."""
    header = laspy.LasHeader(point_format=0, version="1.2")
    points = laspy.LasData(header)
    points.x = points.y = points.z = np.arange(500.0)
    points.write(tmp_path / "a.laz")
    data = bytearray((tmp_path / "a.laz").read_bytes())
    begin = struct.unpack_from("<I", data, 96)[0]
    table = data[begin : begin + 8]
    data[begin : begin + 8] = struct.pack("<q", -1)
    (tmp_path / "b.laz").write_bytes(data + table)
    batches = list(open_cloud(tmp_path / "b.laz").batches())
    assert np.concatenate([batch.xyz_m[:, 0] for batch in batches]).tolist() == np.arange(500.0).tolist()
    (tmp_path / "c.laz").write_bytes(data)
    with pytest.raises(InputError, match="the chunk table is at byte") as refused:
        open_cloud(tmp_path / "c.laz")
    assert refused.value.code == "laz-damaged"
