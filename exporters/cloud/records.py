"""Records of waiting points, and columns of a node for its compression."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final, Self

import numba
import numpy as np
from numpy.typing import NDArray

from furrowmap.core.runtime.kernels import kernel
from furrowmap.exporters.cloud.layers import ChunkColumns

Records = NDArray[np.void]
"""(n,) structured array of one layout."""
ALWAYS_ZERO: Final = ("classification_flags", "user_data", "scan_angle")
"""Fields of a LAS record that are always 0 here and take no memory."""
NUMBER_FIELDS: Final = 8
"""Fields of a record before colour and extra ones, in the order of :class:`.chunk.Columns`."""
COLOUR: Final = ("red", "green", "blue")


def held_layout(las: np.dtype[np.void], *, colours_later: bool = False) -> np.dtype[np.void]:
    """The layout of records in memory: LAS fields without those that are always 0, or without colours as well."""
    left_out = (*ALWAYS_ZERO, *COLOUR) if colours_later else ALWAYS_ZERO
    return np.dtype([(name, las[name]) for name in las.names or () if name not in left_out])


@dataclass(frozen=True)
class Chosen:
    """A selection of records in the layout of :func:`held_layout`."""

    records: Records
    members: NDArray[np.uint32]

    def __len__(self) -> int:
        return len(self.members)

    @classmethod
    def all_of(cls, records: Records) -> Self:
        """All records."""
        return cls(records, np.arange(len(records), dtype=np.uint32))

    def gathered(self) -> Records:
        """A copy of the records, in order."""
        return gather_records(self.records, self.members, np.empty(len(self), self.records.dtype))


def rows_of(records: Records) -> NDArray[np.uint8]:
    """A view of the records' bytes (n, bytes of one)."""
    return records.view(np.uint8).reshape(len(records), records.dtype.itemsize)


def gather_records(source: Records, members: NDArray[np.uint32], target: Records) -> Records:
    """Fill `target` with the records `members` of `source`."""
    gather(*_words_of(source), members, *_words_of(target))
    return target


def _words_of(records: Records) -> tuple[NDArray[np.uint64], NDArray[np.uint64]]:
    """Views of the records' whole words (n, bytes of one // 8), and of the last eight bytes of each (n,)."""
    size = records.dtype.itemsize
    formats = [("<u8", (size // 8,)), "<u8"]
    words = {"names": ["whole", "last"], "formats": formats, "offsets": [0, size - 8], "itemsize": size}
    view = records.view(np.dtype(words))  # type: ignore[call-overload]  # words that overlap
    return view["whole"], view["last"]


def select_columns(parts: Sequence[Chosen], *, coloured: bool) -> ChunkColumns:
    """The points of at least one selection, in order; where records hold no colours, `coloured` points get zeros."""
    n = sum(map(len, parts))
    layout = parts[0].records.dtype
    names = layout.names or ()
    held = COLOUR[0] in names
    extra_bytes = sum(layout[name].itemsize for name in names[NUMBER_FIELDS + len(COLOUR) * held :])
    numbers = [np.empty(n, layout[name]) for name in names[:NUMBER_FIELDS]]
    extra = np.empty((extra_bytes, n), np.uint8)
    rgb = np.zeros((3, n), np.uint16) if coloured else None
    start = 0
    for part in parts:
        end = start + len(part)
        fields = tuple(part.records[name] for name in names[:NUMBER_FIELDS])
        extra_fields = rows_of(part.records)[:, layout.itemsize - extra_bytes :]
        columns = tuple(column[start:end] for column in numbers)
        take(fields, extra_fields, part.members, columns, extra[:, start:end])
        if rgb is not None and held:
            for column, name in zip(rgb, COLOUR, strict=True):
                column[start:end] = part.records[name][part.members]
        start = end
    x, y, z, intensity, returns, classification, point_source_id, gps_time = numbers
    return ChunkColumns(x, y, z, intensity, returns, classification, point_source_id, gps_time, rgb, extra)


def field_type(dtype: Any) -> Any:
    """The numba type of a record's field, which is not aligned."""
    return numba.types.Array(dtype, 1, "A", aligned=False)


@kernel(
    numba.void(
        numba.types.Array(numba.uint64, 2, "A", aligned=False),
        field_type(numba.uint64),
        numba.uint32[::1],
        numba.types.Array(numba.uint64, 2, "A", aligned=False),
        field_type(numba.uint64),
    )
)
def gather(source, source_last, members, target, target_last):  # type: ignore[no-untyped-def]
    """Kernel of :func:`gather_records`; eight bytes at once, as a loop over single bytes takes three times as long."""
    for i in range(len(members)):
        k = members[i]
        for j in range(source.shape[1]):
            target[i, j] = source[k, j]
        target_last[i] = source_last[k]


FIELD_TYPES: Final = (*(numba.int32,) * 3, numba.uint16, numba.uint8, numba.uint8, numba.uint16, numba.float64)


# Tuples without names, as numba converts arrays in these alone: the fields of a single record are contiguous.
@kernel(
    numba.void(
        numba.types.Tuple([*map(field_type, FIELD_TYPES)]),
        numba.uint8[:, :],
        numba.uint32[::1],
        numba.types.Tuple([numba.types.Array(dtype, 1, "C") for dtype in FIELD_TYPES]),
        numba.uint8[:, :],
    )
)
def take(fields, extras, members, columns, extra):  # type: ignore[no-untyped-def]
    """Kernel of :func:`select_columns`: copies fields of records into columns, both in the order of FIELD_TYPES."""
    xs, ys, zs, intensities, all_returns, classes, sources, times = fields
    x, y, z, intensity, returns, classification, source, time = columns
    for i in range(len(members)):
        k = members[i]
        x[i] = xs[k]
        y[i] = ys[k]
        z[i] = zs[k]
        intensity[i] = intensities[k]
        returns[i] = all_returns[k]
        classification[i] = classes[k]
        source[i] = sources[k]
        time[i] = times[k]
        for j in range(extra.shape[0]):
            extra[j, i] = extras[k, j]
