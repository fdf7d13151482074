"""Chunks are byte for byte those of lazrs, which goes back to another translation of LASzip."""

from __future__ import annotations

import io
from typing import Any

import lazrs
import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from furrowmap.exporters.cloud.layers import ChunkColumns, compress_points

RECORD = [
    ("x", "<i4"),
    ("y", "<i4"),
    ("z", "<i4"),
    ("intensity", "<u2"),
    ("returns", "u1"),
    ("flags", "u1"),
    ("classification", "u1"),
    ("user_data", "u1"),
    ("scan_angle", "<i2"),
    ("point_source_id", "<u2"),
    ("gps_time", "<f8"),
]
NAMES = [name for name, _ in RECORD if name not in ("flags", "user_data", "scan_angle")]


def records(points: ChunkColumns) -> NDArray[np.void]:
    """The points as LAS records."""
    colour = [("rgb", "<u2", 3)] if points.rgb is not None else []
    extra = [("extra", "u1", len(points.extra))] if len(points.extra) else []
    table = np.zeros(len(points), np.dtype([*RECORD, *colour, *extra]))
    for name in NAMES:
        table[name] = getattr(points, name)
    if points.rgb is not None:
        table["rgb"] = points.rgb.T
    if extra:
        table["extra"] = points.extra.T
    return table


def laz(points: ChunkColumns) -> lazrs.LazVlr:
    point_format = 6 if points.rgb is None else 7
    return lazrs.LazVlr.new_for_compression(point_format, len(points.extra), use_variable_size_chunks=True)


def by_lazrs(points: ChunkColumns) -> bytes:
    """The chunk that lazrs makes of the points."""
    file = io.BytesIO()
    compressor = lazrs.LasZipCompressor(file, laz(points))
    compressor.reserve_offset_to_chunk_table()
    compressor.compress_chunks([records(points).view(np.uint8)])
    compressor.done()
    file.seek(0)
    (_, length), *_ = lazrs.read_chunk_table(file, laz(points))
    return file.getvalue()[8 : 8 + length]


def steps(draw: st.DrawFn, random: np.random.Generator, n: int, bits: int) -> NDArray[np.int64]:
    """Numbers of so many bits: alike, near each other, with jumps, or anywhere."""
    reach = 1 << draw(st.integers(0, bits - 1))
    start = int(random.integers(1 << bits))
    kind = draw(st.sampled_from(["one", "walk", "two walks", "jumps", "any"]))
    if kind == "one":
        return np.full(n, start)
    walk = start + np.cumsum(random.integers(-reach, reach + 1, n))
    if kind == "two walks":
        walk += random.integers(2, size=n) << (bits - 1)
    if kind == "jumps":
        walk = np.where(random.random(n) < 0.1, random.integers(1 << bits, size=n), walk)
    return random.integers(1 << bits, size=n) if kind == "any" else walk % (1 << bits)


def times(draw: st.DrawFn, random: np.random.Generator, n: int) -> NDArray[np.float64]:
    """Times that all cases of the coding meet: even and uneven steps, back and forth, several sequences, any number."""
    kind = draw(st.sampled_from(["one", "even", "uneven", "multiples", "sequences", "any"]))
    start = draw(st.sampled_from([0.0, 4.65e8, -1e9, 1e-300]))
    bits = np.float64(start).view(np.int64)
    step = draw(st.sampled_from([1, 17, 2_304, 10**6, 2**31 - 1, -5]))
    if kind == "one":
        return np.full(n, start)
    if kind == "even":
        taken = np.arange(n) * step
    elif kind == "uneven":
        taken = np.cumsum(random.integers(-1, 3, n) * step + random.integers(-3, 4, n))
    elif kind == "multiples":
        taken = np.cumsum(random.choice([0, 1, 1, 2, 9, 10, 499, 500, 501, 3_000, -1, -9, -10, -11, -700], n) * step)
    elif kind == "sequences":
        taken = np.arange(n) * step + (random.integers(6, size=n) << 36)
    else:
        return random.normal(0, 1e9, n)
    return np.asarray(np.abs(bits + taken).view(np.float64))


@st.composite
def chunks(draw: st.DrawFn, most: int = 3_000) -> ChunkColumns:
    """Points of all kinds that a file can hold, and some that it should not."""
    n = draw(st.sampled_from([1, 2, 3, 40, 500, most]))
    random = np.random.default_rng(draw(st.integers(0, 2**32)))

    def column(bits: int, dtype: type[np.generic]) -> NDArray[Any]:
        return steps(draw, random, n, bits).astype(np.uint64).astype(f"u{max(bits // 8, 1)}").view(dtype)

    pulses = draw(st.sampled_from(["single", "in order", "any"]))
    count = np.repeat(random.integers(1, 16, n), random.integers(1, 6, n))[:n] if pulses == "in order" else np.ones(n)
    number = 1 + np.arange(n) % count
    returns = (count.astype(np.int64) << 4 | number.astype(np.int64)).astype(np.uint8)
    return ChunkColumns(
        x=column(32, np.int32),
        y=column(32, np.int32),
        z=column(32, np.int32),
        intensity=column(16, np.uint16),
        returns=column(8, np.uint8) if pulses == "any" else returns,
        classification=column(8, np.uint8),
        point_source_id=column(16, np.uint16),
        gps_time=times(draw, random, n),
        rgb=np.stack([column(16, np.uint16) for _ in range(3)]) if draw(st.booleans()) else None,
        extra=np.array([column(8, np.uint8) for _ in range(draw(st.integers(0, 3)))], np.uint8).reshape(-1, n),
    )


@settings(max_examples=150)
@given(points=chunks())
def test_any_chunk__is_that_of_lazrs(points: ChunkColumns) -> None:
    expected = by_lazrs(points)
    assert compress_points(points) == expected
