"""Points of PCD and PLY files: written by other software, laws of the rows, damage."""

from __future__ import annotations

from base64 import b85decode
from pathlib import Path

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray

from furrowmap.core.readers.las.cloud import CloudFile, open_cloud
from furrowmap.core.readers.las.point_records import CloudBatch
from furrowmap.core.readers.reader import Recognised
from furrowmap.core.runtime.errors import InputError

ROWS = np.array(
    [(500000.25, 4700000.5, 84.125, 7, 255, 0, 128, 2), (500001.25, 4700001.5, 84.5, 9, 0, 1, 2, 5)],
    [*((axis, "<f8") for axis in "xyz"), ("intensity", "<u2"), ("red", "u1"), ("green", "u1"), ("blue", "u1"),
     ("scalar_Classification", "<f4")],
)  # fmt: skip
PLY = "ply\nformat {} 1.0\ncomment a\nelement vertex {}\n{}element face 0\nproperty list uchar int v\nend_header\n"
PCD = "# .PCD v0.7\nVERSION 0.7\nFIELDS {}\nSIZE {}\nTYPE {}\nWIDTH {n}\nHEIGHT 1\nPOINTS {n}\nDATA {data}\n"
PLY_NAMES = {"f8": "double", "f4": "float", "u2": "ushort", "u1": "uchar", "u4": "uint"}


def ply(rows: NDArray[np.void], form: str = "binary_little_endian") -> bytes:
    kinds = {name: PLY_NAMES[rows.dtype[name].str[1:]] for name in rows.dtype.names or ()}
    head = PLY.format(form, len(rows), "".join(f"property {kind} {name}\n" for name, kind in kinds.items()))
    return head.encode() + content(rows if "big" not in form else rows.astype(rows.dtype.newbyteorder(">")), form)


def pcd(rows: NDArray[np.void], data: str = "binary") -> bytes:
    fields = [(name, rows.dtype[name]) for name in rows.dtype.names or ()]
    columns = zip(*((name, str(kind.itemsize), kind.kind.upper()) for name, kind in fields), strict=True)
    return PCD.format(*(" ".join(column) for column in columns), n=len(rows), data=data).encode() + content(rows, data)


def content(rows: NDArray[np.void], form: str) -> bytes:
    if form != "ascii":
        return rows.tobytes()
    return "".join(" ".join(str(value) for value in row.tolist()) + "\n" for row in rows).encode()


def opened(folder: Path, data: bytes) -> tuple[CloudFile, CloudBatch]:
    (folder / "cloud").write_bytes(data)
    cloud = open_cloud(folder / "cloud")
    (batch,) = cloud.batches()
    return cloud, batch


@pytest.mark.parametrize(
    "data",
    [
        *(ply(ROWS, form) for form in ("ascii", "binary_little_endian", "binary_big_endian")),
        *(pcd(ROWS, form) for form in ("ascii", "binary")),
    ],
)
def test_batches__are_the_rows(data: bytes, tmp_path: Path) -> None:
    cloud, batch = opened(tmp_path, data)
    assert batch.xyz_m.tolist() == [list(row)[:3] for row in ROWS.tolist()]
    assert batch.intensity.tolist() == [7, 9]
    assert batch.classification.tolist() == [2, 5]
    assert batch.rgb is not None
    assert batch.rgb.tolist() == [[65535, 0, 128 * 257], [0, 257, 514]]
    assert (cloud.points, cloud.header.low, cloud.header.high) == (2, (500000.25, 4700000.5, 84.125), (
        500001.25, 4700001.5, 84.5))  # fmt: skip
    assert (cloud.crs, cloud.notices) == (None, ())
    assert [len(part) for part in cloud.batches(batch_points=1)] == [1, 1]
    assert [len(part) for part in cloud.batches(box=(500001.0, 0.0, 1e6, 1e7))] == [1]


def test_ply__by_trimesh(tmp_path: Path) -> None:
    xyz = np.random.default_rng(1).uniform(-50, 50, (100, 3)).astype(np.float32).astype(np.float64)
    colours = np.random.default_rng(2).integers(0, 256, (100, 4)).astype(np.uint8)
    data = trimesh.PointCloud(xyz, colours).export(file_type="ply")
    _, batch = opened(tmp_path, data)
    assert np.array_equal(batch.xyz_m, xyz)
    assert batch.rgb is not None
    assert np.array_equal(batch.rgb, colours[:, :3].astype(np.uint16) * 257)


def test_pcd__of_another_decoder(shared_data: Path) -> None:
    path = shared_data / "velodyne/vlp16_dual_truth.pcd"
    assert Recognised.by_content(path).inspect().facts["points"] == 14831
    (batch,) = open_cloud(path).batches()
    with path.open("rb") as file:
        data = file.read()
    rows = data[data.index(b"DATA binary\n") + 12 :]
    assert len(rows) == 14831 * 32
    assert np.array_equal(batch.xyz_m.T[0], np.ndarray(14831, "<f4", rows, strides=32).astype(np.float64))


COMPRESSED = (
    b"VERSION 0.7\nFIELDS x y z intensity\nSIZE 4 8 4 2\nTYPE F F F U\nCOUNT 1 1 1 1\nWIDTH 40\nHEIGHT 1\n"
    b"VIEWPOINT 0.0 0.0 0.0 1.0 0.0 0.0 0.0\nPOINTS 40\nDATA binary_compressed\n"
) + b85decode(
    "zyJUM&;kGe0RR9%00DqLAO!<I002NB0|0;^0|1~P0|3Av0|4M40|Wp-000mm0{|c(0{}1}0{}oE0{~DU0{~zk0|0O!0|0;^0|1C10|1a90|1yH"
    "0|1~P0|2NX0|2lf0|2-n0|3Av0|3Y%0|3w<0|3|{0|4M40|4kC0|4+K0|59S0|Wp;000Ca0{{ph0{{#l0{{>p0{|2t0{|Ex0{|Q#13&-(9zZ7`"
    "0O0=z;U@<{(?Q2T0N{lS0A%1q0RdzH"
)
"""As pypcd4 1.5.1 with liblzf writes it."""


def test_pcd__compressed_by_pypcd4(tmp_path: Path) -> None:
    _, batch = opened(tmp_path, COMPRESSED)
    numbers = np.arange(40.0)
    assert np.array_equal(batch.xyz_m, np.column_stack([0.25 * numbers, np.full(40, 7.5), numbers % 3]))
    assert set(batch.intensity.tolist()) == {100}
    at = COMPRESSED.index(b"compressed\n") + 11
    for data in (COMPRESSED[:-9], COMPRESSED[: at + 30] + b"\xff" * 20 + COMPRESSED[at + 50 :], COMPRESSED[:at]):
        with pytest.raises(InputError):
            opened(tmp_path, data)


def test_pcd__packed_colours_and_points_without_a_place(tmp_path: Path) -> None:
    rows = np.array([(1, 2, 3, 0x00FF8001), (np.nan, 2, 3, 0)], [*((axis, "<f4") for axis in "xyz"), ("rgb", "<u4")])
    cloud, batch = opened(tmp_path, pcd(rows))
    assert batch.rgb is not None
    assert batch.rgb.tolist() == [[65535, 128 * 257, 257]]
    assert [notice.code for notice in cloud.notices] == ["points-without-place"]


def test_damage__is_reported_or_refused(tmp_path: Path) -> None:
    cloud, batch = opened(tmp_path, ply(ROWS)[:-5])
    assert (len(batch), [notice.code for notice in cloud.notices]) == (1, ["points-missing"])
    whole = ply(ROWS, "ascii")
    for data in (
        whole.replace(b"4700000.5", b"47000x0.5"),
        whole[:-6],
        whole.replace(b"vertex 2", b"vertex two"),
        whole.replace(b"double y", b"double why"),
        whole.replace(b"end_header", b""),
        whole.replace(b"property ushort", b"property list uchar"),
        pcd(ROWS).replace(b"SIZE 8", b"SIZE 3"),
        pcd(ROWS)[: pcd(ROWS).index(b"DATA binary") + 20],
        ply(ROWS[:0]),
    ):
        with pytest.raises(InputError) as error:
            opened(tmp_path, data)
        assert all(error.value.lines)


@pytest.mark.parametrize(
    ("data", "why"),
    [
        (b"ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\n"
         b"property list uchar int view\nend_header\n0 0 0 2 1 1\n", "its vertices have lists (view)"),
        (PCD.format("x y z a", "4 4 4", "F F F F", n=1, data="ascii").encode(), "SIZE has 3 entries for 4 FIELDS"),
        (PCD.format("x y z a", "4 4 4 4", "F F F", n=1, data="ascii").encode(), "TYPE has 3 entries for 4 FIELDS"),
        (PCD.format("x y z", "4 4 4", "F F F\nCOUNT 1 1", n=1, data="ascii").encode(), "COUNT has 2 entries for 3"),
        (PCD.format("x y z", "4 4 4", "F F F", n=1, data="ascii").replace("SIZE 4 4 4\n", "").encode(), "no line SIZE"),
    ],
)  # fmt: skip
def test_header__that_cannot_be_used_says_which_line(data: bytes, why: str, tmp_path: Path) -> None:
    path = tmp_path / "points.any"
    path.write_bytes(data)
    with pytest.raises(InputError) as raised:
        open_cloud(path)
    assert why in raised.value.what


@pytest.mark.parametrize(
    ("name", "why"), [("list.ply", "its vertices have lists (view)"), ("size.pcd", "SIZE has 4 entries for 5 FIELDS")]
)
def test_samples__say_what_is_wrong(name: str, why: str, shared_data: Path) -> None:
    with pytest.raises(InputError) as raised:
        open_cloud(shared_data / "foreign/20-header-words" / name)
    assert why in raised.value.what
