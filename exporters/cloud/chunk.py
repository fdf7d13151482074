"""A chunk of LAZ 1.4: points compressed layer by layer."""

import struct
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.exporters.cloud import layers

MAX_POINT_BYTES: Final = 80
"""Upper bound of all layers of a point without its extra bytes."""
MAX_EXTRA_BYTES: Final = 2
MAX_END_BYTES: Final = 64
"""Upper bound of the ends of all layers."""
RECORD: Final = struct.Struct("<3iHBxBx2xHd")
"""A record of point format 6; flags, user data and scan angle are 0."""


@dataclass(frozen=True)
class ChunkColumns:
    """The points of a chunk as columns; all arrays have n > 0 elements and may be changed in place.

    Attributes:
        x, y, z: steps of the coordinates' scale.
        returns: return number, and number of returns of the pulse times 16.
        gps_time: adjusted standard GPS time.
        rgb: (3, n); None in point format 6.
        extra: (bytes, n) of the dimensions beyond those of LAS.
    """

    x: NDArray[np.int32]
    y: NDArray[np.int32]
    z: NDArray[np.int32]
    intensity: NDArray[np.uint16]
    returns: NDArray[np.uint8]
    classification: NDArray[np.uint8]
    point_source_id: NDArray[np.uint16]
    gps_time: NDArray[np.float64]
    rgb: NDArray[np.uint16] | None
    extra: NDArray[np.uint8]

    def __len__(self) -> int:
        return len(self.x)


def compress_points(points: ChunkColumns) -> bytes:
    """The chunk of points: the first point uncompressed, their number, the layers' lengths, and the layers.

    Layers of columns with a single value are empty.
    """
    n, extra = len(points), points.extra
    out = np.empty(n * (MAX_POINT_BYTES + MAX_EXTRA_BYTES * len(extra)) + MAX_END_BYTES * (10 + len(extra)), np.uint8)
    table, memory = np.empty(layers.TABLE_SIZE, np.int32), np.empty(layers.MEMORY_SIZE, np.int64)
    z_context = np.empty(n, np.uint8)
    x, y, z, returns, time = points.x, points.y, points.z, points.returns, points.gps_time
    ends = [0]

    def layer(column: NDArray[Any], encode: Callable[..., int], *columns: NDArray[Any]) -> None:
        ends.append(encode(out, ends[-1], table, *columns) if differs(column) else ends[-1])

    ends.append(layers.encode_places(out, 0, table, memory, x, y, returns, points.point_source_id, time, z_context))
    ends.append(layers.encode_heights(out, ends[-1], table, memory, z, returns, z_context))
    layer(points.classification, layers.encode_classes, points.classification, returns)
    ends.append(ends[-1])  # flags
    layer(points.intensity, layers.encode_intensities, memory, points.intensity, returns, time)
    ends += [ends[-1]] * 2  # scan angle, user data
    layer(points.point_source_id, layers.encode_sources, points.point_source_id)
    layer(time, layers.encode_times, memory, time, time.view(np.int64))
    if points.rgb is not None:
        red, green, blue = points.rgb
        coloured = differs(red) or differs(green) or differs(blue)
        ends.append(layers.encode_colours(out, ends[-1], table, red, green, blue) if coloured else ends[-1])
    for values in extra:
        layer(values, layers.encode_bytes, values)
    lengths = np.diff(ends).astype("<u4").tobytes()
    fields = (x, y, z, points.intensity, returns, points.classification, points.point_source_id, time)
    colour = b"" if points.rgb is None else points.rgb[:, 0].astype("<u2").tobytes()
    first = RECORD.pack(*(column[0] for column in fields)) + colour + extra[:, 0].tobytes()
    return b"".join([first, struct.pack("<I", n), lengths, out[: ends[-1]].data])


def differs(column: NDArray[Any]) -> bool:
    """Whether not all values are the same."""
    return bool(column[0] != column[-1] or (column != column[0]).any())
