"""Damage to LAS and LAZ files that no sample has."""

from __future__ import annotations

import gzip
import struct
from pathlib import Path

import laspy
import numpy as np
import pytest
from pyproj import CRS

from furrowmap.core.readers.las.cloud import open_cloud
from furrowmap.core.readers.reader import Recognised
from furrowmap.core.runtime.errors import InputError


def cloud(folder: Path, name: str = "a.las", **extra: type) -> Path:
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.add_extra_dims([laspy.ExtraBytesParams(name=key, type=kind) for key, kind in extra.items()])
    header.add_crs(CRS("EPSG:6677"))
    points = laspy.LasData(header)
    points.x, points.y, points.z = np.random.default_rng(1).uniform(0.0, 10.0, (3, 500))
    points.write(folder / name)
    return folder / name


def with_bytes(path: Path, at: int, data: bytes) -> Path:
    whole = bytearray(path.read_bytes())
    whole[at : at + len(data)] = data
    path.write_bytes(whole)
    return path


def record_at(path: Path, user: bytes, number: int) -> int:
    """Offset of a variable-length record."""
    data = path.read_bytes()
    at = data.find(user)
    while struct.unpack_from("<H", data, at + 16)[0] != number:
        at = data.find(user, at + 1)
    return at - 2


@pytest.mark.parametrize(
    ("at", "data", "code"),
    [(24, b"\x01\x09", "las-version"), (94, struct.pack("<H", 100), "las-header")],
)
def test_a_header__of_another_version_or_size_is_refused(tmp_path: Path, at: int, data: bytes, code: str) -> None:
    with pytest.raises(InputError) as refused:
        open_cloud(with_bytes(cloud(tmp_path), at, data))
    assert refused.value.code == code


def test_compressed_points__without_the_record_on_their_compression_are_refused(tmp_path: Path) -> None:
    path = cloud(tmp_path, "a.laz")
    with pytest.raises(InputError, match="LASzip record, which describes") as refused:
        open_cloud(with_bytes(path, record_at(path, b"laszip encoded", 22204) + 2, b"laszip decoded"))
    assert refused.value.code == "laz-damaged"


def test_a_cloud__in_a_compressed_stream_is_refused(tmp_path: Path) -> None:
    packed = tmp_path / "a.las.gz"
    packed.write_bytes(gzip.compress(cloud(tmp_path).read_bytes()))
    with pytest.raises(InputError) as refused:
        Recognised.by_content(packed).inspect()
    assert refused.value.code == "cloud-in-archive"


def test_extra_dimensions__that_do_not_fit_are_reported(tmp_path: Path) -> None:
    path = cloud(tmp_path, scan=np.uint8)
    at = record_at(path, b"LASF_Spec", 4)
    found = open_cloud(with_bytes(path, at + 54 + 2, b"\x0a"))  # a double instead of a byte
    assert "extra-bytes" in {notice.code for notice in found.notices}


def test_a_record__that_the_header_does_not_count_is_reported(tmp_path: Path) -> None:
    path = cloud(tmp_path, scan=np.uint8)
    count = struct.unpack_from("<I", path.read_bytes(), 100)[0]
    found = open_cloud(with_bytes(path, 100, struct.pack("<I", count - 1)))
    assert "records-uncounted" in {notice.code for notice in found.notices}
