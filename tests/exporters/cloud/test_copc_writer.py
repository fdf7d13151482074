"""What CopcWriter writes is what other people's readers find: laspy with lazrs, and copclib with laz-perf."""

from __future__ import annotations

import datetime as dt
import os
import resource
import signal
import struct
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from importlib.metadata import version
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import copclib
import laspy
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray
from pyproj import CRS

from furrowmap.core.runtime.errors import FurrowmapError
from furrowmap.core.runtime.write_errors import WriteError
from furrowmap.core.values.clock import las_time_to_utc
from furrowmap.exporters.cloud.copc_file import CopcFormat
from furrowmap.exporters.cloud.layers import ChunkColumns
from furrowmap.exporters.cloud.point_batches import PointBatch
from furrowmap.exporters.cloud.writer import MIN_NODE_POINTS, CopcSummary, CopcWriter, _check

ORIGIN_M = (16_600.0, 96_500.0, 270.0)
WKT = CRS("EPSG:6677").to_wkt("WKT1_GDAL")
SCAN = (("scan", "uint32", "number of the scan"),)
KIND = CopcFormat(WKT, ORIGIN_M, extra=SCAN)
T0_S = 1_781_141_020.3


@dataclass(frozen=True)
class Written:
    """A file and what was appended to it."""

    path: Path
    batch: PointBatch
    summary: CopcSummary


def cloud(xyz_m: NDArray[np.float64], seed: int = 0) -> PointBatch:
    """Points at these places with something different in every dimension."""
    random = np.random.default_rng(seed)
    n = len(xyz_m)
    returns = random.integers(1, 16, n)
    return PointBatch(
        xyz_m,
        T0_S + np.sort(random.uniform(0, 60, n)),
        intensity=random.integers(0, 65_536, n),
        return_number=random.integers(1, returns + 1),
        returns=returns,
        classification=random.choice([1, 2, 7, 64, 65, 255], n),
        point_source_id=random.integers(0, 65_536, n),
        extra={"scan": random.integers(0, 2**32, n)},
    )


def part(batch: PointBatch, which: Any) -> PointBatch:
    arrays = {name: value[which] for name, value in vars(batch).items() if isinstance(value, np.ndarray)}
    return replace(batch, **arrays, extra={name: value[which] for name, value in batch.extra.items()})


def write(path: Path, batch: PointBatch, batches: int = 3, kind: CopcFormat = KIND, **options: Any) -> Written:
    with CopcWriter(path, kind, **options) as writer:
        for which in np.array_split(np.arange(len(batch)), batches):
            writer.append(part(batch, which))
        summary = writer.close()
    return Written(path, batch, summary)


def surface(n: int, side_m: float = 131.071, seed: int = 1) -> NDArray[np.float64]:
    random = np.random.default_rng(seed)
    xy = random.uniform(0, side_m, (n, 2))
    return np.column_stack([xy, 0.5 + 0.3 * np.sin(xy[:, 0] / 5)])


def rows(columns: list[Any]) -> NDArray[np.float64]:
    """Points as rows of numbers, sorted."""
    table = np.column_stack([np.asarray(column, np.float64) for column in columns])
    return table[np.lexsort(table.T)]


def expected(batch: PointBatch, scale_m: float = 0.001) -> NDArray[np.float64]:
    steps = np.rint(batch.xyz_m / scale_m)
    attributes = [batch.intensity, batch.return_number, batch.returns, batch.classification, batch.point_source_id]
    return rows([*steps.T, batch.t_s, *attributes, batch.extra["scan"]])


def found(points: Any) -> NDArray[np.float64]:
    attributes = [points.intensity, points.return_number, points.number_of_returns, points.classification]
    time = las_time_to_utc(np.asarray(points.gps_time))
    return rows([points.X, points.Y, points.Z, time, *attributes, points.point_source_id, points["scan"]])


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


@pytest.fixture(scope="module", params=["in memory", "out of core"])
def field(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Written:
    """A surface of 60,000 points, a heap that divides far deeper, and one point high above."""
    heap = np.random.default_rng(2).normal((30.0, 40.0, 1.0), (0.02, 0.02, 0.02), (5_000, 3))
    batch = cloud(np.concatenate([surface(60_000), heap, [[100.0, 100.0, 90.0]]]))
    memory = 100_000 if request.param == "in memory" else 7_000
    path = tmp_path_factory.mktemp("copc") / "cloud.copc.laz"
    return write(path, batch, batches=40, memory_points=memory, node_points=500)


def test_laspy__reads_the_same_points(field: Written) -> None:
    las = laspy.read(field.path)
    np.testing.assert_allclose(found(las.points), expected(field.batch), rtol=0, atol=1e-6)
    assert las.header.parse_crs() == CRS.from_wkt(WKT)


def test_laspy_copc__reads_it_whole(field: Written) -> None:
    with laspy.CopcReader.open(field.path) as reader:
        np.testing.assert_allclose(found(reader.query()), expected(field.batch), rtol=0, atol=1e-6)


def test_laspy_copc__reads_it_by_bounds(field: Written) -> None:
    low, high = np.array([20.0, 35.0, -1.0]), np.array([33.0, 55.0, 1.0])
    inside = ((field.batch.xyz_m >= low - 5e-4) & (field.batch.xyz_m <= high + 5e-4)).all(axis=1)
    assert 1_000 < inside.sum() < 10_000
    with laspy.CopcReader.open(field.path) as reader:
        points = reader.query(bounds=laspy.Bounds(low + ORIGIN_M, high + ORIGIN_M))
    assert abs(len(points) - inside.sum()) <= 3, "but for points on the border"
    near = (points.X >= 20_000) & (points.X <= 33_000) & (points.Y >= 35_000) & (points.Y <= 55_000)
    assert near.all()


def test_laspy_copc__reads_it_by_level(field: Written) -> None:
    with laspy.CopcReader.open(field.path) as reader:
        levels = [reader.query(level=level) for level in range(len(field.summary.points_by_level))]
    assert tuple(len(points) for points in levels) == field.summary.points_by_level
    assert sum(field.summary.points_by_level) == len(field.batch)
    together = np.concatenate([found(points) for points in levels])
    np.testing.assert_allclose(together[np.lexsort(together.T)], expected(field.batch), rtol=0, atol=1e-6)


def test_copclib__reads_the_same_points(field: Written) -> None:
    reader = copclib.FileReader(str(field.path))
    points = reader.GetAllPoints()
    assert len(points) == len(field.batch)
    got = rows([[getattr(p, axis) for p in points] for axis in "xyz"] + [[p.intensity for p in points]])
    want = rows([*(field.batch.xyz_m + ORIGIN_M).T, field.batch.intensity])
    assert np.abs(np.sort(got[:, :3], axis=0) - np.sort(want[:, :3], axis=0)).max() <= 0.0005 + 1e-9
    scans = [struct.unpack("<I", bytes(p.extra_bytes))[0] for p in points]
    assert sorted(scans) == sorted(field.batch.extra["scan"].tolist())
    times = las_time_to_utc([p.gps_time for p in points])
    np.testing.assert_allclose(np.sort(times), np.sort(field.batch.t_s), rtol=0, atol=1e-6)
    header = reader.copc_config.las_header
    assert (header.point_format_id, header.point_count, header.point_record_length) == (6, len(points), 34)


def misplaced(path: Path) -> int:
    """Points outside the cube of their node, as copclib decodes both; the cubes follow from the info record."""
    reader = copclib.FileReader(str(path))
    info = reader.copc_config.copc_info
    low = np.array([info.center_x, info.center_y, info.center_z]) - info.halfsize
    outside = 0
    for node in reader.GetAllNodes():
        points = reader.GetPoints(node)
        side = 2 * info.halfsize / 2**node.key.d
        corner = low + side * np.array([node.key.x, node.key.y, node.key.z])
        xyz = np.column_stack([points.x, points.y, points.z])
        outside += int(((xyz < corner) | (xyz > corner + side)).any(axis=1).sum())
    return outside


def test_copclib__finds_every_point_in_its_node(field: Written) -> None:
    assert misplaced(field.path) == 0


def test_hierarchy__is_one_tree_of_all_points(field: Written) -> None:
    with laspy.CopcReader.open(field.path) as reader:
        entries = reader.root_page.entries
        halfsize, centre = reader.copc_info.halfsize, reader.copc_info.center
    assert len(entries) == field.summary.nodes
    keys = {(key.level, key.x, key.y, key.z) for key in entries}
    for level, x, y, z in keys - {(0, 0, 0, 0)}:
        assert (level - 1, x >> 1, y >> 1, z >> 1) in keys
    assert (np.abs(field.batch.xyz_m + ORIGIN_M - centre) <= halfsize).all()
    assert all(entry.point_count > 0 for entry in entries.values())
    full = [entry.point_count for key, entry in entries.items() if key.level < 9]
    assert max(full) < 2 * 500 + 200, "no node holds much more than twice what was asked for"


def test_header__tells_the_truth(field: Written) -> None:
    with laspy.open(field.path) as reader:
        header = reader.header
    steps = np.rint(field.batch.xyz_m / 0.001) * 0.001 + ORIGIN_M
    assert header.point_count == len(field.batch)
    np.testing.assert_allclose(header.mins, steps.min(axis=0), rtol=0, atol=1e-9)
    np.testing.assert_allclose(header.maxs, steps.max(axis=0), rtol=0, atol=1e-9)
    by_return = np.bincount(field.batch.return_number, minlength=16)[1:]
    assert header.number_of_points_by_return.tolist() == by_return.tolist()
    assert header.generating_software == f"furrowmap {version('furrowmap')}"
    assert header.creation_date is not None
    assert abs((header.creation_date - dt.datetime.now(dt.UTC).date()).days) <= 1
    with laspy.CopcReader.open(field.path) as copc:
        info = copc.copc_info
    ends = las_time_to_utc([info.gps_min, info.gps_max])
    np.testing.assert_allclose(ends, [field.batch.t_s.min(), field.batch.t_s.max()], rtol=0, atol=1e-6)
    assert info.spacing == pytest.approx(2 * info.halfsize / np.sqrt(500))
    assert field.summary.low_m == tuple(header.mins)


def test_bytes__stand_where_the_specifications_want_them(field: Written) -> None:
    data = field.path.read_bytes()
    (encoding,) = struct.unpack_from("<H", data, 6)
    assert encoding == 0b10001, "standard GPS time, CRS as WKT"
    header_size, offset, records, point_format = struct.unpack_from("<HIIB", data, 94)
    assert (header_size, point_format & 0x3F, point_format & 0x80) == (375, 6, 0x80)
    assert struct.unpack_from("<6I", data, 107) == (0,) * 6, "the old counts are of no use to point format 6"
    first_extended, extended = struct.unpack_from("<QI", data, 235)
    heads = []
    place = 375
    for _ in range(records):
        user, number, length = struct.unpack_from("<2x16sHH", data, place)
        heads.append((user.rstrip(b"\0").decode(), number, length))
        place += 54 + length
    assert place == offset
    assert heads[0] == ("copc", 1, 160)
    assert {head[:2] for head in heads} == {
        ("copc", 1),
        ("laszip encoded", 22204),
        ("LASF_Projection", 2112),
        ("LASF_Spec", 4),
    }
    assert extended == 1
    user, number, length = struct.unpack_from("<2x16sHQ", data, first_extended)
    assert (user.rstrip(b"\0"), number, length) == (b"copc", 1000, 32 * field.summary.nodes)
    assert first_extended + 60 + length == len(data)


def test_levels__take_four_times_as_many_points_each_on_a_surface(tmp_path: Path) -> None:
    written = write(tmp_path / "a.copc.laz", cloud(surface(400_000)), memory_points=10**6, node_points=1_000)
    levels = np.array(written.summary.points_by_level)
    np.testing.assert_allclose(levels[:4], 1_000 * 4.0 ** np.arange(4), rtol=0.15)


def test_levels__are_fair_samples(tmp_path: Path) -> None:
    """A quarter of the points in the western half: so it is among the root's, within three standard deviations."""
    xyz_m = surface(100_000)
    west = xyz_m[:, 0] < 65.536
    xyz_m = np.concatenate([xyz_m[west][: len(xyz_m) // 6], xyz_m[~west]])
    share = float(np.mean(xyz_m[:, 0] < 65.536))
    write(tmp_path / "a.copc.laz", cloud(xyz_m), node_points=10_000)
    with laspy.CopcReader.open(tmp_path / "a.copc.laz") as reader:
        root = reader.query(level=0)
    assert len(root) == pytest.approx(10_000, abs=3 * np.sqrt(10_000))
    assert np.mean(root.X < 65_536) == pytest.approx(share, abs=3 * np.sqrt(share * (1 - share) / len(root)))


def test_same_seed__same_file_but_for_nothing(tmp_path: Path) -> None:
    batch = cloud(surface(5_000))
    files = [
        write(tmp_path / f"{i}.copc.laz", batch, node_points=100, seed=seed).path for i, seed in enumerate([7, 7, 8])
    ]
    first, second, other = (path.read_bytes() for path in files)
    assert first == second
    assert first != other


coordinates = st.integers(-(2**31), 2**31 - 1)


@st.composite
def clouds(draw: st.DrawFn) -> NDArray[np.float64]:
    """Steps of the grid: heaps, lines, planes and far outliers of up to 600 points."""
    heaps = []
    for _ in range(draw(st.integers(1, 3))):
        centre = [draw(coordinates) for _ in range(3)]
        reach = [draw(st.sampled_from([0, 0, 1, 50, 10_000, 2**31 - 1])) for _ in range(3)]
        random = np.random.default_rng(draw(st.integers(0, 2**32)))
        points = random.integers(-1, 2, (draw(st.integers(1, 200)), 3)) * random.random((1, 3)) * reach + centre
        heaps.append(np.clip(np.rint(points), -(2**31), 2**31 - 1))
    return np.concatenate(heaps) * 0.001


@settings(max_examples=40)
@given(xyz_m=clouds(), memory=st.sampled_from([150, 400, 10_000]), batches=st.integers(1, 5))
def test_any_cloud__comes_back_whole(xyz_m: NDArray[np.float64], memory: int, batches: int) -> None:
    with TemporaryDirectory() as folder:
        written = write(Path(folder) / "a.copc.laz", cloud(xyz_m), batches, memory_points=memory, node_points=64)
        las = laspy.read(written.path)
        np.testing.assert_allclose(found(las.points), expected(written.batch), rtol=0, atol=1e-6)
        with laspy.CopcReader.open(written.path) as reader:
            assert len(reader.query()) == len(xyz_m)
        assert misplaced(written.path) == 0
        assert names(Path(folder)) == ["a.copc.laz"]


KINDS = ("u1", "i1", "u2", "i2", "u4", "i4", "u8", "i8", "f4", "f8")


@settings(max_examples=20)
@given(kinds=st.lists(st.sampled_from(KINDS), min_size=1, max_size=3), data=st.data(), batches=st.integers(1, 3))
def test_extra_dimensions__state_their_least_and_greatest_value(
    kinds: list[str], data: st.DataObject, batches: int
) -> None:
    """In the bytes after LAS 1.4 R15, table 24: options, then eight bytes each of nodata, least and greatest."""
    extra = {f"extra {k}": data.draw(arrays(np.dtype(kind), 5)) for k, kind in enumerate(kinds)}
    kind = replace(KIND, extra=[(name, values.dtype.name, "") for name, values in extra.items()])
    with TemporaryDirectory() as folder:
        path = write(Path(folder) / "a.copc.laz", replace(cloud(surface(5)), extra=extra), batches, kind).path
        with laspy.open(path) as reader:
            record = reader.header.vlrs.get("ExtraBytesVlr")[0].record_data_bytes()
    assert len(record) == 192 * len(kinds)
    for k, values in enumerate(extra.values()):
        one = record[192 * k : 192 * (k + 1)]
        known = values[~np.isnan(values)]
        assert one[3] & 0b110 == (0b110 if len(known) else 0)
        wide = {"u": "<u8", "i": "<i8", "f": "<f8"}[values.dtype.kind]
        stated = np.frombuffer(one, wide)[[8, 11]]
        if len(known):
            assert stated.astype(values.dtype).tolist() == [known.min(), known.max()]


def test_extra_dimensions__of_a_file_without_points_state_nothing(tmp_path: Path) -> None:
    with CopcWriter(tmp_path / "a.copc.laz", KIND):
        pass
    with laspy.open(tmp_path / "a.copc.laz") as reader:
        (scan,) = reader.header.vlrs.get("ExtraBytesVlr")[0].extra_bytes_structs
    assert (scan.min, scan.max) == (None, None)


def test_coordinates__are_within_half_a_step(tmp_path: Path) -> None:
    batch = cloud(np.random.default_rng(5).normal(0, 50, (1_000, 3)))
    write(tmp_path / "a.copc.laz", batch, kind=replace(KIND, scale_m=0.01))
    points = laspy.read(tmp_path / "a.copc.laz").points
    order, want = np.argsort(points.gps_time), np.argsort(batch.t_s)
    got = np.column_stack([points.x, points.y, points.z])[order] - ORIGIN_M
    assert np.abs(got - batch.xyz_m[want]).max() <= 0.005 + 1e-9


def test_colour__is_kept(tmp_path: Path) -> None:
    batch = cloud(surface(1_000))
    rgb = np.random.default_rng(3).integers(0, 65_536, (1_000, 3))
    write(tmp_path / "a.copc.laz", replace(batch, rgb=rgb), batches=1, kind=replace(KIND, colour=True))
    las = laspy.read(tmp_path / "a.copc.laz")
    assert las.header.point_format.id == 7
    want = rows([batch.t_s, *rgb.T])
    got = rows([las_time_to_utc(np.asarray(las.gps_time)), las.red, las.green, las.blue])
    np.testing.assert_allclose(got, want, rtol=0, atol=1e-6)


def test_colour_given_later__is_that_of_each_point(tmp_path: Path) -> None:
    batch = cloud(surface(1_000))

    def paint(points: ChunkColumns) -> None:
        assert points.rgb is not None
        assert not points.rgb.any()
        points.rgb[0], points.rgb[2] = points.intensity, 7

    kind = replace(KIND, colour=True)
    with CopcWriter(tmp_path / "a.copc.laz", kind, memory_points=300, node_points=64, colours_later=True) as writer:
        writer.append(batch)
        writer.close(complete=paint)
    las = laspy.read(tmp_path / "a.copc.laz")
    np.testing.assert_array_equal(las.red, las.intensity)
    assert (set(las.green), set(las.blue), len(set(las.red)) > 1, len(las)) == ({0}, {7}, True, 1_000)


def test_no_extra_dimensions__one_value_for_all(tmp_path: Path) -> None:
    with CopcWriter(tmp_path / "a.copc.laz", CopcFormat(WKT, ORIGIN_M)) as writer:
        writer.append(PointBatch(np.ones((4, 3)), np.full(4, T0_S), classification=2, point_source_id=9))
    las = laspy.read(tmp_path / "a.copc.laz")
    assert las.header.point_format.size == 30
    assert (set(las.classification), set(las.point_source_id), set(las.intensity)) == ({2}, {9}, {0})


def test_arrays__of_any_layout(tmp_path: Path) -> None:
    """Views, other number types and arrays nobody may write to are points as well."""
    batch = cloud(surface(1_000))
    views = replace(
        batch,
        xyz_m=np.asfortranarray(batch.xyz_m),
        t_s=np.repeat(batch.t_s, 2)[::2],
        intensity=batch.intensity.astype(np.float32).astype(np.uint16),
        return_number=batch.return_number.astype(np.int8),
    )
    for array in (views.xyz_m, views.t_s, views.return_number):
        array.flags.writeable = False  # type: ignore[union-attr]
    written = write(tmp_path / "a.copc.laz", views)
    np.testing.assert_allclose(found(laspy.read(written.path).points), expected(batch), rtol=0, atol=1e-6)


def test_time__across_a_leap_second(tmp_path: Path) -> None:
    """Of 2017-01-01T00:00:00Z, when GPS - UTC went from 17 to 18 s: GPS seconds by the calendar, less 10^9."""
    t_s = 1_483_228_800.0 + np.array([-0.5, 0.5])
    with CopcWriter(tmp_path / "a.copc.laz", CopcFormat(WKT, ORIGIN_M)) as writer:
        writer.append(PointBatch(np.ones((2, 3)), t_s))
    times = np.sort(laspy.read(tmp_path / "a.copc.laz").gps_time)
    assert times.tolist() == [167_264_016.5, 167_264_018.5]


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 2_147_484.0, -2_147_484.0])
def test_coordinates__that_no_record_holds_are_refused(tmp_path: Path, value: float) -> None:
    xyz_m = surface(100)
    xyz_m[57, 1] = value
    with pytest.raises(FurrowmapError) as raised:
        write(tmp_path / "a.copc.laz", cloud(xyz_m))
    assert raised.value.code == ("cloud-out-of-range" if np.isfinite(value) else "cloud-not-finite")
    assert names(tmp_path) == []


def test_times__that_are_no_numbers_are_refused(tmp_path: Path) -> None:
    batch = cloud(surface(100))
    batch.t_s[3] = np.nan
    with pytest.raises(FurrowmapError, match="the time nan s") as raised:
        write(tmp_path / "a.copc.laz", batch, batches=1)
    assert raised.value.code == "cloud-not-finite"


def test_no_points__is_a_cloud_as_well(tmp_path: Path) -> None:
    written = write(tmp_path / "a.copc.laz", cloud(np.zeros((0, 3))))
    assert (written.summary.points, written.summary.nodes, written.summary.low_m) == (0, 0, ORIGIN_M)
    las = laspy.read(written.path)
    assert (len(las.points), las.header.parse_crs()) == (0, CRS.from_wkt(WKT))
    with laspy.CopcReader.open(written.path) as reader:
        assert len(reader.query()) == 0
        (root,) = reader.root_page.entries.values()
    assert (root.key.level, root.point_count, root.byte_size, root.offset) == (0, 0, 0, 0)
    assert len(copclib.FileReader(str(written.path)).GetAllPoints()) == 0


@pytest.mark.parametrize(
    "changed",
    [
        {"intensity": np.full(10, 65_536)},
        {"intensity": np.zeros(9, np.uint16)},
        {"classification": -1},
        {"classification": np.full(10, 1.5)},
        {"return_number": 0},
        {"returns": np.full(10, 16)},
        {"xyz_m": np.zeros((9, 3))},
        {"extra": {}},
        {"extra": {"scan": 1, "more": 2}},
        {"extra": {"scan": -1}},
        {"rgb": np.zeros((10, 3), np.uint16)},
    ],
)
def test_values__that_do_not_fit_are_refused(tmp_path: Path, changed: dict[str, Any]) -> None:
    batch = replace(cloud(surface(10)), **changed)
    with CopcWriter(tmp_path / "a.copc.laz", KIND) as writer:
        with pytest.raises(ValueError):
            writer.append(batch)
        writer.append(cloud(surface(10)))
    assert laspy.read(tmp_path / "a.copc.laz").header.point_count == 10


@pytest.mark.parametrize("memory", [100, 10_000])
@pytest.mark.parametrize("stage", ["appending", "writing"])
def test_interrupted__leaves_the_older_file(tmp_path: Path, memory: int, stage: str) -> None:
    path = tmp_path / "cloud.copc.laz"
    path.write_text("older")

    def interrupt(_stage: str, _share: float) -> None:
        raise KeyboardInterrupt

    def write_and_interrupt() -> None:
        with CopcWriter(path, KIND, memory_points=memory) as writer:
            writer.append(cloud(surface(1_000)))
            if stage == "appending":
                raise KeyboardInterrupt
            writer.close(interrupt)

    with pytest.raises(KeyboardInterrupt):
        write_and_interrupt()
    assert path.read_text() == "older"
    assert names(tmp_path) == ["cloud.copc.laz"]


def test_progress__ends_at_one(tmp_path: Path) -> None:
    shares = []
    with CopcWriter(tmp_path / "a.copc.laz", KIND) as writer:
        writer.append(cloud(surface(1_000)))
        writer.close(lambda stage, share: shares.append((stage, share)))
    assert shares == [("writing cloud", 1.0)]


def test_disk_full__is_told_as_the_system_tells_it(tmp_path: Path) -> None:
    """A limit on the size of files stands for the full disk."""
    path = tmp_path / "cloud.copc.laz"
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    ignored = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    try:
        resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, limits[1]))
        with pytest.raises(WriteError) as raised:
            write(path, cloud(surface(20_000)))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
        signal.signal(signal.SIGXFSZ, ignored)
    assert raised.value.what.startswith(f"{path} cannot be written: {os.strerror(27)}")
    assert names(tmp_path) == []


WRITE_MANY = """
import resource, sys
from pathlib import Path
import numpy as np
from furrowmap.exporters.cloud.copc_file import CopcFormat
from furrowmap.exporters.cloud.point_batches import PointBatch
from furrowmap.exporters.cloud.writer import CopcWriter
path, wkt, batches = Path(sys.argv[1]), sys.argv[2], int(sys.argv[3])
random = np.random.default_rng(0)
with CopcWriter(path, CopcFormat(wkt, (0, 0, 0)), memory_points=150_000, node_points=5_000) as writer:
    for i in range(batches):
        xy = random.uniform(0, 100, (50_000, 2)) + [i, 0]
        writer.append(PointBatch(np.column_stack([xy, xy[:, 0] * 0.01]), i + np.linspace(0, 1, 50_000)))
        if i == 20:
            print("under way", flush=True)
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024)
"""


def test_memory__does_not_grow_with_the_points(tmp_path: Path) -> None:
    peaks = []
    for batches in (12, 40):
        command = [sys.executable, "-c", WRITE_MANY, str(tmp_path / "a.copc.laz"), WKT, str(batches)]
        peaks.append(int(subprocess.run(command, check=True, capture_output=True, text=True).stdout.split()[-1]))
    assert peaks[1] - peaks[0] < 12, f"{peaks} MB for 0.6 and 2 million points of 30 bytes"


def test_killed__leaves_nothing_that_stays(tmp_path: Path) -> None:
    path = tmp_path / "cloud.copc.laz"
    command = [sys.executable, "-c", WRITE_MANY, str(path), WKT, "100000"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as writer:
        assert writer.stdout is not None
        writer.stdout.readline()
        writer.kill()
    assert not path.exists()
    write(path, cloud(surface(100)))
    assert names(tmp_path) == ["cloud.copc.laz"]


@pytest.mark.parametrize("options", [{"node_points": MIN_NODE_POINTS - 1}, {"memory_points": 0}])
def test_octree__of_too_few_points_a_node_or_in_memory_is_refused(tmp_path: Path, options: dict[str, int]) -> None:
    with pytest.raises(ValueError, match="no octree with"):
        CopcWriter(tmp_path / "cloud.copc.laz", KIND, **options)
    assert names(tmp_path) == []


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda one: replace(one, points=one.points + 1), "contains 500 points, not the 501 written"),
        (lambda one: replace(one, points_by_level=(one.points_by_level[0] + 1,)), "contains 500 points"),
        (lambda one: replace(one, low_m=(one.low_m[0] + 0.001, *one.low_m[1:])), "other bounds"),
        (lambda one: replace(one, high_m=(*one.high_m[:2], one.high_m[2] - 0.001)), "other bounds"),
    ],
)
def test_file__that_differs_from_what_was_written_is_an_error(
    tmp_path: Path, change: Callable[[CopcSummary], CopcSummary], words: str
) -> None:
    """A disk that lost something on the way: the file is read back before it takes its place."""
    written = write(tmp_path / "cloud.copc.laz", cloud(surface(500)))
    _check(written.path, written.summary)
    with pytest.raises(OSError, match=words):
        _check(written.path, change(written.summary))
