"""LAZ whose damage ends the decoder: the process that reads it lives, and gives an error."""

from __future__ import annotations

import os
import struct
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import laspy
import numpy as np
import pytest

from furrowmap.cli.main import attempt
from furrowmap.core.readers.las.cloud import CloudFile, open_cloud, survey
from furrowmap.core.readers.las.las_decoder import DECODER, Decoder, Undecodable
from furrowmap.core.runtime.errors import InputError, RefusedError
from furrowmap.core.runtime.memory import expect_growth
from furrowmap.core.runtime.settings import allowing
from tests.fuzz.recordings import copc_seeds, las


def points_of(cloud: CloudFile) -> np.ndarray:
    return np.concatenate([batch.xyz_m for batch in cloud.batches()])


def cloud_of(path: Path, number: int, points: int = 500) -> CloudFile:
    path.write_bytes(las(number, points, compressed=True))
    return open_cloud(path)


def overflowing(cloud: CloudFile) -> list[bytes]:
    """The file with times that say, bit by bit and without end, that the next one is of another series; from 12 places.

    Points up to format 5 are coded one after the other, times among them; later ones have a layer for the times.
    """
    assert cloud.laz is not None
    begin, size = int(cloud.laz.begins[0]), int(cloud.laz.sizes[0])
    data = cloud.path.read_bytes()
    first, last = begin + size // 8, begin + size
    if cloud.laz.layers:
        head = begin + cloud.laz.record_bytes + 4
        lengths = struct.unpack_from(f"<{cloud.laz.layers}I", data, head)
        first = head + 4 * cloud.laz.layers + sum(lengths[:8]) - 100
        last = first + 100 + lengths[8] // 4
    return [data[:at] + b"\xff" * (last - at) + data[last:] for at in range(first, first + 96, 8)]


@pytest.mark.parametrize("number", [1, 3, 6, 7])
def test_promise_09__a_laz_that_ends_its_decoder_is_refused(number: int, tmp_path: Path) -> None:
    errors = []
    for data in overflowing(cloud_of(tmp_path / "cloud.laz", number)):
        (tmp_path / "damaged.laz").write_bytes(data)
        with pytest.raises(InputError, match=r"damaged\.laz: points 1 to 500 cannot be decoded") as error:
            points_of(open_cloud(tmp_path / "damaged.laz"))
        assert error.value.code == "laz-damaged"
        errors.append(error.value.what)
        assert len(points_of(open_cloud(tmp_path / "cloud.laz"))) == 500  # a sound one is read after it
    assert any("the decoder crashed" in what for what in errors)


def test_promise_09__undamaged_chunks_are_kept_on_request(tmp_path: Path) -> None:
    path = tmp_path / "cloud.copc.laz"
    path.write_bytes(copc_seeds(tmp_path)[0]["cloud.copc.laz"])
    cloud = open_cloud(path)
    assert cloud.laz is not None
    begin, number = int(cloud.laz.begins[4]), int(cloud.laz.points[4])
    whole = points_of(cloud)
    data = bytearray(path.read_bytes())
    data[begin + 34 : begin + 38] = b"\xff" * 4
    path.write_bytes(data)
    with pytest.raises(InputError, match=r"chunk 5 of (.|\n)*--allow-damaged"):
        points_of(open_cloud(path))
    with allowing("damaged"):
        found = survey(open_cloud(path))
        left = points_of(open_cloud(path))
    before = int(cloud.laz.points[:4].sum())
    assert np.array_equal(left, np.delete(whole, slice(before, before + number), axis=0))
    (notice,) = (notice for notice in found.notices() if notice.code == "laz-damage-left-out")
    assert f"points {before + 1:,} to {before + number:,} are left out" in notice.text
    status, error = attempt(["inspect", str(path), "--json", "--allow-damaged", "--quiet"])
    assert (status, error) == (0, None)


def test_promise_10__a_cloud_of_constant_points_in_a_tiny_file_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "cloud.laz"
    header = laspy.LasHeader(version="1.4", point_format=6)
    cloud = laspy.LasData(header)
    cloud.x = np.zeros(1_000_000)
    cloud.write(path)
    assert path.stat().st_size < 30_000
    points, at = 40_000_000_000, 247  # 1.2 TB
    table = open_cloud(path).laz
    assert table is not None
    data = bytearray(path.read_bytes())
    struct.pack_into("<Q", data, at, points)
    with pytest.raises(InputError, match="these do not match"):  # the table has too few chunks for that
        path.write_bytes(data)
        open_cloud(path)
    with pytest.raises(RefusedError, match="--allow-large") as error:
        expect_growth(path, path.stat().st_size, points * 30)
    assert error.value.code == "too-large"
    with allowing("large"):
        expect_growth(path, path.stat().st_size, points * 30)


def test_decoder__serves_threads_and_forks(tmp_path: Path) -> None:
    cloud = cloud_of(tmp_path / "cloud.laz", 6)
    whole = points_of(cloud)
    with ThreadPoolExecutor(4) as pool:
        assert all(np.array_equal(points, whole) for points in pool.map(points_of, [cloud] * 12))
    pid = os.fork()
    if pid == 0:
        os._exit(0 if np.array_equal(points_of(cloud), whole) else 1)
    assert os.waitpid(pid, 0)[1] == 0
    assert np.array_equal(points_of(cloud), whole)


def test_decoder__that_does_not_answer_is_ended(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("furrowmap.core.readers.las.las_decoder.MIN_ORDER_S", 0.3)
    fifo = tmp_path / "points"
    os.mkfifo(fifo)
    with pytest.raises(Undecodable, match="needs more than 0 s"):
        DECODER.points(10, what="stream", path=str(fifo), offset=0, vlr="")


def test_decoder__has_little_memory(tmp_path: Path) -> None:
    decoder = Decoder()
    with pytest.raises(Undecodable):
        decoder.points(3 << 30, what="more")
    decoder.close()


@pytest.mark.parametrize(
    ("number", "field", "value"),
    [(1, 0, 3), (3, 0, 3), (6, 0, 3), (7, 0, 3), (1, 2, 1), (3, 2, 1), (6, 2, 1), (7, 2, 1), (1, 4, 9), (3, 4, 9)],
)
def test_laz__whose_items_are_not_those_of_its_points_is_refused(
    number: int, field: int, value: int, tmp_path: Path
) -> None:
    """The decoder would read each point as another one."""
    cloud = cloud_of(tmp_path / "cloud.laz", number)
    data = bytearray(cloud.path.read_bytes())
    record = data.index(b"laszip encoded") - 2 + 54
    struct.pack_into("<H", data, record + 34 + field, value)
    (tmp_path / "damaged.laz").write_bytes(data)
    with pytest.raises(InputError, match=f"do not match point format {number} with ") as error:
        open_cloud(tmp_path / "damaged.laz")
    assert error.value.code == "laz-damaged"
